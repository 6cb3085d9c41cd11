"""Requests are strict, and what the service takes."""

import json
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

import armwright_client as ours
from armwright_wire import pose as their_pose
from armwright_wire.base import Body as Request


def sent(request: Request) -> Any:
    return json.loads(request.to_json())


def test_requests_are_values() -> None:
    pose = ours.Pose.at(1, 2, 3)
    assert pose == ours.Pose(position=(1.0, 2.0, 3.0))
    with pytest.raises(ValidationError):
        pose.position = [0, 0, 0]  # type: ignore[misc]


def test_what_was_left_out_is_not_sent() -> None:
    assert sent(ours.Pose.at(1, 2, 3)) == {"position": [1.0, 2.0, 3.0]}
    # But a None among options is the caller's own.
    options = {"cap": None}
    request = ours.PlanRequest(
        robot="r", start=ours.Start(joints=[0]), goal=ours.Goal(joints=[1]), planner_options=options
    )
    assert sent(request)["planner_options"] == options


def test_arrays_are_taken() -> None:
    joints = np.linspace(0.0, 1.0, 6)
    assert sent(ours.FkRequest.of(joints=joints)) == {"joints": joints.tolist()}
    assert sent(ours.FkRequest.of(joints=list(joints))) == {"joints": joints.tolist()}
    assert sent(ours.FkRequest.of(joints=[joints, joints]))["joints"] == [joints.tolist()] * 2


def test_numbers_are_sent_to_the_last_digit() -> None:
    values = np.random.default_rng(5).normal(size=60) * 10.0 ** np.linspace(-100, 11, 60)
    assert sent(ours.FkRequest.of(joints=values))["joints"] == values.tolist()


def test_poses_are_made_of_other_forms() -> None:
    rotation = Rotation.random(random_state=7)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation.as_matrix(), (0.1, 0.2, 0.3)
    position = T[:3, 3]
    roll, pitch, yaw = rotation.as_euler("xyz")
    phi, theta, psi = rotation.as_euler("ZYZ")
    forms = [
        ours.Pose.from_matrix(T),
        ours.Pose.from_matrix(T.tolist()),
        ours.Pose.from_quaternion(position, rotation.as_quat()),
        ours.Pose.from_rpy(position, roll, pitch, yaw),
        ours.Pose.from_zyz(position, phi, theta, psi),
        ours.Pose.from_axis_angle(position, 2.0 * rotation.as_rotvec(), rotation.magnitude()),
    ]
    from service.translate.poses import transform

    for form in forms:
        body = their_pose.Pose.model_validate_json(form.to_json())
        np.testing.assert_allclose(transform(body), T, atol=1e-12)


@pytest.mark.parametrize("rows", [np.eye(3), np.ones((4, 4)), [[1.0], [2.0], [3.0], [4.0]], []])
def test_a_matrix_that_is_no_transform_is_refused(rows: Any) -> None:
    with pytest.raises(ValueError, match="transform"):
        ours.Pose.from_matrix(rows)


def test_goals_are_told_apart() -> None:
    from armwright_wire.goals.goal import as_goal

    pose = ours.Pose.at(1, 2, 3)
    goal = ours.Goal.at_pose(pose, position_tolerance=0.01)
    assert as_goal(goal) is goal
    assert as_goal(np.array([1.0, 2.0])) == ours.Goal(joints=[1.0, 2.0])
    assert as_goal(ours.SingleGoal(joints=[1.0])) == ours.Goal(joints=[1.0])
    several = ours.Goal.among([goal, [1.0, 2.0]])
    assert sent(several) == {
        "any_of": [{"pose": sent(pose), "position_tolerance": 0.01}, {"joints": [1.0, 2.0]}]
    }


def test_a_pose_takes_its_frame_along() -> None:
    pose = ours.FramedPose(position=[0.1, 0.2, 0.3], frame="tool")
    ball = ours.Obstacle(id="a", shape=ours.Sphere(radius=0.1), pose=pose)
    for body in (ours.Goal(pose=pose), ball, ours.ToolMotion.lin(pose), ours.IkRequest(pose=pose)):
        assert sent(body)["pose"] == {"position": [0.1, 0.2, 0.3], "frame": "tool"}
    assert sent(ours.Start(state="home")) == sent(ours.Goal.at_state("home")) == {"state": "home"}
