"""Requests are strict, and what the service takes."""

import json
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from pydantic import BaseModel, ValidationError
from scipy.spatial.transform import Rotation

import armwright_client as ours
from armwright_wire import pose as their_pose
from armwright_wire.base import Body as Request
from armwright_wire.plans import plan as their_plan
from armwright_wire.robots import kinematics as their_kinematics
from armwright_wire.robots import potential as their_potential
from armwright_wire.robots import robot as their_robot
from armwright_wire.scenes import check as their_check
from armwright_wire.scenes import scene as their_scene

BOX = ours.Box(size=[1.0, 0.8, 0.04])
SCENE = ours.Scene(
    name="table",
    obstacles=[ours.Obstacle(id="top", shape=BOX, pose=ours.Pose.at(0.6, 0.0, 0.2), margin=0.01)],
    allowed_collisions=[("link0", "top")],
)
PART = ours.Attached(
    id="part", shape=ours.Sphere(radius=0.1), pose=ours.Pose.at(0, 0, 0.1), link="hand"
)
DH = ours.DhTable(
    convention="standard",
    rows=[ours.DhRow(type="revolute", a=0.5, alpha=0, d=0, theta=0, lower=-3, upper=3)],
    base=ours.Pose.at(0, 0, 1),
    gravity=(0, 0, -9.81),
)


def sent(request: Request) -> Any:
    return json.loads(request.to_json())


@pytest.mark.parametrize(
    ("request_", "theirs"),
    [
        (SCENE, their_scene.NamedScene),
        (ours.Scene(moveit="name: x"), their_scene.Scene),
        (ours.RobotUpload.from_dh("arm", DH, tip_link="t"), their_robot.RobotBody),
        (
            ours.RobotUpload(
                name="arm",
                urdf="<robot/>",
                srdf="<robot/>",
                meshes={"a.stl": "AAAA"},
                joint_limits={"j": ours.JointLimits(velocity=2.0)},
            ),
            their_robot.RobotBody,
        ),
        (ours.FkRequest(joints=(0, 1)), their_kinematics.FkRequest),
        (
            ours.PotentialRequest(
                joints=[(0, 1), (2, 3)],
                goal_joints=(4, 5),
                scene="table",
                options=ours.PotentialOptions(
                    attractive_weights=(1.0, 2.0),
                    attractive_cap=0.1,
                    repulsive_weights=0.0,
                    influence_distance=0.3,
                    least_distance=0.01,
                ),
            ),
            their_potential.PotentialRequest,
        ),
        (ours.FkRequest(joints=[(0, 1), (2, 3)]), their_kinematics.FkRequest),
        (
            ours.IkRequest(
                pose=ours.Pose.at(1, 2, 3),
                scene=SCENE,
                constraints=({"type": "clearance", "margin": 0.1},),
            ),
            their_kinematics.IkRequest,
        ),
        (
            ours.CheckRequest(robot="panda", joints=(0, 1), scene="table", attached=(PART,)),
            their_check.CheckRequest,
        ),
        (
            ours.PlanRequest(
                robot="panda",
                start=ours.Start(joints=(0.0, 1.0)),
                goal=ours.Goal.among([(0.0, 1.0), ours.Pose.at(1, 2, 3)]),
                scene=SCENE,
                planner_options={"goal_bias": 0.1, "deep": {"er": (1, 2)}},
                attached=[PART],
                margin=0.01,
                timing=ours.Timing(velocity_scaling=0.5, sample_period=0.01),
                timeout=5,
            ),
            their_plan.PlanRequest,
        ),
        (
            ours.PlanRequest(
                robot="panda",
                start=ours.Start(joints=(0, 1), velocities=(0.1, 0), accelerations=(0, 0)),
                goal=ours.Goal.at_joints((1, 1), velocities=(0, 0.1), accelerations=(0, 0)),
                refine=ours.Refine(objective={"time": 1, "jerk": 1e-6}, degree=5, rounds=20),
            ),
            their_plan.PlanRequest,
        ),
        (
            ours.ValidateRequest(
                robot="panda",
                trajectory=ours.Trajectory(
                    segments=[ours.Segment(t0=0, t1=1, coefficients=((0, 1),))]
                ),
                limits=ours.LimitValues(velocity=(1,)),
                collisions="ignore",
                tool_motions=ours.TimedToolMotions(
                    motions=[ours.TimedToolMotion.lin(ours.Pose(position=(0, 0, 1)))], ends=(1,)
                ),
                payload=ours.Payload(mass=1),
                tool_speed=0.5,
            ),
            their_plan.ValidateRequest,
        ),
    ],
    ids=lambda value: type(value).__name__ if isinstance(value, Request) else "",
)
def test_the_service_takes_what_is_sent(request_: Request, theirs: type[BaseModel]) -> None:
    theirs.model_validate_json(request_.to_json())


SHAPES = [
    BOX,
    ours.Sphere(radius=1),
    ours.Cylinder(radius=1, height=2),
    ours.Capsule(radius=1, height=2),
    ours.Cone(radius=1, height=2),
    ours.Halfspace(normal=(0, 0, 1), offset=0),
    ours.Convex.of(vertices=np.eye(4, 3)),
    ours.Mesh.of(vertices=np.eye(3), faces=np.array([[0, 1, 2]])),
    ours.Mesh(stl_base64="AAAA"),
    ours.PointCloud.of(points=np.zeros((2, 3)), radius=0.01),
]


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: shape.type)
def test_the_service_takes_every_shape(shape: Any) -> None:
    scene = ours.Scene(obstacles=[ours.Obstacle(id="it", shape=shape, pose=ours.Pose.at(0, 0, 0))])
    taken = their_scene.Scene.model_validate_json(scene.to_json())
    assert taken.obstacles is not None
    assert taken.obstacles[0].shape.type == shape.type


@pytest.mark.parametrize(
    "make",
    [
        lambda: ours.Pose(position=[1.0, 2.0]),
        lambda: ours.Pose(position=[1.0, 2.0, math.nan]),
        lambda: ours.Pose(position=[1.0, 2.0, math.inf]),
        lambda: ours.Pose(position=[1.0, 2.0, "3"]),  # type: ignore[list-item]
        lambda: ours.Pose.of(position=[0, 0, 0], orientation=[0, 0, 0, 1]),
        lambda: ours.Pose(position=[0, 0, 0], rpy=[0, 0, 0], euler_zyz=[0, 0, 0]),
        lambda: ours.Sphere(radius=0.0),
        lambda: ours.Sphere(radius=math.inf),
        ours.Scene,
        lambda: ours.Scene(obstacles=[], moveit="name: x"),
        lambda: ours.RobotUpload(name="a"),
        lambda: ours.RobotUpload(name="a", urdf="<robot/>", dh=DH),
        ours.Goal,
        lambda: ours.Goal(joints=[1.0], pose=ours.Pose.at(0, 0, 0)),
        ours.Trajectory,
        lambda: ours.FkRequest(joints=[]),
        lambda: ours.FkRequest(joints=[[0.0], [math.nan]]),
        lambda: ours.PlanRequest.of(
            robot="r", start=ours.Start(joints=[0]), goal=ours.Goal(joints=[1]), sed=1
        ),
        lambda: ours.PlanRequest(
            robot="r",
            start=ours.Start(joints=[0]),
            goal=ours.Goal(joints=[1]),
            planner_options={"weight": math.nan},
        ),
        lambda: ours.VelocityRequest(joints=[0.0]),
    ],
)
def test_what_is_wrong_is_refused_here(make: Callable[[], Request]) -> None:
    with pytest.raises(ValidationError):
        make()


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
