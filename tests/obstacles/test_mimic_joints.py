"""Verdicts, edges and gradients of a robot with links that mimic, against FCL and differences."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.judges.fcl import FclJudge
from kinematics.forward import link_poses
from obstacles.collision.checker import Checker
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Box, Sphere
from tests.mimic_joints import mimic_robot
from tests.obstacles.collision.test_checker import at, edges
from tests.obstacles.solids import random_transform


@pytest.fixture(scope="module")
def robot() -> RobotGeometry:
    return mimic_robot()


def scene(seed: int) -> Scene:
    """A few solids on a ring about the arm."""
    random = np.random.default_rng(seed)
    found = []
    for k in range(8):
        T, angle, away = (
            random_transform(random, 1.0),
            random.uniform(-3, 3),
            random.uniform(0.5, 1),
        )
        T[:3, 3] = away * np.cos(angle), away * np.sin(angle), random.uniform(0.2, 1.3)
        solid = Box(random.uniform(0.1, 0.4, 3)) if k % 2 else Sphere(0.15)
        found.append(Obstacle(f"solid {k}", solid, T))
    return Scene(tuple(found))


def test_what_hits_names_the_link_that_mimics(robot: RobotGeometry) -> None:
    q = np.zeros(6)
    T = link_poses(robot.chain, q)[robot.chain.index["drum"]].copy()
    T[:3, 3] += 0.2 * T[:3, 0]
    wall = Obstacle("wall", Box([0.03, 0.03, 0.03]), T)
    checker = Checker.of(robot, Scene((wall,)))
    assert not checker.valid(q)
    assert checker.closest(q[None], 0.1)[2] == ("drum", "wall")
    # The drum turns out of its way, by the joint that it follows alone.
    assert checker.valid(np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0]))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_fcl_finds_no_collision_on_a_proved_edge(robot: RobotGeometry, seed: int) -> None:
    around = scene(seed)
    checker, judge = Checker.of(robot, around), FclJudge(robot, around)
    nearer, proved = replace(checker, slack=0.0), 0
    for start, powers in edges(robot, seed, 60):
        motion = checker.curve(start, *powers)
        states = np.array([at(start, powers, s) for s in np.linspace(0.0, 1.0, 41)])
        if motion.colliding:
            assert judge.collides(at(start, powers, motion.at))
        if not motion.free:
            continue
        proved += 1
        least = min(nearer.clearance(q)[0] for q in states)
        assert motion.clearance <= least + 1e-9
        if least < 0.05:
            assert not any(judge.collides(q) for q in states)
    assert proved > 5
