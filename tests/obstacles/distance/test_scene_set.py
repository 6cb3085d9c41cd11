"""Packed scenes: one row a piece, in the order of the obstacles, shared and read-only."""

import numpy as np

from kinematics.pose import transform
from obstacles.distance.piece_set import CENTER, KIND, POSE, RADIUS, WIDTH, CoreKind
from obstacles.distance.scene_set import scene_set
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Box, PointCloud, Sphere

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
