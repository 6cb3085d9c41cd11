"""Certified motions and verdicts on states beside python-fcl."""

import itertools
import time
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.judges.fcl import FclJudge
from benchmarks.planning.scale import room
from benchmarks.verdict import clutter, judge, wrong
from kinematics.arrays import Array
from kinematics.robots import builtin_names
from obstacles.collision.checker import Checker, Motion
from obstacles.collision.edge_check import (
    COLLIDING,
    FREE,
    MAX_INTERVALS,
    UNDECIDED,
    Cubic,
    certify_in,
)
from obstacles.collision.model.kernel_work import workspace
from obstacles.collision.state_check import blocked_at
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Box, Cylinder, HalfSpace, PointCloud, Sphere
from tests.obstacles.arms import builtin, cup, gantry, mesh_shape
from tests.obstacles.solids import random_transform


def few_solids(random: np.random.Generator, count: int = 6) -> Scene:
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
        checker = Checker.of(robot, few_solids(random))
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
    model = Checker.of(robot, few_solids(random)).model.arrays
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
    model = Checker.of(robot, few_solids(random)).model.arrays
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
