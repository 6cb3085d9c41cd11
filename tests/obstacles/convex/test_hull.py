"""Convex hulls, flat ones included, and one that grows point by point."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from kinematics.arrays import Array
from obstacles.convex.growing_hull import hull_volumes
from obstacles.convex.hull import convex_hull, corners_and_volume


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
