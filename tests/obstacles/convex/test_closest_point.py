"""Closest points of triangles and hulls, against quadratic programs."""

import numpy as np
import pytest
from scipy.optimize import nnls

from kinematics.arrays import Array
from obstacles.convex.closest_point import (
    hull_distances,
    mesh_distances,
    nearest_on_triangle,
)
from obstacles.convex.hull import convex_hull


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
