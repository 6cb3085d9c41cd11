"""How far a point is from a piece: with a ball's radius taken off, the ball's own signed distance.

Closed forms for balls, boxes, cylinders, cones, half-spaces and capsules, exact inside and outside.
A polytope's box bounds its distance from below; the distance itself takes an iteration.
"""

import math

import numpy as np

from compiled.kernel import kernel
from compiled.vec3 import dot, row, subtract
from kinematics.arrays import Array
from obstacles.convex.closest_point import nearest_on_cone, nearest_on_segment
from obstacles.distance.piece_set import (
    HALF,
    KIND,
    MIDDLE,
    POSE,
    ROUNDING,
    SIZE,
    START,
    STOP,
    CoreKind,
)

_POLYTOPE = int(CoreKind.POLYTOPE)
_CYLINDER = int(CoreKind.CYLINDER)
_CONE = int(CoreKind.CONE)
_HALFSPACE = int(CoreKind.HALFSPACE)
_BOX = int(CoreKind.BOX)
_TABLED = int(CoreKind.TABLED)
_POINT = int(CoreKind.POINT)


@kernel(allocates=False)
def closed_form(rows: Array, k: int) -> bool:
    """Whether ``bound_from`` is the distance itself: of all but polytopes that are no box."""
    kind = rows[k, KIND]
    return bool(kind != _TABLED and (kind != _POLYTOPE or rows[k, STOP] - rows[k, START] == 2.0))


@kernel(allocates=False, inline="always")
def bound_from(rows: Array, k: int, corners: Array, x: float, y: float, z: float) -> float:
    """Signed distance of a point from piece k [m]; from the box around a polytope.

    Args:
        rows: Rows of a ``PieceSet``.
        k: One of them.
        corners: Theirs.
        x: Coordinate x of the point, in the frame the rows' poses map into [m].
        y: Coordinate y of the point [m].
        z: Coordinate z of the point [m].
    """
    a, b, c = x - rows[k, POSE + 3], y - rows[k, POSE + 7], z - rows[k, POSE + 11]
    if rows[k, KIND] == _POINT:
        return float(math.sqrt(a * a + b * b + c * c) - rows[k, ROUNDING])
    u = rows[k, POSE] * a + rows[k, POSE + 4] * b + rows[k, POSE + 8] * c
    v = rows[k, POSE + 1] * a + rows[k, POSE + 5] * b + rows[k, POSE + 9] * c
    w = rows[k, POSE + 2] * a + rows[k, POSE + 6] * b + rows[k, POSE + 10] * c
    if rows[k, KIND] < _BOX:
        return from_core(rows, k, corners, u, v, w)
    u = abs(u - rows[k, MIDDLE]) - rows[k, HALF]
    v = abs(v - rows[k, MIDDLE + 1]) - rows[k, HALF + 1]
    w = abs(w - rows[k, MIDDLE + 2]) - rows[k, HALF + 2]
    deepest = max(u, v, w)
    if deepest <= 0.0:
        return float(deepest)
    u, v, w = max(u, 0.0), max(v, 0.0), max(w, 0.0)
    return math.sqrt(u * u + v * v + w * w)


@kernel(allocates=False)
def from_core(rows: Array, k: int, corners: Array, x: float, y: float, z: float) -> float:
    """``bound_from`` of the rarer kinds, the point in the frame of the piece."""
    kind, rounding = rows[k, KIND], rows[k, ROUNDING]
    if kind == _HALFSPACE:
        return float(z)
    if kind == _CYLINDER:
        across, along = math.sqrt(x * x + y * y) - rows[k, SIZE], abs(z) - rows[k, SIZE + 1]
        return float(_outside(across, along, -np.inf) - rounding)
    if kind == _CONE:
        return float(nearest_on_cone((x, y, z), rows[k, SIZE], rows[k, SIZE + 1])[3] - rounding)
    if rows[k, STOP] - rows[k, START] == 2.0:
        first, p = int(rows[k, START]), (x, y, z)
        gap = subtract(p, nearest_on_segment(p, row(corners, first), row(corners, first + 1)))
        return float(math.sqrt(dot(gap, gap)) - rounding)
    return _outside(
        abs(x - rows[k, MIDDLE]) - rows[k, HALF],
        abs(y - rows[k, MIDDLE + 1]) - rows[k, HALF + 1],
        abs(z - rows[k, MIDDLE + 2]) - rows[k, HALF + 2],
    )


@kernel(allocates=False, inline="always")
def _outside(a: float, b: float, c: float) -> float:
    """How far out is what is a, b and c beyond three planes at right angles; -inf for no plane."""
    deepest = max(a, b, c)
    if deepest <= 0.0:
        return deepest
    a, b, c = max(a, 0.0), max(b, 0.0), max(c, 0.0)
    return math.sqrt(a * a + b * b + c * c)
