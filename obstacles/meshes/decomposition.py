"""Triangle meshes as convex pieces that cover them, each with the triangles it stands for.

A body whose hull is the body is its hull. What is not convex is cut by planes where that saves the
hulls of the parts most volume. A part's hull covers it, cut faces included: what a plane cuts out
of a solid is bounded by where it cuts the surface, and those points belong to both parts. So a
distance to all hulls is a distance to the solid; where it does not do, the triangles decide
(``obstacles.distance.triangles.distance``), and nothing is filled that the mesh leaves open.

Bodies cut by planes into parts whose hulls cover them.

Cuts are made where they save the hulls of the parts most volume. What a plane cuts out of a solid
is bounded by where it cuts the surface, and those points belong to both parts.
"""

import hashlib
from dataclasses import dataclass, fields
from typing import IO, Any, NamedTuple
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from kinematics.arrays import Array, frozen
from kinematics.caches.bounded_cache import bounded_cache
from kinematics.caches.preparation_limit import check_preparation_time
from obstacles.convex.closest_point import hull_distances, mesh_distances
from obstacles.convex.piece import Hull, convex_hull, corners_and_volume
from obstacles.kept_files import is_written, keep_file, read_file, write_file
from obstacles.meshes.bodies import mesh_bodies
from obstacles.meshes.mesh import Faces
from obstacles.meshes.plane_cut import (
    Surface,
    cheapest_cut,
    cut_surface,
    triangle_areas,
    used_surface,
)
from obstacles.meshes.winding import winding_numbers

#: A hull of more corners than this is thinned, and gets no more corners once it has as many.
_COVER_CORNERS = 128
#: Part of the diagonal that thinning may cost before more corners are spent.
_THINNING = 1e-3
#: Two cuts at once are looked for in a part with more than this part of that volume.
_LARGE = 0.25
#: They are worth their pieces there if each saves so many times what a cut must.
_WORTH_LATER = 2.5
#: Winding number beyond which a point is inside.
_INSIDE = 0.5
#: Corners that a cover gets at once.
_THINNED_AT_ONCE = 8


class Fineness(NamedTuple):
    """How finely meshes are cut.

    Args:
        worth: A cut is worth a piece more if it saves this part of the volume of the whole hull.
        most: Parts of a mesh at most.
    """

    worth: float
    most: int


COARSE = Fineness(0.02, 12)
#: Of solids whose covers get into each other wherever the robot stands.
FINE = Fineness(0.001, 48)


@dataclass(frozen=True, slots=True, eq=False)
class ConvexPart:
    """One convex piece of a mesh: the hull of ``vertices`` (k, 3) grown by ``offset_radius`` [m].

    Args:
        vertices: Vertices of the hull.
        offset_radius: Radius by which the hull is grown.
        triangles: Triangles that the part covers, corners of each, shape (t, 3, 3); none where it
            is the mesh.
        anchors: A point on each of the bodies they belong to, shape (r, 3).
        filled: Whether they bound a solid, together with those of the other filled parts.
    """

    vertices: Array
    offset_radius: float
    triangles: Array
    anchors: Array
    filled: bool


def hull_part(hull: Hull) -> ConvexPart:
    """A part that is its hull."""
    none = frozen(np.zeros((0, 3)))
    return ConvexPart(hull.vertices, 0.0, frozen(np.zeros((0, 3, 3))), none, False)


class _Bodies(NamedTuple):
    """Bodies that are cut together.

    Args:
        vertices: Shape (k, 3).
        faces: Faces of all, shape (f, 3).
        filled: Whether they bound solids.
        diagonal: Diagonal of the whole mesh [m].
    """

    vertices: Array
    faces: Faces
    filled: bool
    diagonal: float

    def inside(self, points: Array) -> Array:
        """Points among ``points`` (m, 3) that the bodies enclose."""
        numbers = np.zeros(len(points))
        if self.filled and len(points):
            winding_numbers(points, self.vertices, self.faces, numbers)
        return np.asarray(points[np.abs(numbers) > _INSIDE])


class _Part(NamedTuple):
    """Part that planes cut out of bodies.

    Args:
        surface: Triangles of the surface in the part.
        box: Places of the planes, lowest and highest, infinite where none is, shape (2, 3).
        inner: Corners of the box that are inside the bodies, shape (c, 3).
        corners: Corners of the hull of both, shape (h, 3).
        volume: Volume of the hull [m^3].
        axis: Across which another cut is best.
        at: Place of the best cut.
        saved: Volume that this would save [m^3].
        judged: Whether two cuts at once were looked for.
    """

    surface: Surface
    box: Array
    inner: Array
    corners: Array
    volume: float
    axis: int = 0
    at: float = 0.0
    saved: float = 0.0
    judged: bool = False


def cut_bodies(
    vertices: Array,
    faces: list[Faces],
    diagonal: float,
    filled: bool,
    fineness: Fineness = COARSE,
) -> list[ConvexPart]:
    """Cut bodies together, by planes, until no cut saves enough.

    Args:
        vertices: Vertices of the mesh, shape (k, 3) [m].
        faces: Faces of each body, shape (f, 3).
        diagonal: Diagonal of the whole mesh [m].
        filled: Whether the bodies bound solids.
        fineness: Fineness at which cutting stops.
    """
    if not faces:
        return []
    bodies = _Bodies(vertices, np.ascontiguousarray(np.vstack(faces)), filled, diagonal)
    names = np.repeat(np.arange(len(faces)), [len(body) for body in faces])
    box = np.array([[-np.inf] * 3, [np.inf] * 3])
    surface = used_surface(Surface(vertices, bodies.faces, names))
    parts = [_with_best_cut(_part(surface, box, np.zeros((0, 3))))]
    whole = parts[0].volume
    enough = fineness.worth * whole
    while len(parts) < fineness.most:
        best = max(range(len(parts)), key=lambda k: parts[k].saved)
        if parts[best].saved > enough:
            halves = _cut(bodies, parts[best])
            # What it saves was an estimate.
            worth = _saved(parts[best], halves) > enough
            parts[best : best + 1] = halves if worth else [parts[best]._replace(saved=0.0)]
            continue
        best = max(range(len(parts)), key=lambda k: parts[k].volume * (not parts[k].judged))
        large = parts[best].volume > _LARGE * whole and not parts[best].judged
        if not large or len(parts) + 3 > fineness.most:
            break
        each = enough if len(parts) == 1 else _WORTH_LATER * enough
        parts[best : best + 1] = _cut_twice(bodies, parts[best], each)
    return [_cover(part, bodies) for part in parts]


def _part(surface: Surface, box: Array, inner: Array) -> _Part:
    check_preparation_time()
    hull = corners_and_volume(np.vstack([surface.vertices, inner]))
    return _Part(surface, box, inner, *hull)


def _halves(bodies: _Bodies, part: _Part) -> list[_Part]:
    """Parts below and above the plane chosen for a part."""
    halves = []
    for side, surface in enumerate(cut_surface(part.surface, part.axis, part.at)):
        box = part.box.copy()
        box[1 - side, part.axis] = part.at
        corners = np.array([[box[i, 0], box[j, 1], box[k, 2]] for i, j, k in np.ndindex(2, 2, 2)])
        inner = bodies.inside(corners[np.isfinite(corners).all(axis=1)])
        if len(surface.faces) or len(inner):
            halves.append(_part(surface, box, inner))
    return halves


def _cover(part: _Part, bodies: _Bodies) -> ConvexPart:
    check_preparation_time()
    surface = part.surface
    if not len(surface.faces):  # a box all of which is inside
        return hull_part(convex_hull(part.corners))
    corners, rounding = _thin(part.corners, _THINNING * bodies.diagonal)
    triangles = frozen(surface.vertices[surface.faces])
    _, first = np.unique(surface.names, return_index=True)
    anchors = frozen(triangles[first, 0])
    return ConvexPart(corners, rounding, triangles, anchors, bodies.filled)


def _thin(points: Array, tolerance: float) -> tuple[Array, float]:
    """Some of a hull's corners, and the radius that their hull must grow by to hold the others."""
    if len(points) <= _COVER_CORNERS:
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


def _with_best_cut(part: _Part) -> _Part:
    """The part with its best cut."""
    check_preparation_time()
    points = np.vstack([part.surface.vertices, part.inner])
    axis, at, saved = cheapest_cut(points, part.surface.faces)
    return part._replace(axis=axis, at=at, saved=saved)


def _cut(bodies: _Bodies, part: _Part) -> list[_Part]:
    """The parts on both sides of the plane chosen for a part, each with its best cut."""
    return [_with_best_cut(side) for side in _halves(bodies, part)]


def _saved(part: _Part, pieces: list[_Part]) -> float:
    """Volume that the hulls of a part's pieces have less than its own [m^3]."""
    return part.volume - sum(piece.volume for piece in pieces)


def _cut_twice(bodies: _Bodies, part: _Part, enough: float) -> list[_Part]:
    """A part cut through its middle, and its halves again, where each piece more saves enough.

    No single cut helps a ring, whose halves have hulls as large as half of its own.
    """
    corners, kept = part.corners, [part._replace(judged=True)]
    best, most = kept, 0.0
    for axis in range(3):
        at = 0.5 * float(corners[:, axis].min() + corners[:, axis].max())
        halves = _cut(bodies, part._replace(axis=axis, at=at))
        saved = _saved(part, halves) + sum(half.saved for half in halves)
        if len(halves) == 2 and saved > most:
            best, most = halves, saved
    if not most > enough:
        return kept
    pieces = []
    for half in best:
        quarters = _cut(bodies, half) if half.saved > enough else []
        worth = len(quarters) > 0 and _saved(half, quarters) > enough
        pieces += quarters if worth else [half._replace(saved=0.0)]
    return pieces if _saved(part, pieces) > enough * (len(pieces) - 1) else kept


#: A hull that is nowhere farther from the mesh than this stands for it [m]: half of what verdicts
#: are held to.
_SAME = 5e-7
#: Part of a hull's area that may be missing from a mesh that has the same area but for rounding.
_SAME_AREA = 1e-6
#: Points on a hull at which its distance to the mesh is measured.
_SAMPLES = 2000
#: So many bodies, the largest, may be pieces of their own; others are cut together.
_MOST_HULLS = 64
#: Corners that a piece may have that is the mesh itself: its farthest one is looked up, so that
#: many cost little, and a convex piece is a hundredth as dear as triangles under a cover.
_EXACT_CORNERS = 4096
#: So few corners that any hull of them is looked at closely.
_FEW_CORNERS = 192
#: Part of the corners of a mesh that are its hull's where it has more and may be convex.
_OWN_CORNERS = 0.9
#: Triangles that are held against all planes of a hull at once.
_TRIANGLES_AT_ONCE = 256


def convex_pieces(
    vertices: Array, faces: Faces, fineness: Fineness = COARSE
) -> tuple[ConvexPart, ...]:
    """Convex pieces whose union covers a mesh and what it encloses.

    Args:
        vertices: Shape (k, 3) [m].
        faces: Shape (f, 3).
        fineness: How finely to cut.

    Returns:
        The pieces, filled ones first; the same mesh gives the same ones.
    """
    used, numbers = np.unique(faces, return_inverse=True)
    mesh = vertices[used].tobytes(), numbers.astype(np.int64).tobytes()
    parts = _stored_pieces(*mesh, fineness)
    if is_written():  # what is in memory as well
        keep_file(_file_name(*mesh, fineness), lambda stream: _write(stream, parts))
    return parts


@bounded_cache(maxsize=256)
def _stored_pieces(vertices: bytes, faces: bytes, fineness: Fineness) -> tuple[ConvexPart, ...]:
    name = _file_name(vertices, faces, fineness)
    if (stored := _read(name)) is not None:
        return stored
    points = np.frombuffer(vertices).reshape(-1, 3)
    parts = _decompose(points, np.frombuffer(faces, dtype=np.int64).reshape(-1, 3), fineness)
    write_file(name, lambda stream: _write(stream, parts))
    return parts


def _file_name(vertices: bytes, faces: bytes, fineness: Fineness) -> str:
    how = b"7" if fineness == COARSE else repr(("7", *fineness)).encode()
    digest = hashlib.sha256(how + len(vertices).to_bytes(8) + vertices + faces).hexdigest()
    return f"{digest}.npz"


def _read(name: str) -> tuple[ConvexPart, ...] | None:
    file = read_file(name)
    if file is None:
        return None
    try:
        with np.load(file, allow_pickle=False) as stored:
            columns = [_split_by_counts(stored, item.name) for item in fields(ConvexPart)]
    except (OSError, ValueError, KeyError, BadZipFile):
        return None
    return tuple(
        ConvexPart(frozen(v), float(r[0]), frozen(t), frozen(a), bool(f[0]))
        for v, r, t, a, f in zip(*columns, strict=True)
    )


def _split_by_counts(stored: "np.lib.npyio.NpzFile", name: str) -> list[Array]:
    return np.split(stored[name], np.cumsum(stored[f"{name}_counts"])[:-1])


def _write(stream: IO[bytes], parts: tuple[ConvexPart, ...]) -> None:
    columns: dict[str, Any] = {}
    for item in fields(ConvexPart):
        own = [np.atleast_1d(getattr(part, item.name)) for part in parts]
        columns[item.name] = np.concatenate(own)
        columns[f"{item.name}_counts"] = np.array([len(array) for array in own])
    np.savez(stream, **columns)


def _decompose(vertices: Array, faces: Faces, fineness: Fineness) -> tuple[ConvexPart, ...]:
    diagonal = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    whole = _small_hull(vertices, faces)
    if (
        whole is not None
        and _is_hull(whole, vertices, faces)
        and _has_no_inside_walls(whole, vertices, faces)
    ):
        return (hull_part(whole),)
    bodies = mesh_bodies(vertices, faces)
    # Where one is a cavity of another one nothing may be filled unasked.
    hollow = any(body.cavity for body in bodies)
    sizes = [np.linalg.norm(np.ptp(vertices[body.faces], axis=(0, 1))) for body in bodies]
    hulls = dict[int, Hull]()
    for k in np.argsort(sizes)[::-1][:_MOST_HULLS].tolist():
        hull = None if hollow and bodies[k].closed else _small_hull(vertices, bodies[k].faces)
        if hull is not None and _is_hull(hull, vertices, bodies[k].faces):
            hulls[k] = hull
    rest = [body for k, body in enumerate(bodies) if k not in hulls]
    solid, open_ = ([b.faces for b in rest if b.closed == kind] for kind in (True, False))
    parts = cut_bodies(vertices, solid, diagonal, True, fineness)
    parts += cut_bodies(vertices, open_, diagonal, False, fineness)
    parts += [hull_part(hulls[k]) for k in sorted(hulls)]
    return tuple(sorted(parts, key=lambda part: not part.filled))


def _small_hull(vertices: Array, faces: Faces) -> Hull | None:
    """The hull of some triangles; None where it has more corners than a piece may have."""
    check_preparation_time()
    used = _used(vertices, faces)
    corners, _ = corners_and_volume(used)
    if len(corners) <= _FEW_CORNERS:
        return convex_hull(corners)
    # Looking closely at a large hull takes long: only where nearly all corners of the mesh are its.
    may_be_convex = len(corners) > _OWN_CORNERS * len(np.unique(used, axis=0))
    return convex_hull(corners) if may_be_convex and len(corners) <= _EXACT_CORNERS else None


def _used(vertices: Array, faces: Faces) -> Array:
    """The corners of some triangles."""
    used = np.zeros(len(vertices), dtype=np.bool_)
    used[faces] = True
    return vertices[used]


def _is_hull(hull: Hull, vertices: Array, faces: Faces) -> bool:
    """Whether every point of a hull's surface is one of the mesh inside it."""
    check_preparation_time()
    corners = hull.vertices[hull.triangles]
    wanted = float(triangle_areas(corners).sum())
    if hull.solid:
        own = vertices[np.unique(np.sort(faces, axis=1), axis=0)]
        if float(triangle_areas(own[_on_hull(own, hull)]).sum()) < (1.0 - _SAME_AREA) * wanted:
            return False
    return overhang(hull, vertices, faces) <= _SAME


def _on_hull(triangles: Array, hull: Hull) -> NDArray[np.bool_]:
    """Whether triangles (t, 3, 3) lie on a face of a hull of their corners, shape (t,)."""
    corners = np.vstack([triangles.reshape(-1, 3), hull.vertices])
    names = np.unique(corners, axis=0, return_inverse=True)[1].reshape(-1)
    count = len(names) - len(hull.vertices)
    both = np.vstack([names[:count].reshape(-1, 3), names[count:][hull.triangles]])
    low, middle, high = np.sort(both, axis=1).T
    keys = (low * len(names) + middle) * len(names) + high
    # Most are faces themselves; those of a flat part may be cut otherwise.
    lies = np.isin(keys[: len(triangles)], keys[len(triangles) :])
    rest = np.flatnonzero(~lies)
    lies[rest] = _on_planes(triangles[rest], hull.planes)
    return lies


def _on_planes(triangles: Array, planes: Array) -> NDArray[np.bool_]:
    """Whether triangles (t, 3, 3) lie on one of some planes (k, 4), shape (t,)."""
    lies = np.zeros(len(triangles), dtype=np.bool_)
    for begin in range(0, len(triangles), _TRIANGLES_AT_ONCE):
        own = triangles[begin : begin + _TRIANGLES_AT_ONCE]
        # Few planes pass the first corner: the others are held against these alone.
        near = np.abs(own[:, 0] @ planes[:, :3].T - planes[:, 3]) <= _SAME
        triangle, plane = np.nonzero(near)
        rest = np.einsum("ncd,nd->nc", own[triangle, 1:], planes[plane, :3]) - planes[plane, 3:]
        lies[begin + triangle[(np.abs(rest) <= _SAME).all(axis=1)]] = True
    return lies


def _has_no_inside_walls(hull: Hull, vertices: Array, faces: Faces) -> bool:
    """Whether no corner of a mesh lies deep in its hull, as those of a cavity would."""
    if not hull.solid:
        return True
    used = _used(vertices, faces)
    return all(
        float((block @ hull.planes[:, :3].T - hull.planes[:, 3]).max(axis=1).min()) >= -_SAME
        for block in np.array_split(used, len(used) // 4096 + 1)
    )


def overhang(hull: Hull, vertices: Array, faces: Faces) -> float:
    """Largest distance from points all over a hull to the mesh inside it [m].

    It is what a robot would see of the hull that the mesh has not. Unlike a ratio of volumes it
    needs no closed mesh, and unlike the depth of the mesh in its hull it does not mind inner walls.
    """
    corners = hull.vertices[hull.triangles]
    areas = triangle_areas(corners)
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
