"""Triangles cut by planes across an axis, and what a cut leaves of the hulls' volume.

A hull's volume is looked up on the points that are the farthest ones along some directions. Those
of a union are among those of its parts: points are put into slabs between the places of a cut, and
a hull grows from slab to slab, once from either end.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics.arrays import Array, Indices
from obstacles.convex.growing_hull import hull_volumes
from obstacles.convex.piece import DIRECTIONS, farthest_points
from obstacles.meshes.mesh import Faces

#: Places at which a cut is tried, along each axis.
_PLACES = 12


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
    sides = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    edges = np.column_stack(np.divmod(np.unique(sides @ [len(vertices), 1]), len(vertices)))
    for axis in range(3):
        if not high[axis] > low[axis]:
            continue
        places = np.linspace(low[axis], high[axis], _PLACES + 2)[1:-1]
        slabs = _slabs(vertices, edges, axis, places)
        below, above = _volumes(slabs), _volumes(slabs[::-1])[::-1]
        saved = below[-1] - (below[:-1] + above[1:])
        k = int(saved.argmax())
        if saved[k] > best[2]:
            best = (axis, float(places[k]), float(saved[k]))
    return best


def _slabs(vertices: Array, edges: Indices, axis: int, places: Array) -> list[Array]:
    """The farthest points of each slab between places; edges meet a place in both beside it."""
    slab = np.searchsorted(places, vertices[:, axis])
    points = [[vertices[slab == k]] for k in range(len(places) + 1)]
    first, last = np.sort(slab[edges], axis=1).T
    for k, place in enumerate(places):
        across = _crossings(vertices, edges[(first <= k) & (k < last)], axis, place)
        points[k].append(across)
        points[k + 1].append(across)
    return [farthest_points(np.concatenate(own)) for own in points]


def _crossings(vertices: Array, edges: Indices, axis: int, at: float) -> Array:
    """Points where edges (e, 2) meet a plane across an axis, shape (e, 3).

    The lower end is taken first whichever way an edge runs: neighbours agree to the last bit.
    """
    heights = vertices[edges, axis]
    order = np.where(heights[:, :1] > heights[:, 1:], [[1, 0]], [[0, 1]])
    low, high = np.moveaxis(vertices[np.take_along_axis(edges, order, axis=1)], 1, 0)
    share = (at - low[:, axis]) / (high[:, axis] - low[:, axis])
    points: Array = low + share[:, None] * (high - low)
    points[:, axis] = at
    return points


def _volumes(slabs: Sequence[Array]) -> Array:
    """Volumes of the hulls of the first slab, of the first two, and so on."""
    reached, outer = np.full(DIRECTIONS.shape[1], -np.inf), list[Array]()
    for slab in slabs:
        values = np.vstack([reached, slab @ DIRECTIONS])
        outer.append(slab[np.setdiff1d(values.argmax(axis=0), [0]) - 1])
        reached = values.max(axis=0)
    return hull_volumes(np.concatenate(outer), np.cumsum([len(own) for own in outer]))


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
    low, high = spans.min(axis=1) < 0.0, spans.max(axis=1) > 0.0
    rows = np.flatnonzero(low & high)
    # The corner that is alone on its side comes first.
    sign = np.where((spans[rows] > 0.0).sum(axis=1) == 1, 1.0, -1.0)
    alone = (sign[:, None] * spans[rows] > 0.0).argmax(axis=1)
    i, j, k = np.take_along_axis(faces[rows], (alone[:, None] + np.arange(3)) % 3, axis=1).T
    edges = np.column_stack([i, j, i, k]).reshape(-1, 2)
    crossed = heights[edges[:, 1]] != 0.0
    ends = edges[:, 1].copy()
    ends[crossed] = len(vertices) + np.arange(crossed.sum())
    points = np.concatenate([vertices, _crossings(vertices, edges[crossed], axis, at)])
    p, q = ends.reshape(-1, 2).T
    parts = np.stack([np.column_stack(c) for c in ((i, p, q), (p, j, k), (p, k, q))], axis=1)
    tips = np.stack([sign > 0.0, sign < 0.0, sign < 0.0], axis=1).reshape(-1)
    parts, owner = parts.reshape(-1, 3), np.repeat(rows, 3)
    corners = points[parts]
    n = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    real = (n * n).sum(axis=1) > 0.0
    whole = np.flatnonzero(~(low & high))
    triangles = np.concatenate([faces[whole], parts[real]])
    owners = np.concatenate([whole, owner[real]])
    over = np.concatenate([high[whole], tips[real]])
    order = np.argsort(owners, kind="stable")
    below, above = (
        used_surface(Surface(points, triangles[chosen], names[owners[chosen]]))
        for chosen in (order[~over[order]], order[over[order]])
    )
    return below, above


def used_surface(surface: Surface) -> Surface:
    """A surface without the points that are no corners, numbered in the order of their use."""
    used, first, number = np.unique(surface.faces, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order))
    return Surface(surface.vertices[used[order]], rank[number].reshape(-1, 3), surface.names)
