"""Triangle meshes as convex pieces that cover them, each with the triangles it stands for.

A body whose hull is the body is its hull. What is not convex is cut by planes where that saves the
hulls of the parts most volume. A part's hull covers it, cut faces included: what a plane cuts out
of a solid is bounded by where it cuts the surface, and those points belong to both parts. So a
distance to all hulls is a distance to the solid; where it does not do, the triangles decide
(``obstacles.mesh_distance``), and nothing is filled that the mesh leaves open.
"""

import hashlib
import tempfile
from dataclasses import dataclass, fields
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, QhullError

from kinematics.arrays import Array, Indices, frozen
from kinematics.compiled.kernel import kernel
from obstacles.closest_point import hull_distances, mesh_distances
from obstacles.hull import Hull, convex_hull
from obstacles.mesh import Faces
from obstacles.winding import is_solid, oriented, winding_numbers

#: A hull that is nowhere farther from the mesh than this stands for it [m]: half of what verdicts
#: are held to.
_SAME = 5e-7
#: Part of a hull's area that may be missing from a mesh that has the same area but for rounding.
_SAME_AREA = 1e-6
#: Points on a hull at which its distance to the mesh is measured.
_SAMPLES = 2000
#: A mesh of more bodies than this is no assembly but a heap of triangles.
_MAX_BODIES = 64
#: Corners a piece may have that is the mesh itself, and one that only covers it.
_EXACT_CORNERS = 192
_COVER_CORNERS = 128
#: Part of the diagonal that thinning may cost before more corners are spent.
_THINNING = 1e-3
#: Part of the diagonal that counts as one point: what single-precision files keep.
_MERGING = 1e-6
#: Places at which a cut is tried, along each axis.
_PLACES = 12
#: A cut is worth a piece more if it saves this part of the volume of the whole mesh's hull.
_WORTH = 0.02
_MOST_PARTS = 12
#: Winding number beyond which a point is inside.
_INSIDE = 0.5
#: Corners that a cover gets at once.
_THINNED_AT_ONCE = 8


def _spread(count: int) -> Array:
    """Directions all over the sphere, (count, 3), along a spiral of equal areas."""
    z = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    turn = np.pi * (1.0 + np.sqrt(5.0)) * np.arange(count)
    flat = np.sqrt(1.0 - z * z)
    return np.column_stack([flat * np.cos(turn), flat * np.sin(turn), z])


#: Where to look for the corners of a hull when only its volume is of interest.
_DIRECTIONS = np.vstack([_spread(200), np.eye(3), -np.eye(3)])

_directory: Path | None = None


@dataclass(frozen=True, slots=True, eq=False)
class ConvexPart:
    """One convex piece of a mesh: the hull of ``vertices`` (k, 3) grown by ``rounding`` [m].

    Args:
        vertices: Of the hull.
        rounding: What it is grown by.
        triangles: What it covers, corners of each, shape (t, 3, 3); none where it is the mesh.
        anchors: A point on each of the bodies they belong to, shape (r, 3).
        filled: Whether they bound a solid, together with those of the other filled parts.
    """

    vertices: Array
    rounding: float
    triangles: Array
    anchors: Array
    filled: bool


def keep_decompositions(directory: Path | None) -> None:
    """Keep decompositions in ``directory`` as well, for other processes and later ones."""
    global _directory  # noqa: PLW0603  one cache a process, like the one in memory
    _directory = directory


def convex_pieces(vertices: Array, faces: Faces) -> tuple[ConvexPart, ...]:
    """Convex pieces whose union covers a mesh and what it encloses.

    Args:
        vertices: Shape (k, 3) [m].
        faces: Shape (f, 3).

    Returns:
        The pieces, filled ones first; the same mesh gives the same ones.
    """
    used, numbers = np.unique(faces, return_inverse=True)
    return _kept(vertices[used].tobytes(), numbers.astype(np.int64).tobytes())


@lru_cache(maxsize=256)
def _kept(vertices: bytes, faces: bytes) -> tuple[ConvexPart, ...]:
    digest = hashlib.sha256(b"4" + len(vertices).to_bytes(8) + vertices + faces).hexdigest()
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
            columns = [_ungrouped(stored, item.name) for item in fields(ConvexPart)]
    except (OSError, ValueError, KeyError, BadZipFile):
        return None
    return tuple(
        ConvexPart(frozen(v), float(r[0]), frozen(t), frozen(a), bool(f[0]))
        for v, r, t, a, f in zip(*columns, strict=True)
    )


def _ungrouped(stored: "np.lib.npyio.NpzFile", name: str) -> list[Array]:
    return np.split(stored[name], np.cumsum(stored[f"{name}_counts"])[:-1])


def _write(file: Path, parts: tuple[ConvexPart, ...]) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    columns: dict[str, Any] = {}
    for item in fields(ConvexPart):
        own = [np.atleast_1d(getattr(part, item.name)) for part in parts]
        columns[item.name] = np.concatenate(own)
        columns[f"{item.name}_counts"] = np.array([len(array) for array in own])
    # Written aside and renamed: another process sees all of it or nothing.
    with tempfile.NamedTemporaryFile(dir=file.parent, suffix=".npz", delete=False) as stream:
        np.savez(stream, **columns)
    Path(stream.name).replace(file)


class _Body(NamedTuple):
    """A connected part of a mesh: triangles all turned alike, and whether they bound a solid."""

    faces: Faces
    hull: Hull
    solid: bool
    volume: float


def _decompose(vertices: Array, faces: Faces) -> tuple[ConvexPart, ...]:
    diagonal = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    whole = convex_hull(vertices[np.unique(faces)])
    if _is_hull(whole, vertices, faces) and _has_no_inside_walls(whole, vertices, faces):
        return (_as_it_is(whole),)
    bodies = [_body(vertices, own) for own in _connected(vertices, faces, _MERGING * diagonal)]
    # A body turned inside out is a cavity of another one: then nothing may be filled unasked.
    cavities = len({body.volume > 0.0 for body in bodies if body.solid}) > 1
    convex = [
        not (cavities and body.solid) and _is_hull(body.hull, vertices, body.faces)
        for body in bodies
    ]
    rest = [body for body, is_convex in zip(bodies, convex, strict=True) if not is_convex]
    parts = _parts(vertices, [body.faces for body in rest if body.solid], diagonal, True)
    parts += _parts(vertices, [body.faces for body in rest if not body.solid], diagonal, False)
    parts += [_as_it_is(b.hull) for b, is_convex in zip(bodies, convex, strict=True) if is_convex]
    return tuple(sorted(parts, key=lambda part: not part.filled))


def _as_it_is(hull: Hull) -> ConvexPart:
    none = frozen(np.zeros((0, 3)))
    return ConvexPart(hull.vertices, 0.0, frozen(np.zeros((0, 3, 3))), none, False)


def _body(vertices: Array, faces: Faces) -> _Body:
    hull = convex_hull(vertices[np.unique(faces)])
    once, faces = _without_repeats(faces), oriented(faces)
    solid = hull.solid and is_solid(vertices, faces)
    if hull.solid and not solid and len(once) < len(faces):
        # A triangle that is there twice winds around twice: without it there may be an inside.
        once = oriented(once)
        solid = is_solid(vertices, once)
        faces = once if solid else faces
    a, b, c = (vertices[faces[:, k]] - vertices[faces[0, 0]] for k in range(3))
    volume = float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)
    return _Body(faces, hull, solid, volume)


def _without_repeats(faces: Faces) -> Faces:
    """Every triangle once, whichever way round, and none of less than three corners."""
    corners = np.sort(faces, axis=1)
    real = (np.diff(corners, axis=1) > 0).all(axis=1)
    _, first = np.unique(corners, axis=0, return_index=True)
    return faces[np.intersect1d(first, np.flatnonzero(real))]


def _is_hull(hull: Hull, vertices: Array, faces: Faces) -> bool:
    """Whether every point of a hull's surface is one of the mesh inside it."""
    if len(hull.vertices) > _EXACT_CORNERS:
        return False
    corners = hull.vertices[hull.triangles]
    wanted = float(_areas(corners).sum())
    if hull.solid:
        own = vertices[np.unique(np.sort(faces, axis=1), axis=0)]
        lies = np.zeros(len(own), dtype=np.bool_)
        for plane in hull.planes:
            lies |= (np.abs(own @ plane[:3] - plane[3]) <= _SAME).all(axis=1)
        if float(_areas(own[lies]).sum()) < (1.0 - _SAME_AREA) * wanted:
            return False
    return overhang(hull, vertices, faces) <= _SAME


def _has_no_inside_walls(hull: Hull, vertices: Array, faces: Faces) -> bool:
    """Whether no corner of a mesh lies deep in its hull, as those of a cavity would."""
    if not hull.solid:
        return True
    used = vertices[np.unique(faces)]
    return all(
        float((block @ hull.planes[:, :3].T - hull.planes[:, 3]).max(axis=1).min()) >= -_SAME
        for block in np.array_split(used, len(used) // 4096 + 1)
    )


def _areas(corners: Array) -> Array:
    """Areas of triangles (t, 3, 3)."""
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return np.asarray(0.5 * np.linalg.norm(cross, axis=1))


def overhang(hull: Hull, vertices: Array, faces: Faces) -> float:
    """Largest distance from points all over a hull to the mesh inside it [m].

    It is what a robot would see of the hull that the mesh has not. Unlike a ratio of volumes it
    needs no closed mesh, and unlike the depth of the mesh in its hull it does not mind inner walls.
    """
    corners = hull.vertices[hull.triangles]
    areas = _areas(corners)
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


def _connected(vertices: Array, faces: Faces, merging: float) -> list[Faces]:
    """Connected parts of a mesh, each with one number for corners that lie in one place."""
    _, first, number = np.unique(
        np.round(vertices / merging) if merging > 0.0 else vertices,
        axis=0, return_index=True, return_inverse=True,
    )  # fmt: skip
    merged = first[number.reshape(-1)][faces]
    edges = merged[:, [[0, 1], [1, 2]]].reshape(-1, 2)
    size = len(vertices)
    graph = coo_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(size, size))
    label = connected_components(graph, directed=False)[1][merged[:, 0]]
    names = np.unique(label)
    if len(names) > _MAX_BODIES:
        return [merged]
    return [merged[label == name] for name in names]


class _Bodies(NamedTuple):
    """Bodies that are cut together.

    Args:
        vertices: Shape (k, 3).
        faces: Of all, shape (f, 3).
        filled: Whether they bound solids.
        diagonal: Of the whole mesh [m].
    """

    vertices: Array
    faces: Faces
    filled: bool
    diagonal: float

    def inside(self, points: Array) -> Array:
        """Those of ``points`` (m, 3) that the bodies enclose."""
        numbers = np.zeros(len(points))
        if self.filled and len(points):
            winding_numbers(points, self.vertices, self.faces, numbers)
        return np.asarray(points[np.abs(numbers) > _INSIDE])


class _Part(NamedTuple):
    """What planes have cut out of bodies.

    Args:
        triangles: What is there of the surface, shape (t, 3, 3).
        names: The body of each, shape (t,).
        box: Where the planes are, lowest and highest, infinite where none is, shape (2, 3).
        inner: Corners of the box that are inside the bodies, shape (c, 3).
        volume: Of the hull [m^3].
        axis: Across which another cut is best.
        at: Where.
        saved: Volume that this would save [m^3].
    """

    triangles: Array
    names: NDArray[np.int64]
    box: Array
    inner: Array
    volume: float = 0.0
    axis: int = 0
    at: float = 0.0
    saved: float = 0.0

    @property
    def points(self) -> Array:
        """All whose hull covers the part, shape (3 t + c, 3)."""
        return np.vstack([self.triangles.reshape(-1, 3), self.inner])


def _parts(vertices: Array, own: list[Faces], diagonal: float, filled: bool) -> list[ConvexPart]:
    """Bodies cut together, by planes, until no cut saves enough."""
    if not own:
        return []
    bodies = _Bodies(vertices, np.ascontiguousarray(np.vstack(own)), filled, diagonal)
    names = np.repeat(np.arange(len(own)), [len(faces) for faces in own])
    box = np.array([[-np.inf] * 3, [np.inf] * 3])
    found = [_weighed(_Part(vertices[bodies.faces], names, box, np.zeros((0, 3))))]
    enough = _WORTH * found[0].volume
    ahead = not found[0].saved > enough
    if ahead:
        found = [_ahead(bodies, found[0], enough)]
    while len(found) < _MOST_PARTS:
        best = max(range(len(found)), key=lambda k: found[k].saved)
        if not found[best].saved > enough:
            break
        halves = [_weighed(side) for side in _halves(bodies, found[best])]
        # What it saves was an estimate.
        saved = found[best].volume - sum(half.volume for half in halves)
        worth = saved > enough or (ahead and len(found) == 1)
        found[best : best + 1] = halves if worth else [found[best]._replace(saved=0.0)]
    return [_covered(part, bodies) for part in found]


def _halves(bodies: _Bodies, part: _Part) -> list[_Part]:
    """What is below the plane chosen for a part, and what is above it."""
    sides = _cut(part.triangles, part.names, part.axis, part.at)
    halves = []
    for side, (triangles, names) in enumerate(sides):
        box = part.box.copy()
        box[1 - side, part.axis] = part.at
        corners = np.array([[box[i, 0], box[j, 1], box[k, 2]] for i, j, k in np.ndindex(2, 2, 2)])
        inner = bodies.inside(corners[np.isfinite(corners).all(axis=1)])
        if len(triangles) or len(inner):
            halves.append(_Part(triangles, names, box, inner))
    return halves


def _covered(part: _Part, bodies: _Bodies) -> ConvexPart:
    if not len(part.triangles):  # a box all of which is inside
        return _as_it_is(convex_hull(part.inner))
    corners, rounding = _thinned(convex_hull(part.points), _THINNING * bodies.diagonal)
    _, first = np.unique(part.names, return_index=True)
    anchors = frozen(part.triangles[first, 0])
    return ConvexPart(corners, rounding, frozen(part.triangles), anchors, bodies.filled)


def _thinned(hull: Hull, tolerance: float) -> tuple[Array, float]:
    """Some of a hull's corners, and what their hull must be grown by to hold the others."""
    points = hull.vertices
    if len(points) <= _COVER_CORNERS or not hull.solid:
        return frozen(points), 0.0
    signs = np.array([[x, y, z] for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)])
    chosen = {int(i) for i in (points @ signs.T).argmax(axis=0)}
    distances = np.empty(len(points))
    while True:
        inner = convex_hull(points[sorted(chosen)])
        hull_distances(
            points, inner.vertices, inner.triangles, inner.planes, inner.solid, distances
        )
        if len(chosen) >= _COVER_CORNERS or distances.max() <= tolerance:
            return frozen(inner.vertices), max(0.0, float(distances.max()))
        # Several at once: a hull costs more than a corner too many.
        chosen |= {int(i) for i in np.argsort(-distances)[:_THINNED_AT_ONCE]}


def _weighed(part: _Part) -> _Part:
    """The part with its volume and its best cut."""
    points = np.unique(part.points, axis=0)
    best, volume = part._replace(volume=_volume(points)), _grown([points])[0]
    edges = part.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2, 3)
    for axis in range(3):
        low, high = float(points[:, axis].min()), float(points[:, axis].max())
        if not volume > 0.0 or not high > low:
            continue
        places = np.linspace(low, high, _PLACES + 2)[1:-1]
        at, left = _cheapest(edges, points, axis, places)
        if volume - left > best.saved:
            best = best._replace(axis=axis, at=at, saved=volume - left)
    return best


def _ahead(bodies: _Bodies, part: _Part, enough: float) -> _Part:
    """The part with a cut through its middle where only cutting its halves again saves volume.

    No single cut helps a ring, whose halves have hulls as large as half of its own.
    """
    points, best = part.points, part
    for axis in range(3):
        at = 0.5 * float(points[:, axis].min() + points[:, axis].max())
        halves = [_weighed(side) for side in _halves(bodies, part._replace(axis=axis, at=at))]
        saved = part.volume - sum(half.volume - half.saved for half in halves)
        if len(halves) == 2 and saved > max(best.saved, enough):
            best = part._replace(axis=axis, at=at, saved=saved)
    return best


def _cheapest(edges: Array, points: Array, axis: int, places: Array) -> tuple[float, float]:
    """Where a cut across an axis leaves the hulls least volume, and how much that is."""
    place = np.searchsorted(places, points[:, axis])
    order = np.argsort(place, kind="stable")
    slabs = np.split(points[order], np.searchsorted(place[order], np.arange(1, len(places) + 1)))
    ends = edges[:, :, axis]
    for k, at in enumerate(places):
        across = edges[(ends[:, 0] < at) != (ends[:, 1] < at)]
        cuts = _crossings(across[:, 0], across[:, 1], axis, at)
        slabs[k], slabs[k + 1] = np.vstack([slabs[k], cuts]), np.vstack([slabs[k + 1], cuts])
    slabs = [_farthest(slab) for slab in slabs]
    below = _grown(slabs)[:-1]
    above = _grown(slabs[::-1])[-2::-1]
    both = np.array(below) + np.array(above)
    return float(places[both.argmin()]), float(both.min())


def _grown(slabs: list[Array]) -> list[float]:
    """Volumes of the hulls of the first one, two, ... slabs of points."""
    corners, volumes = np.zeros((0, 3)), []
    for points in slabs:
        corners = _farthest(np.vstack([corners, points]))
        volumes.append(_volume(corners))
    return volumes


def _volume(points: Array) -> float:
    try:
        return float(ConvexHull(points).volume)
    except (QhullError, ValueError):
        return 0.0


def _farthest(points: Array) -> Array:
    """The points that are the farthest ones along some direction: their hull is nearly the hull."""
    if len(points) <= len(_DIRECTIONS):
        return points
    found = np.empty(len(_DIRECTIONS), dtype=np.int64)
    _extremes(np.ascontiguousarray(points.T), _DIRECTIONS, found)
    return np.asarray(points[np.unique(found)])


@kernel
def _extremes(columns: Array, directions: Array, found: Indices) -> None:
    """Write which of the points (3, m) is the farthest along each of ``directions`` (d, 3)."""
    for k in range(directions.shape[0]):
        x, y, z = directions[k, 0], directions[k, 1], directions[k, 2]
        best, at = -np.inf, 0
        for i in range(columns.shape[1]):
            value = x * columns[0, i] + y * columns[1, i] + z * columns[2, i]
            if value > best:
                best, at = value, i
        found[k] = at


def _crossings(a: Array, b: Array, axis: int, at: float) -> Array:
    """Where segments from ``a`` to ``b``, both (m, 3), meet a plane across an axis.

    Ends are taken in the same order whichever way an edge runs: neighbours agree to the last bit.
    """
    turned = (a[:, axis] > b[:, axis])[:, None]
    low, high = np.where(turned, b, a), np.where(turned, a, b)
    share = (at - low[:, axis]) / (high[:, axis] - low[:, axis])
    points = low + share[:, None] * (high - low)
    points[:, axis] = at
    return np.asarray(points)


def _cut(
    triangles: Array, bodies: NDArray[np.int64], axis: int, at: float
) -> tuple[tuple[Array, NDArray[np.int64]], tuple[Array, NDArray[np.int64]]]:
    """Triangles and their bodies below a plane and above it; those that cross it are cut."""
    heights = triangles[:, :, axis] - at
    under, over = heights.max(axis=1) <= 0.0, heights.min(axis=1) >= 0.0
    below, above = [(triangles[under], bodies[under])], []
    above.append((triangles[over & ~under], bodies[over & ~under]))
    across = np.flatnonzero(~under & ~over)
    # The corner that is alone on its side comes first.
    signs = np.sign(heights[across])
    alone = np.where((signs > 0.0).sum(axis=1) == 1, (signs > 0.0).argmax(axis=1),
                     (signs < 0.0).argmax(axis=1))  # fmt: skip
    order = (alone[:, None] + np.arange(3)) % 3
    corners = np.take_along_axis(triangles[across], order[:, :, None], axis=1)
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    ab, ac = _crossing_or_end(a, b, axis, at), _crossing_or_end(a, c, axis, at)
    lower = (a[:, axis] < at)[:, None, None]
    tips = np.stack([a, ab, ac], axis=1)
    for own, number in (
        (tips, 0),
        (np.stack([ab, b, c], axis=1), 1),
        (np.stack([ab, c, ac], axis=1), 1),
    ):
        is_low = lower[:, 0, 0] if number == 0 else ~lower[:, 0, 0]
        real = _areas(own) > 0.0
        below.append((own[is_low & real], bodies[across][is_low & real]))
        above.append((own[~is_low & real], bodies[across][~is_low & real]))
    joined = [
        (np.concatenate([own for own, _ in side]), np.concatenate([name for _, name in side]))
        for side in (below, above)
    ]
    return joined[0], joined[1]


def _crossing_or_end(a: Array, b: Array, axis: int, at: float) -> Array:
    on = (b[:, axis] == at)[:, None]
    return np.where(on, b, _crossings(a, b, axis, at))
