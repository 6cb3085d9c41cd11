"""A convex hull that grows point by point, for volumes and for telling which points it may lack.

A point outside sees some of the faces; they give way to triangles from the rim of what it sees to
the point. What that adds is the volume of the tetrahedra between the point and the faces it sees,
which is never negative: volumes grow, whatever is rounded. Source: "Computational geometry in C",
chapter 4, the incremental algorithm.
"""

from typing import NamedTuple

import numpy as np

from compiled.kernel import kernel
from compiled.vec3 import Vector, cross, dot, row, subtract
from kinematics.arrays import Array, Indices

#: A point that is added sees the faces that it is above by this part of what it must be: not those
#: that it is above by rounding.
_ROUNDING = 1e-6
#: Points whose tetrahedron is thinner than this part of their extent have no volume.
_FLAT = 1e-9
#: Offset of a face that is gone or has no area: no point is above it [m].
_GONE = 1e300
#: Entries of ``counts``: face slots in use, free slots, and whether there is a tetrahedron.
_MADE, _FREE, _SOLID = 0, 1, 2


class GrowingHull(NamedTuple):
    """A hull and the room that it grows in.

    Args:
        corners: Corners of each face, counter-clockwise seen from outside, shape (f, 3).
        across: The face beyond the edge from each corner to the next one, shape (f, 3).
        planes: Unit normal and offset of each face, a huge offset where none is, shape (4, f).
        heights: Scratch: heights of a point above the faces, shape (f,).
        seen: Scratch: faces that a point sees, shape (f,).
        free: Slots of faces that are gone, shape (f,).
        rim: Scratch: edges of the rim, each two corners and the face beyond, shape (3 f, 3).
        begins: Scratch: the new face whose edge begins at a point, always a slot, shape (m,).
        ends: Scratch: the new face whose edge ends at a point, always a slot, shape (m,).
        counts: Face slots in use, free ones, and whether there is a tetrahedron, shape (3,).
    """

    corners: Indices
    across: Indices
    planes: Array
    heights: Array
    seen: Indices
    free: Indices
    rim: Indices
    begins: Indices
    ends: Indices
    counts: Indices


@kernel(inline="always")
def empty_hull(points: int, most: int) -> GrowingHull:
    """Room for a hull of at most ``most`` of so many points."""
    slots = 4 * most + 16
    return GrowingHull(
        np.empty((slots, 3), dtype=np.int64),
        np.empty((slots, 3), dtype=np.int64),
        np.empty((4, slots)),
        np.empty(slots),
        np.empty(slots, dtype=np.int64),
        np.empty(slots, dtype=np.int64),
        np.empty((3 * slots, 3), dtype=np.int64),
        np.zeros(points, dtype=np.int64),
        np.zeros(points, dtype=np.int64),
        np.zeros(3, dtype=np.int64),
    )


@kernel(allocates=False)
def _write_face(hull: GrowingHull, points: Array, f: int, i: int, j: int, k: int) -> None:
    """Put the face i, j, k into slot ``f``; one without an area is seen by nothing."""
    a = row(points, i)
    n = cross(subtract(row(points, j), a), subtract(row(points, k), a))
    length = np.sqrt(dot(n, n))
    scale = 1.0 / length if length > 0.0 else 0.0
    hull.corners[f, 0], hull.corners[f, 1], hull.corners[f, 2] = i, j, k
    for axis in range(3):
        hull.planes[axis, f] = n[axis] * scale
    hull.planes[3, f] = dot(n, a) * scale if length > 0.0 else _GONE


@kernel(allocates=False, inline="always")
def _volume_over(hull: GrowingHull, points: Array, f: int, p: Vector) -> float:
    """Volume of the tetrahedron between a face and a point above it."""
    a = subtract(row(points, hull.corners[f, 0]), p)
    b = subtract(row(points, hull.corners[f, 1]), p)
    c = subtract(row(points, hull.corners[f, 2]), p)
    return max(0.0, -dot(a, cross(b, c)) / 6.0)


@kernel(allocates=False, inline="always")
def begin_hull(hull: GrowingHull, points: Array, chosen: Indices, count: int) -> float:
    """Make a tetrahedron of four of the first ``count`` points ``chosen``; its volume, or 0.

    It is the first point, the farthest from it, the farthest from the line through both, and the
    farthest from the plane through the three.
    """
    if count < 4:
        return 0.0
    i, j, k, m = chosen[0], chosen[0], chosen[0], chosen[0]
    a, best = row(points, i), 0.0
    for entry in range(count):
        gap = subtract(row(points, chosen[entry]), a)
        if dot(gap, gap) > best:
            best, j = dot(gap, gap), chosen[entry]
    extent, ab, best = np.sqrt(best), subtract(row(points, j), a), 0.0
    for entry in range(count):
        n = cross(ab, subtract(row(points, chosen[entry]), a))
        if dot(n, n) > best:
            best, k = dot(n, n), chosen[entry]
    n, wide = cross(ab, subtract(row(points, k), a)), np.sqrt(best)
    if not wide > _FLAT * extent * extent:
        return 0.0
    height = 0.0
    for entry in range(count):
        above = dot(n, subtract(row(points, chosen[entry]), a)) / wide
        if abs(above) > abs(height):
            height, m = above, chosen[entry]
    if not abs(height) > _FLAT * extent:
        return 0.0
    if height > 0.0:  # the fourth point lies below the first face
        j, k = k, j
    _write_face(hull, points, 0, i, j, k)
    _write_face(hull, points, 1, j, i, m)
    _write_face(hull, points, 2, k, j, m)
    _write_face(hull, points, 3, i, k, m)
    for edge in range(3):
        hull.across[0, edge] = edge + 1
        hull.across[edge + 1, 0] = 0
        hull.across[edge + 1, 1] = 1 + (edge + 2) % 3
        hull.across[edge + 1, 2] = 1 + (edge + 1) % 3
    hull.counts[_MADE], hull.counts[_FREE], hull.counts[_SOLID] = 4, 0, 1
    return float(wide * abs(height) / 6.0)


@kernel(fastmath=True, allocates=False)
def _write_heights(planes: Array, made: int, x: float, y: float, z: float, heights: Array) -> None:
    for f in range(made):
        heights[f] = planes[0, f] * x + planes[1, f] * y + planes[2, f] * z - planes[3, f]


@kernel(allocates=False, inline="always")
def _write_rim(hull: GrowingHull, made: int, rounding: float) -> tuple[int, int]:
    """Write the faces that a point is above by more than rounding, and the edges around them.

    Returns:
        How many of each there are.
    """
    count, edges = 0, 0
    for f in range(made):
        if hull.heights[f] > rounding:
            hull.seen[count] = f
            count += 1
    for entry in range(count):
        f = hull.seen[entry]
        for edge in range(3):
            beyond = hull.across[f, edge]
            if not hull.heights[beyond] > rounding:
                hull.rim[edges, 0] = hull.corners[f, edge]
                hull.rim[edges, 1] = hull.corners[f, (edge + 1) % 3]
                hull.rim[edges, 2] = beyond
                edges += 1
    return count, edges


@kernel(allocates=False, inline="always")
def _is_cycle(rim: Indices, edges: int, begins: Indices) -> bool:
    """Whether edges go round once, through no corner twice; ``begins`` is scratch."""
    for edge in range(edges):
        begins[rim[edge, 0]] = edge
    edge, steps = 0, 0
    while steps < edges:
        edge = begins[rim[edge, 1]]
        steps += 1
        if edge == 0:
            break
    return edges > 2 and edge == 0 and steps == edges


@kernel(allocates=False, inline="always")
def add_point(hull: GrowingHull, points: Array, i: int, sight: float) -> float:
    """Let a hull grow to a point; the volume that this adds.

    A point is left out where rounding would tear the surface: the faces it sees have to be in one
    piece and without a hole, as they always are with exact arithmetic.

    Args:
        hull: The hull.
        points: All, shape (m, 3).
        i: Number of the point that is added.
        sight: Height above a face below which the point is left out [m].
    """
    p = row(points, i)
    made = hull.counts[_MADE]
    _write_heights(hull.planes, made, p[0], p[1], p[2], hull.heights)
    highest = -np.inf
    for f in range(made):
        highest = max(highest, hull.heights[f])
    if not highest > sight:
        return 0.0
    count, edges = _write_rim(hull, made, _ROUNDING * sight)
    if made + edges > hull.heights.shape[0] or not _is_cycle(hull.rim, edges, hull.begins):
        return 0.0
    seen, volume = hull.seen, 0.0
    for entry in range(count):
        f = seen[entry]
        volume += _volume_over(hull, points, f, p)
        hull.planes[3, f] = _GONE
        hull.free[hull.counts[_FREE]] = f
        hull.counts[_FREE] += 1
    for edge in range(edges):
        if hull.counts[_FREE] > 0:
            hull.counts[_FREE] -= 1
            f = hull.free[hull.counts[_FREE]]
        else:
            f = hull.counts[_MADE]
            hull.counts[_MADE] += 1
        a, b, beyond = hull.rim[edge, 0], hull.rim[edge, 1], hull.rim[edge, 2]
        _write_face(hull, points, f, a, b, i)
        hull.begins[a], hull.ends[b] = f, f
        hull.across[f, 0] = beyond
        for side in range(3):
            if hull.corners[beyond, side] == b and hull.corners[beyond, (side + 1) % 3] == a:
                hull.across[beyond, side] = f
        seen[edge] = f
    for edge in range(edges):
        f = seen[edge]
        hull.across[f, 1] = hull.begins[hull.corners[f, 1]]
        hull.across[f, 2] = hull.ends[hull.corners[f, 0]]
    return volume
