import math
from typing import Any

import numpy as np
import pytest
from pydantic import BaseModel, TypeAdapter, ValidationError

from armwright_wire.base import Joints
from armwright_wire.goals.goal import Goal
from armwright_wire.motions.retime import RetimeRequest
from armwright_wire.motions.trajectory import TrajectoryBody
from armwright_wire.plans.plan import PlanRequest
from armwright_wire.pose import FramedPose, Pose
from armwright_wire.robots.kinematics import FkRequest, IkRequest
from armwright_wire.robots.robot import RobotBody
from armwright_wire.scenes.check import CheckRequest
from armwright_wire.scenes.scene import NamedScene, Scene, Shape
from service.problem import ProblemError
from service.translate import poses
from service.validation import field_path, validate_as

_HALF = math.sqrt(0.5)
TRANSFORM = [[1, 0, 0, 0.3], [0, -1, 0, 0.2], [0, 0, -1, 0.4], [0, 0, 0, 1]]
SHAPE: TypeAdapter[Shape] = TypeAdapter(Shape)


def refused(model: type[BaseModel] | TypeAdapter[Any], value: Any, words: str) -> None:
    check = model.validate_python if isinstance(model, TypeAdapter) else model.model_validate
    with pytest.raises(ValidationError, match=words):
        check(value)


@pytest.mark.parametrize("model", [NamedScene, RobotBody, PlanRequest, RetimeRequest])
def test_published_examples_are_valid(model: type[BaseModel]) -> None:
    examples = model.model_json_schema()["examples"]
    assert examples
    for example in examples:
        model.model_validate(example)


@pytest.mark.parametrize(
    ("pose", "rotation"),
    [
        ({}, np.eye(3)),
        ({"quaternion_xyzw": [0, 0, _HALF, _HALF]}, [[0, -1, 0], [1, 0, 0], [0, 0, 1]]),
        ({"quaternion_xyzw": [0, 0, 0, 1.0009]}, np.eye(3)),
        ({"rotation_matrix": [[0, 0, 1], [1, 0, 0], [0, 1, 0]]}, [[0, 0, 1], [1, 0, 0], [0, 1, 0]]),
        ({"rpy": [math.pi / 2, 0, 0]}, [[1, 0, 0], [0, 0, -1], [0, 1, 0]]),
        ({"axis_angle": [3, 0, 0, math.pi / 2]}, [[1, 0, 0], [0, 0, -1], [0, 1, 0]]),
        ({"axis_angle": [0, 1, 0, 0]}, np.eye(3)),
        ({"euler_zyz": [math.pi / 2, math.pi / 2, 0]}, [[0, -1, 0], [0, 0, 1], [-1, 0, 0]]),
    ],
)  # fmt: skip
def test_every_form_of_a_pose(pose: dict[str, Any], rotation: Any) -> None:
    T = poses.transform(Pose.model_validate({"position": [1, 2, 3]} | pose))
    np.testing.assert_allclose(T[:3, :3], rotation, atol=1e-12)
    assert T[:, 3].tolist() == [1, 2, 3, 1]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"position": [0, 0]}, "at least 3"),
        ({"position": [0, 0, True]}, "valid number"),
        ({"position": [0, 0, "0"]}, "valid number"),
        ({"position": [0, 0, math.nan]}, "finite number"),
        ({"position": [0, 0, math.inf]}, "finite number"),
        ({"position": [0, 0, 1e7]}, "less than or equal"),
        ({"quaternion_xyzw": [0, 0, 0, 1.0011]}, "norm"),
        ({"quaternion_xyzw": [0, 0, 0, 0]}, "norm"),
        ({"rotation_matrix": [[1, 0, 0], [0, 1, 0], [0, 0, -1]]}, "not a rotation"),
        ({"rotation_matrix": [[1, 0, 0], [0, 1, 1.2345e-5], [0, 0, 1]]}, "not a rotation"),
        ({"rpy": [0, 0, 0], "euler_zyz": [0, 0, 0]}, "at most one"),
        ({"axis_angle": [0, 0, 0, 1]}, "no direction"),
        ({"axis_angle": [0, 0, 1]}, "at least 4"),
        ({"yaw": 1}, "Extra"),
        ({"transform": TRANSFORM, "rpy": [0, 0, 0]}, "leave all others out"),
        ({"transform": TRANSFORM, "position": [1, 0, 0]}, "leave all others out"),
        ({"transform": [*TRANSFORM[:3], [0, 0, 0, 2]]}, "last row"),
        ({"transform": [[2, 0, 0, 0], *TRANSFORM[1:]]}, "not a rotation.*three decimals"),
    ],
)
def test_poses_that_are_none(change: dict[str, Any], words: str) -> None:
    refused(Pose, {"position": [0, 0, 0]} | change, words)


def test_a_transform_is_a_pose_and_the_only_one_that_needs_no_position() -> None:
    pose = FramedPose.model_validate({"transform": TRANSFORM})
    same = {"position": [0.3, 0.2, 0.4], "rotation_matrix": [[1, 0, 0], [0, -1, 0], [0, 0, -1]]}
    assert poses.transform(pose).tolist() == TRANSFORM
    assert pose.model_dump(exclude_none=True) == same
    assert FramedPose.model_validate(pose.model_dump()) == pose
    refused(Pose, {}, "a position or a transform")
    refused(Pose, {"rpy": [0, 0, 0]}, "a position or a transform")


def test_joints_are_one_vector_or_many() -> None:
    joints: TypeAdapter[Any] = TypeAdapter(Joints)
    assert joints.validate_python([0, 1.5]) == [0.0, 1.5]
    assert joints.validate_python([[0, 1], [2, 3]]) == [[0.0, 1.0], [2.0, 3.0]]
    refused(FkRequest, {"joints": []}, "at least 1")
    refused(FkRequest, {"joints": [[0], 1]}, "valid list")
    refused(FkRequest, {"joints": [True]}, "valid number")
    refused(FkRequest, {"joints": [[0.0]] * 10_001}, "at most 10000")
    refused(FkRequest, {"joints": 1}, "valid list")


@pytest.mark.parametrize(
    "shape",
    [
        {"type": "box", "size": [1, 2, 3]},
        {"type": "sphere", "radius": 1},
        {"type": "cylinder", "radius": 1, "height": 2},
        {"type": "capsule", "radius": 1, "height": 2},
        {"type": "cone", "radius": 1, "height": 2},
        {"type": "halfspace", "normal": [0, 0, 2], "offset": -1},
        {"type": "convex", "vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]},
        {"type": "mesh", "vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]],
         "faces": [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]},
        {"type": "point_cloud", "points": [[0, 0, 0]], "radius": 0.1},
    ],
)  # fmt: skip
def test_every_shape_reaches_the_domain(shape: dict[str, Any]) -> None:
    made = poses.shape(SHAPE.validate_python(shape))
    assert made.pieces()
    assert type(made).__name__.lower() == shape["type"].replace("_", "")


@pytest.mark.parametrize(
    ("shape", "words"),
    [
        ({"type": "sphere", "radius": 0}, "greater than"),
        ({"type": "sphere", "radius": -1}, "greater than"),
        ({"type": "sphere", "radius": math.inf}, "finite"),
        ({"type": "sphere", "radius": 1, "height": 1}, "Extra"),
        ({"type": "halfspace", "normal": [0, 0, 0], "offset": 0}, "no direction"),
        ({"type": "convex", "vertices": [[0, 0, 0]] * 3}, "at least 4"),
        ({"type": "mesh"}, "give vertices and faces"),
        ({"type": "mesh", "stl_base64": "***"}, "base64"),
        ({"type": "mesh", "vertices": [[0, 0, 0]] * 3, "faces": [[0, 1, 3]]}, "names vertex 3"),
        ({"type": "mesh", "vertices": [[0, 0, 0]] * 3, "faces": [[0, 1, -1]]}, "greater than"),
        ({"type": "mesh", "vertices": [[0, 0, 0]] * 3, "faces": []}, "at least 1"),
        ({"type": "point_cloud", "points": [], "radius": 1}, "at least 1"),
        ({"type": "point_cloud", "points": [[0.0] * 3] * 100_001, "radius": 1}, "at most 100000"),
        ({"type": "teapot"}, "teapot"),
        ({"radius": 1}, "type"),
        ([], "valid dictionary"),
    ],
)
def test_shapes_that_are_none(shape: Any, words: str) -> None:
    refused(SHAPE, shape, words)


def test_scenes() -> None:
    box = {"id": "b", "shape": {"type": "box", "size": [1, 1, 1]}, "pose": {"position": [0, 0, 0]}}
    scene = poses.scene(Scene.model_validate({"obstacles": [box | {"margin": 0.1}]}))
    assert scene.obstacle("b").margin == 0.1
    refused(Scene, {"obstacles": [box, box]}, "is given twice")
    refused(Scene, {"obstacles": [], "moveit": "x"}, "exactly one")
    refused(Scene, {"obstacles": [box | {"margin": -1}]}, "greater than")
    refused(Scene, {"obstacles": [box | {"id": "a\n"}]}, "pattern")
    refused(NamedScene, {"name": "a/b", "obstacles": []}, "pattern")
    refused(Scene, {"obstacles": [], "allowed_collisions": [["a"]]}, "at least 2")
    request = {"robot": "r", "joints": [0.0]}
    assert CheckRequest.model_validate(request | {"scene": "stored"}).scene == "stored"
    inline = CheckRequest.model_validate(request | {"scene": {"obstacles": [box]}}).scene
    assert isinstance(inline, Scene)
    refused(CheckRequest, request | {"scene": 1}, "valid dictionary")


def test_goals_are_exactly_one_thing() -> None:
    pose = {"position": [0, 0, 0]}
    for goal in ({"joints": [0]}, {"pose": pose, "position_tolerance": 1e-3},
                 {"any_of": [{"joints": [0]}, {"pose": pose}]}):  # fmt: skip
        Goal.model_validate(goal)
    refused(Goal, {}, "exactly one")
    refused(Goal, {"joints": [0], "pose": pose}, "exactly one")
    refused(Goal, {"any_of": []}, "at least 1")
    refused(Goal, {"any_of": [{"any_of": [{"joints": [0]}]}]}, "Extra")
    refused(Goal, {"joints": [0], "position_tolerance": 0.1}, "belongs to pose")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"timeout": 0}, "greater than 0"),
        ({"timeout": True}, "valid number"),
        ({"seed": -1}, "greater than"),
        ({"seed": 1.0}, "valid integer"),
        ({"seed": 2**32}, "less than"),
        ({"margin": -0.1}, "greater than"),
        ({"planner": ""}, "pattern"),
        ({"planner_options": {"range": math.nan}}, "finite"),
        ({"planner_options": {"deep": [{"er": math.inf}]}}, "finite"),
        ({"timing": {"velocity_scaling": 0}}, "greater than 0"),
        ({"timing": {"velocity_scaling": 1.1}}, "less than"),
        ({"timing": {"method": "magic"}}, "toppra"),
        ({"start": {}}, "exactly one of joints, state"),
    ],
)
def test_plans_that_cannot_be_asked(change: dict[str, Any], words: str) -> None:
    request = {"robot": "r", "start": {"joints": [0]}, "goal": {"joints": [1]}}
    PlanRequest.model_validate(request)
    refused(PlanRequest, request | change, words)


def test_trajectories() -> None:
    segment = {"t0": 0, "t1": 1, "coefficients": [[0, 1]]}
    TrajectoryBody.model_validate({"segments": [segment]})
    samples = {"time": [0, 1], "position": [[0], [1]]}
    TrajectoryBody.model_validate({"samples": samples, "interpolation": "linear"})
    refused(TrajectoryBody, {"samples": samples}, "interpolation")
    refused(TrajectoryBody, {}, "give segments")
    refused(TrajectoryBody, {"segments": [segment | {"t1": 0}]}, "must be after")
    short = {"time": [0, 1], "position": [[0]]}
    refused(TrajectoryBody, {"samples": short, "interpolation": "linear"}, "1 rows for 2 times")


def test_robots() -> None:
    row = {"type": "revolute", "a": 0, "alpha": 0, "d": 0, "theta": 0, "lower": -1, "upper": 1}
    dh = {"convention": "modified", "rows": [row]}
    RobotBody.model_validate({"name": "r", "dh": dh})
    RobotBody.model_validate({"name": "r", "urdf": "<robot/>", "meshes": {"a.stl": "AAAA"}})
    refused(RobotBody, {"name": "r"}, "exactly one")
    refused(RobotBody, {"name": "r", "dh": dh, "urdf": "<robot/>"}, "exactly one")
    refused(RobotBody, {"name": "r", "dh": dh, "srdf": "<robot/>"}, "belongs to a URDF")
    refused(RobotBody, {"name": "r", "urdf": "x", "meshes": {"a": "*"}}, "base64")
    crossed = {"convention": "standard", "rows": [row | {"lower": 2}]}
    refused(RobotBody, {"name": "r", "dh": crossed}, "less than upper")


def test_a_path_leaves_out_the_tags_of_unions() -> None:
    body = {"joints": [[0], ["x"]], "shape": {"type": "box", "size": [1]}}
    assert field_path(("body", "joints", "many", 1, 0), body) == "joints[1][0]"
    assert field_path(("body", "shape", "box", "size"), body) == "shape.size"
    assert field_path(("body", "shape", "box", "other"), body, missing=True) == "shape.other"
    assert field_path(("body", "missing"), body, missing=True) == "missing"
    assert field_path(("body",), body) == "body"
    assert field_path(("query", "limit"), None) == "query.limit"
    with pytest.raises(ProblemError) as error:
        validate_as(IkRequest, {"pose": {"position": [0, 0, "x"]}})
    assert error.value.details["errors"][0]["path"] == "pose.position[2]"
