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
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Any, Literal, NoReturn, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinematics.chain import Array, Chain, Indices, JointType, frozen
from kinematics.errors import InvalidOption, InvalidPose
from kinematics.forward import (
    IDENTITY,
    Frame,
    compose_kernel,
    finite_kernel,
    link_number,
    move_kernel,
)
from kinematics.ik.batch import shared
from kinematics.ik.solution import IkResult, IkSolution
from kinematics.ik.step import (
    State,
    error_kernel,
    frame_kernel,
    step_within_kernel,
    uniform_kernel,
)
from kinematics.jacobian import frame_and_jacobian_kernel
from kinematics.kernel import direct, kernel
from kinematics.turns import turns_kernel

Axis = Literal["x", "y", "z", "rx", "ry", "rz"]
AXES: tuple[Axis, ...] = get_args(Axis)
POSITION: tuple[Axis, ...] = ("x", "y", "z")

POSITION_TOLERANCE = 1e-6
ORIENTATION_TOLERANCE = 1e-6
#: Starts to spend before a pose is called out of reach: about 12 ms of them.
STARTS = 2000
#: Steps from one start; most that converge at all do so in a quarter of it.
_STEPS = 60
#: A start is given up after so many steps in a row without this factor of the squared error; one
#: in so many starts is given more, for poses near singularities.
_PATIENCE, _GAIN = 1, 0.7
_LONG, _LONG_PATIENCE, _LONG_GAIN = 5, 8, 0.9
#: mu at the start and what a good or bad step makes of it.
_DAMPING, _LESS, _MORE = 0.1, 0.7, 6.0
_LEAST_MU, _LEAST_DAMPING = 1e-7, 1e-13
#: Random draws of which the nearest is the next start.
_DRAWS = 2
#: Configurations whose frames are known beforehand, those among which a start is chosen, and
#: where only some axes count.
_ROWS, _LOOK, _MASKED, _TABLE_SEED = 4096, 64, 32, 1
#: What a radian weighs against a reach of metres.
_WEIGHT = 0.18
#: Solutions nearer than this in every joint [rad or m] are one.
_SAME = 1e-3
_FLOAT = np.dtype(np.float64)
_empty, _contiguous = np.empty, np.ascontiguousarray
_POSE = (4, 4)
#: Seeds are taken as 63 bits.
_SEEDS = 2**63 - 1


@kernel
def weigh_kernel(
    error: tuple[float, float, float, float, float, float], T: Frame, axes: Array, w: float,
    e: Array,
) -> tuple[float, float, float]:  # fmt: skip
    """Write the weighed error (6,); answer its square and the errors [m], [rad] that count."""
    x, y, z, a, b, c = error
    if axes[6] != 0.0:
        x, y, z = (
            T[0] * x + T[4] * y + T[8] * z, T[1] * x + T[5] * y + T[9] * z,
            T[2] * x + T[6] * y + T[10] * z,
        )  # fmt: skip
        a, b, c = (
            T[0] * a + T[4] * b + T[8] * c, T[1] * a + T[5] * b + T[9] * c,
            T[2] * a + T[6] * b + T[10] * c,
        )  # fmt: skip
        x, y, z = axes[0] * x, axes[1] * y, axes[2] * z
        a, b, c = axes[3] * a, axes[4] * b, axes[5] * c
    e[0], e[1], e[2], e[3], e[4], e[5] = x, y, z, w * a, w * b, w * c
    position, rotation = x * x + y * y + z * z, a * a + b * b + c * c
    return position + w * w * rotation, math.sqrt(position), math.sqrt(rotation)


@kernel
def weigh_jacobian_kernel(T: Frame, axes: Array, w: float, J: Array) -> None:
    """The same for the columns of J (6, n), in place."""
    for j in range(J.shape[1]):
        if axes[6] == 0.0:
            J[3, j], J[4, j], J[5, j] = w * J[3, j], w * J[4, j], w * J[5, j]
            continue
        for k in range(2):
            i = 3 * k
            x, y, z = J[i, j], J[i + 1, j], J[i + 2, j]
            scale = w if k == 1 else 1.0
            J[i, j] = scale * axes[i] * (T[0] * x + T[4] * y + T[8] * z)
            J[i + 1, j] = scale * axes[i + 1] * (T[1] * x + T[5] * y + T[9] * z)
            J[i + 2, j] = scale * axes[i + 2] * (T[2] * x + T[6] * y + T[10] * z)


@kernel
def draw_kernel(
    model: Array, link: int, T: Frame, axes: Array, lower: Array, upper: Array, w: float,
    state: State, trial: Array, e: Array, room: Array, q: Array,
) -> None:  # fmt: skip
    """Put the nearest of some random draws into q; joints behind the link stay as they are.

    ``room`` is (6, n), where turns can stand.
    """
    row = 1 + q.shape[0] + link
    last = int(model[row, 0])
    for j in range(q.shape[0]):
        trial[j] = q[j]
    nearest = np.inf
    for _ in range(_DRAWS):
        for j in range(last + 1):
            trial[j] = lower[j] + uniform_kernel(state) * (upper[j] - lower[j])
        turns_kernel(trial, room[0], room[1])
        B = IDENTITY
        for j in range(last + 1):
            B = move_kernel(model, 1 + j, trial[j], room[0, j], room[1, j], B)
        B = compose_kernel(B, model, row)
        square, _, _ = weigh_kernel(error_kernel(B, T), T, axes, w, e)
        if square < nearest:
            nearest = square
            for j in range(last + 1):
                q[j] = trial[j]


@kernel
def pick_kernel(
    table: Array, T: Frame, axes: Array, w: float, state: State, last: int, e: Array, near: Array,
    q: Array,
) -> None:  # fmt: skip
    """Put into q that of some neighbouring rows of the table whose frame is nearest to T.

    Args:
        table: Configurations and their frames by columns, shape (n + 12, k); the rotation's rows
            times w / sqrt(2), so that squares add up as those of small errors do.
        T: The target.
        axes: As ``solve_kernel`` has it.
        w: Weight of a radian [m].
        state: Of the draws.
        last: The last joint that moves the link.
        e: Room (6,).
        near: Room, as many as rows are looked at.
        q: The answer (n,); joints behind ``last`` stay as they are.
    """
    n, k = q.shape[0], near.shape[0]
    begin = int(uniform_kernel(state) * (table.shape[1] - k))
    if axes[6] == 0.0:
        for i in range(k):
            near[i] = 0.0
        for row in range(12):
            wanted = T[row] if row % 4 == 3 else w * math.sqrt(0.5) * T[row]
            column = table[n + row, begin : begin + k]
            for i in range(k):
                near[i] += (column[i] - wanted) * (column[i] - wanted)
    else:
        r = math.sqrt(2.0) / w
        k = min(k, _MASKED)
        for i in range(k):
            c = begin + i
            B = (
                r * table[n, c], r * table[n + 1, c], r * table[n + 2, c], table[n + 3, c],
                r * table[n + 4, c], r * table[n + 5, c], r * table[n + 6, c], table[n + 7, c],
                r * table[n + 8, c], r * table[n + 9, c], r * table[n + 10, c], table[n + 11, c],
            )  # fmt: skip
            near[i], _, _ = weigh_kernel(error_kernel(B, T), T, axes, w, e)
    best = 0
    for i in range(1, k):
        if near[i] < near[best]:
            best = i
    for j in range(last + 1):
        q[j] = table[j, begin + best]


@kernel
def table_kernel(
    model: Array, link: int, lower: Array, upper: Array, w: float, seed: int, table: Array
) -> None:
    """Fill a table for ``pick_kernel`` with random configurations (n + 12, k)."""
    n = lower.shape[0]
    q, room = np.empty(n), np.empty((6, n))
    state = np.empty(1, dtype=np.uint64)
    state[0] = np.uint64(seed)
    scale = w * math.sqrt(0.5)
    for i in range(table.shape[1]):
        for j in range(n):
            q[j] = lower[j] + uniform_kernel(state) * (upper[j] - lower[j])
            table[j, i] = q[j]
        B = frame_and_jacobian_kernel(model, q, link, room)
        for row in range(12):
            table[n + row, i] = B[row] if row % 4 == 3 else scale * B[row]


@kernel
def solve_kernel(
    model: Array, link: int, target: Array, axes: Array, bounds: Array, table: Array,
    scales: tuple[float, float, float], starts: int, spent: int, seed: int, start: Array,
    best: Array,
) -> int:  # fmt: skip
    """Search from ``start`` (n,), then from random draws, until the tolerances are met.

    Fills ``best`` (n + 4,) with the nearest configuration, its position error, orientation error,
    the steps and the starts spent.

    Args:
        model: ``Chain.model``.
        link: The number of the link to bring there, -1 for the tip.
        target: T_base_link, shape (4, 4).
        axes: 1 for each row of the error in the target's frame that counts, and whether some do
            not, shape (7,).
        bounds: Limits, lower and upper, and where random starts are drawn from, shape (4, n).
        table: What most restarts are taken from, see ``pick_kernel``.
        scales: Tolerance of position [m], of orientation [rad], and the weight of a radian [m].
        starts: How many to spend in all.
        spent: Starts that were spent before; above 0 it begins with a draw instead of ``start``.
        seed: Of the draws.
        start: Inside the limits.
        best: The answer.

    Returns:
        1 when the tolerances are met, 0 when not, -1 where ``start`` is not one finite number a
        joint, -2 where the target is not finite.
    """
    n = start.shape[0]
    if n != int(model[0, 0]) or not finite_kernel(start):
        return -1
    for row in range(3):
        for column in range(4):
            if not math.isfinite(target[row, column]):
                return -2
    if link < 0:
        link = int(model[0, 1])
    T = frame_kernel(target)
    state = np.empty(1, dtype=np.uint64)
    state[0] = np.uint64(seed) + np.uint64(0xD1342543DE82EF95) * np.uint64(spent)
    # One piece of memory for all: each costs as much as a joint does.
    look, wide = min(_LOOK, table.shape[1]), max(n, 6)
    room = np.empty(14 * n + n * n + 12 + wide + look)
    q, trial, room = room[:n], room[n : 2 * n], room[2 * n :]
    J, J_trial = room[: 6 * n].reshape((6, n)), room[6 * n : 12 * n].reshape((6, n))
    H, room = room[12 * n : 12 * n + n * n].reshape((n, n)), room[12 * n + n * n :]
    e, e_trial, g, near = room[:6], room[6:12], room[12 : 12 + wide], room[12 + wide :]
    free, last = np.empty(n, dtype=np.int64), int(model[1 + n + link, 0])
    lower, upper, w = bounds[0], bounds[1], scales[2]
    for j in range(n):
        q[j] = min(max(start[j], lower[j]), upper[j])
    least, steps = np.inf, 0
    for attempt in range(spent, starts):
        if attempt > 0 and attempt % _LONG != _LONG - 1:
            pick_kernel(table, T, axes, w, state, last, e, near, q)
        elif attempt > 0:
            draw_kernel(model, link, T, axes, bounds[2], bounds[3], w, state, trial, e, J, q)
        patience, gain = _PATIENCE, _GAIN
        if attempt % _LONG == _LONG - 1:
            patience, gain = _LONG_PATIENCE, _LONG_GAIN
        B = frame_and_jacobian_kernel(model, q, link, J)
        square, position, rotation = weigh_kernel(error_kernel(B, T), T, axes, w, e)
        weigh_jacobian_kernel(T, axes, w, J)
        mu, stale, mark = _DAMPING, 0, square
        for _ in range(_STEPS):
            if position <= scales[0] and rotation <= scales[1]:
                break
            damping = mu * square + _LEAST_DAMPING
            step_within_kernel(J, e, q, lower, upper, damping, free, H, g, trial)
            steps += 1
            B = frame_and_jacobian_kernel(model, trial, link, J_trial)
            after, position_after, rotation_after = weigh_kernel(
                error_kernel(B, T), T, axes, w, e_trial
            )
            if after < square:
                q, trial = trial, q
                J, J_trial = J_trial, J
                e, e_trial = e_trial, e
                square, position, rotation = after, position_after, rotation_after
                weigh_jacobian_kernel(T, axes, w, J)
                mu = max(_LESS * mu, _LEAST_MU)
            else:
                mu = _MORE * mu
            stale += 1
            if square < gain * mark:
                mark, stale = square, 0
            if stale > patience:
                break
        done = position <= scales[0] and rotation <= scales[1]
        if square < least or done:
            least = square
            for j in range(n):
                best[j] = q[j]
            best[n], best[n + 1] = position, rotation
        if done:
            best[n + 2], best[n + 3] = steps, attempt + 1
            return 1
    best[n + 2], best[n + 3] = steps, starts
    return 0


@kernel
def solve_batch_kernel(
    model: Array, link: int, targets: Array, axes: Array, bounds: Array, table: Array,
    scales: tuple[float, float, float], starts: int, seed: int, begin: Array, best: Array,
    solved: Indices,
) -> None:  # fmt: skip
    """``solve_kernel`` for targets (m, 4, 4) from begin (m, n), the draws the same for each."""
    for k in range(targets.shape[0]):
        solved[k] = solve_kernel(
            model, link, targets[k], axes, bounds, table, scales, starts, 0, seed, begin[k], best[k]
        )


@dataclass(frozen=True, slots=True, eq=False)
class IkBatch:
    """What the numeric method found for m poses.

    Args:
        joints: The nearest configuration to each, shape (m, n) [rad or m].
        position_error: Its distance [m], shape (m,).
        orientation_error: Its angle [rad], shape (m,).
        steps: Steps over all starts, shape (m,).
        solved: Whether it is inside the tolerances, shape (m,).
    """

    joints: Array
    position_error: Array
    orientation_error: Array
    steps: Array
    solved: NDArray[np.bool_]


def solve_many(
    chain: Chain,
    targets: ArrayLike,
    *,
    link: str | None = None,
    seed_joints: ArrayLike | None = None,
    seed: int = 0,
    starts: int = STARTS,
    position_tolerance: float = POSITION_TOLERANCE,
    orientation_tolerance: float = ORIENTATION_TOLERANCE,
    axes: Collection[Axis] = AXES,
    threads: int | None = None,
) -> IkBatch:
    """One configuration for each of many poses; arguments as ``solve`` has them.

    Args:
        chain: The robot.
        targets: T_base_link, shape (m, 4, 4).
        link: The link to bring there; the tip where none is named.
        seed_joints: Where to start from, shape (n,) or (m, n).
        seed: Of the restarts.
        starts: Start configurations to spend on each pose.
        position_tolerance: [m].
        orientation_tolerance: [rad].
        axes: The axes of the target's frame that count.
        threads: How many to share the poses among, which changes nothing but the time; all the
            processors that this process may use where not given.

    Raises:
        InvalidRobotState: ``seed_joints`` has the wrong length or is not finite.
        InvalidLinkName: No such link.
        InvalidPose: A target is no finite 4x4 matrix.
        InvalidOption: A tolerance or the number of starts is not positive, or an axis unknown.
    """
    T = _numbers(targets)
    if T.ndim != 3 or T.shape[1:] != _POSE or not np.isfinite(T).all():
        raise InvalidPose("the targets must be finite 4x4 transforms, shape (m, 4, 4)")
    number = -1 if link is None else link_number(chain, link)
    model, bounds, table, home, weight = _prepared(chain, number)
    seeds = home if seed_joints is None else chain.configuration(seed_joints, "seed_joints")
    m = T.shape[0]
    if seeds.ndim > 1 and seeds.shape[0] != m:
        raise InvalidOption(f"seed_joints must be one or {m}, as the poses are")
    begin = np.ascontiguousarray(np.broadcast_to(seeds, (m, chain.n)))
    n = chain.n
    best, solved = np.empty((m, n + 4)), np.empty(m, dtype=np.int64)
    scales = (float(position_tolerance), float(orientation_tolerance), weight)
    if not (position_tolerance > 0.0 and orientation_tolerance > 0.0 and starts >= 1):
        _refuse(starts)

    mask = _mask(axes)

    def part(k: slice) -> None:
        solve_batch_kernel(
            model, number, T[k], mask, bounds, table, scales, starts, seed & _SEEDS, begin[k],
            best[k], solved[k],
        )  # fmt: skip

    shared(part, m, threads)
    return IkBatch(best[:, :n], best[:, n], best[:, n + 1], best[:, n + 2], solved == 1)


def solve(
    chain: Chain,
    target: ArrayLike,
    *,
    link: str | None = None,
    seed_joints: ArrayLike | None = None,
    seed: int = 0,
    solutions: int = 1,
    starts: int = STARTS,
    position_tolerance: float = POSITION_TOLERANCE,
    orientation_tolerance: float = ORIENTATION_TOLERANCE,
    axes: Collection[Axis] = AXES,
    position_only: bool = False,
) -> IkResult:
    """Find up to ``solutions`` distinct configurations that bring a link to a pose.

    Args:
        chain: The robot.
        target: T_base_link, shape (4, 4).
        link: The link to bring there; the tip where none is named.
        seed_joints: Where to start from, shape (n,); the middle of the limits where not given.
        seed: Of the restarts; the same seed gives the same answer.
        solutions: How many distinct ones to look for.
        starts: Start configurations to spend in all.
        position_tolerance: [m].
        orientation_tolerance: [rad].
        axes: The axes of the target's frame that count: positions along x, y, z, turns about them
            rx, ry, rz. Without rz, say, the tool may turn about its own z.
        position_only: The same as only x, y and z.

    Returns:
        The solutions, nearest to ``seed_joints`` first, or the nearest attempt and advice.

    Raises:
        InvalidRobotState: ``seed_joints`` has the wrong length or is not finite.
        InvalidLinkName: No such link.
        InvalidPose: ``target`` is no finite 4x4 matrix.
        InvalidOption: A tolerance or the number of starts is not positive, or an axis unknown.
    """
    T = _numbers(target)
    if T.shape != _POSE:
        raise InvalidPose("the target must be a finite 4x4 transform")
    number = -1 if link is None else link_number(chain, link)
    model, bounds, table, home, weight = _prepared(chain, number)
    begin = home if seed_joints is None else _numbers(seed_joints)
    if begin.ndim != 1:
        raise_start(chain, begin)
    mask = _mask(POSITION if position_only else axes)
    scales = (position_tolerance, orientation_tolerance, weight)
    if not (position_tolerance > 0.0 and orientation_tolerance > 0.0 and starts >= 1):
        _refuse(starts)
    n = home.shape[0]
    found: list[IkSolution] = []
    nearest: IkSolution | None = None
    spent = 0
    while spent < starts and len(found) < solutions:
        best = _empty(n + 4)
        done = _one()(
            model, number, T, mask, bounds, table, scales, starts, spent, seed & _SEEDS, begin, best
        )
        if done < 0:
            raise_start(chain, begin)
            raise InvalidPose("the target must be a finite 4x4 transform")
        p, r, steps, used = best[n:].tolist()
        spent = int(used)
        best.setflags(write=False)
        solution = IkSolution(best[:n], p, r, int(steps))
        if solutions == 1 and done:
            return IkResult((solution,), solution, spent)
        if nearest is None or _error(solution) < _error(nearest):
            nearest = solution
        if done and all(np.abs(best[:n] - other.joints).max() > _SAME for other in found):
            found.append(solution)
    assert nearest is not None
    if len(found) > 1:
        found.sort(key=lambda solution: float(np.linalg.norm(solution.joints - begin)))
    advice = "" if found else _advice(chain, link, T, nearest, position_only)
    return IkResult(tuple(found), nearest, spent, advice)


def raise_start(chain: Chain, begin: Array) -> None:
    """Say what is wrong with a start, if anything is.

    Raises:
        InvalidRobotState: It is not one finite number a joint.
    """
    if chain.configuration(begin, "seed_joints").ndim != 1:
        raise InvalidOption("seed_joints must be one configuration here, not several")


@lru_cache(maxsize=64)
def _prepared(chain: Chain, link: int) -> tuple[Array, Array, Array, Array, float]:
    """Model, bounds, table, the middle of the limits, and the weight of a radian."""
    low, high = chain.sampling_bounds()
    radius = float(np.linalg.norm(chain.offsets[1:, :3, 3], axis=1).sum())
    radius += float(np.linalg.norm(chain.tip.T_joint_link[:3, 3]))
    radius += float((high - low)[chain.joint_types == JointType.PRISMATIC].sum())
    weight = _WEIGHT * radius if radius > 0.0 else 1.0
    table = _empty((chain.n + 12, _ROWS))
    table_kernel(chain.model, link, low, high, weight, _TABLE_SEED, table)
    bounds = np.array([chain.limits.lower, chain.limits.upper, low, high])
    return chain.model, frozen(bounds), frozen(table), frozen(0.5 * (low + high)), weight


def _numbers(values: ArrayLike) -> Array:
    try:
        return _contiguous(values, _FLOAT)
    except (TypeError, ValueError) as error:
        raise InvalidOption(f"an array of numbers was expected: {error}") from None


def _refuse(starts: int) -> NoReturn:
    if starts < 1:
        raise InvalidOption("starts must be 1 at least")
    raise InvalidOption("tolerances must be positive")


def _mask(axes: Collection[Axis]) -> Array:
    return _ALL if axes is AXES else _some(tuple(axes))


@lru_cache(maxsize=64)
def _some(axes: tuple[Axis, ...]) -> Array:
    unknown = [axis for axis in axes if axis not in AXES]
    if unknown or not axes:
        raise InvalidOption(
            f"axes must be some of {', '.join(AXES)}, got {list(axes)}",
            hint="They are those of the target's frame; leave out what may be free.",
        )
    mask = [float(axis in axes) for axis in AXES]
    return np.array([*mask, float(min(mask) == 0.0)])


_ALL = np.array([1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.0])


@cache
def _one() -> Any:
    def fixed(*shape: int) -> Array:
        array = np.zeros(shape)
        array.setflags(write=False)
        return array

    row = np.zeros(1)
    return direct(
        solve_kernel, fixed(1, 14), 0, np.zeros((4, 4)), row, fixed(4, 1), fixed(1, 1),
        (0.0, 0.0, 0.0), 0, 0, 0, row, row,
    )  # fmt: skip


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
    chain: Chain, link: str | None, T: Array, nearest: IkSolution, position_only: bool
) -> str:
    center, radius = reach(chain, link)
    away = float(np.linalg.norm(T[:3, 3] - center))
    if away > radius:
        return (
            f"The target is {away:.3f} m from the first joint, {away - radius:.3f} m beyond the "
            f"longest the arm can reach ({radius:.3f} m). Bring it nearer."
        )
    if not position_only:
        alone = solve(chain, T, link=link, starts=100, position_only=True)
        if alone.solutions:
            return (
                "The position can be reached, but not in this orientation: the nearest attempt "
                f"is off by {nearest.orientation_error:.4f} rad and "
                f"{nearest.position_error:.4f} m. Turn the pose or move it."
            )
        return (
            "The position can't be reached inside the joint limits in any orientation: the "
            f"nearest attempt stays {alone.nearest.position_error:.4f} m away."
        )
    return f"The nearest attempt inside the joint limits stays {nearest.position_error:.4f} m away."
