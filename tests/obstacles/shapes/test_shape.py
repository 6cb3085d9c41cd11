"""Shapes: what is taken, what is refused, and the pieces they answer."""

import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from kinematics.arrays import Array
from kinematics.errors import InvalidScene
from obstacles.convex.piece import PieceKind
from obstacles.shapes.shape import (
    MAX_POINTS,
    Box,
    Capsule,
    Cone,
    Convex,
    Cylinder,
    HalfSpace,
    Mesh,
    PointCloud,
    Shape,
    Sphere,
)

NAN, INF = float("nan"), float("inf")
TETRAHEDRON = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])

SHAPES: list[Shape] = [
    Box(np.array([1.0, 2.0, 3.0])),
    Sphere(0.5),
    Cylinder(0.2, 1.0),
    Capsule(0.2, 1.0),
    Cone(0.2, 1.0),
    HalfSpace(np.array([0.0, 0.0, 1.0]), 0.1),
    Convex(TETRAHEDRON),
    Mesh(TETRAHEDRON, FACES),
    PointCloud(TETRAHEDRON, 0.1),
]


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: type(shape).__name__)
def test_survives_pickling_with_arrays_read_only(shape: Shape) -> None:
    copy = pickle.loads(pickle.dumps(shape))
    for own, other in zip(shape.pieces(), copy.pieces(), strict=True):
        np.testing.assert_array_equal(own.vertices, other.vertices)
        np.testing.assert_array_equal(own.T_owner_piece, other.T_owner_piece)
        assert (own.kind, own.radius, own.half_height, own.offset_radius) == (
            other.kind, other.radius, other.half_height, other.offset_radius,
        )  # fmt: skip
    for name in vars(type(shape))["__slots__"]:
        value = getattr(copy, name)
        assert not isinstance(value, np.ndarray) or not value.flags.writeable


@pytest.mark.parametrize(
    "build",
    [
        lambda x: Box([1.0, x, 1.0]),
        Sphere,
        lambda x: Cylinder(x, 1.0),
        lambda x: Cylinder(1.0, x),
        lambda x: Capsule(x, 1.0),
        lambda x: Capsule(1.0, x),
        lambda x: Cone(x, 1.0),
        lambda x: Cone(1.0, x),
        lambda x: PointCloud(TETRAHEDRON, x),
    ],
)
@pytest.mark.parametrize("size", [0.0, -1.0, NAN, INF, -INF, 1e-9, 1e9, "a", None, [1.0]])
def test_refuses_a_size(build: Callable[[Any], Shape], size: Any) -> None:
    with pytest.raises(InvalidScene):
        build(size)


@pytest.mark.parametrize(
    "points",
    [[], [[1.0, 2.0]], [1.0, 2.0, 3.0], [[NAN, 0, 0]], [[INF, 0, 0]], "abc", [[1e9, 0, 0]]],
)
def test_refuses_points(points: Any) -> None:
    for build in (Convex, lambda p: PointCloud(p, 0.1), lambda p: Mesh(p, FACES)):
        with pytest.raises(InvalidScene):
            build(points)


def test_refuses_too_many_points() -> None:
    with pytest.raises(InvalidScene, match="at most"):
        PointCloud(np.zeros((MAX_POINTS + 1, 3)), 0.1)


@pytest.mark.parametrize("faces", [[], [[0, 1]], [[0, 1, 4]], [[0, 1, -1]], [[0.0, 1.0, 2.0]], 3])
def test_refuses_faces(faces: Any) -> None:
    with pytest.raises(InvalidScene, match="mesh"):
        Mesh(TETRAHEDRON, faces)


def test_capsule_is_longer_than_its_height_by_both_ends() -> None:
    (piece,) = Capsule(0.2, 1.0).pieces()
    center, radius = piece.bounding_sphere()
    np.testing.assert_allclose(center, 0.0)
    assert 2.0 * radius == pytest.approx(1.4)


def test_halfspace_scales_its_offset_with_its_normal() -> None:
    for scale in (1e-200, 1e-3, 1.0, 7.0, 1e200):
        shape = HalfSpace(scale * np.array([3.0, 0.0, 4.0]), scale * 10.0)
        np.testing.assert_allclose(shape.normal, [0.6, 0.0, 0.8])
        assert shape.offset == pytest.approx(2.0)
        (piece,) = shape.pieces()
        assert piece.kind == PieceKind.HALFSPACE
        np.testing.assert_allclose(piece.T_owner_piece[:3, 2], [0.6, 0.0, 0.8])
        np.testing.assert_allclose(piece.T_owner_piece[:3, 3], [1.2, 0.0, 1.6])


@pytest.mark.parametrize(
    ("normal", "offset"), [([0, 0, 0], 1.0), ([0, 0, NAN], 1.0), ([0, 0, 1], NAN), ([0, 0, 1], 1e9)]
)
def test_refuses_a_halfspace(normal: Any, offset: float) -> None:
    with pytest.raises(InvalidScene):
        HalfSpace(np.array(normal), offset)


def test_convex_takes_the_hull() -> None:
    random = np.random.default_rng(1)
    for _ in range(20):
        points = random.normal(size=(50, 3))
        (piece,) = Convex(points).pieces()
        expected = ConvexHull(points)
        assert len(piece.vertices) == len(expected.vertices)
        assert ConvexHull(piece.vertices).volume == pytest.approx(expected.volume)


@pytest.mark.parametrize(("points", "corners"), [
    ([[1.0, 2.0, 3.0]], 1),
    ([[1.0, 2.0, 3.0]] * 5, 1),
    ([[0.0, 0, 0], [1, 1, 1], [0.5, 0.5, 0.5]], 2),
    ([[0.0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0], [1, 1, 0]], 4),
])  # fmt: skip
def test_convex_may_have_no_inside(points: Array, corners: int) -> None:
    for T in (np.eye(3), np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]):
        (piece,) = Convex(np.array(points) @ T).pieces()
        assert len(piece.vertices) == corners
