"""Hulls, cells cut by planes and closest points beside Qhull and quadratic programs."""

from typing import NamedTuple

import numpy as np
import pytest
from scipy.optimize import nnls
from scipy.spatial import ConvexHull, HalfspaceIntersection

from kinematics.arrays import Array, Indices
from obstacles.convex.closest_point import (
    hull_distances,
    mesh_distances,
    nearest_on_triangle,
)
from obstacles.convex.growing_hull import hull_volumes
from obstacles.convex.piece import convex_hull, corners_and_volume
from obstacles.convex.sphere_cover import cut_cell


def test_encloses_every_point_and_faces_out() -> None:
    random = np.random.default_rng(0)
    for scale in (1e-3, 1.0, 1e3):
        for _ in range(20):
            points = scale * random.normal(size=(random.integers(4, 100), 3)) * [1.0, 0.3, 2.0]
            hull = convex_hull(points)
            assert hull.solid
            assert hull.volume == pytest.approx(ConvexHull(points).volume)
            heights = points @ hull.planes[:, :3].T - hull.planes[:, 3]
            assert heights.max() <= 1e-12 * scale
            corners = hull.vertices[hull.triangles]
            normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
            assert (np.einsum("ij,ij->i", normals, hull.planes[:, :3]) > 0.0).all()


@pytest.mark.parametrize("jitter", [0.0, 1e-14])
def test_flat_sets_have_no_inside(jitter: float) -> None:
    random = np.random.default_rng(0)
    axes = np.linalg.qr(random.normal(size=(3, 3)))[0]
    disc = random.normal(size=(40, 3)) * [1.0, 1.0, jitter]
    line = random.normal(size=(40, 3)) * [1.0, jitter, jitter]
    polygon, segment = convex_hull(disc @ axes + 1.0), convex_hull(line @ axes + 1.0)
    assert not polygon.solid
    assert polygon.volume == 0.0
    area = _area(polygon.vertices[polygon.triangles])
    assert area == pytest.approx(ConvexHull(disc[:, :2]).volume)
    assert len(segment.vertices) == 2
    assert np.linalg.norm(np.diff(segment.vertices, axis=0)) == pytest.approx(np.ptp(line[:, 0]))


def _area(corners: Array) -> float:
    edges = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return float(np.linalg.norm(edges, axis=1).sum() / 2.0)


def many_points(kind: str, random: np.random.Generator) -> Array:
    """More points than are given to qhull as they are."""
    points = random.normal(size=(4000, 3))
    if kind == "sphere":
        points /= np.linalg.norm(points, axis=1, keepdims=True)
    if kind == "box":
        points = np.clip(points, -0.5, 0.5)
    if kind == "thin":
        points[:, 2] *= 1e-7
    if kind == "flat":
        points[:, 2] = 0.25
    return points


@pytest.mark.parametrize("kind", ["normal", "sphere", "box", "thin", "flat"])
def test_of_many_points_no_corner_is_missing(kind: str) -> None:
    random = np.random.default_rng(4)
    for _ in range(3):
        points = many_points(kind, random)
        hull = convex_hull(points)
        corners, volume = corners_and_volume(points)
        if kind == "flat":
            assert not hull.solid
            assert volume == 0.0
            expected = points[ConvexHull(points[:, :2]).vertices]
        else:
            qhull = ConvexHull(points)
            expected = points[qhull.vertices]
            assert volume == pytest.approx(qhull.volume, rel=1e-12)
            assert (points @ hull.planes[:, :3].T - hull.planes[:, 3]).max() <= 1e-12
        for found in (hull.vertices, corners):
            assert {tuple(p) for p in found} == {tuple(p) for p in expected}


def draw(kind: str, random: np.random.Generator) -> Array:
    points = random.normal(size=(random.integers(5, 200), 3))
    if kind == "sphere":
        return np.asarray(points / np.linalg.norm(points, axis=1, keepdims=True))
    if kind == "grid":
        return np.round(2.0 * points) / 2.0
    if kind == "prism":
        turn = random.integers(0, 24, len(points)) * np.pi / 12.0
        return np.column_stack([np.cos(turn), np.sin(turn), random.integers(0, 3, len(points))])
    return points


@pytest.mark.parametrize("kind", ["normal", "sphere", "grid", "prism"])
def test_volumes_of_more_and_more_points_are_those_of_their_hulls(kind: str) -> None:
    random = np.random.default_rng(1)
    for _ in range(150):
        points = draw(kind, random)
        ends = [*np.unique(random.integers(4, len(points), 5)).tolist(), len(points)]
        volumes = hull_volumes(points, np.array(ends))
        expected = [convex_hull(points[:end]).volume for end in ends]
        np.testing.assert_allclose(volumes, expected, rtol=1e-3, atol=1e-4 * expected[-1])
        assert volumes.tolist() == sorted(volumes)


@pytest.mark.parametrize("rank", [0, 1, 2])
def test_what_is_flat_has_no_volume(rank: int) -> None:
    random = np.random.default_rng(3)
    axes = np.linalg.qr(random.normal(size=(3, 3)))[0]
    points = random.normal(size=(30, rank)) @ axes[:rank] + 1.0
    assert hull_volumes(points, np.array([3, 30])).tolist() == [0.0, 0.0]


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


def by_program(p: Array, corners: Array) -> Array:
    """The nearest point to p of the hull of some corners, by non-negative least squares."""
    heavy = 1e6
    A = np.vstack([corners.T, np.full(len(corners), heavy)])
    weights, _ = nnls(A, np.append(p, heavy))
    return np.asarray(weights @ corners / weights.sum())


def test_points_of_triangles_are_those_of_a_quadratic_program() -> None:
    random = np.random.default_rng(1)
    for _ in range(200):
        corners, p = random.normal(size=(3, 3)), random.normal(size=3) * 2.0
        nearest = nearest_on_triangle(tuple(p), *(tuple(corner) for corner in corners))
        expected = by_program(p, corners)
        assert np.linalg.norm(p - nearest) == pytest.approx(np.linalg.norm(p - expected), abs=1e-6)
        np.testing.assert_allclose(nearest, expected, atol=1e-4)


def test_distances_of_meshes_and_hulls_are_the_least_of_their_triangles() -> None:
    random = np.random.default_rng(2)
    hull = convex_hull(random.normal(size=(20, 3)))
    points = random.normal(size=(50, 3)) * 2.0
    each = [
        min(
            np.linalg.norm(
                p - nearest_on_triangle(tuple(p), *(tuple(hull.vertices[k]) for k in face))
            )
            for face in hull.triangles
        )
        for p in points
    ]
    distances = np.empty(len(points))
    mesh_distances(points, hull.vertices, hull.triangles, distances)
    np.testing.assert_allclose(distances, each, atol=1e-12)
    hull_distances(points, hull.vertices, hull.triangles, hull.planes, True, distances)
    inside = (points @ hull.planes[:, :3].T - hull.planes[:, 3]).max(axis=1) < 0.0
    np.testing.assert_allclose(distances, np.where(inside, -1.0, 1.0) * each, atol=1e-9)
