"""Choice of the closed form that fits a chain, and the chain as that form reads it.

All is found on the axes as lines at q = 0, so neither the frames nor a description's conventions
matter. Each form is tried forwards and, as T^-1 runs the joints the other way, backwards: a
spherical shoulder is a spherical wrist then. Seven joints are two spheres with an elbow (S-R-S), or
six with the first or the last held at a parameter.

An arm that misses a form by a little (calibration moves axes by a few millimetres) is read as the
nearest arm that has it; ``refine`` carries what comes out over to the true one.

Kernels read the form as a plan, an array of rows of 14 numbers. A frame in a row is laid out as in
``Chain.model``: one number, then the frame's upper three rows.
"""

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Literal, NamedTuple

import numpy as np

from kinematics.arrays import Array, frozen
from kinematics.frame import Frame
from kinematics.ik.closed_form.subproblem import EXACT, wrist_constants
from kinematics.model.chain import Chain, JointType
from kinematics.pose import inverse, rotation_x, transform

#: Kinds of closed forms, by the number in a plan.
SPHERICAL = 0
THREE_PARALLEL = 1
REDUNDANT = 2

# Columns of a plan's first row, ``plan[HEADER]``.
HEADER = 0
#: Which kind of form.
KIND = 0
#: 1 where the form reads the joints from the tip.
REVERSED = 1
#: Index of the joint that is held at the parameter, -1 for none.
HELD = 2
#: Number of joints of the chain that take part.
CHAIN_JOINTS = 3
#: 0 where axes 5 and 6 meet behind three parallel axes, which leaves an equation of q1 alone.
GENERAL = 4
#: How far the arm's axes are from the form [m or rad].
MISS = 5
#: Cosine of the turn that the offsets of joints 3 and 4 make about three parallel axes.
TURN_COSINE = 6
#: Sine of that turn.
TURN_SINE = 7

# Columns of the row of the form's joint j, ``plan[1 + j]``, around its offset.
#: 1, or -1 where the form counts the joint's angle the other way.
SIGN = 0
#: Index of the joint in the chain.
INDEX = 13

# Rows behind those of the joints.
#: The tip in the frame of the form's last joint.
TIP = 8
#: ``subproblem.wrist_constants`` of the last three joints.
WRIST = 9
#: The same of the first three joints of an arm with two spheres.
SHOULDER = 10
#: Type of the held joint, and its offset inverted.
LOCKED = 11
#: The tip in the frame of the joint before it, inverted.
LOCKED_TIP = 12
#: Rows in all.
ROWS = 13
#: Numbers in a row.
COLUMNS = 14

# Columns of a candidate, behind the cosines and sines of seven angles.
#: Its branch, in bits.
BRANCH = 14
#: Number of the family that it stands for, 0 where it is alone.
FAMILY = 15
#: Parameter of a redundant arm.
PARAMETER = 16
#: Numbers of a candidate.
WIDTH = 17


class Arm(NamedTuple):
    """A chain up to a link, with the closed form that it has or nearly has.

    Args:
        plan: The closed form, as ``structure`` packs it, shape (ROWS, COLUMNS).
        model: ``Chain.model``.
        link: Number of the link to bring to a pose.
        lower: Lower limits, shape (n,) [rad or m].
        upper: Upper limits, shape (n,) [rad or m].
    """

    plan: Array
    model: Array
    link: int
    lower: Array
    upper: Array


class Problem(NamedTuple):
    """A pose that the link of an arm is to be brought to.

    Args:
        arm: The arm.
        T: The pose T_base_link.
        seed: Configuration that whole turns and free angles are to be near, shape (n,).
        tolerance: Largest error of a solution [m], [rad].
    """

    arm: Arm
    T: Frame
    seed: Array
    tolerance: float


class CandidateTable(NamedTuple):
    """Candidates of a form for one pose, and what they are made from.

    Args:
        free: Angles to try where a pose leaves them free, that of the seed first, by the form's
            joints, shape (k, 6 or 7) [rad].
        slack: Lengths and squares out of range by no more than this are cut [m or m^2].
        rows: The candidates: cosine and sine of each angle by the form's joints, then the columns
            named above, shape (r, WIDTH).
    """

    free: Array
    slack: float
    rows: Array


Kind = Literal["spherical", "three_parallel", "redundant"]
Wrist = Literal["spherical", "three_parallel", "none"]
KINDS: tuple[Kind, ...] = ("spherical", "three_parallel", "redundant")
#: Numbers of the kinds in a plan.
_NUMBERS: dict[Kind, int] = {
    "spherical": SPHERICAL,
    "three_parallel": THREE_PARALLEL,
    "redundant": REDUNDANT,
}

#: Axes may miss a form by this much [m]; beyond, too many branches would come and go.
NEAR_LENGTH = 8e-3
#: Axes may miss a form by this angle [rad].
NEAR_ANGLE = 2e-2
#: Axes are called parallel or meeting within this [rad], [m]: published tables round angles to a
#: millionth of a radian and lengths to a hundredth of a millimetre.
PARALLEL_TOLERANCE = 1e-6
MEETING_TOLERANCE = 1e-5
#: Axes that must not be parallel are at least so far from it [rad].
_DISTINCT = 0.05
_FLIP = transform(rotation_x(np.pi))


@dataclass(frozen=True, slots=True, eq=False)
class Structure:
    """A closed form and the chain packed for it.

    Args:
        kind: Name of the form.
        reverse: Whether the form reads the joints from the tip.
        locked: Index of the joint that is held at the parameter; None where the parameter is the
            arm angle, or none is needed.
        joints: Number of joints of the chain that take part, from the first on.
        miss: Distance of the axes from the form [m or rad].
        plan: The arm for the kernels, columns as ``plan`` names them, shape (ROWS, COLUMNS).
    """

    kind: Kind
    reverse: bool
    locked: int | None
    joints: int
    miss: float
    plan: Array

    @property
    def redundant(self) -> bool:
        """Whether solutions have a parameter."""
        return self.locked is not None or self.kind == "redundant"


@lru_cache(maxsize=256)
def structure(chain: Chain, link: str | None = None) -> Structure | None:
    """The closed form that a chain has up to a link (the tip), or is nearest to; None for none."""
    carrier = chain.link(link or chain.tip_link)
    m = carrier.joint + 1
    if m not in {6, 7}:
        return None
    forms: list[Structure] = []
    for lock in (None,) if m == 6 else (None, 6, 0):
        forms += _forms(chain, carrier.T_joint_link, m, lock)
    # The first of those that fit exactly, else the nearest.
    return min(forms, key=lambda form: max(form.miss, EXACT), default=None)


def _forms(chain: Chain, T_joint_link: Array, m: int, lock: int | None) -> list[Structure]:
    used = [j for j in range(m) if j != lock]
    if (chain.joint_types[used] != JointType.REVOLUTE).any():
        return []
    offsets = chain.offsets
    F, T = [], np.eye(4)
    for j in used:
        T = T @ offsets[j]
        F.append(T)
    if lock is None or lock == 0:
        T = T @ T_joint_link
    frames, home = np.array(F), T
    if m == 7 and lock is None:
        form = _two_spheres(frames)
        # One that misses the form has it with its first or its last joint held.
        exact = form is not None and form.miss <= EXACT
        return [_pack("redundant", False, m, form, home, used)] if form and exact else []
    forms = []
    for reverse in (False, True):
        order = used[::-1] if reverse else used
        lines = inverse(home) @ frames[::-1] if reverse else frames
        end = inverse(home) if reverse else home
        for kind in KINDS[:2]:
            form = _wrist(lines) if kind == "spherical" else _parallels(lines)
            if form is not None:
                item = _pack(kind, reverse, m, form, end, order)
                forms.append(item if lock is None else _held(item, lock, chain, T_joint_link))
    return forms


@dataclass(frozen=True, slots=True, eq=False)
class _Form:
    """Home frames that have a form exactly, the sense of each axis, and how far they were moved."""

    frames: Array
    signs: Array
    miss: float
    special: bool = False


def _two_spheres(F: Array) -> _Form | None:
    S, miss_s = _meeting(F[:3])
    W, miss_w = _meeting(F[4:])
    distinct = all(_angle(F[i], F[i + 1]) > _DISTINCT for i in (0, 1, 2, 3, 4, 5))
    miss = max(miss_s, miss_w)
    if miss > NEAR_LENGTH or not distinct:
        return None
    frames = F.copy()
    frames[:3, :3, 3], frames[4:, :3, 3] = S, W
    return _Form(frames, np.ones(7), miss)


def _wrist(F: Array) -> _Form | None:
    W, miss = _meeting(F[3:])
    if miss > NEAR_LENGTH or _angle(F[3], F[4]) < _DISTINCT or _angle(F[4], F[5]) < _DISTINCT:
        return None
    frames = F.copy()
    frames[3:, :3, 3] = W
    return _Form(frames, np.ones(6), miss)


def _parallels(F: Array) -> _Form | None:
    z = F[1, :3, 2]
    same = F[1:4, :3, 2] * np.sign(F[1:4, :3, 2] @ z)[:, None]
    n = np.asarray(same.sum(axis=0) / np.linalg.norm(same.sum(axis=0)))
    miss = max(_tilt(F[i, :3, 2], n) for i in (1, 2, 3))
    apart = (_angle(F[0], F[1]), _angle(F[3], F[4]), _angle(F[4], F[5]))
    if miss > NEAR_ANGLE or min(apart) < _DISTINCT:
        return None
    frames, signs = F.copy(), np.ones(6)
    # Turn the axes onto one direction, by the smallest turn or half a turn and that.
    for i in (1, 2, 3):
        if frames[i, :3, 2] @ n < 0.0:
            frames[i] = frames[i] @ _FLIP
            signs[i] = -1.0
        x = frames[i, :3, 0] - (frames[i, :3, 0] @ n) * n
        x /= np.linalg.norm(x)
        frames[i, :3, :3] = np.column_stack([x, np.cross(n, x), n])
    point, gap = _meeting(F[4:])
    special = gap <= (1e-6 if miss <= EXACT else NEAR_LENGTH)
    if special:
        frames[4:, :3, 3] = point
        miss = max(miss, gap)
    return _Form(frames, signs, miss, special)


def _meeting(F: Array) -> tuple[Array, float]:
    """The point nearest to the z axes of frames, and its largest distance from one."""
    z, p = F[:, :3, 2], F[:, :3, 3]
    across = np.eye(3) - z[:, :, None] * z[:, None, :]
    point = np.linalg.lstsq(across.sum(0), np.einsum("kij,kj->i", across, p), rcond=1e-9)[0]
    away = np.einsum("kij,kj->ki", across, point - p)
    return point, float(np.linalg.norm(away, axis=1).max())


def _tilt(a: Array, b: Array) -> float:
    """Angle between two directions as lines."""
    sine = float(np.linalg.norm(np.cross(a, b)))
    return float(np.arctan2(sine, abs(float(a @ b))))


def _angle(A: Array, B: Array) -> float:
    return _tilt(A[:3, 2], B[:3, 2])


def _pack(
    kind: Kind,
    reverse: bool,
    m: int,
    form: _Form,
    home: Array,
    order: list[int],
) -> Structure:
    plan = np.zeros((ROWS, COLUMNS))
    k = len(order)
    header = plan[HEADER]
    header[KIND], header[REVERSED] = _NUMBERS[kind], float(reverse)
    header[HELD] = -1.0
    header[CHAIN_JOINTS], header[GENERAL] = m, 0.0 if form.special else 1.0
    header[MISS] = form.miss
    before = np.eye(4)
    offsets = []
    for j, (frame, sign, index) in enumerate(zip(form.frames, form.signs, order, strict=True)):
        offset = inverse(before) @ frame
        offsets.append(offset)
        plan[1 + j, SIGN] = -sign if reverse else sign
        plan[1 + j, 1:13] = offset[:3].flat
        plan[1 + j, INDEX] = index
        before = frame
    plan[TIP, 1:13] = (inverse(before) @ home)[:3].flat
    plan[WRIST, :4] = wrist_constants(offsets[k - 2][:3, :3], offsets[k - 1][:3, :3])
    if kind == "redundant":
        plan[SHOULDER, :4] = wrist_constants(offsets[1][:3, :3], offsets[2][:3, :3])
    if kind == "three_parallel":
        turn = offsets[2][:3, :3] @ offsets[3][:3, :3]
        header[TURN_COSINE], header[TURN_SINE] = turn[0, 0], turn[1, 0]
    return Structure(kind, reverse, None, m, form.miss, frozen(plan))


def _held(form: Structure, lock: int, chain: Chain, T_joint_link: Array) -> Structure:
    """The form with the held joint and the tip behind it in its plan."""
    plan = np.array(form.plan)
    plan[HEADER, HELD], plan[LOCKED, 0] = lock, chain.joint_types[lock]
    plan[LOCKED, 1:13] = inverse(chain.offsets[lock])[:3].flat
    plan[LOCKED_TIP, 1:13] = inverse(T_joint_link)[:3].flat
    return replace(form, locked=lock, plan=frozen(plan))


def classify_wrist(chain: Chain) -> Wrist:
    """Classify a chain by the axes that make its inverse kinematics solvable in closed form.

    Returns:
        "spherical" when the last three axes meet in one point; else "three_parallel" when any
        three consecutive axes are parallel; else "none". Only revolute joints count. Source: the
        sufficient conditions of "The kinematics of manipulators under computer control", 1968.
    """
    if chain.n >= 3 and _three_revolute(chain, chain.n - 3) and _has_spherical_wrist(chain):
        return "spherical"
    parallel = (
        _three_revolute(chain, i)
        and _parallel_axes(chain.offsets[i + 1])
        and _parallel_axes(chain.offsets[i + 2])
        for i in range(chain.n - 2)
    )
    return "three_parallel" if any(parallel) else "none"


def _three_revolute(chain: Chain, first: int) -> bool:
    """Whether three joints from ``first`` on are revolute."""
    return bool((chain.joint_types[first : first + 3] == JointType.REVOLUTE).all())


def _has_spherical_wrist(chain: Chain) -> bool:
    before = _crossing(inverse(chain.offsets[-2]))
    after = _crossing(chain.offsets[-1])
    return before is not None and after is not None and abs(before - after) <= MEETING_TOLERANCE


def _parallel_axes(A: Array) -> bool:
    return float(np.hypot(A[0, 2], A[1, 2])) <= PARALLEL_TOLERANCE


def _crossing(A: Array) -> float | None:
    """Place on z where the z axis of frame ``A`` (4, 4) meets it [m]; None where it doesn't."""
    if _parallel_axes(A):
        return None
    direction, point = A[:3, 2], A[:3, 3]
    across = direction[:2]
    along = -float(point[:2] @ across) / float(across @ across)
    nearest = point + along * direction
    return float(nearest[2]) if float(np.hypot(*nearest[:2])) <= MEETING_TOLERANCE else None
