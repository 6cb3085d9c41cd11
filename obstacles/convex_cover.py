"""Bodies cut by planes into parts whose hulls cover them.

Cuts are made where they save the hulls of the parts most volume. What a plane cuts out of a solid
is bounded by where it cuts the surface, and those points belong to both parts.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics.arrays import Array, frozen
from kinematics.preparation_limit import check_preparation_time
from obstacles.closest_point import hull_distances
from obstacles.hull import Hull, convex_hull
from obstacles.mesh import Faces
from obstacles.plane_cut import cheapest_cut, cut_triangles, growing_volumes, hull_volume
from obstacles.winding import winding_numbers

#: A hull of more corners than this is thinned, and gets no more corners once it has as many.
_COVER_CORNERS = 128
#: Part of the diagonal that thinning may cost before more corners are spent.
_THINNING = 1e-3
#: Places at which a cut is tried, along each axis.
_PLACES = 12
#: A cut is worth a piece more if it saves this part of the volume of the whole mesh's hull.
_WORTH = 0.02
_MOST_PARTS = 12
#: Winding number beyond which a point is inside.
_INSIDE = 0.5
#: Corners that a cover gets at once.
_THINNED_AT_ONCE = 8


@dataclass(frozen=True, slots=True, eq=False)
class ConvexPart:
    """One convex piece of a mesh: the hull of ``vertices`` (k, 3) grown by ``offset_radius`` [m].

    Args:
        vertices: Of the hull.
        offset_radius: What it is grown by.
        triangles: What it covers, corners of each, shape (t, 3, 3); none where it is the mesh.
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
    """Part that planes cut out of bodies.

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


def cut_bodies(
    vertices: Array, faces: list[Faces], diagonal: float, filled: bool
) -> list[ConvexPart]:
    """Cut bodies together, by planes, until no cut saves enough.

    Args:
        vertices: Of the mesh, shape (k, 3) [m].
        faces: Those of each body, shape (f, 3).
        diagonal: Of the whole mesh [m].
        filled: Whether the bodies bound solids.
    """
    if not faces:
        return []
    bodies = _Bodies(vertices, np.ascontiguousarray(np.vstack(faces)), filled, diagonal)
    names = np.repeat(np.arange(len(faces)), [len(body) for body in faces])
    box = np.array([[-np.inf] * 3, [np.inf] * 3])
    parts = [_with_best_cut(_Part(vertices[bodies.faces], names, box, np.zeros((0, 3))))]
    enough = _WORTH * parts[0].volume
    ahead = not parts[0].saved > enough
    if ahead:
        parts = [_with_cut_for_two(bodies, parts[0], enough)]
    while len(parts) < _MOST_PARTS:
        best = max(range(len(parts)), key=lambda k: parts[k].saved)
        if not parts[best].saved > enough:
            break
        halves = [_with_best_cut(side) for side in _halves(bodies, parts[best])]
        # What it saves was an estimate.
        saved = parts[best].volume - sum(half.volume for half in halves)
        worth = saved > enough or (ahead and len(parts) == 1)
        parts[best : best + 1] = halves if worth else [parts[best]._replace(saved=0.0)]
    return [_cover(part, bodies) for part in parts]


def _halves(bodies: _Bodies, part: _Part) -> list[_Part]:
    """Parts below and above the plane chosen for a part."""
    sides = cut_triangles(part.triangles, part.names, part.axis, part.at)
    halves = []
    for side, (triangles, names) in enumerate(sides):
        box = part.box.copy()
        box[1 - side, part.axis] = part.at
        corners = np.array([[box[i, 0], box[j, 1], box[k, 2]] for i, j, k in np.ndindex(2, 2, 2)])
        inner = bodies.inside(corners[np.isfinite(corners).all(axis=1)])
        if len(triangles) or len(inner):
            halves.append(_Part(triangles, names, box, inner))
    return halves


def _cover(part: _Part, bodies: _Bodies) -> ConvexPart:
    check_preparation_time()
    if not len(part.triangles):  # a box all of which is inside
        return hull_part(convex_hull(part.inner))
    corners, rounding = _thin(convex_hull(part.points), _THINNING * bodies.diagonal)
    _, first = np.unique(part.names, return_index=True)
    anchors = frozen(part.triangles[first, 0])
    return ConvexPart(corners, rounding, frozen(part.triangles), anchors, bodies.filled)


def _thin(hull: Hull, tolerance: float) -> tuple[Array, float]:
    """Some of a hull's corners, and the radius that their hull must grow by to hold the others."""
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


def _with_best_cut(part: _Part) -> _Part:
    """The part with its volume and its best cut."""
    check_preparation_time()
    points = np.unique(part.points, axis=0)
    best, volume = part._replace(volume=hull_volume(points)), growing_volumes([points])[0]
    edges = part.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2, 3)
    for axis in range(3):
        low, high = float(points[:, axis].min()), float(points[:, axis].max())
        if not volume > 0.0 or not high > low:
            continue
        places = np.linspace(low, high, _PLACES + 2)[1:-1]
        at, left = cheapest_cut(edges, points, axis, places)
        if volume - left > best.saved:
            best = best._replace(axis=axis, at=at, saved=volume - left)
    return best


def _with_cut_for_two(bodies: _Bodies, part: _Part, enough: float) -> _Part:
    """The part with a cut through its middle where only cutting its halves again saves volume.

    No single cut helps a ring, whose halves have hulls as large as half of its own.
    """
    points, best = part.points, part
    for axis in range(3):
        at = 0.5 * float(points[:, axis].min() + points[:, axis].max())
        halves = [_with_best_cut(side) for side in _halves(bodies, part._replace(axis=axis, at=at))]
        saved = part.volume - sum(half.volume - half.saved for half in halves)
        if len(halves) == 2 and saved > max(best.saved, enough):
            best = part._replace(axis=axis, at=at, saved=saved)
    return best
