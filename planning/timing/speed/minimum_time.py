"""The least time along a given path within velocity and acceleration limits."""

from collections.abc import Callable, Sequence
from importlib import import_module
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from kinematics.arrays import Array, frozen
from kinematics.errors import InvalidOption
from kinematics.trajectory.trajectory import Trajectory
from planning.timing.failure import TimingFailed
from planning.timing.options import Solver
from planning.timing.path.path import JointPath
from planning.timing.speed.constraints import Cells, cells
from planning.timing.speed.effort_limits import slow_down, with_effort_rows
from planning.timing.speed.profile import timed_pieces
from planning.timing.speed.reachability import squared_speeds
from planning.timing.time_scaling import ScaledTime, checked_limits, dilate
from planning.values.limits import EffortLimits

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
    limits = _limits(path, velocity, acceleration)
    # The solver is given limits this much lower, so that what it rounds off stays within the true
    # ones and no dilation is needed as a rule.
    aims = frozen(limits * (1.0 - 1e-12))
    if not 1 <= resolution <= MAX_RESOLUTION:
        raise InvalidOption(
            f"a timing resolution of {resolution} cells",
            hint=f"Give a number from 1 to {MAX_RESOLUTION}.",
        )
    problem = SpeedProblem(path, aims, resolution, end_speeds, loads)
    solve = _speed_solver(solver)
    if solver == "toppra" and any(end_speeds):
        return _slowed_at_given_ends(problem, solve, joint_names, limits)
    scaled = dilate(_motion(problem, solve, joint_names), *limits)
    if loads is None:
        return scaled
    slowed = slow_down(loads, scaled)
    if slowed.factor > (1.0 + _SAME_SPEED) * scaled.factor and sum(end_speeds) > 0.0:
        raise _end_speed_failure()
    return slowed


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


def _slowed_at_given_ends(
    problem: SpeedProblem, solve: SpeedSolver, joint_names: Sequence[str], limits: Array
) -> ScaledTime:
    """A motion that meets the speeds at its ends after it was slowed down.

    Slowing down changes the speeds at the ends: they are asked for that much higher.
    """
    start, end = problem.end_speeds
    factor = 1.0
    # How often an answer that has to be slowed down is asked for with higher speeds at its ends.
    for _ in range(8):
        asked = problem._replace(end_speeds=(start * factor, end * factor))
        motion = _motion(asked, solve, joint_names)
        scaled = dilate(motion, *limits)
        slowed = scaled if problem.effort is None else slow_down(problem.effort, scaled)
        if slowed.factor <= factor:
            return ScaledTime(motion.dilate(factor), factor) if factor > 1.0 else slowed
        # Slowed down by this part more than was needed, so that the next trial needs no more.
        factor = slowed.factor * (1.0 + 1e-6)
    raise _end_speed_failure()


def _by_reachability(problem: SpeedProblem) -> tuple[Cells, Array]:
    """The largest speeds for which limits hold in whole cells."""
    path, effort = problem.path, problem.effort
    grid = cells(path, problem.resolution, problem.limits, everywhere=effort is not None)
    grid = _with_end_speeds(grid, problem.end_speeds)
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


def _with_end_speeds(grid: Cells, end_speeds: tuple[float, float]) -> Cells:
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
            raise _end_speed_failure()


def _end_speed_failure() -> TimingFailed:
    return TimingFailed(
        "the boundary velocities can't be kept within all limits",
        hint="Give lower boundary velocities, or higher limits.",
    )


def _speed_solver(name: Solver) -> SpeedSolver:
    if name not in _SOLVERS:
        raise InvalidOption(
            f"there is no timing solver {name!r}", hint=f"Choose from {', '.join(_SOLVERS)}."
        )
    return _SOLVERS[name]


def _limits(path: JointPath, velocity: ArrayLike, acceleration: ArrayLike) -> Array:
    limits = np.stack(
        [
            checked_limits(velocity, "velocity", path.n),
            checked_limits(acceleration, "acceleration", path.n),
        ]
    )
    if not np.isfinite(limits[1]).all():
        raise InvalidOption(
            "the acceleration limits must be finite",
            hint="Without them the least time would take infinite accelerations.",
        )
    return frozen(limits)
