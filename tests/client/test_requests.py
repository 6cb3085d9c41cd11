"""Requests as they are sent, and answers that may hold more than is known here."""

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


PLAN: dict[str, Any] = {
    "status": "success",
    "frame": "base",
    "planner": "straight_line",
    "stages": [{"name": "straight_line", "outcome": "succeeded", "milliseconds": 1.5}],
    "path": {"joints": [[0.0], [1.0]], "length": 1.0},
    "trajectory": {
        "joint_names": ["j"],
        "duration": 1.0,
        "segments": [{"t0": 0, "t1": 1, "coefficients": [[0, 1]]}],
        "samples": {
            "time": [0.0],
            "position": [[0.0]],
            "velocity": [[1.0]],
            "acceleration": [[0.0]],
        },
    },
    "certificate": {
        "verified": True,
        "proved": {"limits": True, "collisions": True, "reasons": []},
        "min_clearance": 0.1,
        "clearance_pair": ["hand", "table"],
        "method": "distances",
        "limits": {"position": {"worst_ratio": 0.5, "joint": "j", "time": 0.5}},
    },
    "reproducibility": {
        "seed": 0,
        "robot_hash": "a",
        "scene_hash": "b",
        "request_hash": "c",
        "versions": {"armwright": "0.1.0"},
    },
}


def grown(value: Any) -> Any:
    """The same document from a service that answers more everywhere."""
    if isinstance(value, dict):
        return {name: grown(item) for name, item in value.items()} | {"from_the_future": [1, {}]}
    return [grown(item) for item in value] if isinstance(value, list) else value


def read(document: Any) -> ours.Plan:
    return ours.Plan.read(json.dumps(document).encode())


def test_a_plan_is_read() -> None:
    plan = read(PLAN)
    assert plan.trajectory.sample([0.25]) == [[0.25]]
    assert plan.certificate.clearance_pair == ("hand", "table")
    assert plan.certificate.limits is not None
    assert plan.certificate.limits.velocity is None
    assert plan.stages[0].detail is None
    assert plan.notes == []


def test_what_is_not_known_is_passed_over() -> None:
    document = grown(PLAN)
    document["reproducibility"]["versions"] = {"armwright": "0.1.0"}  # these names are open
    assert read(document) == read(PLAN)


def test_a_stored_scene_of_a_newer_service_can_be_stored_again() -> None:
    pose = {"position": [1, 2, 3]}
    obstacle = {"id": "a", "shape": {"type": "sphere", "radius": 1}, "pose": pose}
    document = {"name": "s", "obstacles": [obstacle]}
    scene = ours.Scene.read(json.dumps(grown(document)).encode())
    assert json.loads(scene.model_dump_json(exclude_none=True)) == document


@pytest.mark.parametrize(
    ("place", "value"),
    [("planner", 3), ("stages", None), ("trajectory", {}), ("certificate", {"verified": "maybe"})],
)
def test_what_has_another_type_is_told(place: str, value: object) -> None:
    with pytest.raises(ValidationError):
        read(PLAN | {place: value})


def test_problems_need_nothing() -> None:
    assert ours.Problem.read(b"{}") == ours.Problem()
    assert ours.Problem().type == "about:blank"
