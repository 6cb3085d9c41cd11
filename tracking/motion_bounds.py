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

from kinematics.arrays import Array
from kinematics.compiled.kernel import kernel

#: Length of a cell [s]: the tracking error of an arm hardly changes within it.
_CELL = 1e-3
#: Fewest cells, so that short motions are resolved alike.
_FEWEST_CELLS = 1000
#: Most cells, so that long motions do not fill the memory.
_MOST_CELLS = 20_000
#: Coefficients of a step's dense output: degree 7 of the explicit method, 3 of the implicit one.
STEP_COEFFICIENTS = 8


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
        lower: By cell, ``Quantity`` and joint, shape (m, 3, n); inf in cells never reached.
        upper: Likewise; -inf in cells never reached.
        local_error: Sum of the integrator's error estimates over all steps, shape (n,) [rad or m].
        peak_torque: Largest |torque| at any step of the integrator, shape (n,) [N m or N].
    """

    cell: float
    lower: Array
    upper: Array
    local_error: Array
    peak_torque: Array

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


def empty_bounds(duration: float, n: int) -> MotionBounds:
    """Bounds of a motion of n joints over ``duration`` [s], to be filled step by step."""
    count = min(max(math.ceil(duration / _CELL), _FEWEST_CELLS), _MOST_CELLS)
    shape = (count, len(Quantity), n)
    return MotionBounds(
        duration / count,
        np.full(shape, np.inf),
        np.full(shape, -np.inf),
        np.zeros(n),
        np.zeros(n),
    )


@kernel
def center_polynomial(c: Array, middle: float, radius: float, out: Array) -> None:
    """Write the coefficients of p(middle + radius w) in powers of w into out (k,), from c (k,)."""
    count = c.shape[0]
    for k in range(count):
        out[k] = c[k]
    for k in range(count - 1):
        for j in range(count - 2, k - 1, -1):
            out[j] += middle * out[j + 1]
    power = 1.0
    for k in range(count):
        out[k] *= power
        power *= radius


@kernel
def note_range(bounds: MotionBounds, cell: int, quantity: int, joint: int, c: Array) -> None:
    """Widen the bounds of a cell to those of sum_k c_k w^k, |w| <= 1."""
    spread = 0.0
    for k in range(1, c.shape[0]):
        spread += abs(c[k])
    lower, upper = bounds.lower[cell, quantity], bounds.upper[cell, quantity]
    lower[joint] = min(lower[joint], c[0] - spread)
    upper[joint] = max(upper[joint], c[0] + spread)


@kernel
def bound_step(
    bounds: MotionBounds, reference: Array, start: float, motion: Array, t: float, h: float
) -> None:
    """Widen the bounds of all cells that a step of length h from time t passes through.

    Args:
        bounds: The bounds.
        reference: Coefficients of the reference's piece, shape (n, k), in powers of time [s].
        start: When this piece begins [s].
        motion: Coefficients of positions and velocities over the step, shape (2 n, 8), in powers
            of the part of the step that has passed.
        t: When the step begins [s].
        h: Its length [s].
    """
    n, m = bounds.lower.shape[2], bounds.lower.shape[0]
    size = max(reference.shape[1], motion.shape[1])
    joint, wanted, error = np.empty(motion.shape[1]), np.empty(reference.shape[1]), np.empty(size)
    first = min(max(int(t / bounds.cell), 0), m - 1)
    last = min(max(int((t + h) / bounds.cell), 0), m - 1)
    for cell in range(first, last + 1):
        low = t if cell == first else cell * bounds.cell
        high = t + h if cell == last else (cell + 1) * bounds.cell
        middle, radius = 0.5 * (low + high), 0.5 * (high - low)
        for i in range(n):
            center_polynomial(motion[n + i], (middle - t) / h, radius / h, joint)
            note_range(bounds, cell, _VELOCITY, i, joint)
            center_polynomial(motion[i], (middle - t) / h, radius / h, joint)
            note_range(bounds, cell, _POSITION, i, joint)
            center_polynomial(reference[i], middle - start, radius, wanted)
            for k in range(size):
                error[k] = wanted[k] if k < wanted.shape[0] else 0.0
                error[k] -= joint[k] if k < joint.shape[0] else 0.0
            note_range(bounds, cell, _ERROR, i, error)
