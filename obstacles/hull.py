"""Convex hulls of point sets, flat and segment-like ones included."""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from kinematics.arrays import Array
from kinematics.compiled.kernel import kernel

#: Extents below this part of the largest one are rounding errors of the coordinates, no thickness.
_FLATNESS = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Hull:
    """The convex hull of a point set.

    Args:
        vertices: Its corners, shape (k, 3) [m].
        triangles: Its surface, counter-clockwise seen from outside where it has an inside, shape
            (f, 3) of indices into ``vertices``; corners repeat where it is a segment or a point.
        planes: Unit normal and offset of each triangle, n.x <= o inside, shape (f, 4).
        solid: Whether it has an inside; a polygon, a segment and a point have none.
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


def convex_hull(points: Array) -> Hull:
    """The convex hull of ``points``, shape (m, 3) with m >= 1, all finite."""
    points = np.unique(np.asarray(points, dtype=np.float64).reshape(-1, 3), axis=0)
    center = points.mean(axis=0)
    _, extents, axes = np.linalg.svd(points - center, full_matrices=False)
    rank = int(np.count_nonzero(extents > _FLATNESS * extents[0])) if extents[0] > 0.0 else 0
    if rank == 3:
        try:
            return _solid(points)
        except QhullError:
            rank = 2  # thinner than qhull can tell from flat
    if rank == 2:
        flat = (points - center) @ axes[:2].T
        return _polygon(points[ConvexHull(flat).vertices])
    if rank == 1:
        along = (points - center) @ axes[0]
        points = points[[int(np.argmin(along)), int(np.argmax(along))]]
    else:
        points = points[:1]
    last = len(points) - 1
    return Hull(points, np.array([[0, last, last]]), np.zeros((1, 4)), solid=False)


def _solid(points: Array) -> Hull:
    hull = ConvexHull(points)
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
    _push_out(planes, np.ascontiguousarray(vertices.T))
    return Hull(vertices, triangles.astype(np.int64), planes, solid=True)


@kernel(fastmath=True)
def _push_out(planes: Array, columns: Array) -> None:
    """Raise the offset of each plane (f, 4) to its highest corner, ``columns`` of shape (3, k)."""
    for f in range(planes.shape[0]):
        a, b, c = planes[f, 0], planes[f, 1], planes[f, 2]
        highest = -np.inf
        for k in range(columns.shape[1]):
            highest = max(highest, a * columns[0, k] + b * columns[1, k] + c * columns[2, k])
        planes[f, 3] = highest


def _polygon(corners: Array) -> Hull:
    k = len(corners)
    fan = np.array([[0, i, i + 1] for i in range(1, k - 1)], dtype=np.int64)
    return Hull(np.ascontiguousarray(corners), fan, np.zeros((k - 2, 4)), solid=False)
