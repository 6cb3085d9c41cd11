"""Fields of requests that go together, or exclude each other."""

import math
from typing import Any

import pytest
from pydantic import BaseModel, TypeAdapter, ValidationError

from armwright_wire.goals.goal import OrientationConstraint
from armwright_wire.goals.tool_motion import TimedToolMotions, cartesian_options
from armwright_wire.motions.retime import ConvertRequest, RetimeRequest
from armwright_wire.motions.simulation import SimulateRequest
from armwright_wire.motions.trajectory import Segment, TrajectoryBody
from armwright_wire.plans.batch import BatchRequest, PlanRequests
from armwright_wire.plans.plan import PlanRequest
from armwright_wire.pose import FramedPose, Pose
from armwright_wire.robots.kinematics import FkRequest
from armwright_wire.robots.robot import RobotBody
from armwright_wire.scenes.check import Attached, CheckRequest
from armwright_wire.scenes.scene import Mesh, NamedScene, Scene, Shape
from service.translate import poses
from tests.service.schemas.bodies import (
    ATTACHED,
    BRIEF,
    CONSTRAINTS,
    CORNERS,
    DH_ROW,
    IDENTITY,
    MOTIONS,
    ORIENTATIONS,
    POSE,
    SAMPLES,
    SEGMENTS,
)
from tests.service.schemas.changes import without

LINE, ARC, CIRCLE = MOTIONS
PART = ATTACHED[0]
UNWEIGHED = without(PART, ("mass",))
CONE = CONSTRAINTS[5]
NEAR = CONSTRAINTS[6]
FACES = {"type": "mesh", "vertices": CORNERS[:3], "faces": [[0, 1, 2]]}
STL = {"type": "mesh", "stl_base64": "AAAA"}
J, TWIST, RATES = {"joints": [0.0]}, {"twist": [0.0] * 6}, {"joint_velocities": [0.1]}
SEGMENT = {"t0": 1.0, "t1": 1.0, "coefficients": [[0.0]]}
BOX = {"id": "b", "shape": {"type": "box", "size": [1, 1, 1]}, "pose": {"position": [0, 0, 0]}}
CHECK = {"robot": "r", "joints": [0.0]}
TABLE = {"convention": "standard", "rows": [DH_ROW]}
URDF = {"name": "r", "urdf": "<robot/>"}
TRANSFORM = [[1, 0, 0, 0.3], [0, -1, 0, 0.2], [0, 0, -1, 0.4], [0, 0, 0, 1]]
SEAM = {"motions": [LINE | {"part": "seam"}]}
FREE, SLOW = {"tolerance": {"free": ["rz"]}}, {"tool_speed": 0.1}
CIRC = "belong to motions of type circ"
ONE_POSE = "exactly one of pose, poses"
WHOLE = "give axis, direction and cone_angle"


def goal(**fields: Any) -> dict[str, Any]:
    return BRIEF | {"goal": fields}


def limited(lower: float | None, upper: float | None) -> dict[str, Any]:
    row = DH_ROW | {"lower": lower, "upper": upper}
    return {"name": "r", "dh": {"convention": "modified", "rows": [row]}}


Rule = tuple[Any, list[Any], list[tuple[Any, str]]]
#: By rule: the model, bodies that follow it, and those that do not, with words of the refusal.
RULES: dict[str, Rule] = {
    "a pose has one orientation at most": (
        Pose,
        [POSE | one for one in ORIENTATIONS],
        [(POSE | one | other, "at most one orientation")
         for one in ORIENTATIONS for other in ORIENTATIONS if one != other],
    ),
    "a pose is finite numbers": (Pose, [POSE], [
        ({"position": [0, 0]}, "at least 3"),
        ({"position": [0, 0, True]}, "valid number"),
        ({"position": [0, 0, "0"]}, "valid number"),
        ({"position": [0, 0, math.nan]}, "finite number"),
        ({"position": [0, 0, 1e7]}, "less than or equal"),
        (POSE | {"yaw": 1}, "Extra"),
    ]),
    "an orientation is a rotation": (Pose, [POSE | {"quaternion_xyzw": [0, 0, 0, 1.0009]}], [
        (POSE | {"quaternion_xyzw": [0, 0, 0, 1.0011]}, "norm"),
        (POSE | {"quaternion_xyzw": [0, 0, 0, 0]}, "norm"),
        (POSE | {"rotation_matrix": [[1, 0, 0], [0, 1, 0], [0, 0, -1]]}, "not a rotation"),
        (POSE | {"rotation_matrix": [[1, 0, 0], [0, 1, 1.2345e-5], [0, 0, 1]]}, "not a rotation"),
        (POSE | {"axis_angle": [0, 0, 0, 1]}, "no direction"),
        (POSE | {"axis_angle": [0, 0, 1]}, "at least 4"),
    ]),
    "a transform is a whole pose": (Pose, [{"transform": TRANSFORM}], [
        ({"transform": TRANSFORM, "rpy": [0, 0, 0]}, "leave all others out"),
        ({"transform": TRANSFORM, "position": [1, 0, 0]}, "leave all others out"),
        ({"transform": [*TRANSFORM[:3], [0, 0, 0, 2]]}, "last row"),
        ({"transform": [[2, 0, 0, 0], *TRANSFORM[1:]]}, "not a rotation.*three decimals"),
        ({}, "a position or a transform"),
        ({"rpy": [0, 0, 0]}, "a position or a transform"),
    ]),
    "joints are one vector or many": (
        FkRequest,
        [{"joints": [0, 1.5]}, {"joints": [[0, 1], [2, 3]]}],
        [({"joints": []}, "at least 1"), ({"joints": [[0], 1]}, "valid list"),
         ({"joints": [True]}, "valid number"), ({"joints": 1}, "valid list")],
    ),
    "a shape has its own measures": (TypeAdapter(Shape), [{"type": "sphere", "radius": 1}], [
        ({"type": "sphere", "radius": 0}, "greater than"),
        ({"type": "sphere", "radius": math.inf}, "finite"),
        ({"type": "sphere", "radius": 1, "height": 1}, "Extra"),
        ({"type": "halfspace", "normal": [0, 0, 0], "offset": 0}, "no direction"),
        ({"type": "convex", "vertices": [[0, 0, 0]] * 3}, "at least 4"),
        ({"type": "point_cloud", "points": [], "radius": 1}, "at least 1"),
        ({"type": "point_cloud", "points": [[0.0] * 3] * 100_001, "radius": 1}, "at most 100000"),
        ({"type": "teapot"}, "teapot"),
        ({"radius": 1}, "type"),
        ([], "valid dictionary"),
    ]),
    "a mesh is a file or faces": (Mesh, [FACES, STL], [
        ({"type": "mesh"}, "give vertices and faces"),
        (FACES | STL, "not both"),
        *((without(FACES, (name,)), "give vertices and faces") for name in ("vertices", "faces")),
        *((without(FACES, (name,)) | STL, "not both") for name in ("vertices", "faces")),
        (FACES | {"faces": [[0, 1, 2], [0, 1, 3]]}, "face 1 names vertex 3, but there are 3"),
        (FACES | {"faces": [[0, 1]]}, "at least 3"),
        (FACES | {"faces": [[0, 1, -1]]}, "greater than"),
        (FACES | {"faces": []}, "at least 1"),
        *(({"type": "mesh", "stl_base64": text}, "not valid base64")
          for text in ("A", "AA=A", "A A A", "ÄÄÄÄ", "***")),
    ]),
    "a scene is obstacles or a text": (Scene, [{"obstacles": [BOX]}], [
        ({"obstacles": [BOX, BOX]}, "is given twice"),
        ({"obstacles": [BOX | {"margin": -1}]}, "greater than"),
        ({"obstacles": [BOX | {"id": "a\n"}]}, "pattern"),
        ({"obstacles": [], "allowed_collisions": [["a"]]}, "at least 2"),
    ]),
    "a scene of a request is a name or a scene": (
        CheckRequest,
        [CHECK | {"scene": "stored"}, CHECK | {"scene": {"obstacles": [BOX]}}],
        [(CHECK | {"scene": 1}, "valid dictionary")],
    ),
    "an attached object has one place": (Attached, [PART], [
        *((PART | {"inertia": rows}, "items")
          for rows in (IDENTITY[:2], [*IDENTITY, [0.0, 0.0, 0.0]], [[1.0, 0.0]] * 3)),
    ]),
    "an orientation constraint is a cone or an orientation": (OrientationConstraint, [CONE, NEAR], [
        *((without(CONE, (name,)), WHOLE) for name in ("axis", "direction", "cone_angle")),
        *((NEAR | {name: CONE[name]}, WHOLE) for name in ("axis", "direction", "cone_angle")),
        *((without(NEAR, (name,)), "or quaternion_xyzw and axis_tolerances")
          for name in ("quaternion_xyzw", "axis_tolerances")),
        *((CONE | {name: NEAR[name]}, "or quaternion_xyzw")
          for name in ("quaternion_xyzw", "axis_tolerances")),
        ({"type": "orientation"}, "give axis"),
    ]),
    "timed tool motions have an end each": (
        TimedToolMotions,
        [{"motions": [LINE]}, {"motions": [LINE, ARC], "ends": [1.0, 1.0]}, SEAM | FREE,
         SEAM | SLOW],
        [({"motions": [LINE, ARC]}, "as many times as there are motions"),
         ({"motions": [LINE], "ends": [1.0, 2.0]}, "as many times"),
         ({"motions": [LINE, ARC], "ends": [2.0, 1.0]}, "must not descend"),
         ({"motions": [LINE | {"blend": 0.1}]}, "blend belongs to plans"),
         ({"motions": [LINE], "begins": 2.0, "ends": [1.0]},
          "begins is after the end of the first motion"),
         ({"motions": [LINE]} | FREE, "tolerance belongs to motions whose"),
         ({"motions": [LINE]} | SLOW, "tool_speed belongs to motions whose")],
    ),
    "a plan begins somewhere by a planner": (PlanRequest, [BRIEF], [
        (BRIEF | {"start": {}}, "exactly one of joints, state"),
        (BRIEF | {"start": {"joints": [0.0], "state": "home"}}, "exactly one of joints, state"),
        (BRIEF | {"timeout": True}, "valid number"),
        (BRIEF | {"planner": ""}, "pattern"),
        (BRIEF | {"planner_options": {"deep": [{"er": math.inf}]}}, "finite"),
        (BRIEF | {"timing": {"method": "magic"}}, "toppra"),
    ]),
    "large coefficients belong to short pieces": (
        Segment,
        [{"t0": 0.0, "t1": 1e-7, "coefficients": [[0.0] * 9 + [1.6e22]]}],
        [({"t0": 0.0, "t1": 0.1, "coefficients": [[0.0] * 9 + [1.6e22]]}, "of power 9 is beyond"),
         ({"t0": 0.0, "t1": 3.0, "coefficients": [[2e12]]}, "of power 0 is beyond"),
         ({"t0": 0.0, "t1": 1e-9, "coefficients": [[0.0] * 15 + [1e61]]}, "less than or")],
    ),
    "a segment takes time": (Segment, [SEGMENT | {"t1": 1.0 + 1e-12}], [
        (SEGMENT, r"t1 \(1\) must be after t0 \(1\)"),
        (SEGMENT | {"t1": 0.5}, "must be after"),
    ]),
    "samples have a row for each time": (TrajectoryBody, [SAMPLES], [
        (SAMPLES | {"samples": SAMPLES["samples"] | {name: [[0.0, 0.0]] * count}},
         f"{name} has {count} rows for 2 times")
        for name in ("position", "velocity", "acceleration") for count in (1, 3)
    ]),
    "a motion is segments or samples that say how to read them": (
        TrajectoryBody,
        [SEGMENTS, SEGMENTS | {"samples": SAMPLES["samples"]}],
        [({}, "give segments"), ({"interpolation": "linear"}, "give segments, or samples"),
         (without(SAMPLES, ("interpolation",)), "samples need interpolation"),
         *((SAMPLES | {"interpolation": name}, "pattern")
           for name in ("Linear", "a-b", "", "a" * 33))],
    ),
    "a motion to be converted names its joints": (
        ConvertRequest,
        [{"trajectory": SEGMENTS, "sample_period": 0.01}],
        [({"trajectory": without(SEGMENTS, ("joint_names",)), "sample_period": 0.01},
          "are needed")],
    ),
    "a robot is a description or a table": (
        RobotBody,
        [{"name": "r", "dh": TABLE}, URDF | {"srdf": "<robot/>"}, URDF | {"meshes": {"a": "AAAA"}}],
        [({"name": "r"}, "exactly one"), (URDF | {"dh": TABLE}, "exactly one"),
         ({"name": "r", "dh": TABLE, "srdf": "<robot/>"}, "srdf needs urdf"),
         ({"name": "r", "dh": TABLE, "meshes": {"a": "AAAA"}}, "meshes needs urdf"),
         (URDF | {"meshes": {"b.stl": "?"}}, "mesh 'b.stl': not valid base64")],
    ),
    "limits of a joint leave room": (
        RobotBody,
        [limited(-1.0, 1.0), limited(None, -1.0), limited(1.0, None), limited(None, None)],
        [(limited(1.0, upper), "must be less than upper") for upper in (1.0, -1.0)],
    ),
    "a batch takes whatever a plan does": (
        BatchRequest,
        [{"problems": [BRIEF | {"constraints": CONSTRAINTS, "margin": 0.1}]},
         *({"problems": [BRIEF, without(BRIEF, (name,))], name: BRIEF[name]}
           for name in ("robot", "start", "goal"))],
        [({"problems": [BRIEF | {"margin": -0.1}]}, "greater than or equal"),
         ({"problems": [BRIEF | {"surprise": 1}]}, "Extra"),
         ({"problems": [BRIEF], "margin": -0.1}, "greater than or equal"),
         *(({"problems": [BRIEF, without(BRIEF, (name,))]}, rf"problems\[1\] has no {name}")
           for name in ("robot", "start", "goal"))],
    ),
}  # fmt: skip


def validate(model: Any, body: Any) -> None:
    if isinstance(model, TypeAdapter):
        model.validate_python(body)
    else:
        model.model_validate(body)


@pytest.mark.parametrize("name", RULES)
def test_what_follows_a_rule_is_taken_and_nothing_else(name: str) -> None:
    model, right, wrong = RULES[name]
    for body in right:
        validate(model, body)
    for body, words in wrong:
        with pytest.raises(ValidationError, match=words):
            validate(model, body)


@pytest.mark.parametrize("model", [NamedScene, RobotBody, PlanRequest, RetimeRequest])
def test_published_examples_are_valid(model: type[BaseModel]) -> None:
    examples = model.model_json_schema()["examples"]
    assert examples
    for example in examples:
        model.model_validate(example)


def test_a_transform_is_a_pose_and_the_only_one_that_needs_no_position() -> None:
    pose = FramedPose.model_validate({"transform": TRANSFORM})
    same = {"position": [0.3, 0.2, 0.4], "rotation_matrix": [[1, 0, 0], [0, -1, 0], [0, 0, -1]]}
    assert poses.transform(pose).tolist() == TRANSFORM
    assert pose.model_dump(exclude_none=True) == same
    assert FramedPose.model_validate(pose.model_dump()) == pose


def test_options_of_the_cartesian_planner_are_checked_where_they_are_given() -> None:
    assert cartesian_options(None) == cartesian_options({})
    assert cartesian_options({"max_deviation": 0.5}).max_deviation == 0.5
    for options, words in (
        ({"max_deviation": 0}, r"^planner_options\.max_deviation: .*greater"),
        ({"motions": [LINE, {"type": "lin"}]}, r"^planner_options\.motions\[1\]\.pose: .*required"),
        ({"motions": [LINE | {"via": [0.0] * 3}]},
         r"^planner_options\.motions\[0\]: via, center and normal belong"),
        ({"range": 0.5}, r"^planner_options\.range: "),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=words):
            cartesian_options(options)
        for planner in ("cartesian", "Cartesian"):
            body = BRIEF | {"planner": planner, "planner_options": options}
            with pytest.raises(ValidationError, match=words.removeprefix("^")):
                validate(PlanRequest, body)
        validate(PlanRequest, BRIEF | {"planner": "rrt_connect", "planner_options": options})


def test_gains_may_be_written_in_small_letters() -> None:
    for kind, names in (
        ("pd_gravity", ("Kp", "Kd")),
        ("passivity", ("Lambda", "K")),
        ("adaptive", ("Lambda", "K", "Gamma")),
    ):
        large: dict[str, Any] = {"type": kind} | dict.fromkeys(names, 2.0)
        small: dict[str, Any] = {"type": kind} | dict.fromkeys((n.lower() for n in names), 2.0)
        run = {"robot": "r", "trajectory": SEGMENTS}
        made = [
            SimulateRequest.model_validate(run | {"controller": body}).controller
            for body in (large, small)
        ]
        assert made[0] == made[1]
        assert [getattr(made[0], name) for name in names] == [2.0] * len(names)


def test_a_problem_of_a_batch_takes_what_it_lacks_from_the_batch() -> None:
    goals = [{"joints": [1.0]}, {"joints": [2.0]}]
    common = {"robot": "a", "start": {"joints": [0.0]}, "seed": 3, "margin": 0.1, "timeout": 4.0}
    batch = BatchRequest.model_validate(
        common
        | {
            "problems": [
                {"goal": goals[0]},
                {"goal": goals[1], "seed": 5, "robot": "b", "margin": 0.0},
            ]
        }
    )
    first, second = batch.plan_request(0), batch.plan_request(1, timeout=1.0)
    assert first == PlanRequest.model_validate(common | {"goal": goals[0]})
    expected = common | {"goal": goals[1], "seed": 5, "robot": "b", "margin": 0.0, "timeout": 1.0}
    assert second == PlanRequest.model_validate(expected)


def test_problems_that_differ_by_their_ends_are_the_same_as_validated_ones() -> None:
    pose = {"position": [0.4, 0.0, 0.5], "rpy": [0.0, 3.0, 0.0]}
    waypoints = {"waypoints": [{"pose": pose}, {"pose": pose}]}
    starts, goals = [{"joints": [0.0]}, {"state": "home"}], [{"joints": [1.0]}, {"pose": pose}]
    problems: list[dict[str, Any]] = [
        {"start": start, "goal": goal} for start in starts for goal in goals
    ]
    problems += [{"goal": goals[0]}, {"goal": goals[1]}, {"start": starts[1]}, {}]
    problems += [problems[0] | {"seed": 5}, {"seed": None, "margin": 0.2}, {"goal": None}]
    common = {"robot": "a", "start": starts[0], "clearance": {"preferred": 0.1}, "margin": 0.05}
    seam = {"planner": "cartesian", "planner_options": waypoints}
    for more in ({"goal": goals[1]}, {"goal": goals[1]} | seam):
        batch = BatchRequest.model_validate(common | more | {"problems": problems})
        requests = PlanRequests(batch)
        for index in [*range(len(problems)), *range(len(problems))]:
            expected = batch.plan_request(index)
            assert requests[index] == expected
            assert requests[index].model_dump_json() == expected.model_dump_json()


def test_a_scene_that_is_stored_is_read_as_it_was_sent() -> None:
    cloud = {"type": "point_cloud", "points": [[0.5, 0.0, 0.2]], "radius": 0.01}
    cloud["except"] = [{"object": "part", "margin": 0.01}]
    pose = {"position": [0.0, 0.0, 0.0]}
    sent = {"name": "s", "obstacles": [{"id": "c", "shape": cloud, "pose": pose}]}
    stored = NamedScene.model_validate(sent).model_dump_json(exclude_none=True)
    assert NamedScene.model_validate_json(stored) == NamedScene.model_validate(sent)
    assert '"except"' in stored
