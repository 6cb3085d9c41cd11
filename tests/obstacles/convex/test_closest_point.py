"""Closest points: against quadratic programs, and by what defines them."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import nnls

from compiled.vec3 import Vector
from kinematics.arrays import Array
from obstacles.convex.closest_point import (
    Nearest,
    hull_distances,
    mesh_distances,
    nearest_on_box,
    nearest_on_cone,
    nearest_on_cylinder,
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


def test_primitives_keep_what_defines_a_nearest_point() -> None:
    random = np.random.default_rng(3)
    half, radius, height = (0.3, 0.5, 0.2), 0.4, 0.6
    samples = random.uniform(-1.0, 1.0, (20_000, 3))
    r = np.hypot(samples[:, 0], samples[:, 1])
    z = samples[:, 2]
    solids: list[tuple[Callable[[Vector], Nearest], NDArray[np.bool_]]] = [
        (
            lambda p: nearest_on_box(p, half),
            np.asarray((np.abs(samples) <= half).all(axis=1), dtype=np.bool_),
        ),
        (lambda p: nearest_on_cylinder(p, radius, height), (r <= radius) & (np.abs(z) <= height)),
        (
            lambda p: nearest_on_cone(p, radius, height),
            (np.abs(z) <= height) & (r <= radius * (height - z) / (2.0 * height)),
        ),
    ]
    for nearest, is_in in solids:
        inside, outside = samples[is_in], samples[~is_in]
        assert len(inside) > 300
        for p in random.permutation(outside)[:50]:
            *q, distance = nearest((p[0], p[1], p[2]))
            assert distance == pytest.approx(np.linalg.norm(p - q))
            assert np.linalg.norm(inside - p, axis=1).min() >= distance - 1e-9
            # All of the solid is behind the plane across the way to it.
            assert ((inside - q) @ (p - q) <= 1e-9).all()
        for p in inside[:50]:
            *q, distance = nearest((p[0], p[1], p[2]))
            assert distance == pytest.approx(-np.linalg.norm(p - q))
            assert np.linalg.norm(outside - p, axis=1).min() >= -distance - 1e-9
