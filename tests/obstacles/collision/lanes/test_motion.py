"""Motions that are proved with eight stretches abreast are free, and none is missed by it."""

import numpy as np
import pytest

from benchmarks.judges.fcl import FclJudge
from benchmarks.verdict import clutter
from compiled.kernel import kernel
from compiled.simd import LANES
from kinematics.arrays import Array
from kinematics.forward import joint_frames
from kinematics.robots import builtin_names
from kinematics.tree.serial_chain import serial_chain
from kinematics.urdf.urdf import parse_urdf
from obstacles.collision.checker import Checker
from obstacles.collision.edge_check import COLLIDING, FREE, MAX_INTERVALS, UNDECIDED
from obstacles.collision.lanes.check import write_states
from obstacles.collision.lanes.motion import open_stretches, place_stretches, shifts_of
from obstacles.collision.line_check import certify_line, prove_line
from obstacles.collision.model.kernel_work import Workspace, workspace
from obstacles.collision.model.model_arrays import ModelArrays
from obstacles.distance.piece_set import CENTER, RADIUS
from obstacles.robots.robot_geometry import RobotGeometry, robot_geometry
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import HalfSpace, PointCloud, Sphere
from tests.mimic_joints import urdf
from tests.obstacles.arms import builtin, cup, cut_arm, gantry, mesh_shape
from tests.obstacles.solids import random_transform

#: Instants of a motion that FCL looks at.
_SAMPLES = 41


@kernel
def at_stretches(model: ModelArrays, a: Array, b: Array, shares: Array, half: float) -> Workspace:
    """A workspace after ``place_stretches`` about shares (8,) of a motion, half as far each way."""
    work = workspace(model)
    write_states(work, a, b, shares, 0, LANES)
    for j in range(a.shape[0]):
        work.joints[1, j] = abs(b[j] - a[j]) * half
    place_stretches(model, work)
    return work


@kernel
def stray(work: Workspace, joint: int, still: int, number: int) -> float:
    """How far a body gets on a stretch, seen from another one."""
    return float(work.lanes[shifts_of(work, joint) + LANES * (still + 1) + number])


@kernel
def proof_of(model: ModelArrays, a: Array, b: Array, margin: float, outcome: Array) -> int:
    """``prove_line``."""
    return prove_line(model, workspace(model), a, b, margin, MAX_INTERVALS, outcome)


@kernel
def certificate_of(model: ModelArrays, a: Array, b: Array, margin: float, outcome: Array) -> int:
    """``certify_line``."""
    return certify_line(model, workspace(model), a, b, margin, MAX_INTERVALS, outcome)


@kernel
def intervals_of(model: ModelArrays, a: Array, b: Array) -> int:
    """``open_stretches``."""
    return open_stretches(model, workspace(model), a, b, 0.0)


def mimic() -> RobotGeometry:
    """An arm with links on joints that mimic others."""
    description = parse_urdf(urdf())
    return robot_geometry(serial_chain(description, tip_link="flange"), description)


def robot_of(name: str) -> RobotGeometry:
    if name == "cut":
        return cut_arm()
    return mimic() if name == "mimic joint" else builtin(name)


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


@pytest.mark.parametrize("name", ["stanford", "panda", "mimic joint"])
def test_no_point_of_a_body_gets_farther_than_its_stray(name: str) -> None:
    """Seen from the base and from every body that it hangs on."""
    robot = robot_of(name)
    chain, model = robot.chain, Checker.of(robot, Scene()).model.arrays
    random, bodies = np.random.default_rng(71), chain.n + len(chain.mimic_joints)
    before = [*range(-1, chain.n - 1), *(mimic.parent for mimic in chain.mimic_joints)]
    tightest, half = 0.0, 0.04
    for a, b in lines(robot, random, 25):
        shares = np.sort(random.uniform(half, 1.0 - half, LANES))
        work = at_stretches(model, a, b, shares, half)
        for number, share in enumerate(shares.tolist()):
            there = share + half * float(random.uniform(-1.0, 1.0))
            frames = [joint_frames(chain, a + s * (b - a)) for s in (share, there)]
            assert len(frames[0]) == bodies
            for row in model.bodies[:, 0].tolist():
                joint = still = int(model.joints[row])
                ball = random.normal(size=(40, 3))
                ball *= model.robot[row, RADIUS] / np.linalg.norm(ball, axis=1, keepdims=True)
                ball += model.robot[row, CENTER : CENTER + 3]
                while still >= 0:
                    still = before[still]
                    seen = [
                        (np.eye(4) if still < 0 else np.linalg.inv(F[still])) @ F[joint]
                        for F in frames
                    ]
                    gone = (seen[1] - seen[0])[:3] @ np.c_[ball, np.ones(40)].T
                    bound, most = stray(work, joint, still, number), np.linalg.norm(gone, axis=0)
                    assert most.max() <= bound + 1e-12
                    if bound > 1e-6:
                        tightest = max(tightest, float(most.max()) / bound)
    # A bound that is never nearly reached would prove nothing in time.
    assert tightest > 0.7


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
        T = np.eye(4)
        T[:3, 3] = point
        model = Checker.of(robot, Scene((Obstacle("ball", Sphere(gap - 0.03), T),))).model.arrays
        assert proof_of(model, start, end, 0.03 - 1e-5, found) == FREE
        assert proof_of(model, start, end, 0.03 + 1e-5, found) == COLLIDING
        told += 1
    assert told > 8


def test_two_links_that_come_towards_each_other_are_free_to_a_hair() -> None:
    """Neither hangs on the other: how far both get counts, seen from what both hang on."""
    solid = '<collision><geometry><sphere radius="0.1"/></geometry></collision>'
    slide = """<joint name="{0}" type="prismatic"><parent link="base"/><child link="{1}"/>
        <axis xyz="1 0 0"/><limit lower="-2" upper="2" velocity="1" effort="1"/>{2}</joint>"""
    mimic = '<mimic joint="slide" multiplier="-1" offset="1"/>'
    description = parse_urdf(
        f'<robot name="gripper"><link name="base"/><link name="left">{solid}</link>'
        f'<link name="right">{solid}</link>{slide.format("slide", "left", "")}'
        f"{slide.format('other', 'right', mimic)}</robot>"
    )
    robot = robot_geometry(serial_chain(description, tip_link="left"), description)
    model, found = Checker.of(robot, Scene()).model.arrays, np.empty(4)
    for begin in (-1.0, 0.0, 0.3):
        a, b = np.array([begin]), np.array([0.35])  # there the balls are 0.1 m apart
        assert proof_of(model, a, b, 0.1 - 1e-5, found) == FREE
        assert proof_of(model, a, b, 0.1 + 1e-5, found) == COLLIDING


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_what_is_no_number_is_not_proved(value: float) -> None:
    robot, found = builtin("panda"), np.empty(4)
    model = Checker.of(robot, Scene()).model.arrays
    home = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
    assert proof_of(model, home, home, 0.0, found) == FREE
    for joint in range(7):
        wrong = home.copy()
        wrong[joint] = value
        for ends in ((home, wrong), (wrong, home), (wrong, wrong)):
            assert proof_of(model, *ends, 0.0, found) != FREE


def test_only_what_may_meet_is_left() -> None:
    """Motions far from everything leave nothing, and those near something a few stretches."""
    robot, random = builtin("panda"), np.random.default_rng(75)
    empty = Checker.of(robot, Scene()).model.arrays
    model = Checker.of(robot, around(robot, random)).model.arrays
    counts = [[intervals_of(m, a, b) for m in (empty, model)] for a, b in lines(robot, random, 60)]
    alone, among = np.array(counts).T
    assert (alone >= 0).all()
    assert (alone <= 1).all()
    assert (among >= alone).all()
    assert np.median(among) < 8


def test_a_workspace_with_little_room_gives_the_same_verdict() -> None:
    robot, random, found = builtin("panda"), np.random.default_rng(76), np.empty(4)
    model = Checker.of(robot, around(robot, random)).model.arrays
    work, verdicts = workspace(model), set[int]()
    small = work._replace(
        entries=work.entries[:, :2].copy(),
        hints=np.zeros((3, len(model.roots), 3)),
        spans=work.spans[:, :2].copy(),
        lists=work.lists[:, :2].copy(),
    )
    for a, b in lines(robot, random, 40):
        verdict = prove_line(model, work, a, b, 0.0, MAX_INTERVALS, found)
        assert prove_line(model, small, a, b, 0.0, MAX_INTERVALS, found) == verdict
        verdicts.add(verdict)
    assert verdicts >= {FREE, COLLIDING}
