"""Entries of a cell of time of which a tool's deviation is bounded, and the pose it is to have."""

import math

from compiled.kernel import kernel
from kinematics.arrays import Array
from planning.tool_motions.tool_motion import AXIS, ROTATION, TURN

# Entries of a cell's state.
#: Deviation of the position in the cell's middle [m].
CELL_POSITION = 0
#: Deviation of the orientation in the cell's middle [rad].
CELL_ORIENTATION = 1
#: Bound of the position's deviation all over the cell [m].
CELL_POSITION_BOUND = 2
#: Bound of the orientation's deviation all over the cell [rad].
CELL_ORIENTATION_BOUND = 3
#: Bound of the tool's acceleration [m/s^2].
CELL_ACCELERATION = 4
#: Bound of the tool's angular acceleration [rad/s^2].
CELL_ANGULAR = 5
#: Angle in the middle of the last cell, which tells this one's whole turns [rad].
CELL_ANGLE = 6
#: Place on the motion, from 0 to 1.
CELL_PLACE = 7
#: Rate of the place [1/s].
CELL_PACE = 8
#: Bound of the rate's change [1/s^2].
CELL_PACE_CHANGE = 9
CELL_SIZE = 10


@kernel(allocates=False)
def norm(a: float, b: float, c: float) -> float:
    """Length of (a, b, c)."""
    return math.sqrt(a * a + b * b + c * c)


@kernel
def farthest(e: Array, rate: Array, h: float) -> float:
    """The larger of |e + h e'| and |e - h e'|."""
    plus, minus = 0.0, 0.0
    for k in range(3):
        plus += (e[k] + h * rate[k]) ** 2
        minus += (e[k] - h * rate[k]) ** 2
    return math.sqrt(max(plus, minus))


@kernel(allocates=False)
def nominal_kernel(m: Array, s: float, R: Array) -> None:
    """Write exp(s theta [a]) R_0 of a motion's numbers into R (3, 3)."""
    angle = s * m[TURN]
    c, v = math.cos(angle), math.sin(angle)
    for column in range(3):
        x, y, z = m[ROTATION + column], m[ROTATION + 3 + column], m[ROTATION + 6 + column]
        along = (m[AXIS] * x + m[AXIS + 1] * y + m[AXIS + 2] * z) * (1.0 - c)
        R[0, column] = c * x + v * (m[AXIS + 1] * z - m[AXIS + 2] * y) + along * m[AXIS]
        R[1, column] = c * y + v * (m[AXIS + 2] * x - m[AXIS] * z) + along * m[AXIS + 1]
        R[2, column] = c * z + v * (m[AXIS] * y - m[AXIS + 1] * x) + along * m[AXIS + 2]


@kernel(allocates=False)
def angle_between(A: Array, B: Array) -> float:
    """Angle of A^T B, (3, 3) each, from |A - B| = 2 sqrt(2) sin(angle / 2): exact where small."""
    square = 0.0
    for i in range(3):
        for j in range(3):
            square += (A[i, j] - B[i, j]) ** 2
    return 2.0 * math.asin(min(1.0, math.sqrt(square / 8.0)))
