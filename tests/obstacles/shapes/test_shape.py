"""Shapes: what is taken and refused, the pieces they answer, and the same packed at once."""

import pickle
from collections.abc import Callable
from typing import Any

import coal
import numpy as np
import pytest
from scipy.spatial import ConvexHull

from kinematics.arrays import Array
from kinematics.errors import InvalidScene
from kinematics.pose import transform
from obstacles.convex.piece import Piece, PieceArrays, PieceKind
from obstacles.distance.piece_set import CENTER, RADIUS, PieceSet
from obstacles.distance.scene_set import primitive_rows, scene_set
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.primitives import Primitive
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
from tests.obstacles.arms import cup, mesh_shape
from tests.obstacles.solids import coal_distance, random_solid, random_transform

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


#: coal's distances are exact to about this [m].
_ACCURACY = 1e-6
#: Radius of a ball that stands for a point [m].
_POINT = 1e-9
CUP = mesh_shape(cup())


def random_primitive(random: np.random.Generator, kind: int) -> Shape:
    a, b, c = (float(x) for x in 10.0 ** random.uniform(-5.0, 2.0, 3))
    if kind == Primitive.BOX:
        return Box((a, b, c))
    if kind == Primitive.BALL:
        return Sphere(a)
    if kind == Primitive.CYLINDER:
        return Cylinder(a, b)
    if kind == Primitive.CONE:
        return Cone(a, b)
    return HalfSpace(random.normal(size=3), a)


def obstacle(random: np.random.Generator, k: int, shape: Shape) -> Obstacle:
    T = random_transform(random)
    if k % 3 == 0:  # many stand upright, or turned by a quarter: zeros of either sign
        T[:3, :3] = np.round(T[:3, :3])
        T = transform(np.diag([-1.0, -1.0, 1.0]) if k % 2 else None, T[:3, 3] * (k % 5 > 0))
    return Obstacle(f"o{k}", shape, T, float(random.uniform(0.0, 0.1)))


def random_scene(seed: int, count: int) -> Scene:
    random = np.random.default_rng(seed)
    kinds = random.integers(0, len(Primitive), count)
    return Scene(
        obstacle(random, k, random_primitive(random, kind)) for k, kind in enumerate(kinds)
    )


def one_by_one(scene: Scene) -> tuple[PieceArrays, PieceSet]:
    pieces = [piece for o in scene.obstacles for piece in o.pieces()]
    return PieceArrays.pack(pieces), PieceSet.of(pieces)


def check_same(scene: Scene) -> None:
    arrays, index, margins = scene.pieces()
    expected, rows = one_by_one(scene)
    for name in PieceArrays.__slots__:
        found, wanted = getattr(arrays, name), getattr(expected, name)
        assert (found.dtype, found.shape) == (wanted.dtype, wanted.shape), name
        assert found.flags.c_contiguous
        assert not found.flags.writeable
        assert found.tobytes() == (wanted + 0).tobytes(), name
    counts = [len(o.pieces()) for o in scene.obstacles]
    np.testing.assert_array_equal(index, np.repeat(np.arange(len(counts)), counts))
    np.testing.assert_array_equal(margins, np.repeat([o.margin for o in scene.obstacles], counts))
    assert index.dtype == np.int64
    packed = scene_set(scene)
    for name in PieceSet._fields:
        found, wanted = getattr(packed, name), getattr(rows, name)
        assert (found.dtype, found.shape) == (wanted.dtype, wanted.shape)
        assert found.tobytes() == (wanted + 0).tobytes()


@pytest.mark.parametrize("seed", range(40))
def test_a_scene_of_primitives_is_packed_as_its_pieces_are(seed: int) -> None:
    check_same(random_scene(seed, seed % 13))


@pytest.mark.parametrize("seed", range(10))
def test_among_other_solids_they_keep_their_places(seed: int) -> None:
    random = np.random.default_rng(100 + seed)
    others = (
        Capsule(0.1, 0.3), Convex(random.normal(size=(8, 3))), Convex(random.normal(size=(40, 3))),
        CUP,
    )  # fmt: skip
    shapes = [*(o.shape for o in random_scene(seed, 6).obstacles), *others, CUP]
    order = random.permutation(len(shapes))
    check_same(Scene(obstacle(random, k, shapes[at]) for k, at in enumerate(order)))


def test_their_balls_hold_what_coal_holds_of_them() -> None:
    random = np.random.default_rng(3)
    for k in range(80):
        kind = ("box", "sphere", "cylinder", "cone")[k % 4]
        T, probe, away = random_transform(random), np.eye(4), random.normal(size=3)
        piece, solid = random_solid(random, kind, T)
        (row,) = primitive_rows(Scene([Obstacle("o", _shape_of(kind, piece), T)]).primitives)
        probe[:3, 3] = row[CENTER : CENTER + 3] + 5.0 * away / np.linalg.norm(away)
        distance = coal_distance(solid, T, coal.Sphere(_POINT), probe) + _POINT
        assert distance >= 5.0 - row[RADIUS] - _ACCURACY


def _shape_of(kind: str, piece: Piece) -> Shape:
    if kind == "box":
        return Box(2.0 * piece.vertices.max(axis=0))
    if kind == "sphere":
        return Sphere(piece.offset_radius)
    return (Cylinder if kind == "cylinder" else Cone)(piece.radius, 2.0 * piece.half_height)
