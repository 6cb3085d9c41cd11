"""Bounds of a tracked motion over intervals of time, from the integrator's dense output.

The time axis is cut into equal cells. Within a step of the integrator every joint is a polynomial
of time, and so is its reference. About the middle of what a step and a cell have in common,

    |p(m + r w) - c_0| <= sum_(k >= 1) |c_k| r^k    for |w| <= 1,

so that no value between two samples or two steps is missed.
"""

import math
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from compiled.kernel import kernel
from kinematics.arrays import Array
from kinematics.trajectory.polynomial import shift_kernel

#: Length of a cell [s]: the tracking error of an arm hardly changes within it.
_CELL = 1e-3
#: Fewest cells, so that short motions are resolved alike.
_FEWEST_CELLS = 1000
#: Most cells, so that long motions do not fill the memory.
_MOST_CELLS = 20_000
#: Coefficients of a step's dense output: degree 7 of the explicit method, 3 of the implicit one.
STEP_COEFFICIENTS = 8


#: Chebyshev points of a step, both its ends among them, at which torques are computed.
NODES = 7
#: Their parts of the step.
SHARES = 0.5 - 0.5 * np.cos(np.pi * np.arange(NODES) / (NODES - 1))


def _chebyshev_matrix() -> Array:
    """Values at the points to coefficients of Chebyshev polynomials, shape (NODES, NODES)."""
    angles = np.pi * np.arange(NODES) / (NODES - 1)
    values = np.cos(np.outer(np.pi - angles, np.arange(NODES)))
    return np.asarray(np.linalg.inv(values))


_CHEBYSHEV = _chebyshev_matrix()


class Quantity(IntEnum):
    """Rows of a cell in ``MotionBounds``."""

    #: The tracking error q^r - q.
    ERROR = 0
    POSITION = 1
    VELOCITY = 2


# Kernels index with plain integers: members of an enum are another type each.
_ERROR = int(Quantity.ERROR)
_POSITION = int(Quantity.POSITION)
_VELOCITY = int(Quantity.VELOCITY)


class MotionBounds(NamedTuple):
    """Least and largest values of a tracked motion in every cell of time (m cells, n joints).

    Args:
        cell: Length of a cell [s].
        lower: Least values by cell, ``Quantity`` and joint, shape (m, 3, n); inf in cells never
            reached.
        upper: Largest values, likewise; -inf in cells never reached.
        global_error: Largest error of the integrator in positions and velocities, its local error
            estimates carried along the loop, shape (2, n) [rad or m, rad/s or m/s].
        peak_torque: Largest |torque| at any instant, shape (n,) [N m or N].
    """

    cell: float
    lower: Array
    upper: Array
    global_error: Array
    peak_torque: Array

    @property
    def has_cells(self) -> bool:
        """Whether there is a row for each cell of time, not one for the whole motion."""
        return len(self.lower) > 1

    @property
    def max_error(self) -> Array:
        """Largest tracking error of each joint in any cell, shape (n,) [rad or m]."""
        low, high = self.lower[:, Quantity.ERROR], self.upper[:, Quantity.ERROR]
        size = np.where(low <= high, np.maximum(-low, high), 0.0)
        return np.asarray(size.max(axis=0))

    def visited_cells(self) -> NDArray[np.int64]:
        """Indices of the cells that the motion reached, shape (k,)."""
        rows = (self.lower <= self.upper).all(axis=(1, 2))
        return np.flatnonzero(rows)


def empty_bounds(duration: float, n: int, *, has_cells: bool = True) -> MotionBounds:
    """Bounds of a motion of n joints over ``duration`` [s], to be filled step by step.

    Args:
        duration: [s].
        n: Number of joints.
        has_cells: Whether every cell of time has a row, or one row holds for the whole motion.
    """
    count = min(max(math.ceil(duration / _CELL), _FEWEST_CELLS), _MOST_CELLS)
    shape = (count if has_cells else 1, len(Quantity), n)
    return MotionBounds(
        duration / count,
        np.full(shape, np.inf),
        np.full(shape, -np.inf),
        np.zeros((2, n)),
        np.zeros(n),
    )


@kernel(allocates=False)
def center_polynomial(c: Array, middle: float, radius: float, out: Array) -> None:
    """Write the coefficients of p(middle + radius w) in powers of w into out (k,), from c (k,)."""
    count = c.shape[0]
    shift_kernel(c, middle, out)
    power = 1.0
    for k in range(count):
        out[k] *= power
        power *= radius


@kernel(allocates=False)
def note_range(bounds: MotionBounds, cell: int, quantity: int, joint: int, c: Array) -> None:
    """Widen the bounds of a cell to those of sum_k c_k w^k, |w| <= 1."""
    spread = 0.0
    for k in range(1, c.shape[0]):
        spread += abs(c[k])
    lower, upper = bounds.lower[cell, quantity], bounds.upper[cell, quantity]
    lower[joint] = min(lower[joint], c[0] - spread)
    upper[joint] = max(upper[joint], c[0] + spread)


@kernel
def is_within(
    bounds: MotionBounds, reference: Array, start: float, motion: Array, t: float, h: float
) -> bool:
    """Whether a whole step stays within the bounds of the only row; arguments as ``bound_step``."""
    n = bounds.lower.shape[2]
    size = max(reference.shape[1], motion.shape[1])
    joint, wanted = np.empty(motion.shape[1]), np.empty(reference.shape[1])
    for i in range(n):
        for quantity in (_VELOCITY, _POSITION, _ERROR):
            source = motion[n + i] if quantity == _VELOCITY else motion[i]
            center_polynomial(source, 0.5, 0.5, joint)
            if quantity == _ERROR:
                center_polynomial(reference[i], t + 0.5 * h - start, 0.5 * h, wanted)
            spread, middle = 0.0, 0.0
            for k in range(size):
                c = joint[k] if k < joint.shape[0] else 0.0
                if quantity == _ERROR:
                    c = (wanted[k] if k < wanted.shape[0] else 0.0) - c
                if k == 0:
                    middle = c
                else:
                    spread += abs(c)
            low, high = bounds.lower[0, quantity, i], bounds.upper[0, quantity, i]
            if middle - spread < low or middle + spread > high:
                return False
    return True


@kernel
def bound_step(
    bounds: MotionBounds, reference: Array, start: float, motion: Array, t: float, h: float
) -> None:
    """Widen the bounds of all cells that a step of length h from time t passes through.

    Args:
        bounds: The bounds.
        reference: Coefficients of the reference's piece, shape (n, k), in powers of time [s].
        start: Begin of this piece [s].
        motion: Coefficients of positions and velocities over the step, shape (2 n, 8), in powers
            of the part of the step that has passed.
        t: Begin of the step [s].
        h: Length of the step [s].
    """
    n, m = bounds.lower.shape[2], bounds.lower.shape[0]
    size = max(reference.shape[1], motion.shape[1])
    joint, wanted, error = np.empty(motion.shape[1]), np.empty(reference.shape[1]), np.empty(size)
    first, last = int(t / bounds.cell), int((t + h) / bounds.cell)
    if m == 1 and is_within(bounds, reference, start, motion, t, h):
        return
    if m > 1:
        first, last = min(max(first, 0), m - 1), min(max(last, 0), m - 1)
    for cell in range(first, last + 1):
        row = cell if m > 1 else 0
        low = t if cell == first else cell * bounds.cell
        high = t + h if cell == last else (cell + 1) * bounds.cell
        middle, radius = 0.5 * (low + high), 0.5 * (high - low)
        for i in range(n):
            center_polynomial(motion[n + i], (middle - t) / h, radius / h, joint)
            note_range(bounds, row, _VELOCITY, i, joint)
            center_polynomial(motion[i], (middle - t) / h, radius / h, joint)
            note_range(bounds, row, _POSITION, i, joint)
            center_polynomial(reference[i], middle - start, radius, wanted)
            for k in range(size):
                error[k] = wanted[k] if k < wanted.shape[0] else 0.0
                error[k] -= joint[k] if k < joint.shape[0] else 0.0
            note_range(bounds, row, _ERROR, i, error)


@kernel(allocates=False)
def hermite_polynomials(
    before: Array, after: Array, h: float, x: Array, end: Array, out: Array
) -> None:
    """Write the quintic of positions and the cubic of velocities through the ends of a step.

    Args:
        before: Rate of the state at the start of the step, shape (N,).
        after: Rate at its end, shape (N,).
        h: Length of the step [s].
        x: State at the start, shape (N,).
        end: State at the end, shape (N,).
        out: Coefficients in powers of the part of the step that has passed, shape (2 n, 8).
    """
    n = out.shape[0] // 2
    for i in range(n):
        p, v = out[i], out[n + i]
        for k in range(out.shape[1]):
            p[k], v[k] = 0.0, 0.0
        start, slope = h * x[n + i], h * h * before[n + i]
        p[0], p[1], p[2] = x[i], start, 0.5 * slope
        gap = end[i] - x[i] - start - 0.5 * slope
        rise = h * end[n + i] - start - slope
        bend = h * h * after[n + i] - slope
        p[3] = 10.0 * gap - 4.0 * rise + 0.5 * bend
        p[4] = -15.0 * gap + 7.0 * rise - bend
        p[5] = 6.0 * gap - 3.0 * rise + 0.5 * bend
        change = end[n + i] - x[n + i]
        first, last = h * before[n + i], h * after[n + i]
        v[0], v[1] = x[n + i], first
        v[2] = 3.0 * change - 2.0 * first - last
        v[3] = first + last - 2.0 * change


@kernel(allocates=False)
def raise_peaks(torques: Array, limit: Array, peaks: Array) -> None:
    """Raise the largest |torque| to a bound over a step, by its Chebyshev polynomial.

    |T_k| <= 1, so that the sum of all |coefficients| bounds the polynomial; the last two are
    counted twice, for the terms that come after them.

    Args:
        torques: Torques at ``SHARES`` of the step, shape (NODES, n) [N m or N].
        limit: Torques that they are cut off at, shape (n,).
        peaks: Largest so far, shape (n,).
    """
    for i in range(limit.shape[0]):
        total = 0.0
        for k in range(NODES):
            c = 0.0
            for j in range(NODES):
                c += _CHEBYSHEV[k, j] * torques[j, i]
            total += abs(c) if k < NODES - 2 else 2.0 * abs(c)
        peaks[i] = max(peaks[i], min(total, limit[i]))
