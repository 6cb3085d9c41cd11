"""The least time along a given path within velocity and acceleration limits."""

from collections.abc import Callable, Sequence
from importlib import import_module
from types import MappingProxyType
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from kinematics.arrays import Array, frozen
from kinematics.errors import InvalidOption
from kinematics.trajectory import Trajectory
from planning.effort_limits import EffortLimits
from planning.timing.constraints import Cells, cells
from planning.timing.effort_limits import loaded, slow_down
from planning.timing.failure import TimingFailed
from planning.timing.path import JointPath
from planning.timing.profile import timed_pieces
from planning.timing.time_scaling import ScaledTime, checked_limits, dilate

Solver = Literal["reachability", "toppra"]

#: Cells of a path that has no straight pieces. Against 8,000 cells, 256 cost 0.09 % of the duration
#: on paths of parabolas only, 0.05 % with half as long parabolas, 0.17 % on cubic splines.
RESOLUTION = 256
#: More than this is refused: it would take seconds.
MAX_RESOLUTION = 100_000

# The solver is given limits this much lower, so that what it rounds off stays within the true ones
# and no dilation is needed as a rule.
_HAIR = 1e-12

# A speed asked for at an end is kept to so many digits.
_SAME_SPEED = 1e-9
# How often the speeds are found under friction: their changes shrink tenfold each time.
_FRICTION_ROUNDS = 3

# Imported when used: the toppra package takes a second to load, plotting library included.
_SOLVERS = MappingProxyType(
    {"reachability": "planning.timing.reachability", "toppra": "planning.timing.toppra"}
)


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
        path: What to follow.
        joint_names: n names.
        velocity: Limits, shape (n,), inf where there is none [rad/s or m/s].
        acceleration: Limits, shape (n,), finite [rad/s^2 or m/s^2].
        solver: Who finds the speeds: our compiled "reachability" or the "toppra" package.
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
    aims = frozen(limits * (1.0 - _HAIR))
    if not 1 <= resolution <= MAX_RESOLUTION:
        raise InvalidOption(
            f"a timing resolution of {resolution} cells",
            hint=f"Give a number from 1 to {MAX_RESOLUTION}.",
        )
    grid = _ended(cells(path, resolution, aims, everywhere=loads is not None), end_speeds)
    solve = _squared_speeds(solver)
    squares = solve(grid) if loads is None else _loaded_speeds(grid, path, loads, solve)
    _check_ends(squares, end_speeds)
    durations, coefficients = timed_pieces(path, grid, squares, aims)
    breaks = np.concatenate([[0.0], np.cumsum(durations)])
    if not ((np.diff(breaks) > 0.0).all() and np.isfinite(coefficients).all()):
        raise TimingFailed(
            "the path can't be timed: some piece takes no time, or no finite one",
            hint="Look for limits or lengths of very different sizes.",
        )
    dilated = dilate(Trajectory(tuple(joint_names), breaks, coefficients), limits[0], limits[1])
    if loads is None:
        return dilated
    obeying = slow_down(loads, dilated)
    if obeying.factor > (1.0 + _SAME_SPEED) * dilated.factor and sum(end_speeds) > 0.0:
        raise _unkept()
    return obeying


def _loaded_speeds(
    grid: Cells, path: JointPath, loads: EffortLimits, solve: Callable[[Cells], Array]
) -> Array:
    """Speeds under loads; with friction the guess of the speeds that it needs is improved."""
    squares = None
    rounds = _FRICTION_ROUNDS if loads.chain.viscous_friction.any() else 1
    for _ in range(rounds):
        squares = solve(loaded(grid, path, loads, squares))
    assert squares is not None
    return squares


def _ended(grid: Cells, end_speeds: tuple[float, float]) -> Cells:
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
            raise _unkept()


def _unkept() -> TimingFailed:
    return TimingFailed(
        "the boundary velocities can't be kept within all limits",
        hint="Give lower boundary velocities, or higher limits.",
    )


def _squared_speeds(solver: Solver) -> Callable[[Cells], Array]:
    if solver not in _SOLVERS:
        raise InvalidOption(
            f"there is no timing solver {solver!r}", hint=f"Choose from {', '.join(_SOLVERS)}."
        )
    found: Callable[[Cells], Array] = import_module(_SOLVERS[solver]).squared_speeds
    return found


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
