"""Starts and goals that touch, or nearly, and free configurations near them."""

import re
import time

import numpy as np
import pytest
import trimesh

from benchmarks.problems.mesh_scenes import mesh
from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.pose import transform
from obstacles.collision.checker import Checker
from obstacles.collision.fcl_distance import FclWorld
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Box, Sphere
from planning.options import Options
from planning.pipeline.pipeline import plan
from planning.planner import TOUCHING
from planning.preflight import failures
from planning.preflight.failures import nearest_free
from planning.problem import JointGoal, PoseGoal, Problem
from planning.result import Failure, Plan
from tests.planning.scenes import HOME, box, builtin, planned_motion, planning_failure, shelf
from tests.planning.slider import slider

AWAY = HOME + np.array([0.6, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0])


def with_ball(gap: float, margin: float = 0.0) -> tuple[RobotGeometry, Scene]:
    """A ball in the hand, and a box whose face it is ``gap`` away from at the start."""
    robot = builtin("panda").attach(
        Obstacle("ball", Sphere(0.05), transform(None, [0.0, 0.0, 0.4])), "panda_hand"
    )
    center = (forward(robot.chain, HOME, "panda_hand") @ transform(None, [0, 0, 0.4]))[:3, 3]
    top = center[2] - 0.05 - gap
    plate = Obstacle("plate", Box(np.array([0.2, 0.2, 0.02])), transform(
        None, [center[0], center[1], top - 0.01]), margin)  # fmt: skip
    return robot, Scene((plate,))


@pytest.mark.parametrize("gap", [-1e-2, -1e-5, -1e-7, 0.0, 1e-7])
@pytest.mark.parametrize("backwards", [False, True])
def test_contact_is_told_with_pair_and_depth(gap: float, backwards: bool) -> None:
    robot, scene = with_ball(gap)
    start, goal = (AWAY, HOME) if backwards else (HOME, AWAY)
    answer = planning_failure(
        Problem(robot, scene, start, (JointGoal(goal),)), Options(timeout=10.0)
    )
    which = "goal" if backwards else "start"
    assert answer.code == ("GOAL_IN_COLLISION" if backwards else "START_STATE_IN_COLLISION")
    assert answer.stage == which
    assert answer.details["pair"] == ["ball", "plate"]
    assert answer.details["depth"] == pytest.approx(max(-gap, 0.0), abs=2e-7)
    assert "'ball'" in answer.message
    assert which in answer.message
    if gap > 0.0:
        assert answer.details["clearance"] == pytest.approx(gap, abs=2e-7)


def test_just_clear_is_planned_and_proved() -> None:
    robot, scene = with_ball(1e-6)
    upward = HOME + np.array([0.0, -0.3, 0.0, 0.0, 0.0, 0.0, 0.0])
    answer = planned_motion(
        Problem(robot, scene, HOME, (JointGoal(upward),)), Options(timeout=10.0)
    )
    assert 0.0 < answer.certificate.min_clearance <= 1e-6 + 1e-9


def test_a_margin_has_no_depth() -> None:
    robot, scene = with_ball(0.004, margin=0.003)
    answer = planning_failure(
        Problem(robot, scene, HOME, (JointGoal(AWAY),), margin=0.002), Options()
    )
    assert answer.code == "START_STATE_IN_COLLISION"
    assert answer.details["depth"] == 0.0
    assert answer.details["collisions"] == []
    assert answer.details["clearance"] == pytest.approx(0.004, abs=1e-6)
    assert answer.details["margin"] == pytest.approx(0.005, abs=1e-6)
    assert TOUCHING < 1e-6


def test_many_goals_that_collide_cost_little_and_are_counted() -> None:
    """Only the first is looked into: each takes a search for what is valid nearby."""
    robot, scene = with_ball(-1e-3)
    random = np.random.default_rng(0)
    goals = [JointGoal(HOME + 1e-5 * random.normal(size=7)) for _ in range(300)]
    goals.append(JointGoal(HOME + 10.0))
    searches: list[Array] = []

    def nearby(checker: Checker, q: Array) -> None:
        searches.append(q)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(failures, "nearest_free", nearby)
        refused = plan(Problem(robot, scene, AWAY, tuple(goals)), Options(timeout=10.0))
        assert len(searches) == 1
        found = plan(Problem(robot, scene, AWAY, (*goals, JointGoal(AWAY + 0.1))), Options())
    assert isinstance(refused, Failure)
    assert refused.code == "GOAL_IN_COLLISION"
    assert refused.details["goals"] == {"GOAL_IN_COLLISION": 300, "GOAL_STATE_INVALID": 1}
    assert refused.message.startswith("none of 301 goals is valid; the first: at the goal, ")
    assert len(searches) == 1
    assert isinstance(found, Plan)
    np.testing.assert_allclose(found.trajectory.end, AWAY + 0.1, rtol=0.0, atol=1e-12)


def test_goals_are_looked_at_until_time_is_up() -> None:
    """Poses inside an obstacle, each of which takes inverse kinematics and a search."""
    robot = builtin("panda")
    crate = Obstacle("crate", Box(np.array([0.3, 0.3, 0.3])), transform(None, [0.5, 0.4, 0.4]))
    goals = tuple(
        PoseGoal(transform(np.diag([1.0, -1.0, -1.0]), [0.5 + 1e-4 * k, 0.4, 0.4]))
        for k in range(1000)
    )
    answer = planning_failure(Problem(robot, Scene((crate,)), HOME, goals), Options(timeout=0.5))
    assert (answer.code, answer.stage) == ("TIMED_OUT", "goal")
    looked_at = re.search(r"when (\d+) of 1000 goals", answer.message)
    assert looked_at is not None
    assert int(looked_at[1]) < 1000


def test_time_for_meshes_never_seen_counts_and_is_told() -> None:
    robot, start, goal = builtin("planar_rr"), np.array([0.0, 0.3]), np.array([0.5, 0.4])
    ring = mesh(trimesh.creation.torus(0.11, 0.03, major_sections=128, minor_sections=64))
    scene = Scene((Obstacle("ring", ring, transform(None, [-1.0, 0.6, 0.3])),))
    problem = Problem(robot, scene, start, (JointGoal(goal),))
    began = time.monotonic()
    answer = plan(problem, Options(timeout=0.05))
    assert time.monotonic() - began >= 0.05
    assert isinstance(answer, Failure)
    assert (answer.code, answer.stage) == ("TIMED_OUT", "preparation")
    assert "while meshes were being prepared" in answer.message
    assert "what was prepared so far is kept" in answer.hint
    assert isinstance(plan(problem, Options(timeout=60.0)), Plan)


@pytest.mark.parametrize("case", range(12))
def test_the_nearest_free_place_of_a_ball_in_a_box(case: int) -> None:
    """Out of a box by its nearest face: 5 cm and what is asked for beyond it."""
    random = np.random.default_rng(case)
    half = random.uniform(0.05, 0.2, 2)
    center = random.uniform(-0.3, 0.3, 2)
    crate = box("crate", (2 * half[0], 2 * half[1], 0.4), (center[0], center[1], 0.0))
    q = center + random.uniform(-0.9, 0.9, 2) * half
    checker = Checker.of(slider(), Scene((crate,)))
    found = nearest_free(checker, q, seed=case)
    assert found is not None
    out = float((half - np.abs(q - center)).min()) + 0.05
    assert found.distance == pytest.approx(out, abs=4e-3)
    assert found.distance >= out
    assert found.tip_distance == pytest.approx(found.distance)
    assert found.clearance > 0.0
    np.testing.assert_allclose(found.distance, np.linalg.norm(found.joints - q))


@pytest.mark.parametrize("case", range(12))
def test_free_configurations_of_an_arm(case: int) -> None:
    robot, scene = builtin("panda"), shelf()
    checker = Checker.of(robot, scene, 0.005)
    low, high = robot.chain.sampling_bounds()
    random = np.random.default_rng(case)
    q = next(q for q in random.uniform(low, high, (200, 7)) if not checker.valid(q))
    found = nearest_free(checker, q, seed=3)
    assert found is not None
    assert ((found.joints >= low) & (found.joints <= high)).all()
    clearance = FclWorld(robot, scene).clearance(found.joints)
    assert clearance.distance > 0.0
    again = nearest_free(checker, q, seed=3)
    assert again is not None
    np.testing.assert_array_equal(again.joints, found.joints)


def test_a_start_in_collision_tells_where_it_would_be_free() -> None:
    robot, scene = slider(), Scene((box("crate", (0.2, 0.2, 0.2), (0.0, 0.0, 0.0)),))
    away = JointGoal(np.array([0.5, 0.5]))
    problem = Problem(robot, scene, np.array([0.09, 0.0]), (away,))
    answer = planning_failure(problem, Options())
    nearest = answer.details["nearest_valid"]
    assert nearest["joints"] == pytest.approx([0.151, 0.0], abs=2e-3)
    assert nearest["distance"] == pytest.approx(0.061, abs=2e-3)
    mended = Problem(robot, scene, np.array(nearest["joints"]), (away,))
    assert isinstance(plan(mended, Options()), Plan)
