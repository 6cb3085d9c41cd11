"""From a robot and a scene to a proved motion, in process."""

from typing import Any

import numpy as np
import pytest

import armwright as aw

START = [0.8, 0.3, 0.0, -1.8, 0.0, 2.1, 0.8]
GOAL = [-0.8, 0.3, 0.0, -1.8, 0.0, 2.1, 0.8]
#: Time enough where kernels are still compiled.
PATIENT = aw.Options(timeout=300.0)
POST = aw.Obstacle("post", aw.Box((0.1, 0.1, 1.0)), aw.pose([0.5, 0.0, 0.5]))


@pytest.fixture(scope="module")
def panda() -> aw.RobotGeometry:
    return aw.load_robot("panda")


def test_a_plan_is_proved_and_certify_proves_it_again(panda: aw.RobotGeometry) -> None:
    scene = aw.Scene((POST,))
    plan = aw.plan(panda, scene, START, GOAL, PATIENT)
    assert isinstance(plan, aw.Plan)
    assert plan.certificate.verified
    again = aw.certify(plan.trajectory, panda, scene)
    assert again.verified
    assert again.min_clearance == plan.certificate.min_clearance
    for t in np.linspace(0.0, plan.trajectory.duration, 50):
        assert aw.check(panda, scene, plan.trajectory.sample([t])[0]).valid


def test_a_goal_may_be_a_pose_or_any_of_several(panda: aw.RobotGeometry) -> None:
    T = aw.fk(panda, GOAL)
    goals: list[Any] = [T, aw.PoseGoal(T), [aw.PoseGoal(T), aw.JointGoal(GOAL)]]
    for goal in goals:
        plan = aw.plan(panda, aw.Scene(), START, goal, PATIENT)
        assert isinstance(plan, aw.Plan)
        assert np.allclose(aw.fk(panda, plan.trajectory.end)[:3, 3], T[:3, 3], atol=2e-4)


def test_a_goal_of_another_shape_is_refused(panda: aw.RobotGeometry) -> None:
    with pytest.raises(aw.ArmwrightError, match="neither a configuration"):
        aw.plan(panda, aw.Scene(), START, np.zeros((3, 3)))


def test_what_can_not_be_planned_is_a_failure_with_advice(panda: aw.RobotGeometry) -> None:
    wall = aw.Obstacle("box", aw.Box((0.3, 0.3, 0.3)), aw.fk(panda, GOAL))
    failure = aw.plan(panda, aw.Scene((wall,)), START, GOAL)
    assert isinstance(failure, aw.Failure)
    assert failure.code == "GOAL_IN_COLLISION"
    assert failure.hint


def test_constraints_hold_along_the_plan(panda: aw.RobotGeometry) -> None:
    upright = aw.ToolSpeedConstraint(0.2)
    plan = aw.plan(panda, aw.Scene(), START, GOAL, PATIENT, constraints=[upright])
    assert isinstance(plan, aw.Plan)
    assert plan.certificate.limits["tool_speed"].worst_ratio <= 1.0 + 1e-9


def test_check_tells_the_pair_and_the_joint(panda: aw.RobotGeometry) -> None:
    ball = aw.Obstacle("ball", aw.Sphere(0.1), aw.fk(panda, START))
    report = aw.check(panda, aw.Scene((ball,)), START)
    assert not report.valid
    assert any("ball" in collision.pair for collision in report.collisions)
    assert report.clearance == -report.collisions[0].depth
    outside = aw.check(panda, aw.Scene(), [9.0, *START[1:]])
    assert [violation.joint for violation in outside.limit_violations] == ["panda_joint1"]
    assert not outside.valid


def test_a_path_is_timed_with_and_without_a_robot(panda: aw.RobotGeometry) -> None:
    timed = aw.retime([START, GOAL], panda)
    assert timed.certificate.limits["velocity"].worst_ratio <= 1.0 + 1e-9
    free = aw.retime([[0.0], [1.0]], limits={"velocity": [1.0], "acceleration": [1.0]})
    # Half a metre at 1 m/s^2, and half a metre back to rest.
    assert np.isclose(free.trajectory.duration, 2.0)
    with pytest.raises(aw.ArmwrightError):
        aw.retime([[0.0], [1.0]])


@pytest.mark.parametrize(
    "ask",
    [
        lambda: aw.plan("panda", aw.Scene(), START, GOAL),  # type: ignore[arg-type]
        lambda: aw.check("panda", aw.Scene(), START),  # type: ignore[arg-type]
        lambda: aw.fk("panda", START),  # type: ignore[arg-type]
        lambda: aw.ik("panda", np.eye(4)),  # type: ignore[arg-type]
        lambda: aw.retime([START, GOAL], "panda"),  # type: ignore[arg-type]
    ],
)
def test_a_name_is_no_robot_and_the_error_says_how_to_load_one(ask: Any) -> None:
    with pytest.raises(aw.ArmwrightError) as told:
        ask()
    assert "'panda' is a str" in str(told.value)
    assert "aw.load_robot('panda')" in str(told.value)
