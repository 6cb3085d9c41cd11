"""How deep touching meshes are said to be, against FCL on their triangles moved apart."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from kinematics.arrays import Array
from kinematics.pose import inverse, transform
from obstacles.collision.fcl_distance import FclWorld
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Box, HalfSpace, Shape, Sphere
from tests.obstacles.arms import mesh_shape
from tests.obstacles.collision.test_fcl_distance import slide
from tests.obstacles.distance.triangles.test_distance import (
    BODIES,
    apart,
    bowl,
    small,
)
from tests.obstacles.meshes.test_decomposition import ell, ring, spiky
from tests.obstacles.solids import random_transform


def depth(body: Shape, obstacle: Obstacle) -> float:
    """Of a body that stands at the origin."""
    pieces = body.pieces()
    robot = replace(slide(*pieces), solids=np.zeros(len(pieces), dtype=np.int64))
    world = FclWorld(robot, Scene((obstacle,)))
    (found,) = world.collisions(np.zeros(1))
    nearest = world.clearance(np.zeros(1))
    assert nearest.distance == -found.depth
    assert nearest.pair == found.pair
    return found.depth


def apart_once_moved(body: trimesh.Trimesh, by: Array, other: trimesh.Trimesh, T: Array) -> bool:
    return apart(body, transform(None, by), other, T) > 0.0


def directions(random: np.random.Generator, count: int) -> Array:
    u = random.normal(size=(count, 3))
    return np.asarray(u / np.linalg.norm(u, axis=1, keepdims=True))


@pytest.mark.parametrize("name", ["ell", "ring", "tube", "bowl", "plate"])
def test_no_random_way_out_is_much_shorter(name: str) -> None:
    body, random = BODIES[name], np.random.default_rng(17)
    looked = shorter = 0
    while looked < 4:
        shape, other = small(random)
        T = random_transform(random, 0.5)
        if apart(body, np.eye(4), other, T) > 0.0:
            continue
        looked += 1
        found = depth(mesh_shape(body), Obstacle("it", shape, T))
        for u in directions(random, 8):
            assert not apart_once_moved(body, 0.4 * found * u, other, T)
            shorter += apart_once_moved(body, 0.8 * found * u, other, T)
    assert shorter <= 1


def test_the_wall_of_a_bowl_is_not_as_deep_as_its_hollow() -> None:
    ball = trimesh.creation.icosphere(3, 0.1)
    for sunk in (1e-4, 0.004, 0.03):
        at = transform(None, [0.0, 0.0, -(0.4 + sunk)])
        told = depth(mesh_shape(bowl()), Obstacle("ball", Sphere(0.1), at))
        assert told == pytest.approx(sunk, rel=0.05, abs=2e-3)
        told = depth(mesh_shape(ball), Obstacle("bowl", mesh_shape(bowl()), inverse(at)))
        assert told == pytest.approx(sunk, rel=0.05, abs=2e-3)


def test_a_peg_against_the_inside_of_a_ring() -> None:
    inner = 0.4  # of a torus of radii 0.6 and 0.2, whose facets reach a little further out
    for sunk in (0.002, 0.02):
        at = transform(None, [inner + sunk - 0.05, 0.0, 0.0])
        assert depth(mesh_shape(ring()), Obstacle("peg", Sphere(0.05), at)) < sunk + 0.01


def test_what_lies_inside_has_to_come_out() -> None:
    body = spiky(3)
    told = depth(mesh_shape(body), Obstacle("in", Sphere(0.01)))
    assert told > 0.01
    for u in directions(np.random.default_rng(0), 40):
        ball = trimesh.creation.icosphere(2, 0.01)
        assert not apart_once_moved(body, 0.5 * told * u, ball, np.eye(4))


def test_a_floor_and_margins() -> None:
    corners = np.array(ell(0.8).vertices)
    lowest = float(corners[:, 2].min())
    floor = Obstacle("floor", HalfSpace(np.array([0.0, 0.0, 1.0]), lowest + 0.07), margin=0.01)
    assert depth(mesh_shape(ell(0.8)), floor) == pytest.approx(0.08, abs=1e-9)
    high = float(corners[:, 0].max())
    box = Obstacle(
        "box", Box(np.array([0.2, 4.0, 4.0])), transform(None, [high + 0.1 - 0.003, 0.0, 0.0]), 0.01
    )
    assert depth(mesh_shape(ell(0.8)), box) == pytest.approx(0.013, rel=0.02)
