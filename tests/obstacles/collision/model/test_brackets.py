"""Brackets never contradict the exact verdict, which they make cheaper, and are soon made."""

import numpy as np
import pytest

from benchmarks.judges.fcl import FclJudge
from benchmarks.planning.scale import room
from benchmarks.verdict import builtin, certify_all, clutter, verdicts_on
from kinematics.arrays import Array
from kinematics.robots import builtin_names
from obstacles.collision.checker import Checker
from obstacles.collision.edge_check import COLLIDING, FREE
from obstacles.convex.piece import Piece, PieceKind
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Box, HalfSpace, Sphere
from tests.obstacles.solids import random_transform


def states_of(robot: RobotGeometry, random: np.random.Generator, count: int) -> Array:
    return random.uniform(*robot.chain.sampling_bounds(), (count, robot.chain.n))


def verdicts(checker: Checker, states: Array) -> tuple[Array, Array, int]:
    """By brackets and exact tests on what they leave, by the walk over motions, and how many."""
    ours, edges = np.empty(len(states)), np.empty(len(states))
    asked = verdicts_on(checker.model.arrays, states, checker.slack, ours)
    certify_all(checker.model.arrays, states, 0.0 * states, edges)
    return ours, edges, asked


@pytest.mark.parametrize("name", builtin_names())
def test_brackets_tell_what_fcl_tells(name: str) -> None:
    robot, random = builtin(name), np.random.default_rng(61)
    reach = float(np.linalg.norm(robot.chain.offsets[:, :3, 3], axis=1).sum()) + 0.1
    told = 0
    for scene in (clutter(random, reach), clutter(random, reach)):
        checker, judge = Checker.of(robot, scene), FclJudge(robot, scene)
        states = states_of(robot, random, 40)
        ours, edges, _ = verdicts(checker, states)
        assert (ours == edges).all()
        for q, verdict in zip(states, ours, strict=True):
            bracket = checker.bracket(q)
            assert not (bracket.free and bracket.colliding)
            told += bracket.free or bracket.colliding
            assert not bracket.free or not bracket.flagged
            assert not bracket.free or verdict == FREE
            assert not bracket.colliding or verdict == COLLIDING
            assert bracket.free or bracket.colliding or bracket.flagged
            assert not bracket.free or not judge.collides(q)
            assert not bracket.colliding or judge.collides(q)
            assert checker.valid(q) == (verdict == FREE)
    assert told > 20


def test_margins_slack_and_allowed_pairs() -> None:
    robot, random = builtin("ur5e"), np.random.default_rng(62)
    plain = clutter(random, 1.0)
    states = states_of(robot, random, 150)
    few = Scene(
        tuple(
            Obstacle(o.id, o.shape, o.T_world_obstacle, random.uniform(0.0, 0.05))
            for o in plain.obstacles
        ),
        allowed_collisions=frozenset(
            [("forearm_link", "o1"), ("floor", "shoulder_link"), ("wrist_1_link", "wrist_3_link")]
        ),
    )
    for scene, margin, slack in ((plain, 0.0, 0.0), (few, 0.02, 0.0), (few, 0.0, 0.01)):
        checker = Checker(Checker.of(robot, scene, margin).model, slack)
        ours, found = verdicts(checker, states)[0], np.empty(len(states))
        for k, q in enumerate(states):
            motion = checker.segment(q, q)
            found[k] = FREE if motion.free else COLLIDING if motion.colliding else 2.0
        assert (ours == found).all()
        assert 0 < (ours == FREE).sum() < len(states)


def test_a_robot_that_holds_something() -> None:
    random = np.random.default_rng(63)
    held = Obstacle("held", Box(np.array([0.3, 0.02, 0.2])), random_transform(random, 0.1))
    arm = builtin("iiwa14")
    robot = arm.attach(held, arm.chain.tip.name)
    walls = (Obstacle("wall", HalfSpace(np.array([1.0, 0.0, 0.0]), -0.4)),)
    balls = tuple(Obstacle(f"b{k}", Sphere(0.1), random_transform(random, 0.6)) for k in range(6))
    checker = Checker.of(robot, Scene(walls + balls))
    ours, edges, _ = verdicts(checker, states_of(robot, random, 200))
    assert (ours == edges).all()
    assert 0 < (ours == FREE).sum() < 200


def test_near_contact_the_verdict_is_the_exact_one() -> None:
    # A ball is moved until it all but touches: brackets leave these pairs, or are right.
    robot, random = builtin("kr6_sixx"), np.random.default_rng(64)
    for q in states_of(robot, random, 25):
        place = random_transform(random, 0.4)
        far = Checker.of(robot, Scene((Obstacle("ball", Sphere(0.001), place),)))
        bare = Checker.of(robot, Scene())
        distance = far.clearance(q)[0] + 0.001
        if not bare.valid(q) or bare.clearance(q)[0] < distance or distance < 0.01:
            continue
        for more, verdict in ((-2e-6, True), (2e-6, False)):
            ball = Obstacle("ball", Sphere(distance + more), place)
            assert Checker.of(robot, Scene((ball,))).valid(q) == verdict


def test_most_states_need_no_exact_test() -> None:
    robot, random = builtin("ur5e"), np.random.default_rng(65)
    checker = Checker.of(robot, room(random, 100_000))
    states = states_of(robot, random, 300)
    ours, edges, asked = verdicts(checker, states)
    assert (ours == edges).all()
    assert asked < 20 * len(states)


def test_a_link_without_volume() -> None:
    sheet = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0]])
    arm = builtin("planar_rr")
    flat = RobotGeometry(
        arm.chain, (Piece(PieceKind.POLYTOPE, np.eye(4), sheet),), (arm.links[-1],),
        np.array([1]), np.array([0]), {},
    )  # fmt: skip
    random = np.random.default_rng(66)
    ball = Obstacle("ball", Sphere(0.3), random_transform(random, 0.5))
    ours, edges, _ = verdicts(Checker.of(flat, Scene((ball,))), states_of(flat, random, 200))
    assert (ours == edges).all()
