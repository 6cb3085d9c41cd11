"""Verdicts are FCL's; clouds of a hundred thousand points are soon ready and looked at."""

import itertools
import time

import numpy as np
import pytest

from benchmarks.judges.fcl import FclJudge
from benchmarks.planning.scale import room
from benchmarks.verdict import builtin, clutter, judge, wrong
from kinematics.robots import builtin_names
from obstacles.collision.checker import Checker
from obstacles.collision.edge_check import COLLIDING, FREE
from obstacles.collision.model.kernel_work import workspace
from obstacles.collision.state_check import blocked_at
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import PointCloud, Sphere


@pytest.mark.parametrize("name", builtin_names())
def test_no_verdict_differs_from_fcl(name: str) -> None:
    robot = builtin(name)
    random = np.random.default_rng(51)
    lower, upper = robot.chain.sampling_bounds()
    reach = float(np.linalg.norm(robot.chain.offsets[:, :3, 3], axis=1).sum()) + 0.1
    for scene in (clutter(random, reach), clutter(random, reach)):
        checker, states = Checker.of(robot, scene), random.uniform(lower, upper, (60, len(lower)))
        verdicts = judge(checker, states)
        assert wrong(checker, FclJudge(robot, scene), states, verdicts)[1] == 0
        assert set(verdicts) <= {FREE, COLLIDING}
        assert [checker.valid(q) for q in states] == list(verdicts == FREE)


def test_a_cloud_is_as_many_balls() -> None:
    robot = builtin("ur5e")
    random = np.random.default_rng(52)
    points = random.normal(size=(300, 3)) * 0.6
    cloud = Checker.of(robot, Scene((Obstacle("cloud", PointCloud(points, 0.03), margin=0.01),)))
    balls = Scene(tuple(
        Obstacle(f"b{k}", Sphere(0.03), np.block([[np.eye(3), p[:, None]], [0, 0, 0, 1]]), 0.01)
        for k, p in enumerate(points)
    ))  # fmt: skip
    apart = Checker.of(robot, balls)
    lower, upper = robot.chain.sampling_bounds()
    for _ in range(40):
        a, b = random.uniform(lower, upper, (2, robot.chain.n))
        b = a + 0.1 * (b - a)
        one, other = cloud.segment(a, b), apart.segment(a, b)
        assert (one.free, one.colliding) == (other.free, other.colliding)
        assert cloud.clearance(a)[0] == pytest.approx(apart.clearance(a)[0], abs=1e-9)


def test_a_hundred_thousand_points() -> None:
    robot = builtin("iiwa14")
    random = np.random.default_rng(53)
    scenes = [room(random, count) for count in (1_000, 100_000)]
    Checker.of(robot, scenes[0])
    began = time.process_time()
    large = Checker.of(robot, scenes[1])
    assert time.process_time() - began < 5.0
    lower, upper = robot.chain.sampling_bounds()
    states = random.uniform(lower, upper, (200, robot.chain.n))
    spent = []
    for checker in (Checker.of(robot, scenes[0]), large):
        judge(checker, states)
        began = time.process_time()
        judge(checker, states)
        spent.append(time.process_time() - began)
    assert spent[1] < 10.0 * spent[0] + 0.01
    for q in itertools.islice(states[judge(large, states) == FREE], 3):
        clearance, pair = large.clearance(q)
        assert clearance > 0.0
        assert pair is not None


@pytest.mark.parametrize("parts", [1, 2])
def test_a_motion_is_blocked_at_the_first_state_looked_at_that_is_not_free(parts: int) -> None:
    robot = builtin("ur5e")
    random = np.random.default_rng(55)
    checker = Checker.of(robot, clutter(random, 1.2))
    arrays, asked = checker.model.arrays, np.empty(1, dtype=np.int64)
    work = workspace(arrays)
    lower, upper = robot.chain.sampling_bounds()
    order = [1.0, 0.5, 0.25, 0.75][parts - 1 :]
    outcomes = set()
    for _ in range(60):
        a, b = random.uniform(lower, upper, (2, robot.chain.n))
        b = a + 0.3 * (b - a)
        blocked = [share for share in order if not checker.valid(a + share * (b - a))]
        found = blocked_at(arrays, work, a, b, 0.0, parts, 4, asked)
        assert found == (blocked[0] if blocked else -1.0)
        outcomes.add(found)
    assert {-1.0, order[0], order[1]} <= outcomes
