"""Random convex polytopes with their edges and planes, by Qhull."""

from typing import NamedTuple

import numpy as np
from scipy.spatial import ConvexHull

from kinematics.arrays import Array, Indices


class Polytope(NamedTuple):
    """A convex polytope.

    Args:
        corners: Shape (v, 3) [m].
        edges: Pairs of corners, diagonals of faces among them, shape (e, 2).
        planes: Unit normal and offset of each face, n.x <= o inside, shape (f, 4).
        volume: [m^3].
    """

    corners: Array
    edges: Indices
    planes: Array
    volume: float


def polytope(points: Array) -> Polytope:
    """The hull of points (k, 3) that are not flat."""
    hull = ConvexHull(points)
    number = np.full(len(points), -1)
    number[hull.vertices] = np.arange(len(hull.vertices))
    triangles = number[hull.simplices]
    pairs = np.vstack([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    planes = np.column_stack([hull.equations[:, :3], -hull.equations[:, 3]])
    edges = np.unique(np.sort(pairs, axis=1), axis=0).astype(np.int64)
    return Polytope(points[hull.vertices].copy(), edges, np.unique(planes, axis=0), hull.volume)


def random_polytope(random: np.random.Generator, count: int = 20) -> Polytope:
    """The hull of ``count`` random points, longer along some axes."""
    return polytope(random.normal(size=(count, 3)) * random.uniform(0.1, 1.0, 3))


def inside(random: np.random.Generator, corners: Array, count: int) -> Array:
    """Random points in the hull of corners (v, 3), shape (count, 3)."""
    weights = random.dirichlet(np.full(len(corners), 0.3), count)
    return np.asarray(weights @ corners)


def volume(points: Array) -> float:
    """Volume of the hull of points [m^3], 0 where they are too few."""
    return float(ConvexHull(points).volume) if len(points) > 3 else 0.0
