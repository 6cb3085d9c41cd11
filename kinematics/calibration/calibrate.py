"""Calibration of an arm from measurements of its tip.

Each joint's frame, the tip and the frame of measurement have a correction of six numbers, which
come behind (of the frame of measurement before) what the description says. All of them are found,
though measurements determine fewer: what they leave open stays as the tolerance of the arm's making
has it, and counts with that in the errors of the links between.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal, NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from kinematics.model.chain import Chain, JointType, Link

#: Numbers of a correction: a position [m] and a rotation vector [rad].
SIX = 6
NAMES = ("x", "y", "z", "rx", "ry", "rz")
#: What of the set-up is not known to the tolerance of the arm.
Unknown = Literal["frame", "tip"]
#: Tolerance of the numbers of a set-up that is not known [m or rad].
_OPEN = 10.0
#: Parts of the largest singular value that count as none, and of its tolerance that a standard
#: error of a parameter has that is determined.
_RANK, _DETERMINED = 1e-6, 0.5
#: Corrections of so many times their tolerance are refused.
_MOST = 10.0
#: The noise is found anew so often.
_ROUNDS = 3
#: Evaluations of a fit that no corrections can save.
_FEW = 10
#: Configurations and draws of parameters for margins, and the standard deviations that they are.
_CONFIGURATIONS, _DRAWS, _DEVIATIONS = 100, 100, 3.0


class Measured(NamedTuple):
    """Measurements of the tip, one kind of them, m rows.

    Args:
        poses: T_measurement_tip, shape (m, 4, 4).
        points: Positions of the tip, shape (m, 3) [m].
        distances: Distances of the tip from ``anchor``, shape (m,) [m].
        anchor: A point in the frame of measurement, shape (3,) [m].
        plane: Normal and offset of a plane n p = d that the tip touches, shape (4,) [m].
        noise: Standard deviations of positions [m] and of rotations [rad]; found if not given.
    """

    poses: Array | None = None
    points: Array | None = None
    distances: Array | None = None
    anchor: Array | None = None
    plane: Array | None = None
    noise: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """Corrections of an arm.

    Args:
        corrections: Of each joint's frame, the tip and the frame of measurement, (n + 2, 6).
        standard_errors: Their standard deviations, shape (n + 2, 6).
        covariance: Of all numbers, shape (6 (n + 2), 6 (n + 2)).
        determined: Whether measurements say more of a number than its tolerance, (n + 2, 6).
        identifiable: Number of combinations that measurements of this kind determine at all.
        noise: Standard deviations of positions [m] and rotations [rad] that are left.
        before: Root mean square of the errors of position before [m].
        after: The same after [m].
        robot: The calibrated robot.
        joints: The measured configurations, shape (m, n).
    """

    corrections: Array
    standard_errors: Array
    covariance: Array
    determined: NDArray[np.bool_]
    identifiable: int
    noise: tuple[float, float]
    before: float
    after: float
    robot: Chain
    joints: Array


def calibrate(
    chain: Chain,
    joints: ArrayLike,
    measured: Measured,
    *,
    link: str | None = None,
    unknown: Sequence[Unknown] = (),
    tolerance: tuple[float, float] = (1e-3, 1e-3),
) -> Calibration:
    """Find the corrections of an arm from measurements of a link.

    Args:
        chain: The robot as described.
        joints: Configurations, shape (m, n) [rad or m].
        measured: What was measured there.
        link: Link that is measured; the tip where none is named.
        unknown: "frame" where it is not known how the robot stands in the frame of measurement,
            "tip" where it is not known how the point measured is fixed to the link.
        tolerance: Standard deviations of the arm's making [m], [rad].

    Raises:
        InvalidLinkName: No such link.
        InvalidRobotState: Configurations have the wrong length or are not finite.
        InvalidOption: Measurements are malformed, of several kinds, or too few.
    """
    q = np.atleast_2d(chain.configuration(joints))
    _check(measured, len(q), tolerance)
    tip = chain.link(link or chain.tip_link)
    if not 0 <= tip.joint < chain.n:
        raise InvalidOption(f"no joint of the chain moves link {tip.name!r}")
    spread = np.tile(np.repeat(tolerance, 3), (chain.n + 2, 1))
    spread[chain.n, :] *= _OPEN / tolerance[0] if "tip" in unknown else 1.0
    spread[chain.n + 1] = _OPEN if "frame" in unknown else 1e-9
    start = np.zeros(spread.shape)
    if "frame" in unknown:
        start[-1] = _alignment(tip_poses(chain, tip, q, start), measured)
    rows = partial(_rows, chain, tip, q, measured)
    noise = measured.noise or (0.1 * tolerance[0], 0.1 * tolerance[1])
    before = _size(rows(start.ravel(), (1.0, 1.0)), len(q), measured)[0]
    # Without noise given, corrections that are not too large leave at least the rest: a fit ends
    # in the refusal below, and is cut short.
    is_hopeless = measured.noise is None and before > (
        _MOST * tolerance[0] + _moved_at_most(chain, tip, q, spread)
    )
    x = start.ravel()
    for _ in range(1 if measured.noise or is_hopeless else _ROUNDS):
        cost = partial(_cost, rows, noise, spread.ravel(), start.ravel())
        found = scipy.optimize.least_squares(
            cost, x, jac="3-point", x_scale=spread.ravel(), max_nfev=_FEW if is_hopeless else None
        )
        x = found.x
        full = np.asarray(found.jac)
        J = full[: len(full) - x.size] * spread.ravel()
        rank = int(np.sum(np.linalg.svd(J, compute_uv=False) > _RANK * np.linalg.norm(J, 2)))
        after = _size(rows(x, (1.0, 1.0)), len(q), measured)
        if not measured.noise:
            free = np.sqrt(max(1.0 - rank / len(J), 1.0 / len(J)))
            noise = (max(after[0] / free, 1e-9), max(after[1] / free, 1e-9))
    if len(J) <= rank:
        raise InvalidOption(
            f"{len(J)} measured numbers determine no more than themselves: {rank} are sought",
            hint="Measure at more configurations.",
        )
    largest = float(np.abs((x - start.ravel()) / spread.ravel()).max())
    unexplained = measured.noise is None and after[0] > _MOST * tolerance[0]
    if largest > _MOST or unexplained:
        raise InvalidOption(
            f"{before:.3g} m are between the measurements and this arm, {after[0]:.3g} m after "
            f"corrections of up to {largest:.3g} times the tolerance",
            hint="Look at units, the order of joints, the link and the frame measured, and "
            'whether "frame" or "tip" is unknown; or give a larger tolerance, or the noise.',
        )
    # Rows are in units of noise, which exact measurements have nearly none of.
    size = spread.ravel()
    inverse = size[:, None] * np.linalg.pinv(full * size, rcond=0.0)
    covariance = inverse @ inverse.T
    errors = np.sqrt(np.diag(covariance)).reshape(spread.shape)
    X = x.reshape(spread.shape)
    offsets = chain.offsets @ poses_of(X[: chain.n])
    robot = replace(chain, offsets=offsets, dh_convention=None)
    determined = errors < _DETERMINED * spread
    return Calibration(X, errors, covariance, determined, rank, noise, before, after[0], robot, q)


def poses_of(corrections: Array) -> Array:
    """Transforms (..., 4, 4) of corrections (..., 6)."""
    T = np.zeros((*corrections.shape[:-1], 4, 4))
    turned = scipy.spatial.transform.Rotation.from_rotvec(
        corrections[..., 3:].reshape(-1, 3)
    ).as_matrix()
    T[..., :3, :3] = turned.reshape(*corrections.shape[:-1], 3, 3)
    T[..., :3, 3] = corrections[..., :3]
    T[..., 3, 3] = 1.0
    return T


def with_corrections(chain: Chain, corrections: dict[str, Array]) -> Chain:
    """The chain with corrections (4, 4) behind the frames of joints, by their names.

    Raises:
        InvalidOption: A joint is unknown.
    """
    offsets = np.array(chain.offsets)
    for name, X in corrections.items():
        if name not in chain.joint_names:
            raise InvalidOption(
                f"robot {chain.name!r} has no joint {name!r} to be corrected",
                hint=f"Its joints are: {', '.join(chain.joint_names)}.",
            )
        i = chain.joint_names.index(name)
        offsets[i] = offsets[i] @ X
    return replace(chain, offsets=offsets, dh_convention=None)


def margins(chain: Chain, found: Calibration, reaches: Array) -> tuple[Array, Array]:
    """Margins of the bodies of a calibrated robot and of the one described, each (n,) [m].

    Three standard deviations of the farthest point of each body, in the worst of the measured and
    of a hundred other configurations; as described the distance to the calibrated robot is added.

    Args:
        chain: The robot as described.
        found: Its calibration.
        reaches: How far each body's solids reach from the origin of its joint's frame, (n,) [m].
    """
    rng = np.random.default_rng(0)
    q = np.concatenate([found.joints, rng.uniform(*chain.sampling_bounds(),
                                                  (_CONFIGURATIONS, chain.n))])  # fmt: skip
    own = SIX * chain.n
    squares, axes = np.linalg.eigh(found.covariance[:own, :own])
    root = axes * np.sqrt(np.maximum(squares, 0.0))
    best = found.corrections[: chain.n]
    at = _bodies(chain, q, best)
    square = np.zeros((len(q), chain.n))
    for drawn in rng.standard_normal((_DRAWS, own)):
        away = _bodies(chain, q, best + (root @ drawn).reshape(best.shape))
        square += _moved(at, away, reaches) ** 2 / _DRAWS
    sure = _DEVIATIONS * np.sqrt(square.max(axis=0))
    return sure, sure + _moved(at, _bodies(chain, q, 0.0 * best), reaches).max(axis=0)


def _moved(a: Array, b: Array, reaches: Array) -> Array:
    """How far bodies are apart at their farthest, shape (m, n)."""
    turned = np.linalg.norm(a[..., :3, :3] - b[..., :3, :3], axis=(-2, -1)) / np.sqrt(2.0)
    return np.asarray(np.linalg.norm(a[..., :3, 3] - b[..., :3, 3], axis=-1) + reaches * turned)


def _bodies(chain: Chain, q: Array, corrections: Array) -> Array:
    """Frames of the joints, shape (m, n, 4, 4)."""
    T = np.broadcast_to(np.eye(4), (len(q), 4, 4))
    frames = []
    for A, kind, at in zip(
        chain.offsets @ poses_of(corrections), chain.joint_types, q.T, strict=True
    ):
        move = np.zeros((len(q), SIX))
        move[:, 5 if kind == JointType.REVOLUTE else 2] = at
        T = T @ A @ poses_of(move)
        frames.append(T)
    return np.stack(frames, axis=1)


def tip_poses(chain: Chain, tip: Link, q: Array, X: Array) -> Array:
    """Poses of a tip in the frame of measurement, shape (m, 4, 4), of corrections (n + 2, 6)."""
    frames = _bodies(chain, q, X[: chain.n])[:, tip.joint]
    return np.asarray(poses_of(X[-1]) @ frames @ tip.T_joint_link @ poses_of(X[chain.n]))


def _rows(
    chain: Chain,
    tip: Link,
    q: Array,
    measured: Measured,
    x: Array,
    noise: tuple[float, float],
) -> Array:
    """Differences from measurements in units of their noise: positions, then rotations."""
    T = tip_poses(chain, tip, q, x.reshape(-1, SIX))
    p = T[:, :3, 3]
    if measured.poses is not None:
        turned = np.swapaxes(measured.poses[:, :3, :3], 1, 2) @ T[:, :3, :3]
        angles = scipy.spatial.transform.Rotation.from_matrix(turned).as_rotvec()
        off = (p - measured.poses[:, :3, 3]) / noise[0]
        return np.concatenate([off.ravel(), angles.ravel() / noise[1]])
    if measured.points is not None:
        return np.asarray((p - measured.points).ravel() / noise[0])
    if measured.distances is not None:
        assert measured.anchor is not None
        away = np.linalg.norm(p - measured.anchor, axis=1)
        return np.asarray((away - measured.distances) / noise[0])
    assert measured.plane is not None
    return np.asarray((p @ measured.plane[:3] - measured.plane[3]) / noise[0])


def _cost(
    rows: partial[Array], noise: tuple[float, float], spread: Array, start: Array, x: Array
) -> Array:
    return np.concatenate([rows(x, noise), (x - start) / spread])


def _size(rows: Array, count: int, measured: Measured) -> tuple[float, float]:
    """Root mean squares of a number of position and of rotation."""
    rest = rows if measured.poses is None else rows[: 3 * count]
    turned = rows[3 * count :] if measured.poses is not None else np.zeros(1)
    return float(np.sqrt(np.mean(rest**2))), float(np.sqrt(np.mean(turned**2)))


def _moved_at_most(chain: Chain, tip: Link, q: Array, spread: Array) -> float:
    """How far a tip moves at most by corrections that are not refused as too large [m].

    Each turns it about its own frame, and no frame is farther from it than all links are long.
    """
    shift, turn = np.sqrt(3.0) * _MOST * spread[:, [0, 3]].sum(axis=0)
    slides = q[:, np.equal(chain.joint_types, JointType.PRISMATIC)]
    links = np.vstack([chain.offsets[:, :3, 3], tip.T_joint_link[:3, 3]])
    reach = np.linalg.norm(links, axis=1).sum() + np.abs(slides).sum(axis=1).max() + shift
    return float(shift + turn * reach)


def _alignment(T: Array, measured: Measured) -> Array:
    """The correction of the frame of measurement that brings points onto those measured, (6,)."""
    target = measured.points if measured.poses is None else measured.poses[:, :3, 3]
    if target is None:
        return np.zeros(SIX)
    p = T[:, :3, 3]
    turn, _ = scipy.spatial.transform.Rotation.align_vectors(
        target - target.mean(axis=0), p - p.mean(axis=0)
    )
    return np.concatenate([target.mean(axis=0) - turn.apply(p.mean(axis=0)), turn.as_rotvec()])


def _check(measured: Measured, count: int, tolerance: tuple[float, float]) -> None:
    kinds = (measured.poses, measured.points, measured.distances, measured.plane)
    if sum(kind is not None for kind in kinds) != 1:
        raise InvalidOption("measurements are of one kind: poses, points, distances or a plane")
    if (measured.distances is None) != (measured.anchor is None):
        raise InvalidOption("distances need the anchor that they are from")
    numbers = [np.asarray(kind) for kind in kinds[:3] if kind is not None]
    if any(len(rows) != count or not np.isfinite(rows).all() for rows in numbers):
        raise InvalidOption(
            f"there are {count} configurations and {len(numbers[0])} measurements",
            hint="Give one finite measurement for each configuration.",
        )
    if measured.plane is not None and abs(np.linalg.norm(measured.plane[:3]) - 1.0) > 1e-6:
        raise InvalidOption("the normal of a plane is not of length 1")
    if not min(tolerance) > 0.0:
        raise InvalidOption(f"the tolerance is {tolerance}", hint="Give two positive numbers.")
