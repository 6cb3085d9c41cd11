"""Bodies of a triangle mesh: its connected parts, and which of them bound a solid.

A body is closed where its triangles, turned alike, have no rim, small holes aside: cones over the
rims close it, and have little area beside its own. Fins and inner walls take no inside away: a body
that is not closed may have a core that is. A closed body turned inside out within another one is a
cavity of that one; others are solid, whichever way round the file has them.
"""

from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from kinematics.arrays import Array, Indices
from kinematics.caches.preparation_limit import check_preparation_time
from obstacles.meshes.mesh import Faces
from obstacles.meshes.plane_cut import triangle_areas
from obstacles.meshes.winding import oriented, winding_numbers

#: Part of the diagonal that counts as one point: what single-precision files keep.
_MERGING = 1e-6
#: Part of a body's area that the discs over its holes may have: a link with a screw's hole is a
#: solid, a tube without a lid is none.
_HOLES = 0.03
#: Points at which the winding number is looked up where cones have more than that, though less
#: than the body: over cracks they cancel each other. At so many it must be so nearly whole.
_PROBES, _MOST, _WHOLE = 96, 0.95, 0.05
#: Volume of a body that has none but for rounding, as a part of its area to the power of 3/2.
_FLAT = 1e-12
#: Corners of a body that are looked up for whether it lies within another one.
_LOOKED_UP = 256


class Body(NamedTuple):
    """A connected part of a mesh.

    Args:
        faces: Corners in one place numbered alike; of a closed body turned outward, of a cavity
            inward; shape (f, 3).
        closed: Whether the body bounds a solid or a cavity.
        cavity: Whether the solid is around it.
    """

    faces: Faces
    closed: bool
    cavity: bool


class _Edges(NamedTuple):
    """Edges of triangles (f of them, e edges).

    Args:
        of: The edge of each side, shape (3 f,).
        ends: Lower and higher corner of each edge, shape (e, 2).
        uses: How many sides it has, shape (e,).
        net: How many more of them run up than down, shape (e,).
    """

    of: Indices
    ends: Indices
    uses: Indices
    net: Indices


def mesh_bodies(vertices: Array, faces: Faces) -> list[Body]:
    """The bodies of a mesh.

    Args:
        vertices: Shape (k, 3) [m].
        faces: Shape (f, 3).
    """
    faces = _merged(vertices, faces)
    label = _connected(faces, len(vertices))
    flat = (np.diff(np.sort(faces, axis=1), axis=1) == 0).any(axis=1)
    count = int(label.max(initial=-1)) + 1
    # As written first: two bodies that share a wall are closed by it as long as it is there twice.
    share = _open_share(vertices, faces[~flat], label[~flat], count)
    closed = share == 0.0
    rest = np.flatnonzero(~closed[label])
    once = rest[_first_of_each(faces[rest])]
    turned, kept = faces.copy(), flat | closed[label]
    kept[once] = True
    if len(once):
        turned[once] = oriented(faces[once])
        closed |= _nearly_closed(vertices, turned[once], label[once], count)
        once = once[~closed[label[once]]]
        cores = once[_core(vertices, turned[once], label[once])]
        turned[cores] = oriented(faces[cores])
        closed_core = _nearly_closed(vertices, turned[cores], label[cores], count)
        # What a core leaves over is a body of its own, and open.
        over = closed_core[label] & ~closed[label]
        over[cores] = False
        label = label + count * over
        closed = np.concatenate([closed | closed_core, np.zeros(count, dtype=np.bool_)])
    order = np.flatnonzero(kept)[np.argsort(label[kept], kind="stable")]
    names, first = np.unique(label[order], return_index=True)
    groups = np.split(turned[order], first[1:])
    return _turned_outward(vertices, groups, closed[names])


def _merged(vertices: Array, faces: Faces) -> Faces:
    """Triangles with one number for corners that lie in one place."""
    merging = _MERGING * float(np.linalg.norm(np.ptp(vertices, axis=0)))
    places = vertices
    if merging > 0.0:
        cells = np.round(vertices / merging).astype(np.int64)
        cells -= cells.min(axis=0)
        # The side of a cell is a part of the diagonal: numbers along an axis are below 2**21.
        places = (cells[:, 0] << 42) + (cells[:, 1] << 21) + cells[:, 2]
    _, first, number = np.unique(places, axis=0, return_index=True, return_inverse=True)
    return np.asarray(first[number.reshape(-1)][faces], dtype=np.int64)


def _connected(faces: Faces, size: int) -> Indices:
    """A number for each triangle, (f,): those that share corners have one, from 0 on."""
    pairs = faces[:, [[0, 1], [1, 2]]].reshape(-1, 2)
    return np.unique(_components(pairs, size)[faces[:, 0]], return_inverse=True)[1].reshape(-1)


def _components(pairs: Indices, size: int) -> Indices:
    """Components of a graph of ``size`` nodes by its edges (p, 2), shape (size,)."""
    ones = np.ones(len(pairs), dtype=np.int8)
    graph = scipy.sparse.coo_array((ones, (pairs[:, 0], pairs[:, 1])), shape=(size, size))
    return np.asarray(
        scipy.sparse.csgraph.connected_components(graph, directed=False)[1], dtype=np.int64
    )


def _first_of_each(faces: Faces) -> Indices:
    """Rows of every triangle once, whichever way round, and none of less than three corners."""
    corners = np.sort(faces, axis=1)
    _, first = np.unique(corners, axis=0, return_index=True)
    real = (np.diff(corners[first], axis=1) > 0).all(axis=1)
    return np.asarray(np.sort(first[real]))


def _edges(faces: Faces) -> _Edges:
    begins, ends = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    size, up = int(faces.max(initial=0)) + 1, np.where(begins < ends, 1, -1)
    keys, of, uses = np.unique(
        np.minimum(begins, ends) * size + np.maximum(begins, ends),
        return_inverse=True, return_counts=True,
    )  # fmt: skip
    of = of.reshape(-1)
    net = np.bincount(of, up, len(keys)).astype(np.int64)
    return _Edges(of, np.column_stack(np.divmod(keys, size)), uses, net)


def _nearly_closed(vertices: Array, faces: Faces, label: Indices, count: int) -> NDArray[np.bool_]:
    """Whether bodies have small holes at most; arguments as those of ``_open_share``."""
    share = _open_share(vertices, faces, label, count)
    closed = share <= _HOLES
    for k in np.flatnonzero((share > _HOLES) & (share < 1.0)):
        check_preparation_time()
        own = np.ascontiguousarray(faces[label == k])
        low, high = vertices[own].min(axis=(0, 1)), vertices[own].max(axis=(0, 1))
        points, numbers = (
            np.random.default_rng(0).uniform(low, high, (_PROBES, 3)),
            np.empty(_PROBES),
        )
        winding_numbers(points, vertices, own, numbers)
        whole = (np.abs(numbers - np.round(numbers)) <= _WHOLE).mean() >= _MOST
        closed[k] = whole and (np.abs(numbers) > 0.5).any()
    return closed


def _open_share(vertices: Array, faces: Faces, label: Indices, count: int) -> Array:
    """Area of cones over a body's rims as a part of its own; infinite where it has no volume.

    Args:
        vertices: Shape (k, 3).
        faces: Faces without repeated corners, shape (f, 3).
        label: The body of each, shape (f,).
        count: How many bodies there are.
    """
    check_preparation_time()
    _, first = np.unique(label, return_index=True)
    origin = np.zeros((count, 3))
    origin[label[first]] = vertices[faces[first, 0]]
    a, b, c = (vertices[faces[:, k]] - origin[label] for k in range(3))
    area = np.bincount(label, triangle_areas(vertices[faces]), count)
    volume = np.bincount(label, np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0, count)
    cones = _cone_areas(vertices, faces, label, count)
    solid = np.abs(volume) > _FLAT * area**1.5
    return np.where(solid, cones / np.maximum(area, np.finfo(float).tiny), np.inf)


def _cone_areas(vertices: Array, faces: Faces, label: Indices, count: int) -> Array:
    """Area of cones over the rims of each body, from each rim's middle, shape (count,)."""
    edges = _edges(faces)
    rims = np.flatnonzero(edges.net)
    if not len(rims):
        return np.zeros(count)
    ends = edges.ends[rims]
    rim = _components(ends, int(faces.max()) + 1)[ends[:, 0]]
    middles = 0.5 * (vertices[ends[:, 0]] + vertices[ends[:, 1]])
    total = np.maximum(np.bincount(rim), 1)
    apex = np.column_stack([np.bincount(rim, middles[:, k]) / total for k in range(3)])[rim]
    across = np.cross(vertices[ends[:, 0]] - apex, vertices[ends[:, 1]] - apex)
    owner = np.empty(len(edges.uses), dtype=np.int64)
    owner[edges.of] = np.repeat(label, 3)
    areas = 0.5 * np.linalg.norm(across, axis=1) * np.abs(edges.net[rims])
    return np.asarray(np.bincount(owner[rims], areas, count))


def _core(vertices: Array, faces: Faces, label: Indices) -> NDArray[np.bool_]:
    """Whether triangles are left without fins and inner walls, shape (f,).

    Patches, which end where more than two triangles meet, are taken off a body until it has no rim:
    those with a free edge, then the smallest ones at a rim.
    """
    left = np.ones(len(faces), dtype=np.bool_)
    edges = _edges(faces)
    owner = np.repeat(np.arange(len(faces)), 3)
    order = np.argsort(edges.of, kind="stable")
    pairs = owner[order[edges.uses[edges.of[order]] == 2]].reshape(-1, 2)
    patch = np.unique(_components(pairs, len(faces)), return_inverse=True)[1].reshape(-1)
    area = np.bincount(patch, triangle_areas(vertices[faces]))
    body = np.zeros(len(area), dtype=np.int64)
    body[patch] = label
    while left.any():
        check_preparation_time()
        there = np.repeat(left, 3)
        uses = np.bincount(edges.of[there], minlength=len(edges.uses))[edges.of]
        at_rim = np.unique(patch[owner[there & (uses % 2 == 1)]])
        if not len(at_rim):
            break
        free = np.unique(patch[owner[there & (uses == 1)]])
        at_rim = at_rim[np.lexsort([area[at_rim], body[at_rim]])]
        smallest = at_rim[np.unique(body[at_rim], return_index=True)[1]]
        taken = np.concatenate([free, smallest[~np.isin(body[smallest], body[free])]])
        left &= ~np.isin(patch, taken)
    return left


def _turned_outward(vertices: Array, groups: list[Faces], closed: NDArray[np.bool_]) -> list[Body]:
    """Bodies turned outward but for cavities: those turned unlike the solid they lie within."""
    solids = np.flatnonzero(closed)
    inverted = np.zeros(len(groups), dtype=np.bool_)
    for k in solids:
        a, b, c = (vertices[groups[k][:, i]] - vertices[groups[k][0, 0]] for i in range(3))
        inverted[k] = np.einsum("ij,ij->", a, np.cross(b, c)) < 0.0
    cavity = np.zeros(len(groups), dtype=np.bool_)
    if inverted[solids].any() and not inverted[solids].all():
        low = np.array([vertices[groups[k]].min(axis=(0, 1)) for k in solids])
        high = np.array([vertices[groups[k]].max(axis=(0, 1)) for k in solids])
        sizes = np.prod(high - low, axis=1)
        for n in np.argsort(-sizes, kind="stable"):
            around = np.flatnonzero(
                (low <= low[n]).all(axis=1) & (high >= high[n]).all(axis=1) & (sizes > sizes[n])
            )
            for m in around[np.argsort(sizes[around], kind="stable")]:
                if _within(vertices, groups[solids[n]], groups[solids[m]]):
                    unlike = inverted[solids[n]] != inverted[solids[m]]
                    cavity[solids[n]] = unlike and not cavity[solids[m]]
                    break
    return [
        Body(np.ascontiguousarray(faces[:, :: -1 if turn else 1]), bool(shut), bool(hollow))
        for faces, turn, shut, hollow in zip(
            groups, closed & (inverted != cavity), closed, cavity, strict=True
        )
    ]


def _within(vertices: Array, inner: Faces, outer: Faces) -> bool:
    """Whether corners all over a body lie inside of another one."""
    check_preparation_time()
    corners = np.unique(inner)
    points = vertices[corners[:: len(corners) // _LOOKED_UP + 1]]
    numbers = np.empty(len(points))
    winding_numbers(points, vertices, np.ascontiguousarray(outer), numbers)
    return bool((np.abs(numbers) > 0.5).all())
