"""The toppra package as a solver for the squared speeds on a grid.

"A new approach to time-optimal path parameterization based on reachability analysis", 2018.
"""

import itertools
import logging
from typing import Any

import numpy as np
from toppra.algorithm import TOPPRA
from toppra.constraint import LinearConstraint
from toppra.exceptions import ToppraError

from kinematics.arrays import Array
from planning.timing.failure import TimingFailed
from planning.timing.speed.constraints import Cells, guards

# Above the speed that full acceleration all the way would lead to, on any sensible path.
_ROOM = 16.0

logging.getLogger("toppra").setLevel(logging.CRITICAL)


def squared_speeds(cells: Cells) -> Array:
    """The largest (ds/dt)^2 at the N + 1 grid points that all rows and rests allow.

    Raises:
        TimingFailed: toppra raised an exception or found no parametrisation.
    """
    squares = np.zeros(len(cells.lengths) + 1)
    guarded = np.minimum(cells.caps, np.append(guards(cells), np.inf))
    # Its fixed end speeds are 0 even where q' is 0 and the path speed would be free.
    rests = np.flatnonzero([True, *cells.rest[1:-1], True])
    for first, last in itertools.pairwise(rests):
        # A single cell between two rests has speed 0 at both its ends; nothing is to be solved.
        if last - first > 1:
            within, points = slice(first, last), slice(first, last + 1)
            lengths, rows = cells.lengths[within], cells.rows[within]
            try:
                squares[points] = _solve(lengths, rows, cells.caps[points])
            except TimingFailed:
                squares[points] = _solve(lengths, rows, guarded[points])
    return squares


def _solve(lengths: Array, rows: Array, caps: Array) -> Array:
    """Squared speeds from rest to rest, in units in which toppra's fixed tolerances are small."""
    bounds = _bounds(rows, caps)
    scale = float(bounds.max())
    grid = np.concatenate([[0.0], np.cumsum(lengths / lengths.sum())])
    try:
        with np.errstate(all="ignore"):
            constraint = _Rows(rows * scale, bounds / scale, np.diff(grid))
            solver = TOPPRA([constraint], _Line(grid[-1]), grid, solver_wrapper="seidel")
            _, speeds, _ = solver.compute_parameterization(0.0, 0.0)
    except (ToppraError, ValueError, AssertionError, ArithmeticError, IndexError) as error:
        raise TimingFailed(
            f"toppra failed on this path: {type(error).__name__}",
            hint="Choose another timing solver, or remove nearly repeated waypoints.",
        ) from None
    if speeds is None or not np.isfinite(speeds).all() or not (speeds[1:-1] > 0.0).all():
        raise TimingFailed(
            "toppra found no timing of this path",
            hint="Choose another timing solver, or remove nearly repeated waypoints.",
        )
    squares = np.asarray(speeds, dtype=np.float64) ** 2 * scale
    squares[[0, -1]] = 0.0
    return squares


def _bounds(rows: Array, caps: Array) -> Array:
    """Upper bounds of the squared speeds, shape (N + 1,).

    Where the velocity is not limited, what full acceleration all the way leads to stands in, with
    room to spare.
    """
    gains = 1.0 / np.maximum(rows[:, :, 1].max(axis=1), np.finfo(np.float64).tiny)
    return np.asarray(np.minimum(caps, _ROOM * gains.sum()))


class _Line:
    """What toppra asks of a path when the constraints know everything else."""

    def __init__(self, end: float) -> None:
        self.path_interval = np.array([0.0, end])


class _Rows(LinearConstraint):  # type: ignore[misc]
    """a x_0 + b x_1 <= 1 with x_1 = x_0 + 2 l u, as toppra's (a', b') of a' u + b' x <= 1."""

    def __init__(self, rows: Array, bounds: Array, lengths: Array) -> None:
        super().__init__()
        self.identical = True
        self._rows, self._bounds, self._lengths = rows, bounds, lengths

    def compute_constraint_params(self, *_: Any) -> tuple[Any, ...]:
        a, b = self._rows[:, :, 0], self._rows[:, :, 1]
        count, width = a.shape
        u, x = np.zeros((count + 1, width)), np.zeros((count + 1, width))
        u[:-1] = 2.0 * self._lengths[:, None] * b
        x[:-1] = a + b
        # Tight bounds of the variables: from its own, 1e8, toppra's linear program starts with
        # roundings larger than its tolerance and calls feasible stages infeasible.
        x_bounds = np.column_stack([np.zeros(count + 1), self._bounds])
        most = np.append(np.maximum(self._bounds[:-1], self._bounds[1:]) / self._lengths, 1.0)
        u_bounds = np.column_stack([-most, most])
        unit, one = np.eye(width), np.ones(width)
        return u, x, np.zeros_like(u), unit, one, u_bounds, x_bounds
