"""The toppra package as a timing solver: its own constraints on our grid, its own answer.

The package checks the limits at grid points, not between them. Its answer can therefore exceed
them, and whoever calls has to scale time afterwards. It is called for each section between two
stops, in units of length and time in which its fixed tolerances are small.

Source: "A new approach to time-optimal path parameterization based on reachability analysis", IEEE
Transactions on Robotics, 2018.
"""

import itertools
import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType
from typing import Any

import numpy as np

from kinematics.arrays import Array
from planning.timing.options import TimingFailed
from planning.timing.path.path import JointPath, piece_values
from planning.timing.speed.constraints import Cells
from planning.timing.speed.effort_limits import knot_limits
from planning.values.limits import EffortLimits


@contextmanager
def _without_plots() -> Iterator[None]:
    """Keep matplotlib from being loaded: toppra imports it for methods that draw, none of ours.

    It takes half a second and a tenth of what an installation takes up.
    """
    added = [name for name in ("matplotlib", "matplotlib.pyplot") if name not in sys.modules]
    for name in added:
        sys.modules[name] = ModuleType(name)
    try:
        yield
    finally:
        for name in added:
            del sys.modules[name]


with _without_plots():
    from toppra.algorithm import TOPPRA
    from toppra.constraint import (
        JointAccelerationConstraint,
        JointVelocityConstraint,
        LinearConstraint,
        canlinear_colloc_to_interpolate,
    )
    from toppra.exceptions import ToppraError

_HINT = "Leave timing.solver out, or remove nearly repeated waypoints."

logging.getLogger("toppra").setLevel(logging.CRITICAL)


def squared_speeds(
    path: JointPath,
    grid: Cells,
    limits: Array,
    end_speeds: tuple[float, float],
    effort: EffortLimits | None = None,
    guess: Array | None = None,
) -> Array:
    """(ds/dt)^2 at the N + 1 grid points, as the toppra package finds them.

    Straight lines from rest to rest take their closed form, which the package only comes near to:
    of recorded paths there are thousands.

    Args:
        path: Path to follow.
        grid: Cells of the path, straight pieces divided too; N cells. Its rows and caps are not
            used.
        limits: Limits of velocity (inf where there is none) and acceleration, shape (2, n).
        end_speeds: ds/dt at the start and at the end.
        effort: Limits of torque and tool speed.
        guess: Guess of the answer, for the rows of viscous friction, shape (N + 1,).

    Raises:
        TimingFailed: toppra raised an exception or found no parametrisation.
    """
    squares = np.zeros(len(grid.lengths) + 1)
    stops = [0, *path.corners, len(path.lengths)]
    curved = (path.coefficients[:, :, 2:] != 0.0).any(axis=(1, 2))
    for first, last in itertools.pairwise(stops):
        begin, end = np.searchsorted(grid.pieces, [first, last])
        cells, points = slice(begin, end), slice(begin, end + 1)
        section = grid._replace(
            pieces=grid.pieces[cells], starts=grid.starts[cells], lengths=grid.lengths[cells]
        )
        ends = (end_speeds[0] if first == 0 else 0.0, end_speeds[1] if last == stops[-1] else 0.0)
        if effort is None and last == first + 1 and not curved[first] and not any(ends):
            slopes = np.abs(path.coefficients[first, :, 1])
            _typical_time(slopes * path.lengths[first], limits)
            with np.errstate(divide="ignore"):
                top, rate = (limits[0] / slopes).min() ** 2, (limits[1] / slopes).min()
            way = np.append(section.starts, path.lengths[first])
            squares[points] = np.minimum(top, 2.0 * rate * np.minimum(way, way[-1] - way))
            continue
        near = None if guess is None else guess[points]
        squares[points] = _Section(path, section, limits, ends, effort, near).solve()
    return squares


class _Section:
    """A path from stop to stop, at grid points, as the package asks for it.

    Its units are such that the package's fixed tolerances are small: with s = L sigma, t = T tau
    and joint positions divided by T^2 a, where a are the acceleration limits and T is about the
    duration, the path has length 1, the acceleration limits are 1, those of velocity v / (T a), and
    (ds/dt)^2 = (L / T)^2 (dsigma/dtau)^2.
    """

    def __init__(
        self,
        path: JointPath,
        grid: Cells,
        limits: Array,
        end_speeds: tuple[float, float],
        effort: EffortLimits | None,
        guess: Array | None,
    ) -> None:
        self._effort, self._guess, self._end_speeds = effort, guess, end_speeds
        places = np.concatenate([[0.0], np.cumsum(grid.lengths)])
        self._length, self._points = float(places[-1]), places / places[-1]
        self._derivatives = _at_points(path, grid)
        self.dof = path.n
        self.path_interval = np.array([0.0, 1.0])
        tangents = np.abs(self._derivatives[1]).max(axis=0) * self._length
        self._time = _typical_time(tangents, limits)
        self._units = self._time**2 * limits[1]
        # From rest, |dq/dt|^2 <= 2 a times the way that the joint goes.
        reached = np.sqrt(2.0 * tangents / self._units)
        velocity = limits[0] * self._time / self._units
        # Speeds that nothing but the acceleration limits is bounded by this many times what full
        # acceleration all the way leads to [-].
        self._velocity = np.minimum(velocity, 2.0 * reached + 1.0)

    def __call__(self, places: Array, order: int = 0) -> Array:
        """A derivative of q with respect to sigma, as the package asks for it: at all points."""
        assert np.array_equal(places, self._points)
        values: Array = self._derivatives[order] * self._length**order / self._units
        return values

    def get_duration(self) -> float:
        """The end of the path parameter, by the package's name for it."""
        return 1.0

    def solve(self) -> Array:
        """Squared speeds at the grid points.

        Raises:
            TimingFailed: The package failed.
        """
        unit = self._length / self._time
        start, end = (speed / unit for speed in self._end_speeds)
        try:
            with np.errstate(all="ignore"):
                solver = TOPPRA(self._constraints(), self, self._points, solver_wrapper="seidel")
                _, speeds, _ = solver.compute_parameterization(start, end)
        except (ToppraError, ValueError, AssertionError, ArithmeticError, IndexError) as error:
            raise TimingFailed(
                f"toppra failed on this path: {type(error).__name__}", hint=_HINT
            ) from None
        squares = np.zeros(0) if speeds is None else np.square(np.array(speeds, float) * unit)
        if speeds is None or not np.isfinite(squares).all() or not (squares[1:-1] > 0.0).all():
            raise TimingFailed("toppra found no timing of this path", hint=_HINT)
        return squares

    def _constraints(self) -> list[Any]:
        ones = np.ones(self.dof)
        constraints = [
            JointVelocityConstraint(np.column_stack([-self._velocity, self._velocity])),
            JointAccelerationConstraint(np.column_stack([-ones, ones])),
        ]
        if self._effort is not None:
            q, q1, q2 = self._derivatives
            found = knot_limits(self._effort, q, q1, q2, self._guess)
            unit = self._length / self._time
            # (a, b) of a u + b x <= 1 at the grid points, and caps of x.
            rows = found.rows[:, :, :2] * np.array([unit / self._time, unit**2])
            constraints.append(_EffortConstraint(rows, found.caps / unit**2))
        return constraints


class _EffortConstraint(LinearConstraint):
    """Rows a u + b x <= 1 and caps of x, at grid points."""

    def __init__(self, rows: Array, caps: Array) -> None:
        super().__init__()
        self.identical = True
        # A bound that is not there, as a number: the package's own value for it.
        self._rows, self._caps = rows, np.minimum(caps, 1e8)

    def compute_constraint_params(self, _path: Any, points: Array) -> tuple[Any, ...]:
        bounds = np.column_stack([np.zeros_like(self._caps), self._caps])
        a, b = self._rows[:, :, 0], self._rows[:, :, 1]
        width = a.shape[1]
        if width == 0:
            return None, None, None, None, None, None, bounds
        unit, ones = np.eye(width), np.ones(width)
        found = canlinear_colloc_to_interpolate(
            a, b, np.zeros_like(a), unit, ones, None, None, points, identical=True
        )
        return *found[:5], None, bounds


def _at_points(path: JointPath, grid: Cells) -> Array:
    """q, q' and q'' at the points of a grid, shape (3, N + 1, n); the larger q'' where it jumps."""
    c, starts = path.coefficients[grid.pieces], grid.starts
    first, last = (
        np.stack([piece_values(c, places, order) for order in range(3)])
        for places in (starts, starts + grid.lengths)
    )
    values = np.concatenate([first, last[:, -1:]], axis=1)
    before, after = last[2, :-1], first[2, 1:]
    larger = np.linalg.norm(before, axis=1) > np.linalg.norm(after, axis=1)
    values[2, 1:-1][larger] = before[larger]
    return values


def _typical_time(tangents: Array, limits: Array) -> float:
    """About how long a section takes [s]: by its speeds, and by its accelerations.

    Raises:
        TimingFailed: It is not a finite positive number.
    """
    with np.errstate(all="ignore"):
        time = float((tangents / limits[0]).max() + np.sqrt((tangents / limits[1]).max()))
        units = np.square(time) * limits[1]
    if not (0.0 < time < np.inf and np.isfinite(units).all() and (units > 0.0).all()):
        raise TimingFailed(
            "toppra can't time this path: speeds along it are out of range", hint=_HINT
        )
    return time
