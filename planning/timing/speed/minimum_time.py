"""The least time along a given path within velocity and acceleration limits.

From squared speeds on a grid to exact polynomials of time.

Within a cell the path acceleration is constant, so s(t) is quadratic, and q(s(t)) on a path of
degree d is a polynomial of degree 2 d: its coefficients are computed, nothing is fitted.

Reachability analysis for the fastest speeds on a grid, compiled.

Backwards, the largest x_i from which the next cell can still be braked through; then forwards, the
largest x_(i+1) that each x_i can reach ("A new approach to time-optimal path parameterization based
on reachability analysis", 2018). With limits that are the same in both directions standing still
is always possible, so the sets of speeds all begin at 0 and a single number bounds each. The same
quantities as in ``planning.timing.speed.toppra``, 30 to 100 times as fast and without fixed
tolerances.
"""

from collections.abc import Callable, Sequence
from importlib import import_module
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from compiled.kernel import kernel
from kinematics.arrays import Array, frozen
from kinematics.errors import InvalidOption
from kinematics.trajectory.polynomial import composed_pieces
from kinematics.trajectory.trajectory import Trajectory
from planning.timing.options import Solver, TimingFailed
from planning.timing.path.path import JointPath
from planning.timing.speed.constraints import Cells, cells, guards
from planning.timing.speed.effort_limits import slow_down, with_effort_rows
from planning.timing.time_scaling import (
    ScaledTime,
    dilate,
    end_speed_failure,
    motion_bounds,
    slowed_at_ends,
)
from planning.values.limits import EffortLimits


def squared_speeds(cells: Cells) -> Array:
    """The largest (ds/dt)^2 at the N + 1 grid points that all rows and rests allow.

    Raises:
        TimingFailed: Some speed is not bounded by any limit, or nothing but standing still is left.
    """
    squares = np.zeros(len(cells.lengths) + 1)
    caps = cells.caps.copy()
    reachability_kernel(cells.rows, caps, guards(cells), cells.rest, squares)
    if not (np.isfinite(squares).all() and (squares[~cells.rest] > 0.0).all()):
        raise TimingFailed(
            "no finite speed along the path was found",
            hint="Look for limits or lengths of very different sizes.",
        )
    return squares


@kernel
def reachability_kernel(
    rows: Array, caps: Array, guards: Array, rest: NDArray[np.bool_], squares: Array
) -> None:
    """Write the squared speeds: backward and forward pass, caps lowered where that was a trap."""
    count = rows.shape[0]
    most = np.empty(count + 1)
    # Few paths have a trap, and one or two rounds free them.
    for _ in range(20):
        most[count] = 0.0 if rest[count] else caps[count]
        for i in range(count - 1, -1, -1):
            most[i] = 0.0
            if not rest[i]:
                most[i] = min(caps[i], _controllable_kernel(rows[i], most[i + 1]))
        squares[0] = most[0]
        trapped = False
        for i in range(count):
            squares[i + 1] = 0.0
            if not rest[i + 1]:
                squares[i + 1] = _reachable_kernel(rows[i], squares[i], most[i + 1])
            # A cell is a trap where x has to fall below this part both of what it was and of what
            # the way to the goal allows. Few paths have one, and one or two rounds free them.
            forced = squares[i + 1] < 0.5 * min(squares[i], most[i + 1])
            if forced and guards[i] < caps[i]:
                caps[i] = guards[i]
                trapped = True
        if not trapped:
            break


@kernel(allocates=False)
def _reachable_kernel(rows: Array, x0: float, most: float) -> float:
    """The largest x_1 <= ``most`` with a x_0 + b x_1 <= 1 for all rows.

    Where x_0 leaves one x_1 only, rounding may put its upper bound below its lower one: then the
    bound with the larger coefficient is the sharper one, and breaks the other by rounding only.
    """
    upper, lower, upper_weight, lower_weight = np.inf, 0.0, 0.0, 0.0
    for k in range(rows.shape[0]):
        a, b = rows[k, 0], rows[k, 1]
        if b == 0.0:
            continue
        bound = (1.0 - a * x0) / b
        if b > 0.0 and bound < upper:
            upper, upper_weight = bound, b
        elif b < 0.0 and bound > lower:
            lower, lower_weight = bound, -b
    best = lower if lower > upper and lower_weight > upper_weight else upper
    return min(max(best, 0.0), most)


@kernel(allocates=False)
def _controllable_kernel(rows: Array, most: float) -> float:
    """The largest x_0 for which some x_1 in [0, ``most``] has a x_0 + b x_1 <= 1 for all rows.

    By duality 1 / x_0 is the largest a for which (a, 0) lies in the hull of the rows' points
    (a, b), the bound's (0, 1 / most), and all below them (x_1 >= 0). So it is the largest a of the
    points with b >= 0, or where the rightmost edge of the hull crosses b = 0. The edge is found by
    exchanging one of its ends for the point farthest outside, as long as the crossing moves right.
    No division by a small coefficient occurs.
    """
    count = rows.shape[0]
    best, highest_below = 0.0, -1
    above_a, above_b = 0.0, (1.0 / most if most > 0.0 else np.inf)
    for k in range(count):
        a, b = rows[k, 0], rows[k, 1]
        if a > best and (b >= 0.0 or most == 0.0):
            best = a
        if b < 0.0 and (highest_below < 0 or a > rows[highest_below, 0]):
            highest_below = k
    if highest_below < 0 or most == 0.0:
        return 1.0 / best
    below_a, below_b = rows[highest_below, 0], rows[highest_below, 1]
    crossing = -np.inf
    # Each exchange is for good; there are never more than a few.
    for _ in range(200):
        right = (above_a * -below_b + below_a * above_b) / (above_b - below_b)
        if right <= crossing:
            break
        crossing = right
        rise, run = above_b - below_b, above_a - below_a
        farthest, outside = -1, 0.0
        for k in range(count):
            distance = (rows[k, 0] - below_a) * rise - (rows[k, 1] - below_b) * run
            if distance > outside:
                farthest, outside = k, distance
        if farthest < 0:
            break
        if rows[farthest, 1] >= 0.0:
            above_a, above_b = rows[farthest, 0], rows[farthest, 1]
        else:
            below_a, below_b = rows[farthest, 0], rows[farthest, 1]
    return 1.0 / max(best, crossing)


def timed_pieces(
    path: JointPath, cells: Cells, squares: Array, limits: Array
) -> tuple[Array, Array]:
    """Durations (m,) [s] and coefficients (m, n, 2 k - 1) of the motion with given speeds.

    Each straight cell is run through in the least time between the speeds at its ends: full
    acceleration, the speed limit where there is room, full deceleration.

    Args:
        path: The path.
        cells: The grid on it.
        squares: (ds/dt)^2 at the N + 1 grid points, never 0 at both ends of a curved cell.
        limits: Limits of velocity and acceleration, shape (2, n).
    """
    room = len(cells.pieces) + 2 * int(np.count_nonzero(cells.straight))
    phases = np.empty((room, 4))
    owners = np.empty(room, dtype=np.int64)
    geometry = np.column_stack([cells.starts, cells.lengths, squares[:-1], squares[1:]])
    slopes = path.coefficients[:, :, 1]
    count = phases_kernel(slopes, cells.pieces, cells.straight, geometry, limits, phases, owners)
    starts, lengths, before, after = phases[:count].T
    durations = 2.0 * lengths / (before + after)
    rows = np.column_stack([starts, before, 0.5 * (after - before) / durations])
    return durations, composed_pieces(path.coefficients, owners[:count], rows, 2)


@kernel
def phases_kernel(
    slopes: Array,
    pieces: NDArray[np.int64],
    straight: NDArray[np.bool_],
    geometry: Array,
    limits: Array,
    phases: Array,
    owners: NDArray[np.int64],
) -> int:
    """Write (start, length, speed before, speed after) of each phase, its piece, and their number.

    ``geometry`` is (start, length, x before, x after) of each cell.
    """
    count = 0
    for i in range(pieces.shape[0]):
        start, length, x0, x1 = geometry[i]
        inner = np.empty((2, 2))
        used = 0
        if straight[i]:
            top, rate = np.inf, np.inf
            for j in range(slopes.shape[1]):
                slope = abs(slopes[pieces[i], j])
                if slope > 0.0:
                    top = min(top, (limits[0, j] / slope) ** 2)
                    rate = min(rate, limits[1, j] / slope)
            used = _inner_kernel(length, x0, x1, top, rate, inner)
        place, x = 0.0, x0
        for k in range(used + 1):
            after, x_after = (inner[k, 0], inner[k, 1]) if k < used else (length, x1)
            phases[count, 0], phases[count, 1] = start + place, after - place
            phases[count, 2], phases[count, 3] = np.sqrt(x), np.sqrt(x_after)
            owners[count] = pieces[i]
            count += 1
            place, x = after, x_after
    return count


@kernel(allocates=False)
def _inner_kernel(
    length: float, x0: float, x1: float, top: float, rate: float, inner: Array
) -> int:
    """Write (place, x) where the phases of a straight cell meet, and answer how many: 0, 1 or 2."""
    peak = max(min(top, 0.5 * (x0 + x1) + rate * length), x0, x1)
    rising = min((peak - x0) / (2.0 * rate), length)
    falling = min((peak - x1) / (2.0 * rate), length - rising)
    cruise = length - rising - falling
    # A phase of a straight cell (speeding up, cruising, slowing down) that changes x by a smaller
    # part, or leaves a smaller part of the length, is joined to its neighbour, which then runs at a
    # hair less than the limit.
    least_phase = 1e-9
    least = least_phase * length
    # A phase that changes the speed by next to nothing, or leaves no room for another, is none.
    rises = peak - x0 > least_phase * peak and length - rising > least
    falls = peak - x1 > least_phase * peak and length - falling > least
    used = 0
    if rises:
        inner[used, 0], inner[used, 1] = rising, peak
        used += 1
    if falls and (cruise > least or not rises):
        inner[used, 0], inner[used, 1] = length - falling, peak
        used += 1
    return used


#: Cells of a path that has no straight pieces. Against 8,000 cells, 256 cost 0.09 % of the duration
#: on paths of parabolas only, 0.05 % with half as long parabolas, 0.17 % on cubic splines.
RESOLUTION = 256
#: More than this is refused: it would take seconds.
MAX_RESOLUTION = 100_000


# A speed asked for at an end is kept to so many digits.
_SAME_SPEED = 1e-9


class SpeedProblem(NamedTuple):
    """Problem of finding path speeds on a grid.

    Args:
        path: Path to follow.
        limits: Limits of velocity and acceleration, shape (2, n).
        resolution: Grid cells that a path without straight pieces has.
        end_speeds: ds/dt at the start and at the end.
        effort: Limits of torque and tool speed.
    """

    path: JointPath
    limits: Array
    resolution: int
    end_speeds: tuple[float, float]
    effort: EffortLimits | None


#: A grid on the path and the squared speeds at its points.
SpeedSolver = Callable[[SpeedProblem], tuple[Cells, Array]]


def time_path(
    path: JointPath,
    joint_names: Sequence[str],
    velocity: ArrayLike,
    acceleration: ArrayLike,
    *,
    solver: Solver = "reachability",
    resolution: int = RESOLUTION,
    end_speeds: tuple[float, float] = (0.0, 0.0),
    loads: EffortLimits | None = None,
) -> ScaledTime:
    """The path run through in the least time, at rest at its ends and at its sharp corners.

    The trajectory follows the path exactly and its velocity is continuous; its acceleration jumps.
    On a path of degree d the pieces have degree 2 d.

    Args:
        path: Path to follow.
        joint_names: n names.
        velocity: Limits, shape (n,), inf where there is none [rad/s or m/s].
        acceleration: Limits, shape (n,), finite [rad/s^2 or m/s^2].
        solver: Solver of the speeds: our compiled "reachability" or the "toppra" package.
        resolution: Grid cells that a path without straight pieces has, shared out by length.
        end_speeds: ds/dt at the start and at the end.
        loads: Limits of torque and tool speed.

    Returns:
        The trajectory, and the factor by which time was stretched after the solver so that every
        exact peak ratio is at most 1.

    Raises:
        InvalidOption: A limit is not positive, an acceleration limit is not finite, the solver is
            unknown, or the resolution is out of range.
        TimingFailed: The solver found nothing, or the speeds at the ends can't be kept.
    """
    limits = frozen(motion_bounds(path.n, velocity, acceleration)[:2])
    if not np.isfinite(limits[1]).all():
        raise InvalidOption(
            "the acceleration limits must be finite",
            hint="Without them the least time would take infinite accelerations.",
        )
    # The solver is given limits this much lower, so that what it rounds off stays within the true
    # ones and no dilation is needed as a rule.
    aims = frozen(limits * (1.0 - 1e-12))
    if not 1 <= resolution <= MAX_RESOLUTION:
        raise InvalidOption(
            f"a timing resolution of {resolution} cells",
            hint=f"Give a number from 1 to {MAX_RESOLUTION}.",
        )
    problem = SpeedProblem(path, aims, resolution, end_speeds, loads)
    solve = _SOLVERS.get(solver)
    if solve is None:
        raise InvalidOption(
            f"there is no timing solver {solver!r}", hint=f"Choose from {', '.join(_SOLVERS)}."
        )

    def make(speeds: tuple[float, float]) -> ScaledTime:
        asked = problem._replace(end_speeds=speeds)
        return ScaledTime(_motion(asked, solve, joint_names), 1.0)

    def slow(made: ScaledTime) -> ScaledTime:
        scaled = dilate(made.trajectory, *limits)
        return scaled if loads is None else slow_down(loads, scaled)

    return slowed_at_ends(make, slow, end_speeds)


def _motion(problem: SpeedProblem, solve: SpeedSolver, joint_names: Sequence[str]) -> Trajectory:
    """The motion with the speeds that a solver finds."""
    grid, squares = solve(problem)
    _check_ends(squares, problem.end_speeds)
    durations, coefficients = timed_pieces(problem.path, grid, squares, problem.limits)
    breaks = np.concatenate([[0.0], np.cumsum(durations)])
    if not ((np.diff(breaks) > 0.0).all() and np.isfinite(coefficients).all()):
        raise TimingFailed(
            "the path can't be timed: some piece takes no time, or no finite one",
            hint="Look for limits or lengths of very different sizes.",
        )
    return Trajectory(tuple(joint_names), breaks, coefficients)


def _by_reachability(problem: SpeedProblem) -> tuple[Cells, Array]:
    """The largest speeds for which limits hold in whole cells."""
    path, effort = problem.path, problem.effort
    grid = cells(path, problem.resolution, problem.limits, everywhere=effort is not None)
    grid = with_end_speeds(grid, problem.end_speeds)
    if effort is None:
        return grid, squared_speeds(grid)
    return grid, _with_friction(
        effort, lambda guess: squared_speeds(with_effort_rows(grid, path, effort, guess))
    )


def _by_toppra(problem: SpeedProblem) -> tuple[Cells, Array]:
    """The speeds that the toppra package finds, which keep the limits at grid points only."""
    # Imported when used: the package takes a second to load, plotting library included.
    solve = import_module("planning.timing.speed.toppra").squared_speeds
    path, limits, effort = problem.path, problem.limits, problem.effort
    grid = cells(path, problem.resolution, limits, everywhere=True)
    if effort is None:
        return grid, solve(path, grid, limits, problem.end_speeds)
    return grid, _with_friction(
        effort, lambda guess: solve(path, grid, limits, problem.end_speeds, effort, guess)
    )


_SOLVERS: MappingProxyType[Solver, SpeedSolver] = MappingProxyType(
    {"reachability": _by_reachability, "toppra": _by_toppra}
)


def _with_friction(effort: EffortLimits, solve: Callable[[Array | None], Array]) -> Array:
    """Speeds under loads; with friction the guess of the speeds that it needs is improved."""
    squares = None
    # How often the speeds are found under friction: their changes shrink tenfold each time.
    rounds = 3 if effort.chain.viscous_friction.any() else 1
    for _ in range(rounds):
        squares = solve(squares)
    assert squares is not None
    return squares


def with_end_speeds(grid: Cells, end_speeds: tuple[float, float]) -> Cells:
    """The grid with its ends at given speeds instead of at rest."""
    rest, caps = grid.rest.copy(), grid.caps.copy()
    for end, speed in zip((0, -1), end_speeds, strict=True):
        if speed > 0.0:
            rest[end] = False
            caps[end] = min(caps[end], speed**2)
    return grid._replace(rest=rest, caps=caps)


def _check_ends(squares: Array, end_speeds: tuple[float, float]) -> None:
    for square, speed in zip(squares[[0, -1]], end_speeds, strict=True):
        if speed > 0.0 and square < speed**2 * (1.0 - _SAME_SPEED):
            raise end_speed_failure()
