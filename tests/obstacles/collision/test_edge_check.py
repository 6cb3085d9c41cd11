"""Certified motion: what is proved free stays free, what is refused has a reason."""

import numpy as np
import pytest

from kinematics.robots import builtin_names
from obstacles.collision.checker import Checker
from obstacles.collision.edge_check import (
    COLLIDING,
    FREE,
    MAX_INTERVALS,
    UNDECIDED,
    Cubic,
    certify_in,
)
from obstacles.collision.model.kernel_work import workspace
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Box, Cylinder, HalfSpace, Sphere
from tests.obstacles.arms import builtin
from tests.obstacles.solids import random_transform


def clutter(random: np.random.Generator, count: int = 6) -> Scene:
    obstacles = [Obstacle("floor", HalfSpace(np.array([0.0, 0.0, 1.0]), -0.6))]
    for k in range(count):
        T = random_transform(random, 0.5)
        T[:3, 3] += 0.4 * T[:3, 3] / np.linalg.norm(T[:3, 3])
        shape = [Box(random.uniform(0.05, 0.3, 3)), Sphere(0.1), Cylinder(0.05, 0.4)][k % 3]
        obstacles.append(Obstacle(f"thing_{k}", shape, T, margin=0.01 * (k % 2)))
    return Scene(tuple(obstacles))


@pytest.mark.parametrize("name", builtin_names())
def test_proved_motions_stay_as_far_away_as_was_proved(name: str) -> None:
    robot = builtin(name)
    random = np.random.default_rng(7)
    lower, upper = robot.chain.sampling_bounds()
    proved = refused = 0
    for _ in range(6):
        checker = Checker.of(robot, clutter(random))
        for k in range(14):
            a, b = random.uniform(lower, upper, (2, robot.chain.n))
            b = a + (b - a) * random.uniform(0.02, 0.1 if k % 2 else 1.0)
            bend = random.normal(size=robot.chain.n) * 0.1
            motion = checker.curve(a, b - a - bend, bend)
            s = np.linspace(0.0, 1.0, 80)[:, None]
            states = a + (b - a - bend) * s + bend * s**2
            dense = min(checker.clearance(q)[0] for q in states)
            if motion.free:
                proved += 1
                assert dense >= motion.clearance - 1e-9
                assert motion.clearance > 0.0
            else:
                refused += 1
                at = a + (b - a - bend) * motion.at + bend * motion.at**2
                assert checker.clearance(at)[0] <= (0.0 if motion.colliding else 1e-5)
    assert proved > 3
    assert refused > 3 or name in ("planar_rr", "cart_pendulum", "scara")


def test_proof_is_given_up_after_the_intervals_it_may_take() -> None:
    random = np.random.default_rng(5)
    robot = builtin("panda")
    model = Checker.of(robot, clutter(random)).model.arrays
    limits, zero, found = robot.chain.limits, np.zeros(robot.chain.n), np.empty(4)
    given_up = 0
    for _ in range(200):
        a, b = random.uniform(limits.lower, limits.upper, (2, robot.chain.n))
        step = 0.2 * (b - a)
        work, line = workspace(model), Cubic(a, step, zero, zero)
        verdict = certify_in(model, work, line, 0.0, MAX_INTERVALS, found)
        needed = found[2]
        if verdict == FREE and needed > 1:
            assert certify_in(model, work, line, 0.0, 1, found) == UNDECIDED
            assert found[2] == 1
            given_up += 1
    assert given_up > 5


def test_room_that_runs_out_is_widened_to_the_same_verdict() -> None:
    """A workspace with hardly any room gives what one with plenty gives."""
    random = np.random.default_rng(6)
    robot = builtin("panda")
    model = Checker.of(robot, clutter(random)).model.arrays
    limits, zero = robot.chain.limits, np.zeros(robot.chain.n)
    roomy, small, verdicts = workspace(model), workspace(model), set[int]()
    small = small._replace(
        entries=small.entries[:, :2].copy(),
        hints=np.zeros((3, len(model.roots), 3)),
        spans=small.spans[:, :2].copy(),
        lists=small.lists[:, :2].copy(),
    )
    for _ in range(60):
        a, b = random.uniform(limits.lower, limits.upper, (2, robot.chain.n))
        line, plenty, little = Cubic(a, 0.2 * (b - a), zero, zero), np.empty(4), np.empty(4)
        verdict = certify_in(model, roomy, line, 0.0, MAX_INTERVALS, plenty)
        assert certify_in(model, small, line, 0.0, MAX_INTERVALS, little) == verdict
        np.testing.assert_array_equal(little, plenty)
        verdicts.add(verdict)
    assert verdicts >= {FREE, COLLIDING}
