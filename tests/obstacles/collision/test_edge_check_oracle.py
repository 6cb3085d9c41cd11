"""Proved edges against python-fcl at dense samples, on every built-in robot among solids."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.judges.fcl import FclJudge
from benchmarks.verdict import clutter
from kinematics.arrays import Array
from kinematics.robots import builtin_names
from obstacles.collision.checker import Checker, Motion
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Obstacle, Scene
from tests.obstacles.arms import builtin, cup, gantry, mesh_shape
from tests.obstacles.solids import random_transform

#: Instants of a motion that FCL looks at.
_SAMPLES = 25


def arena(robot: RobotGeometry, seed: int) -> Scene:
    """Solids about as far away as the arm reaches, no floor: it may fill all of a small one's."""
    reach = float(np.linalg.norm(robot.chain.offsets[:, :3, 3], axis=1).sum()) + 0.1
    scene = clutter(np.random.default_rng(seed), 1.2 * reach)
    return replace(scene, obstacles=scene.obstacles[1:])


def edges(robot: RobotGeometry, seed: int, count: int) -> list[tuple[Array, Array]]:
    """Motions that bend, from a hundredth to a half of the joints' range."""
    random = np.random.default_rng(seed)
    lower, upper = robot.chain.sampling_bounds()
    motions = []
    for length in np.geomspace(0.01, 0.5, count):
        a, b = random.uniform(lower, upper, (2, robot.chain.n))
        bend = random.normal(size=robot.chain.n) * 0.1 * length
        motions.append((a, np.array([length * (b - a) - bend, bend])))
    return motions


def at(start: Array, powers: Array, s: float) -> Array:
    return np.asarray(start + powers[0] * s + powers[1] * s * s)


def assert_true(judge: FclJudge, motion: Motion, start: Array, powers: Array) -> None:
    """Free motions collide at no sample, and colliding ones where it is said."""
    if motion.free:
        for s in np.linspace(0.0, 1.0, _SAMPLES):
            assert not judge.collides(at(start, powers, s))
    elif motion.colliding:
        assert 0.0 <= motion.at <= 1.0
        assert judge.collides(at(start, powers, motion.at))


@pytest.mark.parametrize("name", builtin_names())
@pytest.mark.parametrize("seed", [1, 2])
def test_fcl_finds_no_collision_on_a_proved_edge(name: str, seed: int) -> None:
    robot = builtin(name)
    scene = arena(robot, seed)
    checker, judge = Checker.of(robot, scene), FclJudge(robot, scene)
    free = 0
    for start, powers in edges(robot, seed, 12):
        motion = checker.curve(start, powers[0], powers[1])
        assert_true(judge, motion, start, powers)
        free += motion.free
        # What FCL finds at a sample is found by the proof as well.
        if any(judge.collides(at(start, powers, s)) for s in (0.0, 0.5, 1.0)):
            assert not motion.free
    assert free > 1


@pytest.mark.parametrize("seed", [3, 4])
def test_fcl_finds_no_collision_on_a_proved_edge_among_meshes(seed: int) -> None:
    """A ball in and around cups, which may stand inside their hulls but not their walls."""
    random = np.random.default_rng(seed)
    robot = gantry('<sphere radius="0.03"/>')
    cups = [Obstacle(f"cup{k}", mesh_shape(cup()), random_transform(random, 0.3)) for k in range(4)]
    scene = Scene(cups)
    checker, judge = Checker.of(robot, scene), FclJudge(robot, scene)
    seen = {"free": 0, "colliding": 0, "in a hull": 0}
    for _ in range(40):
        start = random.normal(size=3) * 0.25
        powers = np.array([random.normal(size=3) * random.choice([0.05, 0.4]), np.zeros(3)])
        motion = checker.curve(start, powers[0], powers[1])
        assert_true(judge, motion, start, powers)
        seen["free"] += motion.free
        seen["colliding"] += motion.colliding
        near = checker.clearance(start)[0]
        seen["in a hull"] += motion.free and 0.0 < near < 0.1
    assert min(seen.values()) > 3
