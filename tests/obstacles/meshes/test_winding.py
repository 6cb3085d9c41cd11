"""Winding numbers of solids known by formulas, and triangles turned alike."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from kinematics.arrays import Array, Indices
from obstacles.meshes.winding import oriented, winding_numbers


def hull(random: np.random.Generator) -> tuple[Array, Indices, Array]:
    """Corners, triangles turned outward and planes of a random hull."""
    points = random.normal(size=(30, 3))
    found = ConvexHull(points)
    faces = found.simplices.copy()
    a, b, c = (points[faces[:, k]] for k in range(3))
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), found.equations[:, :3]) < 0.0
    faces[inward] = faces[inward][:, ::-1]
    return points, faces.astype(np.int64), found.equations


def numbers_of(points: Array, vertices: Array, faces: Indices) -> Array:
    numbers = np.empty(len(points))
    winding_numbers(points, vertices, faces, numbers)
    return numbers


def test_it_is_one_inside_of_a_hull_and_none_outside() -> None:
    random = np.random.default_rng(1)
    for _ in range(5):
        vertices, faces, planes = hull(random)
        points = random.normal(size=(200, 3)) * 1.5
        heights = (points @ planes[:, :3].T + planes[:, 3]).max(axis=1)
        numbers = numbers_of(points, vertices, faces)
        np.testing.assert_allclose(numbers[heights < -1e-3], 1.0, atol=1e-9)
        np.testing.assert_allclose(numbers[heights > 1e-3], 0.0, atol=1e-9)
        backwards = numbers_of(points, vertices, faces[:, ::-1])
        np.testing.assert_allclose(backwards, -numbers, atol=1e-9)


def test_triangles_are_turned_alike() -> None:
    random = np.random.default_rng(3)
    vertices, faces, _ = hull(random)
    mixed = faces.copy()
    turned = random.random(len(faces)) < 0.5
    mixed[turned] = mixed[turned][:, ::-1]
    inside = vertices.mean(axis=0)[None]
    assert abs(numbers_of(inside, vertices, mixed)[0]) < 0.9
    assert abs(numbers_of(inside, vertices, oriented(mixed))[0]) == pytest.approx(1.0)


def test_triangles_of_two_bodies_are_turned_alike_in_each() -> None:
    random = np.random.default_rng(4)
    first, second = hull(random), hull(random)
    vertices = np.vstack([first[0], second[0] + 10.0])
    faces = np.vstack([first[1], second[1] + len(first[0])])
    for share in (0.2, 0.8):
        mixed = faces.copy()
        turned = random.random(len(faces)) < share
        mixed[turned] = mixed[turned][:, ::-1]
        inside = np.array([first[0].mean(axis=0), second[0].mean(axis=0) + 10.0])
        numbers = numbers_of(inside, vertices, oriented(mixed))
        np.testing.assert_allclose(numbers, 1.0 if share < 0.5 else -1.0, atol=1e-9)
