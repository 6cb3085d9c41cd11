"""Eight states or stretches at once: proved motions and verdicts are FCL's."""

import numpy as np
import pytest

from benchmarks.judges.fcl import FclJudge
from benchmarks.verdict import clutter
from compiled.kernel import kernel
from kinematics.arrays import Array
from kinematics.pose import transform
from kinematics.robots import builtin_names
from obstacles.collision.checker import Checker
from obstacles.collision.edge_check import COLLIDING, FREE, MAX_INTERVALS, UNDECIDED
from obstacles.collision.lanes.check import blocked_between
from obstacles.collision.line_check import certify_line, prove_line
from obstacles.collision.model.kernel_work import workspace
from obstacles.collision.model.model_arrays import ModelArrays
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import HalfSpace, PointCloud, Sphere
from tests.mimic_joints import mimic_robot
from tests.obstacles.arms import builtin, cup, cut_arm, gantry, mesh_shape
from tests.obstacles.solids import random_transform

#: Instants of a motion that FCL looks at.
_SAMPLES = 41


@kernel
def proof_of(model: ModelArrays, a: Array, b: Array, margin: float, outcome: Array) -> int:
    """``prove_line``."""
    return prove_line(model, workspace(model), a, b, margin, MAX_INTERVALS, outcome)


@kernel
def certificate_of(model: ModelArrays, a: Array, b: Array, margin: float, outcome: Array) -> int:
    """``certify_line``."""
    return certify_line(model, workspace(model), a, b, margin, MAX_INTERVALS, outcome)


def robot_of(name: str) -> RobotGeometry:
    if name == "cut":
        return cut_arm()
    return mimic_robot() if name == "mimic joint" else builtin(name)


def around(robot: RobotGeometry, random: np.random.Generator) -> Scene:
    """Solids about as far away as the arm reaches."""
    reach = float(np.linalg.norm(robot.chain.offsets[:, :3, 3], axis=1).sum()) + 0.1
    return clutter(random, reach)


def lines(
    robot: RobotGeometry, random: np.random.Generator, count: int
) -> list[tuple[Array, Array]]:
    """Motions from a hundredth of the joints' range to all of it."""
    lower, upper = robot.chain.sampling_bounds()
    ends = random.uniform(lower, upper, (count, 2, robot.chain.n))
    lengths = np.geomspace(0.01, 1.0, count)
    return [(a, a + length * (b - a)) for (a, b), length in zip(ends, lengths, strict=True)]


@pytest.mark.parametrize("name", [*builtin_names(), "mimic joint", "cut"])
def test_fcl_finds_no_collision_on_a_motion_that_is_proved(name: str) -> None:
    robot, random, found = robot_of(name), np.random.default_rng(72), np.empty(4)
    seen = dict.fromkeys((FREE, COLLIDING, UNDECIDED), 0)
    for _ in range(3):
        scene = around(robot, random)
        checker, judge = Checker.of(robot, scene), FclJudge(robot, scene)
        for a, b in lines(robot, random, 14):
            verdict = proof_of(checker.model.arrays, a, b, 0.0, found)
            seen[verdict] += 1
            # It is the verdict of the proof that looks at the whole motion first.
            assert verdict == certificate_of(checker.model.arrays, a, b, 0.0, found)
            if verdict == FREE:
                states = a + np.linspace(0.0, 1.0, _SAMPLES)[:, None] * (b - a)
                assert not any(judge.collides(q) for q in states)
    assert seen[UNDECIDED] == 0
    assert seen[FREE] > 3
    assert seen[COLLIDING] > 3


def test_motions_among_half_spaces_clouds_and_meshes_are_proved() -> None:
    random, found = np.random.default_rng(73), np.empty(4)
    robot = gantry('<sphere radius="0.03"/>')
    points = random.normal(size=(60, 3)) * 0.4
    things = [
        Obstacle(f"cup{k}", mesh_shape(cup()), random_transform(random, 0.3)) for k in range(3)
    ]
    things.append(Obstacle("floor", HalfSpace(np.array([0.0, 0.0, 1.0]), -0.3)))
    things.append(Obstacle("cloud", PointCloud(points, 0.01), margin=0.005))
    scene = Scene(things)
    checker, judge = Checker.of(robot, scene), FclJudge(robot, scene)
    free = collides = 0
    for _ in range(60):
        a = random.normal(size=3) * 0.25
        b = a + random.normal(size=3) * random.choice([0.05, 0.4])
        verdict = proof_of(checker.model.arrays, a, b, 0.0, found)
        assert verdict == certificate_of(checker.model.arrays, a, b, 0.0, found)
        if verdict == FREE:
            free += 1
            assert not any(judge.collides(a + s * (b - a)) for s in np.linspace(0.0, 1.0, _SAMPLES))
        collides += verdict == COLLIDING
    assert free > 5
    assert collides > 5


@pytest.mark.parametrize("length", [0.02, 0.5, 4.0])
def test_a_motion_past_a_ball_is_free_to_a_hair(length: float) -> None:
    """The distance of a line from a point is known, and a margin is as if the ball were larger."""
    random, found = np.random.default_rng(74), np.empty(4)
    robot, told = gantry('<sphere radius="0.1"/>'), 0
    for _ in range(20):
        start, point = random.normal(size=(2, 3)) * 0.5
        along = random.normal(size=3)
        along /= np.linalg.norm(along)
        end = start + length * along
        share = np.clip((point - start) @ along, 0.0, length)
        gap = float(np.linalg.norm(point - start - share * along)) - 0.1
        if gap < 0.05:
            continue
        T = transform(None, point)
        model = Checker.of(robot, Scene((Obstacle("ball", Sphere(gap - 0.03), T),))).model.arrays
        assert proof_of(model, start, end, 0.03 - 1e-5, found) == FREE
        assert proof_of(model, start, end, 0.03 + 1e-5, found) == COLLIDING
        told += 1
    assert told > 8


@kernel
def between(model: ModelArrays, a: Array, b: Array, parts: int, looks: int) -> bool:
    """``blocked_between``."""
    return blocked_between(model, workspace(model), a, b, 0.0, parts, looks)


@pytest.mark.parametrize("parts", [1, 2])
@pytest.mark.parametrize("looks", [2, 4, 16])
def test_a_motion_is_blocked_where_a_state_is_that_is_looked_at(parts: int, looks: int) -> None:
    robot = builtin("ur5e")
    random = np.random.default_rng(63)
    checker = Checker.of(robot, clutter(random, 1.2))
    lower, upper = robot.chain.sampling_bounds()
    shares = [k / looks for k in range(1, looks + (parts == 1))]
    outcomes = set()
    for _ in range(60):
        a, b = random.uniform(lower, upper, (2, robot.chain.n))
        b = a + 0.2 * (b - a)
        blocked = any(not checker.valid(a + share * (b - a)) for share in shares)
        assert between(checker.model.arrays, a, b, parts, looks) == blocked
        outcomes.add(blocked)
    assert outcomes == {True, False}


@pytest.mark.parametrize("name", ["panda", "ur5e", "mimic joint"])
def test_no_state_of_any_number_differs_from_fcl(name: str) -> None:
    robot, random = robot_of(name), np.random.default_rng(71)
    scene = around(robot, random)
    checker, judge = Checker.of(robot, scene), FclJudge(robot, scene)
    lower, upper = robot.chain.sampling_bounds()
    outcomes = set()
    for count in (*range(20), 64, 65, 71):
        states = random.uniform(lower, upper, (count, robot.chain.n))
        truth = [not judge.collides(q) for q in states]
        assert checker.each_valid(states).tolist() == truth
        outcomes |= set(truth)
    assert outcomes == {True, False}
