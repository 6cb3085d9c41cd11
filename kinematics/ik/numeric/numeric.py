"""Inverse kinematics of any chain by damped least squares inside the joint limits, with restarts.

Each step solves (J^T J + lambda I) dq = J^T e over the joints that are free to move, with
e = [p_target - p; w log(R_target R^T)] and lambda = mu |e|^2, which vanishes with the error. A
joint at a limit that e pushes outwards is left out of the step; what is left over is clipped. A
start that gains too little is given up early: another one costs less than patience. Where to begin
again is looked up among random configurations whose frames are tabulated: the nearest of some of
them; now and then it is drawn afresh. Where only some axes count, e and J are seen from the
target's frame and the other rows are left out.
Sources: "Solvability-unconcerned inverse kinematics by the Levenberg-Marquardt method", IEEE
Transactions on Robotics, 2011 (the damping); restarts and their numbers are our own, tuned on
random poses of the built-in arms.
"""

import math
from collections.abc import Collection
from dataclasses import dataclass, field
from functools import cache, lru_cache
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from compiled.kernel import direct, directly
from kinematics.arrays import Array, contiguous, frozen
from kinematics.errors import InvalidOption, InvalidPose
from kinematics.forward import link_number
from kinematics.ik.batch import shared
from kinematics.ik.numeric.levenberg_marquardt import (
    ROWS,
    TABLE_SEED,
    WEIGHT,
    SearchSettings,
    SearchSpace,
    search_kernel,
    table_kernel,
)
from kinematics.ik.numeric.simd import solve_batch_kernel
from kinematics.ik.ranking import distance
from kinematics.ik.solution import IkResult, IkSolution
from kinematics.model.chain import Chain, JointType

Axis = Literal["x", "y", "z", "rx", "ry", "rz"]
AXES: tuple[Axis, ...] = get_args(Axis)
POSITION: tuple[Axis, ...] = ("x", "y", "z")

POSITION_TOLERANCE = 1e-6
ORIENTATION_TOLERANCE = 1e-6
#: Starts to spend before a pose is called out of reach: about 12 ms of them.
STARTS = 2000
#: Starts that are spent to find out whether at least the position can be reached.
_ADVICE_STARTS = 100
#: Solutions nearer than this in every joint [rad or m], whole turns left out, are one.
_SAME = 1e-3
_POSE = (4, 4)
_ROW, _TABLE = frozen([0.0]), frozen(np.zeros((1, 1)))
#: Arrays of the types that every chain has.
_SPACE = SearchSpace(_TABLE, 0, _TABLE, _ROW, 0.0)
#: Settings of the types that all have.
_SETTINGS = SearchSettings(_ROW, 0.0, 0.0, 0, 0)
#: Seeds are cut to 63 bits.
_MAX_SEED = 2**63 - 1


@dataclass(frozen=True, slots=True, eq=False)
class IkBatch:
    """Result of the numeric method for m poses.

    Args:
        joints: The nearest configuration to each, shape (m, n) [rad or m].
        position_error: Distance from the target [m], shape (m,).
        orientation_error: Angle to the target [rad], shape (m,).
        steps: Steps over all starts, shape (m,).
        solved: Whether the error is inside the tolerances, shape (m,).
    """

    joints: Array
    position_error: Array
    orientation_error: Array
    steps: Array
    solved: NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class SearchOptions:
    """Options of the numeric method.

    Args:
        seed: Seed of the random restarts; the same seed gives the same answer.
        starts: Start configurations to spend in all, on each pose.
        position_tolerance: Largest distance of a solution from its target [m].
        orientation_tolerance: Largest angle of a solution from its target [rad].
        axes: The axes of the target's frame that count: positions along x, y, z, turns about them
            rx, ry, rz. Without rz, say, the tool may turn about its own z.

    Also known: ``settings``, the same for the kernels.

    Raises:
        InvalidOption: A tolerance or the number of starts is not positive, or an axis unknown.
    """

    seed: int = 0
    starts: int = STARTS
    position_tolerance: float = POSITION_TOLERANCE
    orientation_tolerance: float = ORIENTATION_TOLERANCE
    axes: Collection[Axis] = AXES
    settings: SearchSettings = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if self.starts < 1:
            raise InvalidOption("starts must be 1 at least")
        if not (self.position_tolerance > 0.0 and self.orientation_tolerance > 0.0):
            raise InvalidOption("tolerances must be positive")
        object.__setattr__(self, "seed", self.seed & _MAX_SEED)
        settings = SearchSettings(
            _axis_weights(tuple(self.axes)), float(self.position_tolerance),
            float(self.orientation_tolerance), int(self.starts), int(self.seed),
        )  # fmt: skip
        object.__setattr__(self, "settings", settings)


def solve_many(
    chain: Chain,
    targets: ArrayLike,
    options: SearchOptions | None = None,
    *,
    link: str | None = None,
    seed_joints: ArrayLike | None = None,
    threads: int | None = None,
) -> IkBatch:
    """One configuration for each of many poses.

    Args:
        chain: The robot.
        targets: T_base_link, shape (m, 4, 4).
        options: Settings of the search, the same for each pose.
        link: The link to bring there; the tip where none is named.
        seed_joints: Configuration to start from, shape (n,) or (m, n); the middle of the limits
            where not given.
        threads: Number of threads, which changes nothing but the time; all the processors
            that this process may use where not given.

    Raises:
        InvalidRobotState: ``seed_joints`` has the wrong length or is not finite.
        InvalidLinkName: No such link.
        InvalidPose: A target is not a finite 4x4 matrix.
        InvalidOption: ``seed_joints`` has neither one row nor as many as there are poses.
    """
    T = contiguous(targets, "the targets")
    if T.ndim != 3 or T.shape[1:] != _POSE or not np.isfinite(T).all():
        raise InvalidPose("the targets must be finite 4x4 transforms, shape (m, 4, 4)")
    how = options or _default()
    space, middle = _prepared(chain, link)
    seeds = middle if seed_joints is None else chain.configuration(seed_joints, "seed_joints")
    m, n = T.shape[0], chain.n
    if seeds.ndim > 1 and seeds.shape[0] != m:
        raise InvalidOption(f"seed_joints must be one or {m}, as the poses are")
    begin = np.ascontiguousarray(np.broadcast_to(seeds, (m, n)))
    best, solved = np.empty((m, n + 4)), np.empty(m, dtype=np.int64)

    def part(k: slice) -> None:
        rows = T[k], begin[k], best[k], solved[k]
        directly(solve_batch_kernel, space, how.settings, *rows)

    shared(part, m, threads)
    return IkBatch(best[:, :n], best[:, n], best[:, n + 1], best[:, n + 2], solved == 1)


def solve(
    chain: Chain,
    target: ArrayLike,
    options: SearchOptions | None = None,
    *,
    link: str | None = None,
    seed_joints: ArrayLike | None = None,
    solutions: int = 1,
) -> IkResult:
    """Find up to ``solutions`` distinct configurations that bring a link to a pose.

    Args:
        chain: The robot.
        target: T_base_link, shape (4, 4).
        options: Settings of the search.
        link: The link to bring there; the tip where none is named.
        seed_joints: Configuration to start from, shape (n,); the middle of the limits where not
            given.
        solutions: Number of distinct solutions to search for.

    Returns:
        The solutions, nearest to ``seed_joints`` first, or the nearest attempt and advice.

    Raises:
        InvalidRobotState: ``seed_joints`` has the wrong length or is not finite.
        InvalidLinkName: No such link.
        InvalidPose: ``target`` is not a finite 4x4 matrix.
    """
    search = _direct_search()
    space, middle = _prepared(chain, link)
    T = contiguous(target, "the target")
    if T.shape != _POSE:
        raise InvalidPose("the target must be a finite 4x4 transform")
    begin = middle if seed_joints is None else contiguous(seed_joints, "seed_joints")
    if begin.ndim != 1:
        raise_start(chain, begin)
    how = options or _default()
    settings, starts = how.settings, how.starts
    distinct: list[IkSolution] = []
    nearest: IkSolution | None = None
    spent = 0
    while spent < starts and len(distinct) < solutions:
        best = np.empty(middle.shape)
        done, position, orientation, steps, spent = search(space, settings, T, spent, begin, best)
        if done < 0:
            raise_start(chain, begin)
            raise InvalidPose("the target must be a finite 4x4 transform")
        best.setflags(write=False)
        solution = IkSolution(best, position, orientation, steps)
        if solutions == 1 and done:
            return IkResult((solution,), solution, spent)
        if nearest is None or _error(solution) < _error(nearest):
            nearest = solution
        if done and all(distance(chain, best, other.joints) > _SAME for other in distinct):
            distinct.append(solution)
    assert nearest is not None
    distinct.sort(key=lambda solution: float(np.linalg.norm(solution.joints - begin)))
    advice = "" if distinct else _advice(chain, link, T, nearest, how.axes)
    return IkResult(tuple(distinct), nearest, spent, advice, found=len(distinct))


def raise_start(chain: Chain, begin: Array) -> None:
    """Say what is wrong with a start, if anything is.

    Raises:
        InvalidRobotState: The seed is not one finite number a joint.
    """
    if chain.configuration(begin, "seed_joints").ndim != 1:
        raise InvalidOption("seed_joints must be one configuration here, not several")


@lru_cache(maxsize=64)
def _prepared(chain: Chain, link: str | None) -> tuple[SearchSpace, Array]:
    """The arrays of a chain up to a link, and the middle of its limits."""
    number = int(chain.model[0, 1]) if link is None else link_number(chain, link)
    low, high = chain.sampling_bounds()
    radius = float(np.linalg.norm(chain.offsets[1:, :3, 3], axis=1).sum())
    radius += float(np.linalg.norm(chain.tip.T_joint_link[:3, 3]))
    radius += float((high - low)[chain.joint_types == JointType.PRISMATIC].sum())
    weight = WEIGHT * radius if radius > 0.0 else 1.0
    table = np.empty((chain.n + 12) * ROWS)
    table_kernel(chain.model, number, low, high, weight, TABLE_SEED, table)
    bounds = np.array([chain.limits.lower, chain.limits.upper, low, high])
    middle = frozen(0.5 * (low + high))
    return SearchSpace(chain.model, number, frozen(bounds), frozen(table), weight), middle


@lru_cache(maxsize=64)
def _axis_weights(axes: tuple[Axis, ...]) -> Array:
    """1 for each row of the error that counts, else 0, and whether some do not, shape (7,)."""
    check_axes(axes)
    rows = [float(axis in axes) for axis in AXES]
    return frozen([*rows, float(min(rows) == 0.0)])


def check_axes(axes: Collection[str]) -> None:
    """Refuse what are no axes of a target.

    Raises:
        InvalidOption: An axis is unknown, or there is none.
    """
    if not axes or not set(axes) <= set(AXES):
        raise InvalidOption(
            f"axes must be some of {', '.join(AXES)}, got {list(axes)}",
            hint='Those of the target\'s frame, without what may be free: ["x", "y", "z"], say.',
        )


@cache
def _default() -> SearchOptions:
    return SearchOptions()


@cache
def _direct_search() -> Any:
    """``search_kernel`` without dispatch, for arguments as ``solve`` has them."""
    row = np.zeros(1)
    return direct(search_kernel, _SPACE, _SETTINGS, np.zeros((4, 4)), 0, row, row)


def reach(chain: Chain, link: str | None = None) -> tuple[Array, float]:
    """A ball that no configuration takes the link's origin out of: centre (3,) [m], radius [m].

    Centred on the first joint; its radius is the sum of the fixed offsets and the longest slides.
    """
    carrier = chain.link(link or chain.tip_link)
    if carrier.joint < 0:
        return carrier.T_joint_link[:3, 3], 0.0
    radius = float(np.linalg.norm(carrier.T_joint_link[:3, 3]))
    for i in range(carrier.joint + 1):
        if i > 0:
            radius += float(np.linalg.norm(chain.offsets[i, :3, 3]))
        if chain.joint_types[i] == 1:
            radius += float(max(abs(chain.limits.lower[i]), abs(chain.limits.upper[i])))
    return chain.offsets[0, :3, 3], radius


def _error(solution: IkSolution) -> float:
    return math.hypot(solution.position_error, solution.orientation_error)


def _advice(
    chain: Chain, link: str | None, T: Array, nearest: IkSolution, axes: Collection[Axis]
) -> str:
    """Advice after a failed search."""
    center, radius = reach(chain, link)
    away = float(np.linalg.norm(T[:3, 3] - center))
    if away > radius:
        return (
            f"The target is {away:.3f} m from the first joint, {away - radius:.3f} m beyond the "
            f"longest the arm can reach ({radius:.3f} m). Bring it nearer."
        )
    if not set(axes) <= set(POSITION):
        alone = solve(chain, T, SearchOptions(starts=_ADVICE_STARTS, axes=POSITION), link=link)
        if alone.solutions:
            cure = "Turn the pose or move it."
            if chain.n < len(AXES):
                axes = list((*POSITION, "rz", "ry")[: chain.n])
                cure = (
                    f"An arm of {chain.n} joints has few there: name the axes of the pose that "
                    f'count, inverse kinematics takes "axes", say {axes}.'
                )
            return (
                "The position can be reached, but not in this orientation: the nearest attempt "
                f"is off by {nearest.orientation_error:.4f} rad and "
                f"{nearest.position_error:.4f} m. {cure}"
            )
        return (
            "The position can't be reached inside the joint limits in any orientation: the "
            f"nearest attempt stays {alone.nearest.position_error:.4f} m away."
        )
    return f"The nearest attempt inside the joint limits stays {nearest.position_error:.4f} m away."
