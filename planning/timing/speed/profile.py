"""From squared speeds on a grid to exact polynomials of time.

Within a cell the path acceleration is constant, so s(t) is quadratic, and q(s(t)) on a path of
degree d is a polynomial of degree 2 d: its coefficients are computed, nothing is fitted.
"""

import numpy as np
from numpy.typing import NDArray

from compiled.kernel import kernel
from kinematics.arrays import Array
from kinematics.trajectory.polynomial import shift_kernel
from planning.timing.path.path import JointPath, compose_kernel
from planning.timing.speed.constraints import Cells

# A phase of a straight cell (speeding up, cruising, slowing down) that changes x by a smaller part,
# or leaves a smaller part of the length, is joined to its neighbour, which then runs at a hair
# less than the limit.
_LEAST_PHASE = 1e-9


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
    size = path.coefficients.shape[2]
    phases = np.empty((room, 4))
    owners = np.empty(room, dtype=np.int64)
    geometry = np.column_stack([cells.starts, cells.lengths, squares[:-1], squares[1:]])
    slopes = path.coefficients[:, :, 1]
    count = phases_kernel(slopes, cells.pieces, cells.straight, geometry, limits, phases, owners)
    durations = np.empty(count)
    coefficients = np.zeros((count, path.n, 2 * size - 1))
    work = np.empty((2, 2 * size - 1))
    c = path.coefficients
    compose_pieces_kernel(c, owners[:count], phases[:count], work, durations, coefficients)
    return durations, coefficients


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
    least = _LEAST_PHASE * length
    # A phase that changes the speed by next to nothing, or leaves no room for another, is none.
    rises = peak - x0 > _LEAST_PHASE * peak and length - rising > least
    falls = peak - x1 > _LEAST_PHASE * peak and length - falling > least
    used = 0
    if rises:
        inner[used, 0], inner[used, 1] = rising, peak
        used += 1
    if falls and (cruise > least or not rises):
        inner[used, 0], inner[used, 1] = length - falling, peak
        used += 1
    return used


@kernel
def compose_pieces_kernel(
    coefficients: Array,
    owners: NDArray[np.int64],
    phases: Array,
    work: Array,
    durations: Array,
    out: Array,
) -> None:
    """Write the duration of each phase and the coefficients of q(s(t)); ``out`` comes as zeros."""
    n, size = coefficients.shape[1:]
    shifted, product, inner = work[0, :size], work[1], np.empty(2)
    for i in range(owners.shape[0]):
        start, length, v0, v1 = phases[i]
        duration = 2.0 * length / (v0 + v1)
        half = 0.5 * (v1 - v0) / duration
        durations[i] = duration
        inner[0], inner[1] = v0, half
        for j in range(n):
            shift_kernel(coefficients[owners[i], j], start, shifted)
            compose_kernel(shifted, size - 1, inner, product, out[i, j])
