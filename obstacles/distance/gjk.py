"""Distance between two convex pieces, with a bound that holds at every iteration.

The Gilbert-Johnson-Keerthi iteration walks towards the point of A - B nearest to the origin. For
any direction v, the support w of A - B along -v gives a separating plane, so

    v . w / |v|  <=  distance(A, B)  <=  |v|

holds whenever it is stopped. A caller that only asks "farther than this?" is answered after one
or two supports; nothing has to converge for an answer to be proved.
Source: "A fast procedure for computing the distance between complex objects in
three-dimensional space", IEEE Journal on Robotics and Automation, 1988.
"""

import math

import numpy as np

from compiled.kernel import kernel
from compiled.vec3 import Vector, cross, dot, row, store, subtract
from kinematics.arrays import Array
from obstacles.distance.piece_set import (
    KIND,
    POSE,
    ROUNDING,
    SIZE,
    START,
    STOP,
    TABLE,
    CoreKind,
    Lists,
    Pair,
    cell_of,
)

FARTHER = 0
BETWEEN = 1
CLOSER = 2

_POLYTOPE = int(CoreKind.POLYTOPE)
_CYLINDER = int(CoreKind.CYLINDER)
_HALFSPACE = int(CoreKind.HALFSPACE)
_BOX = int(CoreKind.BOX)
_TABLED = int(CoreKind.TABLED)
_POINT = int(CoreKind.POINT)
_MAX_ITERATIONS = 60
#: Relative gap between the bounds at which the distance counts as found.
_GAP = 1e-10
#: A distance between the thresholds is known well enough with this share of it proved.
_KNOWN = 0.8
#: A core distance below this [m] is contact: the digits left hold no more.
_CONTACT = 1e-12

#: The motion of one body seen from another around a configuration: by how much its ball's centre is
#: displaced (3) and how far it turns (3), both to first order, the ball's radius, what the first
#: order leaves out at most, and the most that any point moves [m, rad].
Drift = tuple[float, float, float, float, float, float, float, float, float]
STILL = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@kernel(allocates=False, inline="always")
def _farthest(rows: Array, i: int, corners: Array, tables: Lists, d: Vector) -> Vector:
    """The corner of a polytope that is farthest along ``d``."""
    start = int(rows[i, START])
    best, corner = -np.inf, start
    if rows[i, KIND] == _TABLED:
        table = int(rows[i, TABLE])
        cell = table + cell_of(d[0], d[1], d[2])
        for entry in range(table + tables[cell], table + tables[cell + 1]):
            k = start + tables[entry]
            value = corners[k, 0] * d[0] + corners[k, 1] * d[1] + corners[k, 2] * d[2]
            if value > best:
                best, corner = value, k
    else:
        for k in range(start, int(rows[i, STOP])):
            value = corners[k, 0] * d[0] + corners[k, 1] * d[1] + corners[k, 2] * d[2]
            if value > best:
                best, corner = value, k
    return corners[corner, 0], corners[corner, 1], corners[corner, 2]


@kernel(allocates=False, inline="always")
def _round_support(kind: float, radius: float, half: float, d: Vector) -> Vector:
    radial = math.sqrt(d[0] * d[0] + d[1] * d[1])
    x, y = 0.0, 0.0
    if radial > 0.0:
        x, y = radius * d[0] / radial, radius * d[1] / radial
    if kind == _CYLINDER:
        return x, y, (half if d[2] >= 0.0 else -half)
    if d[2] * half >= radius * radial - d[2] * half:
        return 0.0, 0.0, half
    return x, y, -half


@kernel(allocates=False)
def support(rows: Array, i: int, corners: Array, tables: Lists, d: Vector) -> Vector:
    """Farthest point of the core of piece i along ``d``, in the frame that its pose maps into."""
    T = POSE
    kind = rows[i, KIND]
    if kind == _POINT:
        return rows[i, T + 3], rows[i, T + 7], rows[i, T + 11]
    x = rows[i, T] * d[0] + rows[i, T + 4] * d[1] + rows[i, T + 8] * d[2]
    y = rows[i, T + 1] * d[0] + rows[i, T + 5] * d[1] + rows[i, T + 9] * d[2]
    z = rows[i, T + 2] * d[0] + rows[i, T + 6] * d[1] + rows[i, T + 10] * d[2]
    if kind == _BOX:
        p = (
            rows[i, SIZE] if x >= 0.0 else -rows[i, SIZE],
            rows[i, SIZE + 1] if y >= 0.0 else -rows[i, SIZE + 1],
            rows[i, SIZE + 2] if z >= 0.0 else -rows[i, SIZE + 2],
        )
    elif kind in (_TABLED, _POLYTOPE):
        p = _farthest(rows, i, corners, tables, (x, y, z))
    else:
        p = _round_support(kind, rows[i, SIZE], rows[i, SIZE + 1], (x, y, z))
    return (
        rows[i, T] * p[0] + rows[i, T + 1] * p[1] + rows[i, T + 2] * p[2] + rows[i, T + 3],
        rows[i, T + 4] * p[0] + rows[i, T + 5] * p[1] + rows[i, T + 6] * p[2] + rows[i, T + 7],
        rows[i, T + 8] * p[0] + rows[i, T + 9] * p[1] + rows[i, T + 10] * p[2] + rows[i, T + 11],
    )


@kernel(allocates=False)
def nearest_on_segment(a: Vector, b: Vector, S: Array) -> tuple[Vector, int]:
    """Point of segment ab nearest to the origin; the corners it needs are left in S."""
    ab = subtract(b, a)
    length = dot(ab, ab)
    t = -dot(a, ab)
    if t <= 0.0 or length == 0.0:
        store(S[0], 0, a)
        return a, 1
    if t >= length:
        store(S[0], 0, b)
        return b, 1
    t /= length
    store(S[0], 0, a)
    store(S[1], 0, b)
    return (a[0] + t * ab[0], a[1] + t * ab[1], a[2] + t * ab[2]), 2


@kernel(allocates=False)
def nearest_on_triangle(a: Vector, b: Vector, c: Vector, S: Array) -> tuple[Vector, int]:
    """Point of triangle abc nearest to the origin; the corners it needs are left in S.

    By the regions of the corners, edges and face ("Real-time collision detection", 5.1.5).
    """
    ab, ac = subtract(b, a), subtract(c, a)
    d1, d2 = -dot(ab, a), -dot(ac, a)
    if d1 <= 0.0 and d2 <= 0.0:
        store(S[0], 0, a)
        return a, 1
    d3, d4 = -dot(ab, b), -dot(ac, b)
    if d3 >= 0.0 and d4 <= d3:
        store(S[0], 0, b)
        return b, 1
    d5, d6 = -dot(ab, c), -dot(ac, c)
    if d6 >= 0.0 and d5 <= d6:
        store(S[0], 0, c)
        return c, 1
    vc = d1 * d4 - d3 * d2
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        return nearest_on_segment(a, b, S)
    vb = d5 * d2 - d1 * d6
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        return nearest_on_segment(a, c, S)
    va = d3 * d6 - d5 * d4
    if va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        return nearest_on_segment(b, c, S)
    total = va + vb + vc
    if total <= 0.0:
        # A sliver without area: the longest edge stands for it.
        return nearest_on_segment(a, b if dot(ab, ab) > dot(ac, ac) else c, S)
    v, w = vb / total, vc / total
    store(S[0], 0, a)
    store(S[1], 0, b)
    store(S[2], 0, c)
    return (
        a[0] + ab[0] * v + ac[0] * w,
        a[1] + ab[1] * v + ac[1] * w,
        a[2] + ab[2] * v + ac[2] * w,
    ), 3


@kernel(allocates=False, inline="always")
def _outside(a: Vector, b: Vector, c: Vector, opposite: Vector) -> bool:
    """Whether the origin is not strictly on the side of face abc where ``opposite`` is."""
    normal = cross(subtract(b, a), subtract(c, a))
    origin = -dot(a, normal)
    inside = dot(subtract(opposite, a), normal)
    return origin * inside <= 0.0


@kernel(allocates=False)
def nearest_on_tetrahedron(S: Array, scratch: Array, apart: bool) -> tuple[Vector, int]:
    """Point of the tetrahedron in S nearest to the origin; 4 corners: the origin is inside.

    Of a nearly flat one the sides are unknown; where a plane has shown that the origin is
    outside (``apart``), all faces are checked.
    """
    a, b, c, d = row(S, 0), row(S, 1), row(S, 2), row(S, 3)
    best, count = np.inf, 4
    nearest = (0.0, 0.0, 0.0)
    for face in range(4):
        if face == 0:
            p, q, r, o = a, b, c, d
        elif face == 1:
            p, q, r, o = a, c, d, b
        elif face == 2:
            p, q, r, o = a, d, b, c
        else:
            p, q, r, o = b, d, c, a
        if not (apart or _outside(p, q, r, o)):
            continue
        v, k = nearest_on_triangle(p, q, r, scratch)
        distance = dot(v, v)
        if distance < best:
            best, count, nearest = distance, k, v
            for i in range(k):
                store(S[i], 0, row(scratch, i))
    return nearest, count


@kernel(allocates=False)
def nearest_on_simplex(S: Array, count: int, scratch: Array, apart: bool) -> tuple[Vector, int]:
    """Point of the simplex in S (4, 3) nearest to the origin, and how many corners it needs."""
    if count == 1:
        return row(S, 0), 1
    if count == 2:
        return nearest_on_segment(row(S, 0), row(S, 1), S)
    if count == 3:
        return nearest_on_triangle(row(S, 0), row(S, 1), row(S, 2), S)
    v, left = nearest_on_tetrahedron(S, scratch, False)
    if left == 4 and apart:
        return nearest_on_tetrahedron(S, scratch, True)
    return v, left


@kernel(allocates=False)
def halfspace_distance_kernel(
    a: Array, i: int, b: Array, wall: int, corners: Array, tables: Lists
) -> tuple[float, Vector, Vector]:
    """Distance of piece i to a half-space, negative inside, its normal, and the lowest point."""
    n = (b[wall, POSE + 2], b[wall, POSE + 6], b[wall, POSE + 10])
    p = support(a, i, corners, tables, (-n[0], -n[1], -n[2]))
    r = a[i, ROUNDING]
    p = (p[0] - r * n[0], p[1] - r * n[1], p[2] - r * n[2])
    origin = (b[wall, POSE + 3], b[wall, POSE + 7], b[wall, POSE + 11])
    return dot(n, subtract(p, origin)), n, p


@kernel(allocates=False)
def allowance(n: Vector, drift: Drift) -> float:
    """How much the motion around a configuration can take off a distance measured along ``n``."""
    vx, vy, vz, wx, wy, wz, radius, rest, most = drift
    along = abs(n[0] * vx + n[1] * vy + n[2] * vz)
    turn = cross(n, (wx, wy, wz))
    return min(along + radius * math.sqrt(dot(turn, turn)) + rest, most)


@kernel(allocates=False)
def separation(
    pair: Pair, corners: Array, tables: Lists, near: float, far: float, drift: Drift, axis: Array,
    buffer: Array,
) -> tuple[int, float, float]:  # fmt: skip
    """Compare the distance of two pieces with two thresholds.

    Args:
        pair: The pieces.
        corners: Corners of both, shape (v, 3).
        tables: Support tables of both.
        near: Distance up to which the pieces count as too close [m]; -inf asks for the distance
            itself.
        far: Farther apart than this, and than the drift's allowance along the same plane on top, is
            far enough [m]; +inf asks for the distance itself.
        drift: Motion of the second piece seen from the first, ``STILL`` for none.
        axis: Direction to try first, from j to i, shape (3,); replaced by the best one.
        buffer: Workspace, shape (8, 3).

    Returns:
        FARTHER, CLOSER (distance <= near) or BETWEEN, and a lower and an upper bound of the
        distance. Bounds of overlapping pieces are minus their roundings, or 0. Where it is FARTHER,
        the lower bound is proved by the plane across ``axis``.
    """
    a, i, b, j = pair
    if a[i, KIND] == _HALFSPACE or b[j, KIND] == _HALFSPACE:
        if b[j, KIND] == _HALFSPACE:
            d, n, _ = halfspace_distance_kernel(a, i, b, j, corners, tables)
        else:
            d, n, _ = halfspace_distance_kernel(b, j, a, i, corners, tables)
        axis[0], axis[1], axis[2] = n
        return (
            (FARTHER if d > far + allowance(n, drift) else CLOSER if d <= near else BETWEEN),
            d,
            d,
        )
    rounding = a[i, ROUNDING] + b[j, ROUNDING]
    S, scratch = buffer[:4], buffer[4:]
    v = (axis[0], axis[1], axis[2])
    square = dot(v, v)
    if not square > 0.0:
        v = (1.0, 0.0, 0.0)
        square = 1.0
    lower, upper, enough = -rounding, np.inf, far
    count = 0
    for iteration in range(_MAX_ITERATIONS):
        p = support(a, i, corners, tables, (-v[0], -v[1], -v[2]))
        q = support(b, j, corners, tables, v)
        w = subtract(p, q)
        length = math.sqrt(square)
        plane = dot(v, w) / length
        if plane - rounding > lower:
            lower = plane - rounding
            axis[0], axis[1], axis[2] = v[0] / length, v[1] / length, v[2] / length
            if lower > near:
                enough = far + allowance((axis[0], axis[1], axis[2]), drift)
                if lower > enough:
                    return FARTHER, lower, upper
        if iteration > 0 and length - plane <= _GAP * length:
            break
        repeated = False
        for k in range(count):
            repeated |= S[k, 0] == w[0] and S[k, 1] == w[1] and S[k, 2] == w[2]
        if repeated:
            break
        store(S[count], 0, w)
        v, count = nearest_on_simplex(S, count + 1, scratch, lower > -rounding)
        before, square = square, dot(v, v)
        if count == 4 or square <= _CONTACT * _CONTACT:
            upper = -rounding
            break
        upper = min(upper, math.sqrt(square) - rounding)
        # Between the two, and known well enough for what follows.
        close_enough = upper <= enough and lower - near >= _KNOWN * (upper - near)
        if upper <= near or (close_enough and lower > near > -np.inf):
            break
        if iteration > 0 and square >= before:
            break
    lower = min(lower, upper)
    return (CLOSER if upper <= near else BETWEEN), lower, upper
