"""Reach of an arm in a scene, for many task poses at once: on a grid, within tolerances."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from enum import IntEnum
from itertools import product
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from compiled.kernel import directly
from kinematics.arrays import Array, frozen, numbers, typed
from kinematics.errors import InvalidOption, InvalidPose
from kinematics.forward import link_number
from kinematics.ik.batch import shared
from kinematics.ik.closed_form.analytic import TOLERANCE, middle
from kinematics.ik.closed_form.refine import INSIDE, MORE
from kinematics.ik.closed_form.structure import COLUMNS as PLAN_COLUMNS
from kinematics.ik.closed_form.structure import Arm, Structure, structure
from kinematics.ik.numeric import numeric
from kinematics.model.chain import Chain
from kinematics.pose import inverse
from obstacles.collision.fcl_distance import OverlapMeter, overlap_meter
from obstacles.collision.model.collision_model import CollisionModel, ModelArrays
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene
from planning.reach import assessment
from planning.reach import turns as kernel
from planning.values.deadline import Deadline

Axis = Literal["x", "y", "z", "rx", "ry", "rz"]
AXES: tuple[Axis, ...] = get_args(Axis)


@dataclass(frozen=True, slots=True)
class Tolerance:
    """Ranges of deviation in a pose's own frame, sampled on a grid.

    The tool's pose is T_pose Trans(x, y, z) Rx(rx) Ry(ry) Rz(rz).

    Args:
        ranges: Least and largest deviation by axis [m, rad]; axes left out are exact. A range of a
            rotation that spans a full turn means a free axis.
        samples: Values tried on each of these axes.

    Raises:
        InvalidOption: A range is empty, a rotation spans more than a turn, or there are too many
            deviations.
    """

    ranges: Mapping[Axis, tuple[float, float]] = field(default_factory=dict)
    samples: int = 12

    def __post_init__(self) -> None:
        for axis, (low, high) in self.ranges.items():
            if not low <= high:
                raise InvalidOption(f"tolerance of {axis}: {low:g} is above {high:g}")
            if axis.startswith("r") and high - low > 2.0 * math.pi + 1e-9:
                raise InvalidOption(
                    f"tolerance of {axis} spans {high - low:g} rad, more than a turn",
                    hint="Name the axis in free where any angle will do.",
                )
        count = math.prod(len(self._values(axis)) for axis in AXES)
        # The most deviations that one pose is tried at.
        max_samples = 1_000
        if count > max_samples:
            raise InvalidOption(
                f"the tolerance has {count} deviations of each pose, at most {max_samples} "
                "are tried",
                hint="Ask for fewer samples, or for fewer axes.",
            )

    @classmethod
    def free(cls, *axes: Axis, samples: int = 12) -> "Tolerance":
        """Rotations about axes by any angle."""
        return cls(dict.fromkeys(axes, (-math.pi, math.pi)), samples)

    def deviations(self) -> Array:
        """T_pose_tool of each deviation, the least first, shape (s, 4, 4)."""
        grid = np.array(list(product(*(self._values(axis) for axis in AXES))))
        grid = grid[np.argsort(np.abs(grid).sum(axis=1), kind="stable")]
        T = np.tile(np.eye(4), (len(grid), 1, 1))
        T[:, :3, 3] = grid[:, :3]
        for column in range(3):
            T[:, :3, :3] = T[:, :3, :3] @ _rotations(column, grid[:, 3 + column])
        return T

    def _values(self, axis: Axis) -> Array:
        low, high = self.ranges.get(axis, (0.0, 0.0))
        if low == high:
            return np.array([low])
        if axis.startswith("r") and high - low > 2.0 * math.pi - 1e-9:
            # Both ends are the same angle; the pose's own is among them.
            return np.asarray(np.arange(self.samples) * 2.0 * np.pi / self.samples)
        return np.linspace(low, high, max(self.samples, 2))


def _rotations(axis: int, angles: Array) -> Array:
    """Rotations about a coordinate axis (0, 1, 2) by angles, shape (s, 3, 3)."""
    c, s = np.cos(angles), np.sin(angles)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    R = np.zeros((len(angles), 3, 3))
    R[:, axis, axis] = 1.0
    R[:, i, i], R[:, j, j], R[:, j, i], R[:, i, j] = c, c, s, -s
    return R


@dataclass(frozen=True, slots=True, eq=False)
class PoseGrid:
    """Points of a grid in a box, each with the same orientations.

    Args:
        size: Lengths of the box's edges, shape (3,) [m]; 0 for a plane or a line.
        spacing: Largest distance of neighbouring points along an edge [m].
        T_base_box: Pose of the box's centre, shape (4, 4).
        rotations: R_base_tool of the orientations, shape (o, 3, 3).

    Raises:
        InvalidOption: The spacing is not positive, an edge is negative or there are too many poses.
    """

    size: Array
    spacing: float
    T_base_box: Array
    rotations: Array

    def __post_init__(self) -> None:
        shapes = {"size": (3,), "T_base_box": (4, 4), "rotations": (-1, 3, 3)}
        for name, shape in shapes.items():
            object.__setattr__(self, name, frozen(numbers(getattr(self, name), name, shape)))
        if not 0.0 < self.spacing < np.inf:
            raise InvalidOption(f"spacing is {self.spacing:g} m; it must be positive")
        if min(self.size) < 0.0:
            raise InvalidOption(f"size is {list(self.size)} m; no edge may be negative")
        count = int(np.prod([float(k) for k in self.shape]))
        # The most poses of one grid.
        max_poses = 1_000_000
        if count > max_poses:
            raise InvalidOption(
                f"the grid has {count} poses, at most {max_poses} are looked at",
                hint="Take a wider spacing or fewer orientations.",
            )

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """Numbers of points along x, y and z and of orientations."""
        x, y, z = (int(min(np.ceil(edge / self.spacing - 1e-9), 1e9)) + 1 for edge in self.size)
        return x, y, z, len(self.rotations)

    def axes(self) -> tuple[Array, Array, Array]:
        """Coordinates of the points along the box's axes, from its centre [m]."""
        x, y, z = (
            np.linspace(-0.5 * edge, 0.5 * edge, count) if count > 1 else np.zeros(1)
            for edge, count in zip(self.size, self.shape[:3], strict=True)
        )
        return x, y, z

    def points(self) -> Array:
        """The points in the base frame, shape (x y z, 3), z changes fastest [m]."""
        p_box = np.stack(np.meshgrid(*self.axes(), indexing="ij"), axis=-1).reshape(-1, 3)
        return np.asarray(p_box @ self.T_base_box[:3, :3].T + self.T_base_box[:3, 3])

    def poses(self) -> Array:
        """T_base_tool, orientations change fastest, shape (x y z o, 4, 4)."""
        points, o = self.points(), len(self.rotations)
        T = np.tile(np.eye(4), (len(points) * o, 1, 1))
        T[:, :3, 3] = np.repeat(points, o, axis=0)
        T[:, :3, :3] = np.tile(self.rotations, (len(points), 1, 1))
        return T


Choice = Literal["manipulability", "clearance", "limits", "first"]
CHOICES: tuple[Choice, ...] = get_args(Choice)
#: Levels of values of a redundant arm's parameter: 16, 32, 64, ... values in all; and how many more
#: than the first are tried where none of them has a branch.
_LEVELS, _LEVELS_OUT_OF_REACH = 7, 2


class Status(IntEnum):
    """Outcome of a pose; each one came nearer than those before."""

    OUT_OF_REACH = assessment.OUT_OF_REACH
    OUTSIDE_LIMITS = assessment.OUTSIDE_LIMITS
    IN_COLLISION = assessment.IN_COLLISION
    REACHED = assessment.REACHED


@dataclass(frozen=True, slots=True)
class ReachOptions:
    """Options of a question about reach.

    Args:
        tolerance: Deviations that the tool may have from each pose.
        margin: Distance to be kept from obstacles [m].
        choice: Measure of the best configuration of a pose: the largest product of the Jacobian's
            singular values, the largest clearance, or the largest distance from the joint limits.
            With ``first`` the first one that is found free will do, which is quickest.
        clearance: Whether the clearance of the best configurations is measured.
        seed: Seed of the numeric search, for arms without a closed form.
        threads: How many to share the poses among; all processors where not given.

    Raises:
        InvalidOption: No such choice, or a negative margin.
    """

    tolerance: Tolerance = field(default_factory=Tolerance)
    margin: float = 0.0
    choice: Choice = "manipulability"
    clearance: bool = True
    seed: int = 0
    threads: int | None = None

    def __post_init__(self) -> None:
        if self.choice not in CHOICES:
            raise InvalidOption(
                f"there is no choice {self.choice!r}", hint=f"One of: {', '.join(CHOICES)}."
            )
        if not self.margin >= 0.0:
            raise InvalidOption(f"margin is {self.margin:g} m; it must not be negative")


class Reach(NamedTuple):
    """Reach of m poses; figures are those of the best configuration, NaN where there is none.

    Args:
        status: `Status` of each pose, shape (m,).
        branches: Branches of the inverse kinematics that are free of collision, at the deviation
            that has most of them; of arms without a closed form, and where the first one will do,
            1 where one was found. Shape (m,).
        samples: Deviations at which the pose is reached, 1 where the first one will do, shape (m,).
        joints: Best configuration, shape (m, n) [rad or m].
        manipulability: Product of the singular values of the Jacobian, shape (m,).
        clearance: Distance of the closest pair, margins taken off [m], infinite where nothing can
            collide, NaN where it was not asked for, shape (m,).
        limit_distance: Share of half its range that is left to the joint nearest to a limit, 1 at
            the middle of all ranges, shape (m,).
        completed: How many poses were checked before the deadline; the others are left out.
    """

    status: NDArray[np.int64]
    branches: NDArray[np.int64]
    samples: NDArray[np.int64]
    joints: Array
    manipulability: Array
    clearance: Array
    limit_distance: Array
    completed: int

    @property
    def is_reached(self) -> NDArray[np.bool_]:
        """Whether each pose is reached free of collision and inside the limits."""
        return np.asarray(self.status == Status.REACHED)


@dataclass(frozen=True, slots=True, eq=False)
class _Query:
    """An arm in a scene with all that does not hang on the poses."""

    chain: Chain
    link: str | None
    arm: Arm
    form: Structure | None
    parts: assessment.Parts
    settings: assessment.ReachSettings
    options: ReachOptions


@typed
def reach(
    robot: RobotGeometry,
    scene: Scene,
    poses: ArrayLike,
    options: ReachOptions | None = None,
    *,
    link: str | None = None,
    deadline: Deadline | None = None,
    report: Callable[[float], None] = lambda _: None,
) -> Reach:
    """For each task pose whether and how well the arm takes it, free of collision.

    Every configuration is verified by forward kinematics and by the exact collision check. Arms
    with a closed form try every branch; of arms with seven joints at 16 values of the parameter,
    and where none of these reaches a pose at up to a thousand. Other arms search from several
    starts, so that a pose they miss may have a solution. Contacts
    that may be only so deep are measured in the best configuration of each pose alone.

    Args:
        robot: The arm with its solids.
        scene: The obstacles.
        poses: T_base_link, shape (m, 4, 4).
        options: How to judge.
        link: The link to bring there; the tip where none is named.
        deadline: Time at which to stop; the poses that are left are not answered.
        report: Called with the share of the poses that is done.

    Raises:
        InvalidPose: The poses are not finite 4x4 matrices.
        InvalidLinkName: No such link.
    """
    how, chain = options or ReachOptions(), robot.chain
    T = np.ascontiguousarray(poses, dtype=np.float64)
    if T.ndim != 3 or T.shape[1:] != (4, 4) or not np.isfinite(T).all():
        raise InvalidPose("the poses must be finite 4x4 transforms, shape (m, 4, 4)")
    deviations = how.tolerance.deviations()
    query = _query(robot, scene, link, how, deviations)
    results = np.zeros((len(T), assessment.COLUMNS))
    joints = np.full((len(T), chain.n), np.nan)
    # Poses with all their deviations that are worked off between two checks the clock.
    redundant, values = query.form is not None and query.form.redundant, np.array([np.nan])
    if query.form is not None and redundant:
        values = parameter_values(chain, query.form)
    step, completed = max((200 if redundant else 2_000) // len(deviations), 1), 0
    while completed < len(T) and not (deadline is not None and deadline.passed):
        part = slice(completed, min(completed + step, len(T)))
        targets = T[part, None] @ deviations
        if query.form is not None:
            _by_closed_form(query, targets, results[part], joints[part], values)
            if redundant:
                _by_more_values(query, targets, results[part], joints[part])
        else:
            _by_search(query, targets, results[part], joints[part])
        _leave_out_deep(overlap_meter(robot, scene), results[part], joints[part])
        completed = part.stop
        report(completed / len(T))
    return _answer(results[:completed], joints[:completed], how)


def _leave_out_deep(meter: OverlapMeter, results: Array, joints: Array) -> None:
    """Take poses as in collision whose best configuration has allowed contacts that are too deep.

    Args:
        meter: Meter of the pairs that may touch.
        results: Results of the poses, shape (k, columns).
        joints: Best configurations, shape (k, n).
    """
    if not meter.limited:
        return
    for k in np.flatnonzero(results[:, assessment.Column.STATUS] == Status.REACHED):
        if meter.too_deep(joints[k]):
            results[k, assessment.Column.STATUS] = Status.IN_COLLISION
            results[k, [assessment.Column.BRANCHES, assessment.Column.SAMPLES]] = 0.0
            joints[k] = np.nan


def _query(
    robot: RobotGeometry, scene: Scene, link: str | None, options: ReachOptions, deviations: Array
) -> _Query:
    chain = robot.chain
    form = structure(chain, link)
    plan = np.zeros((1, PLAN_COLUMNS)) if form is None else form.plan
    lower, upper = chain.limits.lower, chain.limits.upper
    arm = Arm(plan, chain.model, link_number(chain, link or chain.tip_link), lower, upper)
    model = CollisionModel(robot, scene, options.margin).arrays
    turns = np.zeros(0) if form is None else _last_turns(arm, form, deviations)
    settings = assessment.ReachSettings(
        TOLERANCE,
        0.0,
        CHOICES.index(options.choice),
        bool(options.clearance),
        form is not None and bool(form.redundant),
    )
    return _Query(chain, link, arm, form, _parts(model, chain.n - 1, turns), settings, options)


def _last_turns(arm: Arm, form: Structure, deviations: Array) -> Array:
    """By how much deviations (s, 4, 4) turn the last joint [rad], (0,) where they do more."""
    last = len(arm.lower) - 1
    row = arm.model[last + 2 + arm.link]
    if arm.model[0, 2] > 0.0:  # bodies off the chain may turn with the last joint too
        return np.zeros(0)
    if len(deviations) == 1 or int(row[0]) != last or arm.model[last + 1, 0] != 0.0:
        return np.zeros(0)
    if form.locked == last:  # then its angle is the parameter of the closed form
        return np.zeros(0)
    T_joint_link = np.vstack([row[1:13].reshape(3, 4), [0.0, 0.0, 0.0, 1.0]])
    M = T_joint_link @ (inverse(deviations[0]) @ deviations) @ inverse(T_joint_link)
    tilt, shift = np.abs(M[:, :3, 2] - [0.0, 0.0, 1.0]).max(), np.abs(M[:, :3, 3]).max()
    # How far from the last joint's axis one may turn about another and still turn that joint [m,
    # rad].
    if max(tilt, shift) > 1e-10:
        return np.zeros(0)
    return np.asarray(np.arctan2(M[:, 1, 0], M[:, 0, 0]))


def _parts(model: ModelArrays, last: int, turns: Array) -> assessment.Parts:
    """A packed robot and scene, whole and parted at joint number ``last``."""
    if not len(turns):
        return assessment.Parts(model, model, model, turns)
    moves = model.joints == last
    body, group = moves[model.bodies[:, 0]], moves[model.groups[:, 2:]].any(axis=1)
    before, behind = (
        model._replace(bodies=model.bodies[body == k], groups=model.groups[group == k])
        for k in (False, True)
    )
    return assessment.Parts(model, before, behind, turns)


def _by_closed_form(
    query: _Query, targets: Array, results: Array, joints: Array, values: Array
) -> None:
    """Reach of a few poses with all their deviations (m, s, 4, 4), by every branch at values."""
    seed = middle(query.chain)

    def part(k: slice) -> None:
        directly(
            kernel.closed_form_reach_kernel,
            query.arm,
            query.parts,
            targets[k],
            seed,
            values,
            query.settings,
            results[k],
            joints[k],
        )

    shared(part, len(targets), query.options.threads)


def _by_more_values(query: _Query, targets: Array, results: Array, joints: Array) -> None:
    """Reach of poses of a redundant arm that no value of its parameter reaches yet, by more values.

    Bodies behind the last joint stand where the pose has them, whatever the value: where these
    collide with the scene, no other value helps. Where no value has a branch at all, fewer are
    tried.
    """
    assert query.form is not None
    status = results[:, assessment.Column.STATUS]
    left = np.flatnonzero(status != Status.REACHED)
    carried = _with_scene_alone(query)
    struck = left[status[left] == Status.IN_COLLISION]
    if carried is not None and len(struck):
        tried, room = np.zeros((len(struck), assessment.COLUMNS)), joints[struck]
        values = parameter_values(query.chain, query.form)
        _by_closed_form(carried, targets[struck], tried, room, values)
        left = np.setdiff1d(left, struck[tried[:, assessment.Column.STATUS] != Status.REACHED])
    for level in range(1, _LEVELS):
        values = parameter_values(query.chain, query.form, level)
        # Branches of many values at once are compared with each other.
        parts = max(len(values) // 64, 1)
        for part in range(parts):
            if level > _LEVELS_OUT_OF_REACH:
                left = left[status[left] != Status.OUT_OF_REACH]
            if not len(left):
                return
            tried, found = np.zeros((len(left), assessment.COLUMNS)), joints[left]
            _by_closed_form(query, targets[left], tried, found, values[part::parts].copy())
            better = tried[:, assessment.Column.STATUS] > status[left]
            results[left[better]], joints[left[better]] = tried[better], found[better]
            left = left[status[left] != Status.REACHED]


def _with_scene_alone(query: _Query) -> _Query | None:
    """The question with the bodies behind the last joint and the scene; None where they may move.

    They may where the link is not rigidly behind the last joint.
    """
    arm, last = query.arm, query.chain.n - 1
    if int(arm.model[last + 2 + arm.link][0]) != last or arm.model[0, 2] > 0.0:
        return None
    model = query.parts.whole
    bodies = model.bodies[model.joints[model.bodies[:, 0]] == last]
    alone = model._replace(bodies=bodies, groups=model.groups[:0])
    settings = query.settings._replace(choice=CHOICES.index("first"), clearance=False)
    return replace(query, parts=_parts(alone, last, np.zeros(0)), settings=settings)


def _by_search(query: _Query, targets: Array, results: Array, joints: Array) -> None:
    """Reach of a few poses with all their deviations (m, s, 4, 4), by the numeric method."""
    m, s = targets.shape[:2]
    flat = np.ascontiguousarray(targets.reshape(-1, 4, 4))
    # Rounds of the numeric search, each from other starts.
    rounds = 4
    rows = np.zeros((m, s * rounds, query.chain.n + MORE))
    for k in range(rounds):
        # Starts of each round.
        found = numeric.solve_many(
            query.chain,
            flat,
            numeric.SearchOptions(query.options.seed + k, 30),
            link=query.link,
            seed_joints=_start(query.chain, query.options.seed + k),
            threads=query.options.threads,
        )
        part = rows[:, k * s : (k + 1) * s]
        part[..., : query.chain.n] = found.joints.reshape(m, s, -1)
        part[..., query.chain.n + INSIDE] = found.solved.reshape(m, s)

    def share(k: slice) -> None:
        directly(
            kernel.searched_reach_kernel,
            query.arm,
            query.parts.whole,
            rows[k],
            query.settings,
            results[k],
            joints[k],
        )

    shared(share, m, query.options.threads)
    # Several rounds find the same configuration: only whether there is one is known.
    results[:, assessment.Column.BRANCHES] = np.minimum(results[:, assessment.Column.BRANCHES], 1.0)
    solved = rows[..., query.chain.n + INSIDE].reshape(m, rounds, s)
    results[:, assessment.Column.SAMPLES] = np.minimum(
        results[:, assessment.Column.SAMPLES], solved.any(axis=1).sum(1)
    )


def _start(chain: Chain, seed: int) -> Array:
    """A configuration that a round of the search begins at, the middle of the limits first."""
    if seed == 0:
        return middle(chain)
    low, high = chain.sampling_bounds()
    return np.asarray(np.random.default_rng(seed).uniform(low, high))


def parameter_values(chain: Chain, form: Structure, level: int = 0) -> Array:
    """Values of a redundant arm's parameter, all around it, shape (v,) [rad or m].

    Args:
        chain: The arm.
        form: Its closed form.
        level: 0 for the first 16 values; k for those in the middles of 8 * 2^k equal parts.
    """
    count = 16 << max(level - 1, 0)
    shares = (np.arange(count) + (0.5 if level else 0.0)) / count
    if form.locked is None:
        return np.asarray(shares * 2.0 * np.pi - np.pi)
    low, high = chain.sampling_bounds()
    ends = (count - 1) if level == 0 else count
    return np.asarray(low[form.locked] + (high - low)[form.locked] * shares * count / ends)


def _answer(results: Array, joints: Array, options: ReachOptions) -> Reach:
    status = results[:, assessment.Column.STATUS].astype(np.int64)
    missed = status != Status.REACHED
    figures = results.copy()
    figures[missed] = np.nan
    clearance = figures[:, assessment.Column.CLEARANCE]
    if not options.clearance:
        clearance = np.full(len(results), np.nan)
    return Reach(
        status,
        results[:, assessment.Column.BRANCHES].astype(np.int64),
        results[:, assessment.Column.SAMPLES].astype(np.int64),
        joints,
        figures[:, assessment.Column.MANIPULABILITY],
        clearance,
        figures[:, assessment.Column.LIMIT_DISTANCE],
        len(results),
    )
