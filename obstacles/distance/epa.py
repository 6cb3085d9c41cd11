"""How far apart two convex pieces are or how deep they overlap, along what, and where.

Apart, the Gilbert-Johnson-Keerthi iteration leads to the nearest points; where cores overlap, a
polytope inside A - B grows towards the face nearest to the origin. Either way the answer is
what the plane across its normal proves, so it never exceeds the true signed distance.
Sources: "A fast procedure for computing the distance between complex objects in three-dimensional
space", IEEE Journal on Robotics and Automation, 1988; "Proximity queries and penetration depth
computation on 3D game objects", Game Developers Conference, 2001.
"""

import math

import numpy as np

from compiled.kernel import kernel
from compiled.vec3 import Vector, cross, dot, subtract
from kinematics.arrays import Array, Indices
from obstacles.convex.growing_hull import grow, put_face
from obstacles.distance.gjk import halfspace_distance_kernel, nearest_on_simplex, support
from obstacles.distance.piece_set import KIND, ROUNDING, CoreKind, Lists

_HALFSPACE = int(CoreKind.HALFSPACE)
_MAX_ITERATIONS = 60
#: Relative gap between the bounds at which nearest points count as found.
_GAP = 1e-12
#: Cores closer than this [m] count as overlapping: the line between them has no digits left.
_CONTACT = 1e-9
#: Corners and faces that the polytope may grow to: round solids are then right to 1e-4 of their
#: size, polytopes exactly.
_CORNERS = 128
_FACES = 4 * _CORNERS
#: A corner beyond a face by less than this [m] lies in its plane.
_COPLANAR = 1e-11
#: A face that the support lies beyond by less than this [m] is a face of A - B itself.
_FLAT = 1e-9


@kernel
def _supports(
    a: Array, i: int, b: Array, j: int, corners: Array, tables: Lists, d: Vector
) -> tuple[Vector, Vector]:
    """Supports of piece i along ``d`` and of piece j along -d."""
    return support(a, i, corners, tables, d), support(b, j, corners, tables, (-d[0], -d[1], -d[2]))


@kernel
def contact(
    a: Array, i: int, b: Array, j: int, corners: Array, tables: Lists, axis: Array
) -> tuple[float, Vector, Vector]:
    """Signed distance of two pieces, the direction along which it is measured, and a point.

    Args:
        a: Rows of a ``PieceSet``, their poses in a common frame.
        i: One of them.
        b: Rows of the second piece, the same or others.
        j: One of them; neither or one of the two is a half-space.
        corners: Corners of both.
        tables: Tables of both.
        axis: Direction to search first, from j to i, shape (3,).

    Returns:
        The distance [m], negative by the depth where they overlap; the unit direction from j to i:
        moving i by t along it, or j by t against it, changes the distance by t; the point of j
        that is nearest or deepest.
    """
    if a[i, KIND] == _HALFSPACE or b[j, KIND] == _HALFSPACE:
        return _with_halfspace(a, i, b, j, corners, tables)
    rounding = a[i, ROUNDING] + b[j, ROUNDING]
    S, scratch, seen = np.empty((4, 3)), np.empty((4, 3)), np.empty((_MAX_ITERATIONS, 6))
    v = (axis[0], axis[1], axis[2])
    if not dot(v, v) > 0.0:
        v = (1.0, 0.0, 0.0)
    count, used, lower, normal = 0, 0, -np.inf, v
    square = np.inf
    for iteration in range(_MAX_ITERATIONS):
        p, r = _supports(a, i, b, j, corners, tables, (-v[0], -v[1], -v[2]))
        w = subtract(p, r)
        length = math.sqrt(dot(v, v))
        plane = dot(v, w) / length
        if plane > lower:
            lower, normal = plane, (v[0] / length, v[1] / length, v[2] / length)
        if iteration > 0 and length - plane <= _GAP * length:
            break
        repeated = False
        for k in range(count):
            repeated |= S[k, 0] == w[0] and S[k, 1] == w[1] and S[k, 2] == w[2]
        if repeated:
            break
        seen[used, 0], seen[used, 1], seen[used, 2] = w
        seen[used, 3], seen[used, 4], seen[used, 5] = r
        used += 1
        S[count, 0], S[count, 1], S[count, 2] = w
        v, count = nearest_on_simplex(S, count + 1, scratch, lower > 0.0)
        before, square = square, dot(v, v)
        if count == 4 or square <= _CONTACT * _CONTACT:
            return _overlap(a, i, b, j, corners, tables, normal, rounding)
        if square >= before:
            break
    weights = _weights(S, count, v)
    point = _weighted(S, count, weights, seen, used)
    return lower - rounding, normal, _rounded(point, normal, b[j, ROUNDING])


@kernel
def _rounded(p: Vector, n: Vector, rounding: float) -> Vector:
    return p[0] + rounding * n[0], p[1] + rounding * n[1], p[2] + rounding * n[2]


@kernel(inline="always")
def _with_halfspace(
    a: Array, i: int, b: Array, j: int, corners: Array, tables: Lists
) -> tuple[float, Vector, Vector]:
    if b[j, KIND] == _HALFSPACE:
        distance, n, p = halfspace_distance_kernel(a, i, b, j, corners, tables)
        return distance, n, _rounded(p, n, -distance)
    distance, n, p = halfspace_distance_kernel(b, j, a, i, corners, tables)
    return distance, (-n[0], -n[1], -n[2]), p


@kernel
def _weights(S: Array, count: int, v: Vector) -> Vector:
    """Barycentric coordinates of ``v`` in the segment or triangle of the first rows of S."""
    if count == 1:
        return 1.0, 0.0, 0.0
    a = (S[0, 0], S[0, 1], S[0, 2])
    ab = subtract((S[1, 0], S[1, 1], S[1, 2]), a)
    av = subtract(v, a)
    if count == 2:
        square = dot(ab, ab)
        t = dot(av, ab) / square if square > 0.0 else 0.0
        return 1.0 - t, t, 0.0
    ac = subtract((S[2, 0], S[2, 1], S[2, 2]), a)
    bb, bc, cc = dot(ab, ab), dot(ab, ac), dot(ac, ac)
    vb, vc = dot(av, ab), dot(av, ac)
    area = bb * cc - bc * bc
    if not area > 0.0:
        return 1.0, 0.0, 0.0
    s, t = (cc * vb - bc * vc) / area, (bb * vc - bc * vb) / area
    return 1.0 - s - t, s, t


@kernel(inline="always")
def _weighted(S: Array, count: int, weights: Vector, seen: Array, used: int) -> Vector:
    """The point of piece j that belongs to the weighted corners in S."""
    x, y, z = 0.0, 0.0, 0.0
    for corner in range(count):
        for k in range(used):
            same = seen[k, 0] == S[corner, 0] and seen[k, 1] == S[corner, 1]
            if same and seen[k, 2] == S[corner, 2]:
                x += weights[corner] * seen[k, 3]
                y += weights[corner] * seen[k, 4]
                z += weights[corner] * seen[k, 5]
                break
    return x, y, z


@kernel
def _overlap(
    a: Array,
    i: int,
    b: Array,
    j: int,
    corners: Array,
    tables: Lists,
    axis: Vector,
    rounding: float,
) -> tuple[float, Vector, Vector]:
    """``contact`` of pieces whose cores overlap or touch."""
    grown = np.empty((_CORNERS, 6))
    used = _first_corners(a, i, b, j, corners, tables, grown)
    if used < 4:
        # A - B is flat: it has no inside, and the cores touch.
        out = _next_direction(grown, used - 1) if used > 1 else axis
        back = (-out[0], -out[1], -out[2])
        p, r = _supports(a, i, b, j, corners, tables, back)
        return dot(out, subtract(p, r)) - rounding, out, _rounded(r, out, b[j, ROUNDING])
    faces, planes = np.empty((_FACES, 3), dtype=np.int64), np.empty((_FACES, 4))
    made = 0
    for skipped in range(4):
        put_face(grown, faces, planes, made, skipped)
        made += 1
    best, depth = 0, np.inf
    normal, point = axis, axis
    while True:
        best = int(np.argmin(planes[:made, 3]))
        n = (planes[best, 0], planes[best, 1], planes[best, 2])
        p, r = _supports(a, i, b, j, corners, tables, n)
        w = subtract(p, r)
        reach = dot(n, w)
        if reach < depth:
            depth, normal = reach, n
            point = _on_face(grown, faces[best], planes[best])
        gap = reach - planes[best, 3]
        full = used == _CORNERS or made + 2 * _CORNERS > _FACES
        if gap <= _FLAT or full or planes[best, 3] >= depth:
            break
        grown[used, 0], grown[used, 1], grown[used, 2] = w
        grown[used, 3], grown[used, 4], grown[used, 5] = r
        made = grow(grown, used, faces, planes, made, _COPLANAR)
        used += 1
    out = (-normal[0], -normal[1], -normal[2])
    return -depth - rounding, out, _rounded(point, out, b[j, ROUNDING])


@kernel(inline="always")
def _first_corners(
    a: Array, i: int, b: Array, j: int, corners: Array, tables: Lists, grown: Array
) -> int:
    """Write corners of a tetrahedron of A - B that has a volume; fewer than 4 where none was found.

    The longest extent first, then what is farthest from the line, then from the plane.
    """
    d = (1.0, 0.0, 0.0)
    for found in range(4):
        best = 0.0
        for sign in range(2 if found else 1):
            turn = 1.0 - 2.0 * sign
            n = (turn * d[0], turn * d[1], turn * d[2])
            p, r = _supports(a, i, b, j, corners, tables, n)
            w = subtract(p, r)
            along = 1.0
            if found:
                along = dot(n, (w[0] - grown[0, 0], w[1] - grown[0, 1], w[2] - grown[0, 2]))
            if along > best:
                best = along
                grown[found, 0], grown[found, 1], grown[found, 2] = w
                grown[found, 3], grown[found, 4], grown[found, 5] = r
        if best <= _FLAT:
            return found
        d = _next_direction(grown, found)
    return 4


@kernel
def _next_direction(corners: Array, found: int) -> Vector:
    a = (corners[0, 0], corners[0, 1], corners[0, 2])
    if found == 0:
        length = math.sqrt(dot(a, a))
        if length == 0.0:
            return 0.0, 1.0, 0.0
        return -a[0] / length, -a[1] / length, -a[2] / length
    ab = subtract((corners[1, 0], corners[1, 1], corners[1, 2]), a)
    if found == 1:
        x, y, z = abs(ab[0]), abs(ab[1]), abs(ab[2])
        least = (0.0, 1.0, 0.0) if y <= z else (0.0, 0.0, 1.0)
        if x <= y and x <= z:
            least = (1.0, 0.0, 0.0)
        n = cross(ab, least)
    else:
        n = cross(ab, subtract((corners[2, 0], corners[2, 1], corners[2, 2]), a))
    length = math.sqrt(dot(n, n))
    return (n[0] / length, n[1] / length, n[2] / length) if length > 0.0 else (1.0, 0.0, 0.0)


@kernel(inline="always")
def _on_face(corners: Array, face: Indices, plane: Array) -> Vector:
    """The point of piece j where the origin falls onto a face."""
    S = np.empty((3, 3))
    for k in range(3):
        for axis in range(3):
            S[k, axis] = corners[face[k], axis]
    v = (plane[0] * plane[3], plane[1] * plane[3], plane[2] * plane[3])
    weights = _weights(S, 3, v)
    x, y, z = 0.0, 0.0, 0.0
    for k in range(3):
        x += weights[k] * corners[face[k], 3]
        y += weights[k] * corners[face[k], 4]
        z += weights[k] * corners[face[k], 5]
    return x, y, z
