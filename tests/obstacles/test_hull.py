"""Convex hulls, flat ones included."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from kinematics.arrays import Array
from obstacles.hull import convex_hull


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
