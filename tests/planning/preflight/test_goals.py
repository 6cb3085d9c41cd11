"""Goal configurations of a ball that slides, whose clearances have closed forms, and of an arm."""

import pickle

import numpy as np
import pinocchio as pin
import pytest

from kinematics.forward import forward
from kinematics.pose import from_rpy, transform
from obstacles.collision.checker import Checker
from obstacles.scenes.scene import Scene
from planning.preflight.goals import find_goals
from planning.preflight.preflight import preflight, start_only
from planning.preflight_result import ENOUGH, TOUCHING, Ready
from planning.problem import JointGoal, PoseGoal, Problem
from planning.result import Failure
from planning.values.deadline import Deadline
from tests.planning.scenes import HOME, box, builtin
from tests.planning.slider import slider

CRATE = Scene((box("crate", (0.2, 0.2, 0.2), (0.0, 0.0, 0.0)),))
START = np.array([-0.5, 0.0])


def at(x: float) -> JointGoal:
    """A ball of 5 cm whose clearance from the crate's face is x - 0.15 m."""
    return JointGoal(np.array([x, 0.0]))


def found(*goals: JointGoal, seconds: float = 10.0) -> list[tuple[float, float]] | Failure:
    problem = Problem(slider(), CRATE, START, goals)
    checker = Checker.of(slider(), CRATE)
    answer = find_goals(problem, checker, START, 0, Deadline.after(seconds))
    if isinstance(answer, Failure):
        return answer
    return [(candidate.clearance, float(candidate.joints[0])) for candidate in answer]


def test_goals_come_with_their_clearance_and_those_that_touch_are_left_out() -> None:
    """As far as anybody asks how much it is."""
    answer = found(at(0.1), at(0.4), at(0.15), at(0.1515), at(0.2))
    assert not isinstance(answer, Failure)
    (first, x), (second, y), (third, z) = answer
    assert (x, y, z) == (0.4, 0.1515, 0.2)
    assert (first, third) == (ENOUGH, ENOUGH)
    assert second == pytest.approx(0.0015, abs=1e-6)


def test_why_no_goal_is_valid() -> None:
    answer = found(at(0.1), at(3.0), at(0.0))
    assert isinstance(answer, Failure)
    assert answer.code == "GOAL_IN_COLLISION"
    assert answer.details["goals"] == {"GOAL_IN_COLLISION": 2, "GOAL_STATE_INVALID": 1}
    assert answer.details["depth"] == pytest.approx(0.05, abs=1e-4)
    alone = found(at(3.0))
    assert isinstance(alone, Failure)
    assert alone.code == "GOAL_STATE_INVALID"
    assert alone.details["excess"] == pytest.approx(2.0)
    late = found(at(0.4), seconds=0.0)
    assert isinstance(late, Failure)
    assert late.code == "TIMED_OUT"


def test_poses_give_several_configurations_that_are_clear() -> None:
    robot = builtin("panda")
    T = forward(robot.chain, HOME)
    problem = Problem(robot, Scene(), HOME, (PoseGoal(T),))
    checker = Checker.of(robot, Scene())
    answer = find_goals(problem, checker, HOME, 1, None)
    assert not isinstance(answer, Failure)
    assert len(answer) > 1
    for candidate in answer:
        assert candidate.clearance > TOUCHING
        np.testing.assert_allclose(forward(robot.chain, candidate.joints), T, atol=2e-4)


def test_slack_is_half_of_what_the_narrowest_end_has_to_spare() -> None:
    def slack(start: float, *goals: float) -> float:
        ends = tuple(at(x) for x in goals)
        ready = preflight(Problem(slider(), CRATE, np.array([start, 0.0]), ends), 0)
        assert isinstance(ready, Ready)
        return ready.checkers[-1].slack

    assert slack(-0.5, 0.5) == pytest.approx(1e-3)
    assert slack(-0.1502, 0.5) == pytest.approx(1e-4, abs=1e-6)
    assert slack(-0.5, 0.1502) == pytest.approx(1e-4, abs=1e-6)
    # The goal with most to spare counts: the others are left out where they have less.
    ready = preflight(Problem(slider(), CRATE, START, (at(0.1502), at(0.4))), 0)
    assert isinstance(ready, Ready)
    assert [float(q[0]) for q in ready.goals] == [0.4]


def test_goals_are_sorted_by_their_distance_from_the_start() -> None:
    goals = (at(0.9), at(-0.9), at(0.4))
    ready = preflight(Problem(slider(), CRATE, START, goals), 0)
    assert isinstance(ready, Ready)
    assert [float(q[0]) for q in ready.goals] == [-0.9, 0.4, 0.9]


def test_the_start_alone() -> None:
    ready = start_only(Problem(slider(), CRATE, START, (at(0.0),)))
    assert isinstance(ready, Ready)
    assert ready.goals == []
    assert ready.checkers[0].slack == pytest.approx(1e-4)
    near = start_only(Problem(slider(), CRATE, np.array([-0.15 - 1e-5, 0.0]), (at(0.0),)))
    assert isinstance(near, Ready)
    assert near.checkers[0].slack == pytest.approx(5e-6, abs=2e-7)
    inside = start_only(Problem(slider(), CRATE, np.array([-0.1, 0.0]), (at(0.0),)))
    assert isinstance(inside, Failure)
    assert inside.code == "START_STATE_IN_COLLISION"


def test_a_robot_of_convex_solids_has_no_hulls_beside_it_though_an_equal_one_was_asked_about() -> (
    None
):
    robot = builtin("panda")
    for one in (robot, pickle.loads(pickle.dumps(robot))):
        answer = preflight(Problem(one, Scene(), HOME, (JointGoal(HOME),)), 0)
        assert isinstance(answer, Ready)
        assert len(answer.checkers) == 1


@pytest.mark.parametrize(("tilt", "tolerance", "reached"), [
    (0.0, 0.2, True), (0.05, 0.2, True), (0.05, 0.04, False), (0.05, 1e-3, False),
])  # fmt: skip
def test_a_pose_that_no_configuration_has_is_reached_within_its_tolerances(
    tilt: float, tolerance: float, reached: bool
) -> None:
    """The tool of a SCARA stands upright: it is turned by the tilt at least."""
    robot = builtin("scara")
    T = forward(robot.chain, np.array([0.3, 0.6, 0.05, 0.2])) @ transform(
        from_rpy([tilt, 0.0, 0.0]), [0.0, 0.0, 0.0]
    )
    start = np.zeros(4)
    problem = Problem(robot, Scene(), start, (PoseGoal(T, 1e-3, tolerance),))
    answer = find_goals(problem, Checker.of(robot, Scene()), start, 0, None)
    if not reached:
        assert isinstance(answer, Failure)
        assert answer.code == "NO_IK_SOLUTION"
        assert answer.details["orientation_error"] == pytest.approx(tilt, abs=1e-3)
        return
    assert not isinstance(answer, Failure)
    for candidate in answer:
        end = pin.SE3(T).actInv(pin.SE3(forward(robot.chain, candidate.joints)))
        assert np.linalg.norm(end.translation) <= (1e-3 if tilt else 1e-6)
        assert np.linalg.norm(pin.log3(end.rotation)) <= (tolerance if tilt else 1e-6)
