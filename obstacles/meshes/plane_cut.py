"""Triangles cut by planes across an axis, and what a cut leaves of the hulls' volume.

A hull's volume is looked up on the points that are the farthest ones along some directions. Those
of a union are among those of its parts: points are put into slabs between the places of a cut, and
a hull grows from slab to slab, once from either end.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from compiled.kernel import kernel
from compiled.vec3 import cross, dot
from kinematics.arrays import Array, Indices
from obstacles.convex.growing_hull import GrowingHull, add_point, begin_hull, empty_hull
from obstacles.convex.hull import DIRECTIONS, keep_farthest, write_values
from obstacles.meshes.mesh import Faces

#: Places at which a cut is tried, along each axis.
_PLACES = 12
#: Points nearer to a hull are not added where its volume is looked up, as a part of the extent.
_SIGHT = 1e-4
#: How far points are moved for it, likewise.
_JOGGLE = 1e-6
#: So many edges at a corner are looked through for one that was there already.
_LOOKED_THROUGH = 32


class Surface(NamedTuple):
    """Triangles, and points that go with them.

    Args:
        vertices: Shape (v, 3) [m].
        faces: Shape (t, 3).
        names: The body of each triangle, shape (t,).
    """

    vertices: Array
    faces: Faces
    names: NDArray[np.int64]


def triangle_areas(corners: Array) -> Array:
    """Areas of triangles (t, 3, 3)."""
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return np.asarray(0.5 * np.linalg.norm(cross, axis=1))


def cheapest_cut(vertices: Array, faces: Faces) -> tuple[int, float, float]:
    """The cut across an axis that saves the hulls of both sides most volume.

    Args:
        vertices: Points, corners of the triangles or not, shape (v, 3) [m].
        faces: The triangles, shape (t, 3).

    Returns:
        The axis, where the cut is [m], and the volume that it saves; none saves 0 [m^3].
    """
    best = (0, 0.0, 0.0)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    places = np.ascontiguousarray(np.linspace(low, high, _PLACES + 2)[1:-1].T)
    below, above = np.zeros((3, _PLACES + 1)), np.zeros((3, _PLACES + 1))
    _write_volumes(vertices, faces, places, DIRECTIONS, below, above)
    for axis in range(3):
        if not high[axis] > low[axis]:
            continue
        saved = below[0, -1] - (below[axis, :-1] + above[axis, 1:])
        k = int(saved.argmax())
        if saved[k] > best[2]:
            best = (axis, float(places[axis, k]), float(saved[k]))
    return best


@kernel
def _write_volumes(
    vertices: Array, faces: Faces, places: Array, directions: Array, below: Array, above: Array
) -> None:
    """Write volumes of the hulls of the slabs up to each one, and from each one on.

    Args:
        vertices: Shape (v, 3).
        faces: Shape (t, 3).
        places: Places between the slabs, ascending, for each axis, shape (3, k).
        directions: Shape (3, d).
        below: Shape (3, k + 1).
        above: Shape (3, k + 1).
    """
    points, best, farthest = _farthest_of_slabs(vertices, faces, places, directions)
    buffer = empty_hull(points.shape[0], best.shape[1] * best.shape[2])
    sight = 0.0
    for axis in range(3):
        sight = max(sight, _SIGHT * (places[axis, -1] - places[axis, 0]))
    for axis in range(3):
        _grow_by_slabs(points, best[axis], farthest[axis], 1, sight, buffer, below[axis])
        _grow_by_slabs(points, best[axis], farthest[axis], -1, sight, buffer, above[axis])


@kernel(inline="always")
def _farthest_of_slabs(
    vertices: Array, faces: Faces, places: Array, directions: Array
) -> tuple[Array, Array, Indices]:
    """Points, how far those of each slab are along directions, and the farthest ones.

    Points are the corners and where edges meet the places; those belong to the slabs on both sides.

    Returns:
        Points (m, 3); how far (3, s, d); which of the points (3, s, d), -1 where there is none.
    """
    v, k, d = vertices.shape[0], places.shape[1], directions.shape[1]
    slabs = np.empty((3, v), dtype=np.int64)
    for axis in range(3):
        for i in range(v):
            slab = 0
            while slab < k and places[axis, slab] < vertices[i, axis]:
                slab += 1
            slabs[axis, i] = slab
    edges = _edges_across(faces, slabs)
    crossings = 0
    for e in range(edges.shape[0]):
        for axis in range(3):
            crossings += abs(slabs[axis, edges[e, 0]] - slabs[axis, edges[e, 1]])
    points = np.empty((v + crossings, 3))
    best = np.full((3, k + 1, d), -np.inf)
    farthest = np.full((3, k + 1, d), -1)
    values = np.empty(d)
    for i in range(v):
        for axis in range(3):
            points[i, axis] = vertices[i, axis]
        write_values(directions, points, i, values)
        for axis in range(3):
            slab = slabs[axis, i]
            keep_farthest(values, i, best[axis, slab], farthest[axis, slab])
    made = v
    for e in range(edges.shape[0]):
        i, j = edges[e, 0], edges[e, 1]
        for axis in range(3):
            first, last = slabs[axis, i], slabs[axis, j]
            for place in range(min(first, last), max(first, last)):
                _write_crossing(vertices, i, j, axis, places[axis, place], points, made)
                write_values(directions, points, made, values)
                for slab in range(place, place + 2):
                    keep_farthest(values, made, best[axis, slab], farthest[axis, slab])
                made += 1
    _joggle(points, places)
    return points, best, farthest


@kernel(allocates=False, inline="always")
def _joggle(points: Array, places: Array) -> None:
    """Move points a little, each time alike: no four of them are in a plane then."""
    state = 1
    for axis in range(3):
        size = _JOGGLE * (places[axis, -1] - places[axis, 0])
        for i in range(points.shape[0]):
            state = (1103515245 * state + 12345) % 2147483648
            points[i, axis] += size * (state / 1073741824.0 - 1.0)


@kernel(inline="always")
def _edges_across(faces: Faces, slabs: Indices) -> Indices:
    """Edges between slabs of some axis, hardly any twice, (e, 2).

    Args:
        faces: Shape (t, 3).
        slabs: Slabs of each point, for each axis, shape (3, v).
    """
    first = np.zeros(slabs.shape[1] + 1, dtype=np.int64)
    for f in range(faces.shape[0]):
        for edge in range(3):
            i, j = faces[f, edge], faces[f, (edge + 1) % 3]
            if _apart(slabs, i, j):
                first[min(i, j) + 1] += 1
    for i in range(slabs.shape[1]):
        first[i + 1] += first[i]
    ends, last = np.empty(first[-1], dtype=np.int64), first[:-1].copy()
    edges, count = np.empty((first[-1], 2), dtype=np.int64), 0
    for f in range(faces.shape[0]):
        for edge in range(3):
            i, j = faces[f, edge], faces[f, (edge + 1) % 3]
            if not _apart(slabs, i, j):
                continue
            i, j = min(i, j), max(i, j)
            known = False
            for entry in range(max(first[i], last[i] - _LOOKED_THROUGH), last[i]):
                known = known or ends[entry] == j
            if not known:
                ends[last[i]] = j
                last[i] += 1
                edges[count, 0], edges[count, 1] = i, j
                count += 1
    return edges[:count]


@kernel(allocates=False, inline="always")
def _apart(slabs: Indices, i: int, j: int) -> bool:
    return bool(
        slabs[0, i] != slabs[0, j] or slabs[1, i] != slabs[1, j] or slabs[2, i] != slabs[2, j]
    )


@kernel(allocates=False, inline="always")
def _write_crossing(
    vertices: Array, i: int, j: int, axis: int, at: float, points: Array, row: int
) -> None:
    """Write where the edge between two corners meets a plane across an axis into a row.

    The lower end is taken first whichever way an edge runs: neighbours agree to the last bit.
    """
    if vertices[i, axis] > vertices[j, axis]:
        i, j = j, i
    share = (at - vertices[i, axis]) / (vertices[j, axis] - vertices[i, axis])
    for k in range(3):
        points[row, k] = vertices[i, k] + share * (vertices[j, k] - vertices[i, k])
    points[row, axis] = at


@kernel
def _grow_by_slabs(
    points: Array,
    best: Array,
    farthest: Indices,
    step: int,
    sight: float,
    hull: GrowingHull,
    volumes: Array,
) -> None:
    """Write volumes of the hulls of the slabs up to each one, or from each one on.

    Args:
        points: Shape (m, 3).
        best: How far the slabs' farthest points are along each direction, shape (s, d).
        farthest: Points that are farthest, -1 where there is none, shape (s, d).
        step: 1 for the slabs up to each one, -1 for those from each one on.
        sight: How far a point is above a face if it sees it.
        hull: Room for it.
        volumes: Shape (s,).
    """
    slabs, d = best.shape
    reached = np.full(d, -np.inf)
    added = np.empty(slabs * d, dtype=np.int64)
    count, volume, solid = 0, 0.0, False
    for turn in range(slabs):
        slab = turn if step > 0 else slabs - 1 - turn
        before = count
        for k in range(d):
            if best[slab, k] > reached[k]:
                reached[k] = best[slab, k]
                point, known = farthest[slab, k], False
                for entry in range(before, count):
                    known = known or added[entry] == point
                if not known:
                    added[count] = point
                    count += 1
        if not solid:
            volume = begin_hull(hull, points, added, count)
            solid, before = volume > 0.0, 0
        if solid:
            for entry in range(before, count):
                volume += add_point(hull, points, added[entry], sight)
        volumes[slab] = volume


def cut_surface(surface: Surface, axis: int, at: float) -> tuple[Surface, Surface]:
    """The parts of a surface below and above a plane across an axis; triangles that cross are cut.

    Args:
        surface: Triangles; points that belong to none are left out.
        axis: 0, 1 or 2.
        at: Place of the plane [m].
    """
    vertices, faces, names = surface
    heights = vertices[:, axis] - at
    spans = heights[faces]
    most = 2 * int(((spans.min(axis=1) < 0.0) & (spans.max(axis=1) > 0.0)).sum())
    points = np.vstack([vertices, np.empty((most, 3))])
    size = len(faces) + most
    sides = np.empty((2, size, 3), dtype=np.int64)
    bodies = np.empty((2, size), dtype=np.int64)
    counts = _cut_faces(points, heights, faces, names, axis, at, sides, bodies)
    below, above = (
        used_surface(Surface(points, sides[side, :count], bodies[side, :count].copy()))
        for side, count in enumerate(counts)
    )
    return below, above


def used_surface(surface: Surface) -> Surface:
    """A surface without the points that are no corners, numbered in the order of their use."""
    used, first, number = np.unique(surface.faces, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order))
    return Surface(surface.vertices[used[order]], rank[number].reshape(-1, 3), surface.names)


@kernel
def _cut_faces(
    points: Array,
    heights: Array,
    faces: Faces,
    names: Indices,
    axis: int,
    at: float,
    sides: Indices,
    bodies: Indices,
) -> tuple[int, int]:
    """Write the triangles below a plane and above it; how many each side has.

    Args:
        points: Corners, then room for crossings, shape (v + 2 c, 3).
        heights: Heights of the corners above the plane, shape (v,).
        faces: Shape (t, 3).
        names: The body of each, shape (t,).
        axis: 0, 1 or 2.
        at: Place of the plane.
        sides: Triangles of both sides, shape (2, t + 2 c, 3).
        bodies: The body of each, shape (2, t + 2 c).
    """
    made, counts = heights.shape[0], np.zeros(2, dtype=np.int64)
    for f in range(faces.shape[0]):
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        lowest = min(heights[i], heights[j], heights[k])
        highest = max(heights[i], heights[j], heights[k])
        if lowest >= 0.0 or highest <= 0.0:
            side = 0 if highest <= 0.0 else 1
            _write_triangle(i, j, k, names[f], side, counts, sides, bodies)
            continue
        # The corner that is alone on its side comes first.
        over = (heights[i] > 0.0) + (heights[j] > 0.0) + (heights[k] > 0.0)
        sign = 1.0 if over == 1 else -1.0
        while not sign * heights[i] > 0.0:
            i, j, k = j, k, i
        tip = 1 if sign > 0.0 else 0
        ends = (j, k)
        cut = np.empty(2, dtype=np.int64)
        for end in range(2):
            cut[end] = ends[end]
            if heights[ends[end]] != 0.0:
                _write_crossing(points, i, ends[end], axis, at, points, made)
                cut[end] = made
                made += 1
        for side, a, b, c in (
            (tip, i, cut[0], cut[1]),
            (1 - tip, cut[0], j, k),
            (1 - tip, cut[0], k, cut[1]),
        ):
            if _has_area(points, a, b, c):
                _write_triangle(a, b, c, names[f], side, counts, sides, bodies)
    return counts[0], counts[1]


@kernel(allocates=False, inline="always")
def _write_triangle(
    i: int, j: int, k: int, name: int, side: int, counts: Indices, sides: Indices, bodies: Indices
) -> None:
    row = counts[side]
    sides[side, row, 0], sides[side, row, 1], sides[side, row, 2] = i, j, k
    bodies[side, row] = name
    counts[side] += 1


@kernel(allocates=False, inline="always")
def _has_area(points: Array, i: int, j: int, k: int) -> bool:
    a = (points[i, 0], points[i, 1], points[i, 2])
    n = cross(
        (points[j, 0] - a[0], points[j, 1] - a[1], points[j, 2] - a[2]),
        (points[k, 0] - a[0], points[k, 1] - a[1], points[k, 2] - a[2]),
    )
    return dot(n, n) > 0.0
