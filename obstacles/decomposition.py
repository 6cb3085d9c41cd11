"""Triangle meshes as convex pieces that cover them.

A mesh whose hull lies on it is its hull; bodies that are closed and convex are a hull each; what
is left is cut into nearly convex parts. Each triangle is then proved to lie inside one piece: the
distance to a convex piece is a convex function, so over a triangle it is largest at a corner.
Triangles that straddle pieces are split, and a piece grows by what still sticks out of it.
"""

import hashlib
import tempfile
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from kinematics.chain import Array, frozen
from kinematics.kernel import kernel
from obstacles.hull import Hull, convex_hull
from obstacles.mesh import Faces, cut
from obstacles.nearest import Indices, hull_distances, mesh_distances, nearest_on_hull

#: A hull that is nowhere farther from the mesh than this part of the mesh's diagonal stands for
#: it: a millimetre for an object of half a metre, less than cutting it up would leave.
_CONVEX = 2e-3
#: Points on a hull at which its distance to the mesh is measured.
_SAMPLES = 2000
#: A mesh of more bodies than this is no assembly but a heap of triangles.
_MAX_BODIES = 64
#: Corners a piece may have: each costs every distance query about a nanosecond.
_EXACT_CORNERS = 192
_THINNED_CORNERS = 64
#: Part of the diagonal that thinning may cost before more corners are spent.
_THINNING = 1e-3
#: Part of the diagonal below which a triangle that straddles pieces is split no further.
_SMALLEST = 1e-3
#: Growth that no one notices, as part of the diagonal.
_NEGLIGIBLE = 1e-4
#: Part of the diagonal that counts as one point: what single-precision files keep.
_MERGING = 1e-6

_directory: Path | None = None


@dataclass(frozen=True, slots=True, eq=False)
class ConvexPart:
    """One convex piece of a mesh: the hull of ``vertices`` (k, 3) grown by ``rounding`` [m]."""

    vertices: Array
    rounding: float


def keep_decompositions(directory: Path | None) -> None:
    """Keep decompositions in ``directory`` as well, for other processes and later ones."""
    global _directory  # noqa: PLW0603  one cache a process, like the one in memory
    _directory = directory


def convex_pieces(vertices: Array, faces: Faces) -> tuple[ConvexPart, ...]:
    """Convex pieces whose union covers every triangle of a mesh.

    Args:
        vertices: Shape (k, 3) [m].
        faces: Shape (f, 3).

    Returns:
        The pieces; the same mesh gives the same ones. A flat mesh gives its flat hull.
    """
    used, numbers = np.unique(faces, return_inverse=True)
    return _kept(vertices[used].tobytes(), numbers.astype(np.int64).tobytes())


@lru_cache(maxsize=256)
def _kept(vertices: bytes, faces: bytes) -> tuple[ConvexPart, ...]:
    digest = hashlib.sha256(b"2" + len(vertices).to_bytes(8) + vertices + faces).hexdigest()
    file = _directory / f"{digest}.npz" if _directory is not None else None
    if file is not None and (stored := _read(file)) is not None:
        return stored
    points = np.frombuffer(vertices).reshape(-1, 3)
    parts = _decompose(points, np.frombuffer(faces, dtype=np.int64).reshape(-1, 3))
    if file is not None:
        _write(file, parts)
    return parts


def _read(file: Path) -> tuple[ConvexPart, ...] | None:
    try:
        with np.load(file, allow_pickle=False) as stored:
            counts, vertices, roundings = stored["counts"], stored["vertices"], stored["roundings"]
    except (OSError, ValueError, KeyError, BadZipFile):
        return None
    groups = np.split(vertices, np.cumsum(counts)[:-1])
    return tuple(
        ConvexPart(frozen(group), float(rounding))
        for group, rounding in zip(groups, roundings, strict=True)
    )


def _write(file: Path, parts: tuple[ConvexPart, ...]) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    # Written aside and renamed: another process sees all of it or nothing.
    with tempfile.NamedTemporaryFile(dir=file.parent, suffix=".npz", delete=False) as stream:
        np.savez(
            stream,
            counts=[len(part.vertices) for part in parts],
            vertices=np.vstack([part.vertices for part in parts]),
            roundings=[part.rounding for part in parts],
        )
    Path(stream.name).replace(file)


def _decompose(vertices: Array, faces: Faces) -> tuple[ConvexPart, ...]:
    whole = convex_hull(vertices)
    diagonal = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    if not whole.solid or overhang(whole, vertices, faces) <= _CONVEX * diagonal:
        return (_thinned(whole, _EXACT_CORNERS, _NEGLIGIBLE * diagonal),)
    parts: list[ConvexPart] = []
    rest = []
    for body, closed in _bodies(vertices, faces, _MERGING * diagonal):
        hull = convex_hull(vertices[np.unique(body)])
        if closed and overhang(hull, vertices, body) <= _CONVEX * diagonal:
            parts.append(_thinned(hull, _EXACT_CORNERS, _NEGLIGIBLE * diagonal))
        else:
            rest.append(body)
    if rest:
        used, numbers = np.unique(np.vstack(rest), return_inverse=True)
        for points in cut(vertices[used], numbers.reshape(-1, 3)):
            # What thinning loses here is no part of the mesh, or covered by growing below.
            thinned = _thinned(convex_hull(points), _THINNED_CORNERS, _THINNING * diagonal)
            parts.append(ConvexPart(thinned.vertices, 0.0))
    return _grown(tuple(parts), vertices, faces, diagonal)


def overhang(hull: Hull, vertices: Array, faces: Faces) -> float:
    """Largest distance from points all over a hull to the mesh inside it [m].

    It is what a robot would see of the hull that the mesh has not. Unlike a ratio of volumes it
    needs no closed mesh, and unlike the depth of the mesh in its hull it does not mind inner walls.
    """
    corners = hull.vertices[hull.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(normals, axis=1)
    if not areas.sum() > 0.0:
        return 0.0
    random = np.random.default_rng(0)
    chosen = random.choice(len(areas), _SAMPLES, p=areas / areas.sum())
    weights = random.dirichlet([1.0, 1.0, 1.0], _SAMPLES)
    points = np.einsum("nk,nkd->nd", weights, corners[chosen])
    # The middle of the largest triangles is where a lid over a hollow is seen best.
    points = np.vstack([points, corners[np.argsort(-areas)[:_SAMPLES]].mean(axis=1)])
    distances = np.empty(len(points))
    mesh_distances(points, vertices, faces, distances)
    return float(distances.max())


def _bodies(vertices: Array, faces: Faces, merging: float) -> list[tuple[Faces, bool]]:
    """Connected parts of a mesh, and whether each is closed: every edge has two triangles."""
    _, number = np.unique(np.round(vertices / merging), axis=0, return_inverse=True)
    merged = number.reshape(-1)[faces]
    edges = np.sort(merged[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    size = int(merged.max()) + 1
    graph = coo_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(size, size))
    label = connected_components(graph, directed=False)[1][merged[:, 0]]
    if label.max() == 0 or len(np.unique(label)) > _MAX_BODIES:
        return [(faces, False)]
    bodies = []
    for body in np.unique(label):
        own = np.flatnonzero(label == body)
        rows = edges.reshape(-1, 3, 2)[own].reshape(-1, 2)
        _, counts = np.unique(rows, axis=0, return_counts=True)
        bodies.append((faces[own], bool((counts == 2).all())))
    return bodies


def _thinned(hull: Hull, most: int, tolerance: float) -> ConvexPart:
    """The hull of some of a hull's corners, grown to hold the others."""
    points = hull.vertices
    if len(points) <= most or not hull.solid:
        return ConvexPart(frozen(points), 0.0)
    signs = np.array([[x, y, z] for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)])
    chosen = {int(i) for i in (points @ signs.T).argmax(axis=0)}
    distances = np.empty(len(points))
    while True:
        inner = convex_hull(points[sorted(chosen)])
        hull_distances(
            points, inner.vertices, inner.triangles, inner.planes, inner.solid, distances
        )
        worst = int(distances.argmax())
        if len(chosen) >= most or distances[worst] <= tolerance:
            return ConvexPart(frozen(inner.vertices), max(0.0, float(distances[worst])))
        chosen.add(worst)


def _grown(
    parts: tuple[ConvexPart, ...], vertices: Array, faces: Faces, diagonal: float
) -> tuple[ConvexPart, ...]:
    """The parts, each grown by what the triangles nearest to it stick out."""
    hulls = [convex_hull(part.vertices) for part in parts]
    packed = _Hulls(
        np.vstack([hull.vertices for hull in hulls]),
        np.vstack([hull.triangles for hull in hulls]),
        np.vstack([hull.planes for hull in hulls]),
        np.array([hull.solid for hull in hulls]),
        np.cumsum([0] + [len(hull.vertices) for hull in hulls]),
        np.cumsum([0] + [len(hull.triangles) for hull in hulls]),
    )
    radii = np.array([part.rounding for part in parts])
    growth = np.zeros(len(parts))
    smallest = _SMALLEST * diagonal
    _cover(vertices, faces, packed, radii, _NEGLIGIBLE * diagonal, smallest, growth)
    return tuple(
        ConvexPart(part.vertices, float(radius))
        for part, radius in zip(parts, radii + growth, strict=True)
    )


class _Hulls(NamedTuple):
    """Hulls of several pieces, packed: those of piece i are from ``starts[i]`` to the next."""

    corners: Array
    triangles: Faces
    planes: Array
    solid: NDArray[np.bool_]
    corner_starts: Indices
    face_starts: Indices


@kernel
def _height(hulls: _Hulls, i: int, p: Array) -> float:
    """Height of a point over the planes of piece i: its distance, or less where it is outside."""
    if not hulls.solid[i]:
        return -np.inf
    height = -np.inf
    planes = hulls.planes
    for f in range(hulls.face_starts[i], hulls.face_starts[i + 1]):
        above = planes[f, 0] * p[0] + planes[f, 1] * p[1] + planes[f, 2] * p[2] - planes[f, 3]
        height = max(height, above)
    return height


@kernel
def _distance(hulls: _Hulls, i: int, p: Array) -> float:
    """Signed distance of a point to piece i."""
    corners = hulls.corners[hulls.corner_starts[i] : hulls.corner_starts[i + 1]]
    first, last = hulls.face_starts[i], hulls.face_starts[i + 1]
    point = (p[0], p[1], p[2])
    nearest = nearest_on_hull(
        point, corners, hulls.triangles[first:last], hulls.planes[first:last], hulls.solid[i]
    )
    return nearest[3]


@kernel
def _inside_one(
    hulls: _Hulls, radii: Array, triangle: Array, first: int, out: Array, exact: NDArray[np.bool_]
) -> int:
    """The piece that holds a triangle's corners in its hull, or -1; looked for from ``first`` on.

    On the way it writes how far corner k is out of piece i with its radius, at least: (p, 3).
    """
    pieces = radii.shape[0]
    for turn in range(pieces):
        i: int = (first + turn) % pieces
        for k in range(3):
            height = _height(hulls, i, triangle[k])
            out[i, k] = height - radii[i]
            exact[i, k] = hulls.solid[i] and height <= 0.0
        if exact[i].all():
            return i
    return -1


@kernel
def _nearest_piece(
    hulls: _Hulls,
    radii: Array,
    growth: Array,
    triangle: Array,
    out: Array,
    exact: NDArray[np.bool_],
) -> int:
    """The piece that a triangle sticks out of least, or one that has grown enough to hold it."""
    best, piece = np.inf, 0
    for i in range(radii.shape[0]):
        if out[i].max() >= max(best, growth[i]):
            continue
        for k in range(3):
            if not exact[i, k]:
                out[i, k] = _distance(hulls, i, triangle[k]) - radii[i]
                exact[i, k] = True
        if out[i].max() <= growth[i]:
            return i
        if out[i].max() < best:
            best, piece = out[i].max(), i
    return piece


@kernel
def _unavoidable(
    hulls: _Hulls, radii: Array, triangle: Array, out: Array, exact: NDArray[np.bool_]
) -> float:
    """How far the worst corner of a triangle is out of all pieces: no splitting helps that."""
    worst = 0.0
    for k in range(3):
        least = np.inf
        for i in range(radii.shape[0]):
            if exact[i, k]:
                least = min(least, out[i, k])
        for i in range(radii.shape[0]):
            if not exact[i, k] and out[i, k] < least:
                out[i, k] = _distance(hulls, i, triangle[k]) - radii[i]
                exact[i, k] = True
                least = min(least, out[i, k])
        worst = max(worst, least)
    return worst


@kernel
def _cover(
    vertices: Array,
    faces: Faces,
    hulls: _Hulls,
    radii: Array,
    negligible: float,
    smallest: float,
    growth: Array,
) -> None:
    """Write into ``growth`` how much each piece has to grow for the union to hold all faces."""
    out = np.empty((radii.shape[0], 3))
    exact = np.empty((radii.shape[0], 3), dtype=np.bool_)
    # Depth first: a triangle split in two leaves one more to do, and halves at most 60 times.
    stack = np.empty((64, 3, 3))
    # Neighbours tend to lie in the same piece.
    last = 0
    for f in range(faces.shape[0]):
        for k in range(3):
            stack[0, k] = vertices[faces[f, k]]
        count = 1
        while count > 0:
            count -= 1
            triangle = stack[count].copy()
            found = _inside_one(hulls, radii, triangle, last, out, exact)
            if found >= 0:
                last = found
                continue
            piece = _nearest_piece(hulls, radii, growth, triangle, out, exact)
            best = out[piece].max()
            if best <= growth[piece]:
                last = piece
                continue
            edge, longest = 0, 0.0
            for k in range(3):
                length = float(np.linalg.norm(triangle[k] - triangle[(k + 1) % 3]))
                if length > longest:
                    edge, longest = k, length
            if (
                best <= negligible
                or longest <= smallest
                or count > 61
                or best <= _unavoidable(hulls, radii, triangle, out, exact) + negligible
            ):
                growth[piece] = best
                continue
            middle = 0.5 * (triangle[edge] + triangle[(edge + 1) % 3])
            stack[count] = triangle
            stack[count, edge] = middle
            stack[count + 1] = triangle
            stack[count + 1, (edge + 1) % 3] = middle
            count += 2
