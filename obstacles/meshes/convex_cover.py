"""Bodies cut by planes into parts whose hulls cover them.

Cuts are made where they save the hulls of the parts most volume. What a plane cuts out of a solid
is bounded by where it cuts the surface, and those points belong to both parts.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from kinematics.arrays import Array, frozen
from kinematics.caches.preparation_limit import check_preparation_time
from obstacles.convex.closest_point import hull_distances
from obstacles.convex.hull import Hull, convex_hull, corners_and_volume
from obstacles.meshes.mesh import Faces
from obstacles.meshes.plane_cut import Surface, cheapest_cut, cut_surface, used_surface
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
