"""Packed pieces and scenes: what touches, and one row a piece in the order of the obstacles."""

import itertools

import numpy as np

from kinematics.pose import transform
from obstacles.distance.piece_set import (
    CENTER,
    KIND,
    POSE,
    RADIUS,
    WIDTH,
    CoreKind,
    PieceSet,
)
from obstacles.distance.scene_set import scene_set
from obstacles.distance.signed_distance import signed_distance
from obstacles.distance.triangles.distance import touching
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Box, PointCloud, Sphere
from tests.obstacles.outline import convex_pieces
from tests.obstacles.solids import random_transform


def test_touching_is_a_signed_distance_of_at_most_zero() -> None:
    random = np.random.default_rng(10)
    seen = [0, 0]
    for _ in range(4):
        pieces = [p.placed(random_transform(random, 0.15)) for p in convex_pieces(random)]
        packed = PieceSet.of(pieces)
        for (i, a), (j, b) in itertools.combinations(enumerate(pieces), 2):
            lower, upper = signed_distance(a, a.T_owner_piece, b, b.T_owner_piece)
            if upper <= 0.0 or lower > 0.0:
                assert touching(packed, i, j) == (upper <= 0.0)
                assert touching(packed, j, i) == (upper <= 0.0)
                seen[int(upper <= 0.0)] += 1
    assert min(seen) > 10


POINTS = np.array([[0.0, 0.0, 0.3], [0.2, -0.1, 0.0]])
MIXED = Scene(
    (
        Obstacle("ball", Sphere(0.1), transform(None, [1.0, 2.0, 3.0])),
        Obstacle("cloud", PointCloud(POINTS, 0.02), transform(None, [0.5, 0.0, 0.0])),
        Obstacle("box", Box((0.2, 0.4, 0.6)), transform(None, [0.0, -1.0, 0.0])),
    )
)


def test_rows_are_where_the_obstacles_are() -> None:
    rows = scene_set(MIXED).rows
    assert rows.shape == (4, WIDTH)
    assert rows[:, KIND].tolist() == [*3 * [CoreKind.POINT], CoreKind.BOX]
    moved = POINTS + np.array([0.5, 0.0, 0.0])
    middles = np.vstack([[1.0, 2.0, 3.0], moved, [0.0, -1.0, 0.0]])
    np.testing.assert_allclose(rows[:, CENTER : CENTER + 3], middles, atol=1e-15)
    np.testing.assert_allclose(rows[:, POSE + 3 : POSE + 12 : 4], middles, atol=1e-15)
    radii = np.array([0.1, 0.02, 0.02, float(np.linalg.norm([0.1, 0.2, 0.3]))])
    np.testing.assert_allclose(rows[:, RADIUS], radii, rtol=1e-12)
