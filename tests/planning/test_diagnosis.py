"""What a failure tells: against closed forms of a ball that slides, and on real arms."""

import numpy as np
import pytest

from kinematics.serial_chain import serial_chain
from kinematics.urdf import parse_urdf
from obstacles.checker import Checker
from obstacles.fcl_distance import FclWorld
from obstacles.robot_geometry import RobotGeometry, robot_geometry
from obstacles.scene import Scene
from planning.deadline import Deadline
from planning.diagnosis import diagnose
from planning.nearest_free import nearest_free
from planning.options import Options
from planning.pipeline import plan
from planning.problem import JointGoal, Problem
from planning.result import Failure, Plan
from tests.planning.scenes import HOME, box, builtin, shelf

#: A ball of 5 cm on a table of two slides, in the plane z = 0.
SLIDER = """<robot name="slider"><link name="base"/><link name="x"/>
<link name="ball"><collision><geometry><sphere radius="0.05"/></geometry></collision></link>
<joint name="jx" type="prismatic"><parent link="base"/><child link="x"/><axis xyz="1 0 0"/>
<limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
<joint name="jy" type="prismatic"><parent link="x"/><child link="ball"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>"""


def slider() -> RobotGeometry:
    description = parse_urdf(SLIDER)
    limits = {name: {"acceleration": 2.0} for name in ("jx", "jy")}
    return robot_geometry(serial_chain(description, joint_limits=limits), description)


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
    answer = plan(problem, Options())
    assert isinstance(answer, Failure)
    nearest = answer.details["nearest_valid"]
    assert nearest["joints"] == pytest.approx([0.151, 0.0], abs=2e-3)
    assert nearest["distance"] == pytest.approx(0.061, abs=2e-3)
    mended = Problem(robot, scene, np.array(nearest["joints"]), (away,))
    assert isinstance(plan(mended, Options()), Plan)


def walled() -> Scene:
    """A wall across the whole table, and a pebble beside it that is in nobody's way."""
    wall = box("wall", (0.1, 3.0, 0.4), (0.0, 0.0, 0.0))
    return Scene((wall, box("pebble", (0.04, 0.04, 0.4), (-0.5, 0.4, 0.0))))


@pytest.mark.parametrize("planner", ["auto", "straight_line", "rrt_connect"])
def test_a_search_that_fails_names_what_is_in_the_way(planner: str) -> None:
    goal = JointGoal(np.array([0.6, 0.1]))
    problem = Problem(slider(), walled(), np.array([-0.6, 0.0]), (goal,))
    answer = plan(problem, Options(planner=planner, timeout=2.0))
    assert isinstance(answer, Failure)
    assert answer.code in {"TIMED_OUT", "PLANNING_FAILED"}
    details = answer.details
    first = details["blocked_by"][0]
    assert first["pair"] == ["ball", "wall"]
    assert 0.5 < first["share"] <= 1.0
    assert sum(item["share"] for item in details["blocked_by"]) == pytest.approx(1.0)
    assert details["would_unblock"] == ["wall"]
    assert details["tried_without"][0] == "wall"
    assert 0.5 < details["start_freedom"] <= 1.0
    assert answer.stages[-1].name == "diagnosis"
    assert "wall" in answer.stages[-1].detail


def test_a_start_that_is_shut_in_has_no_freedom() -> None:
    sides = [
        box("east", (0.02, 0.3, 0.4), (0.08, 0.0, 0.0)),
        box("west", (0.02, 0.3, 0.4), (-0.08, 0.0, 0.0)),
        box("north", (0.3, 0.02, 0.4), (0.0, 0.08, 0.0)),
        box("south", (0.3, 0.02, 0.4), (0.0, -0.08, 0.0)),
    ]
    robot, scene = slider(), Scene(tuple(sides))
    start, goals = np.zeros(2), [np.array([0.6, 0.6])]
    checker = Checker.of(robot, scene)
    found = diagnose(robot, scene, checker, start, goals, Deadline.after(2.0), seed=1)
    assert found.start_freedom == 0.0
    assert found.goal_freedom == 1.0
    assert {name for pair, _ in found.blocked_by for name in pair} == {
        "ball", "east", "west", "north", "south"}  # fmt: skip
    assert set(found.would_unblock) == set(found.tried)
    none = diagnose(robot, Scene(), Checker.of(robot, Scene()), start, goals, Deadline.after(1.0))
    assert none.blocked_by == ()
    assert none.sentence


def test_it_looks_no_longer_than_it_may() -> None:
    robot, scene = builtin("panda"), shelf()
    checker = Checker.of(robot, scene)
    deadline = Deadline.after(0.0)
    found = diagnose(robot, scene, checker, HOME, [HOME + 0.1], deadline)
    assert found.motions == 0
    assert found.tried == ()
