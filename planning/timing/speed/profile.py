"""From squared speeds on a grid to exact polynomials of time.

Within a cell the path acceleration is constant, so s(t) is quadratic, and q(s(t)) on a path of
degree d is a polynomial of degree 2 d: its coefficients are computed, nothing is fitted.
"""

import numpy as np
from numpy.typing import NDArray

from compiled.kernel import kernel
from kinematics.arrays import Array
from planning.timing.path.path import JointPath, composed_pieces
from planning.timing.speed.constraints import Cells


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
    return durations, composed_pieces(path, owners[:count], rows, 2)


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
