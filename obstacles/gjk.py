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

from kinematics.chain import Array, Indices
from kinematics.kernel import kernel
from obstacles.piece import PieceKind

FARTHER = 0
BETWEEN = 1
CLOSER = 2

_CYLINDER = int(PieceKind.CYLINDER)
_CONE = int(PieceKind.CONE)
_HALFSPACE = int(PieceKind.HALFSPACE)
_MAX_ITERATIONS = 60
#: Relative gap between the bounds at which the distance counts as found.
_GAP = 1e-10
#: A core distance below this [m] is contact: what is left of the digits can't tell more.
_CONTACT = 1e-12

Vector = tuple[float, float, float]


@kernel
def support(kind: int, points: Array, start: int, stop: int, size: Array, d: Vector) -> Vector:
    """Farthest point of a piece's core along ``d``, all in the piece's frame."""
    if kind == 0:
        best, index = -np.inf, start
        for i in range(start, stop):
            value = points[i, 0] * d[0] + points[i, 1] * d[1] + points[i, 2] * d[2]
            if value > best:
                best, index = value, i
        return points[index, 0], points[index, 1], points[index, 2]
    radius, half = size[0], size[1]
    radial = math.sqrt(d[0] * d[0] + d[1] * d[1])
    x, y = 0.0, 0.0
    if radial > 0.0:
        x, y = radius * d[0] / radial, radius * d[1] / radial
    if kind == _CYLINDER:
        return x, y, (half if d[2] >= 0.0 else -half)
    if d[2] * half >= radius * radial - d[2] * half:
        return 0.0, 0.0, half
    return x, y, -half


@kernel
def support_in(
    kind: int, points: Array, start: int, stop: int, size: Array, T: Array, d: Vector
) -> Vector:
    """Farthest point of a piece's core along ``d``, in the frame that ``T`` (4, 4) maps into."""
    x = T[0, 0] * d[0] + T[1, 0] * d[1] + T[2, 0] * d[2]
    y = T[0, 1] * d[0] + T[1, 1] * d[1] + T[2, 1] * d[2]
    z = T[0, 2] * d[0] + T[1, 2] * d[1] + T[2, 2] * d[2]
    p = support(kind, points, start, stop, size, (x, y, z))
    return (
        T[0, 0] * p[0] + T[0, 1] * p[1] + T[0, 2] * p[2] + T[0, 3],
        T[1, 0] * p[0] + T[1, 1] * p[1] + T[1, 2] * p[2] + T[1, 3],
        T[2, 0] * p[0] + T[2, 1] * p[1] + T[2, 2] * p[2] + T[2, 3],
    )


@kernel
def dot(a: Vector, b: Vector) -> float:
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def minus(a: Vector, b: Vector) -> Vector:
    """Difference."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@kernel
def cross(a: Vector, b: Vector) -> Vector:
    """Vector product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@kernel
def row(S: Array, i: int) -> Vector:
    """Row i of S (k, 3)."""
    return S[i, 0], S[i, 1], S[i, 2]


@kernel
def put(S: Array, i: int, p: Vector) -> None:
    """Write p into row i of S (k, 3)."""
    S[i, 0], S[i, 1], S[i, 2] = p[0], p[1], p[2]


@kernel
def nearest_on_segment(a: Vector, b: Vector, S: Array) -> tuple[Vector, int]:
    """Point of segment ab nearest to the origin; the corners it needs are left in S."""
    ab = minus(b, a)
    length = dot(ab, ab)
    t = -dot(a, ab)
    if t <= 0.0 or length == 0.0:
        put(S, 0, a)
        return a, 1
    if t >= length:
        put(S, 0, b)
        return b, 1
    t /= length
    put(S, 0, a)
    put(S, 1, b)
    return (a[0] + t * ab[0], a[1] + t * ab[1], a[2] + t * ab[2]), 2


@kernel
def nearest_on_triangle(a: Vector, b: Vector, c: Vector, S: Array) -> tuple[Vector, int]:
    """Point of triangle abc nearest to the origin; the corners it needs are left in S.

    By the regions of the corners, edges and face ("Real-time collision detection", 5.1.5).
    """
    ab, ac = minus(b, a), minus(c, a)
    d1, d2 = -dot(ab, a), -dot(ac, a)
    if d1 <= 0.0 and d2 <= 0.0:
        put(S, 0, a)
        return a, 1
    d3, d4 = -dot(ab, b), -dot(ac, b)
    if d3 >= 0.0 and d4 <= d3:
        put(S, 0, b)
        return b, 1
    d5, d6 = -dot(ab, c), -dot(ac, c)
    if d6 >= 0.0 and d5 <= d6:
        put(S, 0, c)
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
    put(S, 0, a)
    put(S, 1, b)
    put(S, 2, c)
    return (
        a[0] + ab[0] * v + ac[0] * w,
        a[1] + ab[1] * v + ac[1] * w,
        a[2] + ab[2] * v + ac[2] * w,
    ), 3


@kernel
def _outside(a: Vector, b: Vector, c: Vector, opposite: Vector) -> bool:
    """Whether the origin is not strictly on the side of face abc where ``opposite`` is."""
    normal = cross(minus(b, a), minus(c, a))
    origin = -dot(a, normal)
    inside = dot(minus(opposite, a), normal)
    return origin * inside <= 0.0


@kernel
def nearest_on_tetrahedron(S: Array, scratch: Array, apart: bool) -> tuple[Vector, int]:
    """Point of the tetrahedron in S nearest to the origin; 4 corners: the origin is inside.

    Of a nearly flat one the sides can't be told; where a plane has shown that the origin is
    outside (``apart``), all faces are looked at.
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
                put(S, i, row(scratch, i))
    return nearest, count


@kernel
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


@kernel
def halfspace_distance(
    kind: int, points: Array, start: int, stop: int, size: Array, T: Array, H: Array
) -> float:
    """Distance of a piece to the half-space z <= 0 of frame H; negative is how deep it is in."""
    normal = (H[0, 2], H[1, 2], H[2, 2])
    down = (-normal[0], -normal[1], -normal[2])
    p = support_in(kind, points, start, stop, size, T, down)
    return float(dot(normal, (p[0] - H[0, 3], p[1] - H[1, 3], p[2] - H[2, 3])) - size[2])


@kernel
def separation(
    kinds: Indices,
    starts: Indices,
    points: Array,
    sizes: Array,
    i: int,
    T_i: Array,
    j: int,
    T_j: Array,
    near: float,
    far: float,
    axis: Array,
    S: Array,
    scratch: Array,
) -> tuple[int, float, float]:
    """Compare the distance of pieces i and j with two thresholds, near <= far [m].

    Args:
        kinds: Of ``PieceArrays``, as are the next three.
        starts: Where each piece's vertices begin.
        points: The vertices.
        sizes: Radius, half height, rounding.
        i: One piece.
        T_i: Its frame in a common frame, shape (4, 4).
        j: The other piece.
        T_j: Its frame in the same common frame, shape (4, 4).
        near: At most this far apart counts as too close; -inf asks for the distance itself.
        far: Farther apart than this is far enough; +inf asks for the distance itself.
        axis: Where to look first, from j to i, shape (3,); replaced by what was found.
        S: Room to work in, shape (4, 3).
        scratch: More of it, shape (4, 3).

    Returns:
        FARTHER (distance > far), CLOSER (distance <= near) or BETWEEN, and a lower and an upper
        bound of the distance. Bounds of overlapping pieces are minus their roundings, or 0.
    """
    if kinds[j] == _HALFSPACE or kinds[i] == _HALFSPACE:
        if kinds[j] == _HALFSPACE:
            d = halfspace_distance(kinds[i], points, starts[i], starts[i + 1], sizes[i], T_i, T_j)
        else:
            d = halfspace_distance(kinds[j], points, starts[j], starts[j + 1], sizes[j], T_j, T_i)
        return (FARTHER if d > far else CLOSER if d <= near else BETWEEN), d, d
    rounding = sizes[i, 2] + sizes[j, 2]
    v = (axis[0], axis[1], axis[2])
    square = dot(v, v)
    if not square > 0.0:
        v = (1.0, 0.0, 0.0)
        square = 1.0
    lower, upper = -rounding, np.inf
    count = 0
    for iteration in range(_MAX_ITERATIONS):
        back = (-v[0], -v[1], -v[2])
        a = support_in(kinds[i], points, starts[i], starts[i + 1], sizes[i], T_i, back)
        b = support_in(kinds[j], points, starts[j], starts[j + 1], sizes[j], T_j, v)
        w = minus(a, b)
        length = math.sqrt(square)
        plane = dot(v, w) / length
        if plane - rounding > lower:
            lower = plane - rounding
            axis[0], axis[1], axis[2] = v[0] / length, v[1] / length, v[2] / length
        if lower > far:
            return FARTHER, lower, upper
        if iteration > 0 and length - plane <= _GAP * length:
            break
        repeated = False
        for k in range(count):
            repeated |= S[k, 0] == w[0] and S[k, 1] == w[1] and S[k, 2] == w[2]
        if repeated:
            break
        put(S, count, w)
        v, count = nearest_on_simplex(S, count + 1, scratch, lower > -rounding)
        before, square = square, dot(v, v)
        if count == 4 or square <= _CONTACT * _CONTACT:
            upper = -rounding
            break
        upper = min(upper, math.sqrt(square) - rounding)
        settled = near > -np.inf and lower > near and upper <= far
        if upper <= near or settled:
            break
        if iteration > 0 and square >= before:
            break
    lower = min(lower, upper)
    if upper <= near:
        return CLOSER, lower, upper
    return (FARTHER if lower > far else BETWEEN), lower, upper
