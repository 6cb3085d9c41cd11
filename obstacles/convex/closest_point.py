"""Kernels for the point of a solid nearest to a given point, in closed form.

Each answers the nearest point of the solid's boundary and a signed distance, negative inside;
outside, that point is the orthogonal projection onto the solid.
"""

import numpy as np

from compiled.kernel import kernel
from compiled.vec3 import Vector, cross, dot, row, subtract
from kinematics.arrays import Array, Indices

#: Nearest point of the boundary, and the signed distance.
Nearest = tuple[float, float, float, float]

#: Squared sines of a triangle's angle at which it counts as a sliver, whose edges are asked too,
#: and as having no face at all: there its normal is made of rounding errors.
_SLIVER = 1e-12
_NO_AREA = 1e-24


@kernel(allocates=False)
def nearest_on_segment(p: Vector, a: Vector, b: Vector) -> Vector:
    """Point of segment ab nearest to p."""
    ab = subtract(b, a)
    length = dot(ab, ab)
    t = dot(subtract(p, a), ab)
    if t <= 0.0 or length == 0.0:
        return a
    if t >= length:
        return b
    t /= length
    return a[0] + t * ab[0], a[1] + t * ab[1], a[2] + t * ab[2]


@kernel
def nearest_on_triangle(p: Vector, a: Vector, b: Vector, c: Vector) -> Vector:
    """Point of triangle abc nearest to p: on its face, or else on one of its edges.

    The barycentric coordinates come from n = ab x ac, which keeps the digits that products of
    lengths would lose where p is far away. Source: "Real-time collision detection", 5.1.5.
    """
    ab, ac, ap = subtract(b, a), subtract(c, a), subtract(p, a)
    n = cross(ab, ac)
    square = dot(n, n)
    sides = dot(ab, ab) * dot(ac, ac)
    best, nearest = np.inf, a
    if square > _NO_AREA * sides:
        v, w = dot(n, cross(ap, ac)) / square, dot(n, cross(ab, ap)) / square
        if v >= 0.0 and w >= 0.0 and v + w <= 1.0:
            nearest = (
                a[0] + ab[0] * v + ac[0] * w,
                a[1] + ab[1] * v + ac[1] * w,
                a[2] + ab[2] * v + ac[2] * w,
            )
            if square > _SLIVER * sides:
                return nearest
            gap = subtract(p, nearest)
            best = dot(gap, gap)
    for edge in range(3):
        if edge == 0:
            q = nearest_on_segment(p, a, b)
        elif edge == 1:
            q = nearest_on_segment(p, b, c)
        else:
            q = nearest_on_segment(p, c, a)
        gap = subtract(p, q)
        if dot(gap, gap) < best:
            best, nearest = dot(gap, gap), q
    return nearest


@kernel
def nearest_on_hull(
    p: Vector, vertices: Array, triangles: Indices, planes: Array, solid: bool
) -> Nearest:
    """Nearest point of the boundary of a convex hull, from its triangles and planes.

    Outside, it lies on a triangle whose plane separates it from p; inside, on the plane that is
    nearest.
    """
    height, face = -np.inf, 0
    best, nearest = np.inf, p
    for f in range(triangles.shape[0]):
        if solid:
            n = (planes[f, 0], planes[f, 1], planes[f, 2])
            above = dot(n, p) - planes[f, 3]
            if above > height:
                height, face = above, f
            if above <= 0.0 or above * above >= best:
                continue
        q = nearest_on_triangle(
            p,
            row(vertices, triangles[f, 0]),
            row(vertices, triangles[f, 1]),
            row(vertices, triangles[f, 2]),
        )
        gap = subtract(p, q)
        square = dot(gap, gap)
        if square < best:
            best, nearest = square, q
    if solid and height <= 0.0:
        x = p[0] - height * planes[face, 0]
        y = p[1] - height * planes[face, 1]
        z = p[2] - height * planes[face, 2]
        return x, y, z, height
    return nearest[0], nearest[1], nearest[2], np.sqrt(best)


@kernel
def mesh_distances(points: Array, vertices: Array, triangles: Indices, distances: Array) -> None:
    """Distance of each of ``points`` (m, 3) to the nearest triangle, into ``distances`` (m,)."""
    f = triangles.shape[0]
    balls = np.empty((f, 4))
    for i in range(f):
        a, b, c = (
            row(vertices, triangles[i, 0]),
            row(vertices, triangles[i, 1]),
            row(vertices, triangles[i, 2]),
        )
        for k in range(3):
            balls[i, k] = (a[k] + b[k] + c[k]) / 3.0
        center = row(balls, i)
        da, db, dc = subtract(a, center), subtract(b, center), subtract(c, center)
        balls[i, 3] = np.sqrt(max(dot(da, da), dot(db, db), dot(dc, dc)))
    for m in range(points.shape[0]):
        p = row(points, m)
        best = np.inf
        for i in range(f):
            gap = subtract(p, row(balls, i))
            reach = best + balls[i, 3]
            if dot(gap, gap) >= reach * reach:
                continue
            q = nearest_on_triangle(
                p,
                row(vertices, triangles[i, 0]),
                row(vertices, triangles[i, 1]),
                row(vertices, triangles[i, 2]),
            )
            gap = subtract(p, q)
            best = min(best, np.sqrt(dot(gap, gap)))
        distances[m] = best


@kernel
def hull_distances(
    points: Array,
    vertices: Array,
    triangles: Indices,
    planes: Array,
    solid: bool,
    distances: Array,
) -> None:
    """Signed distance of each of ``points`` (m, 3) to a hull, into ``distances`` (m,)."""
    for m in range(points.shape[0]):
        nearest = nearest_on_hull(row(points, m), vertices, triangles, planes, solid)
        distances[m] = nearest[3]


@kernel(inline="always")
def nearest_on_box(p: Vector, half: Vector) -> Nearest:
    """Nearest point of the boundary of the box |x| <= half."""
    dx, dy, dz = abs(p[0]) - half[0], abs(p[1]) - half[1], abs(p[2]) - half[2]
    if dx <= 0.0 and dy <= 0.0 and dz <= 0.0:
        if dx >= dy and dx >= dz:
            return np.copysign(half[0], p[0]), p[1], p[2], dx
        if dy >= dz:
            return p[0], np.copysign(half[1], p[1]), p[2], dy
        return p[0], p[1], np.copysign(half[2], p[2]), dz
    x = min(max(p[0], -half[0]), half[0])
    y = min(max(p[1], -half[1]), half[1])
    z = min(max(p[2], -half[2]), half[2])
    gap = (p[0] - x, p[1] - y, p[2] - z)
    return x, y, z, np.sqrt(dot(gap, gap))


@kernel
def nearest_on_cylinder(p: Vector, radius: float, half: float) -> Nearest:
    """Nearest point of the boundary of the cylinder x^2 + y^2 <= radius^2, |z| <= half."""
    r = np.sqrt(p[0] * p[0] + p[1] * p[1])
    # On the axis every direction is as near as any other.
    ux, uy = (p[0] / r, p[1] / r) if r > 0.0 else (1.0, 0.0)
    dr, dz = r - radius, abs(p[2]) - half
    if dr <= 0.0 and dz <= 0.0:
        if dr >= dz:
            return radius * ux, radius * uy, p[2], dr
        return p[0], p[1], np.copysign(half, p[2]), dz
    r, z = min(r, radius), min(max(p[2], -half), half)
    return r * ux, r * uy, z, np.sqrt(max(dr, 0.0) ** 2 + max(dz, 0.0) ** 2)


@kernel(allocates=False)
def nearest_on_cone(p: Vector, radius: float, half: float) -> Nearest:
    """Nearest point of the boundary of a cone with apex z = half and base z = -half.

    In the half-plane through the axis and p the cone is a triangle; its base and its slope are two
    segments.
    """
    r = np.sqrt(p[0] * p[0] + p[1] * p[1])
    ux, uy = (p[0] / r, p[1] / r) if r > 0.0 else (1.0, 0.0)
    flat = (r, 0.0, p[2])
    rim, apex, center = (radius, 0.0, -half), (0.0, 0.0, half), (0.0, 0.0, -half)
    on_slope, on_base = nearest_on_segment(flat, apex, rim), nearest_on_segment(flat, center, rim)
    to_slope, to_base = subtract(flat, on_slope), subtract(flat, on_base)
    slope, base = dot(to_slope, to_slope), dot(to_base, to_base)
    nearest = on_slope if slope <= base else on_base
    distance = np.sqrt(min(slope, base))
    inside = p[2] >= -half and 2.0 * half * r + radius * (p[2] - half) <= 0.0
    return nearest[0] * ux, nearest[0] * uy, nearest[2], -distance if inside else distance
