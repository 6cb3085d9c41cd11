"""Cells cut by planes are what Qhull makes of the half-spaces, whatever is cut off."""

from typing import NamedTuple

import numpy as np
import pytest
from scipy.spatial import ConvexHull, HalfspaceIntersection

from kinematics.arrays import Array, Indices
from obstacles.convex.sphere_cover import cut_cell


class Polytope(NamedTuple):
    """A convex polytope.

    Args:
        corners: Shape (v, 3) [m].
        edges: Pairs of corners, diagonals of faces among them, shape (e, 2).
        planes: Unit normal and offset of each face, n.x <= o inside, shape (f, 4).
    """

    corners: Array
    edges: Indices
    planes: Array


def polytope(points: Array) -> Polytope:
    """The hull of points (k, 3) that are not flat."""
    hull = ConvexHull(points)
    number = np.full(len(points), -1)
    number[hull.vertices] = np.arange(len(hull.vertices))
    triangles = number[hull.simplices]
    pairs = np.vstack([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    planes = np.column_stack([hull.equations[:, :3], -hull.equations[:, 3]])
    edges = np.unique(np.sort(pairs, axis=1), axis=0).astype(np.int64)
    return Polytope(points[hull.vertices].copy(), edges, np.unique(planes, axis=0))


def random_polytope(random: np.random.Generator, count: int = 20) -> Polytope:
    """The hull of ``count`` random points, longer along some axes."""
    return polytope(random.normal(size=(count, 3)) * random.uniform(0.1, 1.0, 3))


def volume(points: Array) -> float:
    """Volume of the hull of points [m^3], 0 where they are too few."""
    return float(ConvexHull(points).volume) if len(points) > 3 else 0.0


CUBE = polytope(np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float))


def true_edges(points: Array) -> set[frozenset[int]]:
    """Edges of the hull of points between faces that are not in one plane."""
    hull = ConvexHull(points)
    edges = set()
    for f, triangle in enumerate(hull.simplices):
        for side, g in enumerate(hull.neighbors[f]):
            if hull.equations[f, :3] @ hull.equations[g, :3] < 1.0 - 1e-6:
                edges.add(frozenset(int(k) for k in np.delete(triangle, side)))
    return edges


def random_plane(random: np.random.Generator, cell: Polytope) -> tuple[Array, float]:
    n = random.normal(size=3)
    n /= np.linalg.norm(n)
    heights = cell.corners @ n
    return n, float(random.uniform(heights.min(), heights.max()))


def is_a_cell(points: Array, edges: Indices) -> bool:
    """Whether the edges name points, and all edges of their hull are among them."""
    named = {frozenset(map(int, edge)) for edge in edges}
    return bool(edges.min() >= 0 and edges.max() < len(points)) and true_edges(points) <= named


def test_cut_after_cut_it_is_the_intersection_of_half_spaces() -> None:
    random = np.random.default_rng(2)
    compared = 0
    for _ in range(25):
        cell = random_polytope(random)
        center, points, edges = cell.corners.mean(axis=0), cell.corners, cell.edges
        rows = [np.column_stack([cell.planes[:, :3], -cell.planes[:, 3]])]
        for _ in range(5):
            n, _ = random_plane(random, cell)
            offset = float(n @ center + random.uniform(0.01, 0.3))
            rows.append(np.array([[*n, -offset]]))
            points, edges = cut_cell(points, edges, n, offset)
        expected = HalfspaceIntersection(np.vstack(rows), center).intersections
        assert volume(points) == pytest.approx(volume(expected))
        assert is_a_cell(points, edges)
        # Each corner of the one is a corner of the other.
        gaps = np.linalg.norm(points[:, None] - expected[None], axis=2)
        assert gaps.min(axis=0).max() < 1e-7
        assert gaps.min(axis=1).max() < 1e-7
        compared += 1
    assert compared == 25


@pytest.mark.parametrize("offset", [0.0, 1.0])
def test_a_plane_in_a_face_keeps_the_face_or_the_cell(offset: float) -> None:
    """Corners in the plane belong to the part: nothing is computed anew."""
    kept, edges = cut_cell(CUBE.corners, CUBE.edges, np.array([0.0, 0.0, 1.0]), offset)
    expected = CUBE.corners[CUBE.corners[:, 2] <= offset]
    assert {tuple(p) for p in kept} == {tuple(p) for p in expected}
    assert len(edges) >= (4 if offset == 0.0 else 12)
