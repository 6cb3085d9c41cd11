"""What a plan says of the configuration that it ends in, beside costs computed here."""

import re
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.model.chain import Chain
from kinematics.pose import from_rpy, transform
from obstacles.collision.checker import Checker
from obstacles.scenes.scene import Obstacle, Scene
from planning.goal_choice.goal_order import plan_configuration
from planning.options import Options
from planning.pipeline import pipeline
from planning.planner import Ready
from planning.preflight.goals import pose_goals
from planning.preflight.preflight import preflight
from planning.problem import JointGoal, PoseGoal, Problem
from planning.result import Plan
from planning.timing.rest_to_rest import motion_times
from planning.values.preferences import GoalCosts
from tests.planning.scenes import box, builtin, planned_motion

START = np.array([0.3, -1.4, 1.6, -1.5, -1.4, 0.5])
GOAL = np.array([-0.4, -1.1, 1.3, -1.2, -1.5, 0.1])


def _share(chain: Chain, q: Array) -> float:
    low, high = chain.limits.lower, chain.limits.upper
    return float((np.minimum(q - low, high - q) / (high - low)).min())


def _plan(robot: str, start: Array, goal: Array, *around: Obstacle, **more: object) -> Plan:
    arm = builtin(robot)
    goals = (PoseGoal(forward(arm.chain, goal)),)
    return planned_motion(Problem(arm, Scene(around), start, goals), Options(timeout=20.0, **more))  # type: ignore[arg-type]


def test_costs_are_those_of_the_configuration_that_the_plan_ends_in() -> None:
    arm = builtin("ur5e")
    wall = box("wall", (0.1, 0.5, 0.1), (-0.75, 0.2, 0.6))
    answer = _plan("ur5e", START, GOAL, wall)
    last, chosen = answer.path.waypoints[-1], answer.configuration
    assert chosen is not None
    assert chosen.branch
    assert chosen.found > 1
    share = _share(arm.chain, last)
    assert chosen.limit_share == pytest.approx(share)
    weights = GoalCosts()
    clearance = Checker.of(arm, Scene((wall,))).clearance(last)[0]
    turned = int((np.abs(last - START) > np.pi).sum())
    assert chosen.costs == pytest.approx(
        {
            "motion_time": weights.motion_time * motion_times(arm.chain, START, last[None])[0],
            "joint_limits": weights.joint_limits * max(1.0 - share / 0.15, 0.0),
            "manipulability": chosen.costs["manipulability"],
            "turns": weights.turns * turned,
            "clearance": weights.clearance * max(1.0 - clearance / 0.05, 0.0),
        }
    )
    assert 0.0 <= chosen.costs["manipulability"] <= weights.manipulability


def test_goals_that_are_joints_leave_no_choice() -> None:
    arm = builtin("ur5e")
    both = (JointGoal(GOAL), PoseGoal(forward(arm.chain, START + 0.8)))
    answer = planned_motion(Problem(arm, Scene(), START, both[:1]), Options(timeout=20.0))
    assert answer.configuration is None
    near = JointGoal(START + 0.05)
    answer = planned_motion(Problem(arm, Scene(), START, (near, both[1])), Options(timeout=20.0))
    assert np.array_equal(answer.path.waypoints[-1], near.joints)
    assert answer.configuration is None


def test_a_redundant_arm_and_one_without_closed_form_say_it_too() -> None:
    panda = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
    chosen = _plan("panda", panda, panda + 0.2).configuration
    assert chosen is not None
    assert chosen.branch
    slid = np.array([0.2, 0.4, 0.6, 0.3, 0.5, 0.1])
    chosen = _plan("stanford", slid, slid + 0.1).configuration
    assert chosen is not None
    assert chosen.limit_share > 0.0


def test_weights_are_those_of_the_request() -> None:
    heavy = replace(GoalCosts(), motion_time=3.0)
    one = _plan("ur5e", START, GOAL).configuration
    other = _plan("ur5e", START, GOAL, goal_costs=heavy).configuration
    assert one is not None
    assert other is not None
    assert other.costs["motion_time"] == pytest.approx(3.0 * one.costs["motion_time"])


def test_a_configuration_that_took_the_place_of_one_at_a_limit_says_so() -> None:
    arm = builtin("ur5e")
    problem = Problem(arm, Scene(), START, (PoseGoal(forward(arm.chain, GOAL)),))
    ready = preflight(problem, 0)
    assert isinstance(ready, Ready)
    weights, last = GoalCosts(), ready.goals[0]
    posed = pose_goals(problem, [candidate.joints for candidate in ready.found])
    chosen = plan_configuration(problem, ready, posed, last, weights, (1.25, 1.5))
    assert chosen is not None
    assert chosen.reason.startswith("In place of one within 2 % of a joint limit")
    assert "1.500 s, and 1.250 s with that one" in chosen.reason
    assert plan_configuration(problem, ready, posed, last + 1e-6, weights) is None


def test_a_plan_that_took_the_place_of_another_tells_the_times_of_both(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As if the first plan had ended at a limit: few do, where something is in the way."""
    first = _plan("ur5e", START, GOAL)
    monkeypatch.setattr(pipeline, "ends_off_limits", lambda *given: given[2][1:2])
    monkeypatch.setattr(pipeline, "MAX_LONGER", 100.0)
    answer = _plan("ur5e", START, GOAL)
    assert not np.array_equal(answer.path.waypoints[-1], first.path.waypoints[-1])
    assert answer.configuration is not None
    times = f"{answer.trajectory.duration:.3f} s, and {first.trajectory.duration:.3f} s"
    assert times in answer.configuration.reason
    share = _share(builtin("ur5e").chain, answer.path.waypoints[-1])
    assert answer.configuration.limit_share == pytest.approx(share)


@pytest.mark.parametrize("tilt", [0.0, 0.05])
def test_a_plan_that_ends_off_its_pose_says_how_far(tilt: float) -> None:
    """The tool of a SCARA stands upright: it can't be tilted as a pose asks."""
    robot, start = builtin("scara"), np.zeros(4)
    T = forward(robot.chain, np.array([0.3, 0.6, 0.05, 0.2]))
    T = T @ transform(from_rpy([tilt, 0.0, 0.0]), [0.0, 0.0, 0.0])
    answer = planned_motion(Problem(robot, Scene(), start, (PoseGoal(T, 1e-3, 0.2),)), Options())
    notes = [note for note in answer.notes if "off, within the goal's tolerances" in note]
    if tilt == 0.0:
        assert not notes
        return
    error = pin.SE3(T).actInv(pin.SE3(forward(robot.chain, answer.path.waypoints[-1])))
    (away, angle) = re.findall(r"([\d.e-]+) (?:m|rad)\b", notes[0])
    assert float(away) == pytest.approx(np.linalg.norm(error.translation), rel=0.01, abs=1e-9)
    assert float(angle) == pytest.approx(np.linalg.norm(pin.log3(error.rotation)), rel=0.01)
    # To the joints that it ended in, nothing is off.
    joints = Problem(robot, Scene(), start, (JointGoal(answer.path.waypoints[-1]), PoseGoal(T)))
    known = planned_motion(joints, Options())
    assert not any("off" in note for note in known.notes)
