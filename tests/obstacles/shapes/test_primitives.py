"""Primitives packed at once are the pieces that they are packed as one by one, bit by bit."""

import coal
import numpy as np
import pytest

from kinematics.pose import transform
from obstacles.convex.piece import Piece, PieceArrays
from obstacles.distance.piece_set import CENTER, RADIUS, PieceSet
from obstacles.distance.scene_set import primitive_rows, scene_set
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.primitives import Primitive
from obstacles.shapes.shape import (
    Box,
    Capsule,
    Cone,
    Convex,
    Cylinder,
    HalfSpace,
    Shape,
    Sphere,
)
from tests.obstacles.arms import cup, mesh_shape
from tests.obstacles.solids import coal_distance, random_solid, random_transform

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
