"""Corners of a hull that can be its farthest one: a short list for each cell of directions.

The directions are cut into cells of the faces of a cube. Over the cell of directions (1, u, v)
with u and v in intervals, how much farther one corner reaches than another is affine in u and v, so
a corner that another one beats at the four ends of the cell is never the farthest in it. What
is left is kept. The farthest corner found among them is the farthest of all: nothing is guessed,
unlike walking from corner to corner, which may stop on a face that is not quite flat.
"""

import numpy as np
from numpy.typing import NDArray

from compiled.kernel import kernel
from kinematics.arrays import Array

Lists = NDArray[np.int32]

#: Cells along an edge of the cube: lists of three to six corners for hulls of a hundred.
SIDE = 8
CELLS = 6 * SIDE * SIDE
#: Fewer corners than this are looked through as fast as a list is found.
LEAST_CORNERS = 13
#: Corners within this [m] of each other in reach are both kept: rounding must not choose.
_TIE = 1e-12


@kernel(allocates=False)
def cell_of(x: float, y: float, z: float) -> int:
    """The cell that a direction lies in; 0 for a direction of no length."""
    ax, ay, az = abs(x), abs(y), abs(z)
    if ax >= ay and ax >= az:
        major, u, v, face = ax, y, z, (0 if x >= 0.0 else 1)
    elif ay >= az:
        major, u, v, face = ay, z, x, (2 if y >= 0.0 else 3)
    else:
        major, u, v, face = az, x, y, (4 if z >= 0.0 else 5)
    if not major > 0.0:
        return 0
    scale = 0.5 * SIDE / major
    column = min(int(u * scale + 0.5 * SIDE), SIDE - 1)
    row = min(int(v * scale + 0.5 * SIDE), SIDE - 1)
    return (face * SIDE + row) * SIDE + column


@kernel(allocates=False)
def _direction(face: int, u: float, v: float) -> tuple[float, float, float]:
    sign = 1.0 if face % 2 == 0 else -1.0
    if face < 2:
        return sign, u, v
    if face < 4:
        return v, sign, u
    return u, v, sign


@kernel
def _fill(corners: Array, starts: Lists, lists: Lists) -> int:
    """Write the lists of all cells one behind the other; how long they are together."""
    count = corners.shape[0]
    reach, best = np.empty((4, count)), np.empty(4, dtype=np.int64)
    size = 0
    for cell in range(CELLS):
        face, row, column = cell // (SIDE * SIDE), cell // SIDE % SIDE, cell % SIDE
        for end in range(4):
            # A hair wider than the cell, for what lies on its rim.
            u = 2.0 * (column + end % 2) / SIDE - 1.0 + (1e-9 if end % 2 else -1e-9)
            v = 2.0 * (row + end // 2) / SIDE - 1.0 + (1e-9 if end // 2 else -1e-9)
            x, y, z = _direction(face, u, v)
            for k in range(count):
                reach[end, k] = x * corners[k, 0] + y * corners[k, 1] + z * corners[k, 2]
            best[end] = int(np.argmax(reach[end]))
        starts[cell] = size
        middle = int(np.argmax(reach[0] + reach[1] + reach[2] + reach[3]))
        for k in range(count):
            beaten = False
            for rival in (best[0], best[1], best[2], best[3], middle):
                lost = 0
                for end in range(4):
                    lost += reach[end, rival] > reach[end, k] + _TIE
                beaten |= lost == 4
            if not beaten:
                lists[size] = k
                size += 1
    starts[CELLS] = size
    return size


def support_table(corners: Array) -> Lists:
    """Index of each cell's list of corners in the table itself, and behind that the lists."""
    starts = np.empty(CELLS + 1, dtype=np.int32)
    lists = np.empty(CELLS * len(corners), dtype=np.int32)
    size = _fill(np.ascontiguousarray(corners), starts, lists)
    return np.concatenate([starts + np.int32(CELLS + 1), lists[:size]])
