"""A convex hull that grows point by point, kept as triangles with the planes across them.

A point outside sees some of the faces; they give way to triangles from the rim of what it sees to
the point. Source: "Computational geometry in C", chapter 4, the incremental algorithm.
"""

import math

import numpy as np

from compiled.kernel import kernel
from compiled.vec3 import cross, dot, row, subtract
from kinematics.arrays import Array, Indices

#: Parts of the points' extent: how far points are moved, so that no four of them are in a plane;
#: how far a point is above a hull that grows to it, and above the faces that give way then; and
#: the thickness of what has a volume.
_JOGGLE, _SIGHT, _COPLANAR, _FLAT = 1e-5, 1e-4, 1e-10, 5e-5


@kernel(inline="always")
def _plane(corners: Array, p: int, q: int, r: int) -> tuple[float, float, float, float]:
    """Unit normal and offset of the plane through three corners; offset inf where there is none."""
    a = (corners[p, 0], corners[p, 1], corners[p, 2])
    b = (corners[q, 0], corners[q, 1], corners[q, 2])
    c = (corners[r, 0], corners[r, 1], corners[r, 2])
    n = cross(subtract(b, a), subtract(c, a))
    length = math.sqrt(dot(n, n))
    if not length > 1e-18:
        return 0.0, 0.0, 0.0, np.inf
    return n[0] / length, n[1] / length, n[2] / length, dot(n, a) / length


@kernel(inline="always")
def put_face(corners: Array, faces: Indices, planes: Array, at: int, skipped: int) -> None:
    """Write the face of the first tetrahedron that lacks corner ``skipped``, seen from outside."""
    p, q, r = (skipped + 1) % 4, (skipped + 2) % 4, (skipped + 3) % 4
    plane = _plane(corners, p, q, r)
    inner = (corners[skipped, 0], corners[skipped, 1], corners[skipped, 2])
    if dot((plane[0], plane[1], plane[2]), inner) > plane[3]:
        q, r = r, q
        plane = _plane(corners, p, q, r)
    faces[at, 0], faces[at, 1], faces[at, 2] = p, q, r
    planes[at, 0], planes[at, 1], planes[at, 2], planes[at, 3] = plane


@kernel(inline="always")
def grow(
    corners: Array, new: int, faces: Indices, planes: Array, made: int, coplanar: float
) -> int:
    """Replace the faces that corner ``new`` sees by those that join it to their rim.

    Args:
        corners: Corners of the hull in the first three columns.
        new: The row of the new one.
        faces: Corners of each face, counter-clockwise seen from outside, shape (f, 3).
        planes: Unit normal and offset of each face, shape (f, 4).
        made: How many faces there are.
        coplanar: A corner beyond a face by less than this lies in its plane: slivers would open
            the rim [m].

    Returns:
        How many there are then.
    """
    w = (corners[new, 0], corners[new, 1], corners[new, 2])
    rim = np.empty((3 * made, 2), dtype=np.int64)
    edges, kept = 0, 0
    for f in range(made):
        beyond = dot((planes[f, 0], planes[f, 1], planes[f, 2]), w) - planes[f, 3]
        if not beyond > coplanar:
            if kept < f:
                for k in range(3):
                    faces[kept, k] = faces[f, k]
                for k in range(4):
                    planes[kept, k] = planes[f, k]
            kept += 1
            continue
        for side in range(3):
            p, q = faces[f, side], faces[f, (side + 1) % 3]
            opposite = -1
            for e in range(edges):
                if rim[e, 0] == q and rim[e, 1] == p:
                    opposite = e
            if opposite >= 0:
                edges -= 1
                rim[opposite, 0], rim[opposite, 1] = rim[edges, 0], rim[edges, 1]
            else:
                rim[edges, 0], rim[edges, 1] = p, q
                edges += 1
    for e in range(edges):
        if kept == faces.shape[0]:
            break
        faces[kept, 0], faces[kept, 1], faces[kept, 2] = rim[e, 0], rim[e, 1], new
        plane = _plane(corners, rim[e, 0], rim[e, 1], new)
        planes[kept, 0], planes[kept, 1], planes[kept, 2], planes[kept, 3] = plane
        kept += 1
    return kept


def hull_volumes(points: Array, ends: Indices) -> Array:
    """Volumes of the hulls of the first points, up to each of some numbers.

    They are right to a ten thousandth of the whole or so; of what is flat they are 0.

    Args:
        points: Shape (m, 3) [m].
        ends: Numbers of points, ascending, the last of them m, shape (k,).
    """
    volumes, extent = np.zeros(len(ends)), float(np.ptp(points, axis=0).max())
    moved = np.random.default_rng(0).uniform(-_JOGGLE, _JOGGLE, points.shape)
    moved += (points - points[0]) / max(extent, np.finfo(float).tiny)
    for k, end in enumerate(ends):
        first = _tetrahedron(moved[:end])
        if len(first):
            order = np.concatenate([first, np.delete(np.arange(len(points)), first)])
            _write_volumes(moved[order], ends[k:], volumes[k:])
            break
    return volumes * extent**3


def _tetrahedron(points: Array) -> Indices:
    """Numbers of four far points with a volume between them; none of what is flat.

    They are the first point, the farthest from it, the farthest from the line through both, and the
    farthest from the plane through the three.
    """
    away = points - points[0]
    j = int((away**2).sum(axis=1).argmax())
    across = np.cross(away[j], away)
    k = int((across**2).sum(axis=1).argmax())
    heights = np.abs(away @ across[k])
    m = int(heights.argmax())
    return np.array([0, j, k, m] if heights[m] > _FLAT * np.linalg.norm(across[k]) else [])


@kernel
def _write_volumes(points: Array, ends: Indices, volumes: Array) -> None:
    """Write the volumes of the hulls of points, of which the first four are a tetrahedron."""
    room, made = 4 * points.shape[0], 4
    faces, planes = np.empty((room, 3), dtype=np.int64), np.empty((room, 4))
    for skipped in range(4):
        put_face(points, faces, planes, skipped, skipped)
    for k in range(ends.shape[0]):
        for i in range(4 if k == 0 else ends[k - 1], ends[k]):
            p, highest = row(points, i), -np.inf
            for f in range(made):
                highest = max(highest, dot(row(planes, f), p) - planes[f, 3])
            if highest > _SIGHT:
                made = grow(points, i, faces, planes, made, _COPLANAR)
        for f in range(made):
            a, b, c = (row(points, faces[f, 0]), row(points, faces[f, 1]), row(points, faces[f, 2]))
            volumes[k] += dot(a, cross(b, c)) / 6.0
