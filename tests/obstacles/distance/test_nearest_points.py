"""Nearest points of the closest pair: as far apart as the distance, and on both bodies."""

import numpy as np
import pytest

import armwright as aw
from obstacles.collision.fcl_distance import FclWorld
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Box, Capsule, Cone, Convex, Cylinder, HalfSpace, Shape, Sphere

ROBOT = aw.load_robot("planar_rr")
HIGH = 0.35


def at(x: float, y: float, z: float) -> np.ndarray:
    T = np.eye(4)
    T[:3, 3] = x, y, z
    return T


@pytest.mark.parametrize(
    "shape",
    [
        Box([0.1, 0.2, 0.3]),
        Sphere(0.1),
        Cylinder(0.1, 0.3),
        Capsule(0.1, 0.3),
        Cone(0.1, 0.2),
        HalfSpace([0.0, 0.6, 0.8], 0.0),
        Convex(np.random.default_rng(1).normal(scale=0.1, size=(20, 3))),
    ],
    ids=lambda shape: type(shape).__name__,
)
def test_the_points_are_as_far_apart_as_the_bodies(shape: Shape) -> None:
    scene = Scene([Obstacle("thing", shape, at(0.6, -0.9, HIGH))])
    world = FclWorld(ROBOT, scene)
    rng = np.random.default_rng(2)
    measured = 0
    for _ in range(12):
        q = rng.uniform(-1.0, 1.0, ROBOT.chain.n)
        nearest, clearance = world.nearest_points(q), world.clearance(q)
        assert nearest.distance == clearance.distance
        assert nearest.pair == clearance.pair
        if nearest.points is not None:
            first, second = nearest.points
            assert np.linalg.norm(first - second) == pytest.approx(nearest.distance, abs=1e-7)
            measured += 1
    assert measured >= 6


def test_the_points_of_a_ball_lie_on_its_surface() -> None:
    center = np.array([0.5, 0.8, HIGH])
    world = FclWorld(ROBOT, Scene([Obstacle("ball", Sphere(0.1), at(*center))]))
    nearest = world.nearest_points(np.zeros(ROBOT.chain.n))
    assert nearest.points is not None
    assert nearest.pair is not None
    on_ball = nearest.points[nearest.pair.index("ball")]
    on_link = nearest.points[1 - nearest.pair.index("ball")]
    assert np.linalg.norm(on_ball - center) == pytest.approx(0.1, abs=1e-7)
    # The nearest point of the ball looks towards the link.
    towards = (on_link - center) / np.linalg.norm(on_link - center)
    assert on_ball == pytest.approx(center + 0.1 * towards, abs=1e-6)


def test_there_are_no_points_without_anything_to_hit_or_in_collision() -> None:
    free = FclWorld(ROBOT, Scene([])).nearest_points(np.zeros(ROBOT.chain.n))
    if free.pair is None:
        assert np.isinf(free.distance)
    inside = FclWorld(ROBOT, Scene([Obstacle("ball", Sphere(5.0), at(0.0, 0.0, 0.0))]))
    struck = inside.nearest_points(np.zeros(ROBOT.chain.n))
    assert struck.distance < 0.0
    assert struck.points is None
