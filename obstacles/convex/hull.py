"""Convex hulls of point sets, flat and segment-like ones included."""

from dataclasses import dataclass, fields

import numpy as np
import scipy
from numpy.typing import NDArray

from kinematics.arrays import Array

#: Of more points than this, those that are surely inside of the hull are looked for first.
_MANY = 1000
#: Points or planes that are looked at together: with as many sides they take some megabytes.
_AT_ONCE = 4096
#: How deep such a point lies at least, as a part of the points' extent.
_INSIDE = 1e-9
#: Extents below this part of the largest one are rounding errors of the coordinates, no thickness.
_FLATNESS = 1e-9


def _directions(count: int) -> Array:
    """Both ways along the axes, then others along a spiral of equal areas, (3, count + 6).

    Those follow each other in leaps: hulls that grow evenly make fewer faces that do not last.
    """
    z = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    turn = np.pi * (1.0 + np.sqrt(5.0)) * np.arange(count)
    flat = np.sqrt(1.0 - z * z)
    spiral = np.column_stack([flat * np.cos(turn), flat * np.sin(turn), z])
    leaps = np.arange(count) * 77 % count
    return np.ascontiguousarray(np.vstack([np.eye(3), -np.eye(3), spiral[leaps]]).T)


#: Directions all over the sphere, (3, d): points that are the farthest along one are corners.
DIRECTIONS = _directions(200)


@dataclass(frozen=True, slots=True, eq=False)
class Hull:
    """The convex hull of a point set.

    Args:
        vertices: Corners of the hull, shape (k, 3) [m].
        triangles: Surface of the hull, counter-clockwise seen from outside where it has an inside,
            shape (f, 3) of indices into ``vertices``; corners repeat where it is a segment or a
            point.
        planes: Unit normal and offset of each triangle, n.x <= o inside, shape (f, 4).
        solid: Whether the hull has an inside; a polygon, a segment and a point have none.
    """

    vertices: Array
    triangles: NDArray[np.int64]
    planes: Array
    solid: bool

    def __post_init__(self) -> None:
        for item in fields(self):
            if item.name != "solid":
                getattr(self, item.name).setflags(write=False)

    @property
    def volume(self) -> float:
        """Enclosed volume, one sixth of the sum of a.(b x c) over the triangles [m^3]."""
        if not self.solid:
            return 0.0
        corners = (self.vertices - self.vertices.mean(axis=0))[self.triangles]
        a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
        return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def principal_axes(points: Array) -> Array:
    """Principal axes of ``points`` (m, 3) about their mean, the widest first; rows, shape (3, 3).

    The singular vectors of the m x 3 matrix; those of its other side, m x m, are never made.
    """
    # Fewer points than axes leave axes that only the full decomposition has.
    full = len(points) < 3
    _, _, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=full)
    return np.asarray(axes)


def corners_and_volume(points: Array) -> tuple[Array, float]:
    """Corners of the hull of ``points`` (m, 3), m >= 1, and its volume [m^3].

    As those of `convex_hull`, whose planes cost more than both where corners are many.
    """
    points = _without_inner(points)
    try:
        hull = scipy.spatial.ConvexHull(points)
    except (scipy.spatial.QhullError, ValueError):
        return convex_hull(points).vertices, 0.0
    return np.ascontiguousarray(points[hull.vertices]), float(hull.volume)


def farthest_points(points: Array) -> Array:
    """Those of ``points`` (m, 3) that are the farthest ones along some of ``DIRECTIONS``."""
    while len(points):
        blocks = np.array_split(points, len(points) // _AT_ONCE + 1)
        kept = [block[np.unique((block @ DIRECTIONS).argmax(axis=0))] for block in blocks]
        points = np.concatenate(kept)
        if len(blocks) == 1:
            break
    return points


def _without_inner(points: Array) -> Array:
    """Points without most of those that are inside of the hull."""
    if len(points) <= _MANY:
        return points
    inner = convex_hull(farthest_points(points))
    if not inner.solid:
        return points
    depth = _INSIDE * float(np.ptp(inner.vertices, axis=0).max())
    blocks = np.array_split(points, len(points) // _AT_ONCE + 1)
    heights = (block @ inner.planes[:, :3].T - inner.planes[:, 3] for block in blocks)
    outer = np.concatenate([(above > -depth).any(axis=1) for above in heights])
    return np.asarray(points[outer])


def convex_hull(points: Array) -> Hull:
    """The convex hull of ``points``, shape (m, 3) with m >= 1, all finite."""
    points = _without_inner(np.asarray(points, dtype=np.float64).reshape(-1, 3))
    points = np.unique(points, axis=0)
    center = points.mean(axis=0)
    _, extents, axes = np.linalg.svd(points - center, full_matrices=False)
    rank = int(np.count_nonzero(extents > _FLATNESS * extents[0])) if extents[0] > 0.0 else 0
    if rank == 3:
        try:
            return _solid(points)
        except scipy.spatial.QhullError:
            rank = 2  # thinner than qhull can tell from flat
    if rank == 2:
        flat = (points - center) @ axes[:2].T
        return _polygon(points[scipy.spatial.ConvexHull(flat).vertices])
    if rank == 1:
        along = (points - center) @ axes[0]
        points = points[[int(np.argmin(along)), int(np.argmax(along))]]
    else:
        points = points[:1]
    last = len(points) - 1
    return Hull(points, np.array([[0, last, last]]), np.zeros((1, 4)), solid=False)


def _solid(points: Array) -> Hull:
    hull = scipy.spatial.ConvexHull(points)
    corners = hull.vertices
    number = np.full(len(points), -1)
    number[corners] = np.arange(len(corners))
    triangles = number[hull.simplices]
    vertices = np.ascontiguousarray(points[corners])
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    outward = np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3])
    triangles[outward < 0.0] = triangles[outward < 0.0][:, ::-1]
    planes = np.array(hull.equations)
    # Qhull joins nearly coplanar facets: no corner may lie outside of a plane that is trusted.
    blocks = np.array_split(planes[:, :3], len(planes) // _AT_ONCE + 1)
    planes[:, 3] = np.concatenate([(block @ vertices.T).max(axis=1) for block in blocks])
    return Hull(vertices, triangles.astype(np.int64), planes, solid=True)


def _polygon(corners: Array) -> Hull:
    k = len(corners)
    fan = np.array([[0, i, i + 1] for i in range(1, k - 1)], dtype=np.int64)
    return Hull(np.ascontiguousarray(corners), fan, np.zeros((k - 2, 4)), solid=False)
