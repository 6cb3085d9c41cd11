"""Fields of requests that go together, or exclude each other."""

from typing import Any

import pytest
from pydantic import BaseModel, ValidationError

from armwright_wire.goals.constraint import OrientationConstraint
from armwright_wire.goals.tool_motion import TimedToolMotions, ToolMotion, cartesian_options
from armwright_wire.motions.retime import ConvertRequest
from armwright_wire.motions.simulation import SimulateRequest
from armwright_wire.motions.trajectory import Segment, TrajectoryBody
from armwright_wire.plans.batch import BatchRequest, PlanRequests
from armwright_wire.plans.plan import PlanRequest
from armwright_wire.pose import Pose
from armwright_wire.robots.kinematics import IkRequest, VelocityRequest
from armwright_wire.robots.robot import RobotBody
from armwright_wire.scenes.check import Attached
from armwright_wire.scenes.scene import Mesh
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
CONE = CONSTRAINTS[5]
NEAR = CONSTRAINTS[6]
FACES = [[0, 1, 2]]


def reject(model: type[BaseModel], body: Any, words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        model.model_validate(body)


def accept(model: type[BaseModel], body: Any) -> None:
    model.model_validate(body)


@pytest.mark.parametrize("first", range(5))
@pytest.mark.parametrize("second", range(5))
def test_a_pose_has_one_orientation_at_most(first: int, second: int) -> None:
    body = POSE | ORIENTATIONS[first] | ORIENTATIONS[second]
    if first == second:
        accept(Pose, body)
    else:
        reject(Pose, body, "at most one orientation")


def test_an_attached_object_has_one_place() -> None:
    accept(Attached, PART)
    reject(Attached, PART | {"grasp_joints": [0.0]}, "exactly one of pose, grasp_joints")
    reject(Attached, without(PART, ("pose",)), "exactly one of pose, grasp_joints")


@pytest.mark.parametrize("name", ["center_of_mass", "inertia"])
def test_mass_properties_of_an_attached_object_go_with_its_mass(name: str) -> None:
    other = "inertia" if name == "center_of_mass" else "center_of_mass"
    body = without(without(PART, ("mass",)), (other,))
    reject(Attached, body, "to mass")
    accept(Attached, body | {"mass": 0.5})
    accept(Attached, without(body, (name,)))


def test_a_mesh_is_a_file_or_faces() -> None:
    faces = {"type": "mesh", "vertices": CORNERS[:3], "faces": FACES}
    accept(Mesh, faces)
    accept(Mesh, {"type": "mesh", "stl_base64": "AAAA"})
    reject(Mesh, faces | {"stl_base64": "AAAA"}, "not both")
    for name in ("vertices", "faces"):
        reject(Mesh, without(faces, (name,)), "give vertices and faces")
        reject(Mesh, without(faces, (name,)) | {"stl_base64": "AAAA"}, "not both")
    reject(
        Mesh, faces | {"faces": [[0, 1, 2], [0, 1, 3]]}, "face 1 names vertex 3, but there are 3"
    )
    reject(Mesh, faces | {"faces": [[0, 1]]}, "at least 3")
    for text in ("A", "AA=A", "A A A", "ÄÄÄÄ"):
        reject(Mesh, {"type": "mesh", "stl_base64": text}, "not valid base64")


@pytest.mark.parametrize("name", ["axis", "direction", "cone_angle"])
def test_an_orientation_constraint_is_a_whole_cone(name: str) -> None:
    accept(OrientationConstraint, CONE)
    reject(OrientationConstraint, without(CONE, (name,)), "give axis, direction and cone_angle")
    reject(OrientationConstraint, NEAR | {name: CONE[name]}, "give axis, direction and cone_angle")


@pytest.mark.parametrize("name", ["quaternion_xyzw", "axis_tolerances"])
def test_an_orientation_constraint_is_a_whole_orientation(name: str) -> None:
    accept(OrientationConstraint, NEAR)
    reject(OrientationConstraint, without(NEAR, (name,)), "or quaternion_xyzw and axis_tolerances")
    reject(OrientationConstraint, CONE | {name: NEAR[name]}, "or quaternion_xyzw")
    reject(OrientationConstraint, {"type": "orientation"}, "give axis")


def test_a_line_of_the_tool_has_no_circle() -> None:
    accept(ToolMotion, LINE)
    for extra in ({"via": [0.0] * 3}, {"center": [0.0] * 3}, {"normal": [0.0, 0.0, 1.0]}):
        reject(ToolMotion, LINE | extra, "belong to motions of type circ")


def test_an_arc_of_the_tool_has_a_point_or_a_center() -> None:
    accept(ToolMotion, ARC)
    accept(ToolMotion, CIRCLE)
    accept(ToolMotion, without(CIRCLE, ("normal",)))
    reject(ToolMotion, LINE | {"type": "circ"}, "exactly one of via, center")
    reject(ToolMotion, ARC | {"center": [0.0] * 3}, "exactly one of via, center")
    reject(ToolMotion, ARC | {"normal": [0.0, 0.0, 1.0]}, "normal needs center")


def test_timed_tool_motions_have_an_end_each() -> None:
    accept(TimedToolMotions, {"motions": [LINE]})
    accept(TimedToolMotions, {"motions": [LINE, ARC], "ends": [1.0, 1.0]})
    reject(TimedToolMotions, {"motions": [LINE, ARC]}, "as many times as there are motions")
    reject(TimedToolMotions, {"motions": [LINE], "ends": [1.0, 2.0]}, "as many times")
    reject(TimedToolMotions, {"motions": [LINE, ARC], "ends": [2.0, 1.0]}, "must not descend")
    reject(TimedToolMotions, {"motions": [LINE | {"blend": 0.1}]}, "blend belongs to plans")
    late = {"motions": [LINE], "begins": 2.0, "ends": [1.0]}
    reject(TimedToolMotions, late, "begins is after the end of the first motion")


def test_tolerance_and_speed_of_timed_motions_belong_to_seams() -> None:
    seam = LINE | {"part": "seam"}
    for more in ({"tolerance": {"free": ["rz"]}}, {"tool_speed": 0.1}):
        accept(TimedToolMotions, {"motions": [seam], **more})
        (name,) = more
        reject(TimedToolMotions, {"motions": [LINE], **more}, f"{name} belongs to motions whose")


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
            reject(PlanRequest, body, words.removeprefix("^"))
        accept(PlanRequest, BRIEF | {"planner": "rrt_connect", "planner_options": options})


def test_velocity_kinematics_answers_one_question() -> None:
    joints, twist = {"joints": [0.0]}, {"twist": [0.0] * 6}
    rates = {"joint_velocities": [0.1]}
    accept(VelocityRequest, joints | rates)
    accept(VelocityRequest, joints | twist | {"nullspace": [0.0], "damped_below": 0.1})
    reject(VelocityRequest, joints, "exactly one")
    reject(VelocityRequest, joints | twist | rates, "exactly one")
    for extra in ({"nullspace": [0.0]}, {"damped_below": 0.1}):
        reject(VelocityRequest, joints | rates | extra, "belongs to twist")


def test_inverse_kinematics_needs_a_pose_or_constraints() -> None:
    accept(IkRequest, {"pose": POSE})
    accept(IkRequest, {"poses": [POSE]})
    accept(IkRequest, {"constraints": CONSTRAINTS})
    accept(IkRequest, {"constraints": CONSTRAINTS, "pose": POSE})
    wrong: list[dict[str, Any]] = [
        {}, {"constraints": []}, {"pose": POSE, "poses": [POSE]},
        {"constraints": CONSTRAINTS, "pose": POSE, "poses": [POSE]},
    ]  # fmt: skip
    for body in wrong:
        reject(IkRequest, body, "exactly one of pose, poses")


def test_rates_belong_to_joints_and_tolerances_to_poses() -> None:
    for name in ("velocities", "accelerations"):
        accept(PlanRequest, BRIEF | {"goal": {"joints": [0.0], name: [0.0]}})
        reject(
            PlanRequest, BRIEF | {"goal": {"pose": POSE, name: [0.0]}}, "belongs to joints or state"
        )
    for name in ("position_tolerance", "orientation_tolerance"):
        accept(PlanRequest, BRIEF | {"goal": {"pose": POSE, name: 0.1}})
        reject(PlanRequest, BRIEF | {"goal": {"joints": [0.0], name: 0.1}}, "belongs to pose")
        among = {"any_of": [{"pose": POSE}], name: 0.1}
        reject(PlanRequest, BRIEF | {"goal": among}, "belongs to pose")


def test_a_segment_takes_time() -> None:
    segment = {"t0": 1.0, "t1": 1.0, "coefficients": [[0.0]]}
    reject(Segment, segment, r"t1 \(1\) must be after t0 \(1\)")
    reject(Segment, segment | {"t1": 0.5}, "must be after")
    accept(Segment, segment | {"t1": 1.0 + 1e-12})


@pytest.mark.parametrize("name", ["position", "velocity", "acceleration"])
@pytest.mark.parametrize("count", [1, 3])
def test_samples_have_a_row_for_each_time(name: str, count: int) -> None:
    samples: dict[str, Any] = SAMPLES["samples"]
    rows = samples | {name: [[0.0, 0.0]] * count}
    body = SAMPLES | {"samples": rows}
    reject(TrajectoryBody, body, f"{name} has {count} rows for 2 times")


def test_a_motion_is_segments_or_samples_that_say_how_to_read_them() -> None:
    accept(TrajectoryBody, SEGMENTS)
    accept(TrajectoryBody, SEGMENTS | {"samples": SAMPLES["samples"]})
    reject(TrajectoryBody, without(SAMPLES, ("interpolation",)), "samples need interpolation")
    reject(TrajectoryBody, {"interpolation": "linear"}, "give segments, or samples")
    for name in ("Linear", "a-b", "", "a" * 33):
        reject(TrajectoryBody, SAMPLES | {"interpolation": name}, "pattern")


def test_a_motion_to_be_converted_names_its_joints() -> None:
    body = {"trajectory": SEGMENTS, "sample_period": 0.01}
    accept(ConvertRequest, body)
    reject(ConvertRequest, body | {"trajectory": without(SEGMENTS, ("joint_names",))}, "are needed")


def test_a_robot_is_a_description_or_a_table() -> None:
    table = {"convention": "standard", "rows": [DH_ROW]}
    accept(RobotBody, {"name": "r", "dh": table})
    for extra in ({"srdf": "<robot/>"}, {"meshes": {"a": "AAAA"}}):
        accept(RobotBody, {"name": "r", "urdf": "<robot/>"} | extra)
        reject(RobotBody, {"name": "r", "dh": table} | extra, "belongs to a URDF")
    reject(
        RobotBody, {"name": "r", "urdf": "x", "meshes": {"b.stl": "?"}}, "mesh 'b.stl': not valid"
    )


@pytest.mark.parametrize(
    ("limits", "fits"),
    [((-1.0, 1.0), True), ((1.0, 1.0), False), ((1.0, -1.0), False), ((None, -1.0), True),
     ((1.0, None), True), ((None, None), True)],
)  # fmt: skip
def test_limits_of_a_joint_leave_room(
    limits: tuple[float | None, float | None], fits: bool
) -> None:
    row = DH_ROW | dict(zip(("lower", "upper"), limits, strict=True))
    body = {"name": "r", "dh": {"convention": "modified", "rows": [row]}}
    if fits:
        accept(RobotBody, body)
    else:
        reject(RobotBody, body, "must be less than upper")


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


# ---------------------------------------------------------------------------------- batches


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


@pytest.mark.parametrize("name", ["robot", "start", "goal"])
def test_what_a_problem_of_a_batch_needs_stands_somewhere(name: str) -> None:
    whole, part = {"problems": [BRIEF, without(BRIEF, (name,))]}, {name: BRIEF[name]}
    reject(BatchRequest, whole, rf"problems\[1\] has no {name}")
    accept(BatchRequest, whole | part)


def test_a_batch_takes_whatever_a_plan_does_and_checks_it() -> None:
    accept(BatchRequest, {"problems": [BRIEF | {"constraints": CONSTRAINTS, "margin": 0.1}]})
    reject(BatchRequest, {"problems": [BRIEF | {"margin": -0.1}]}, "greater than or equal")
    reject(BatchRequest, {"problems": [BRIEF | {"surprise": 1}]}, "Extra")
    reject(BatchRequest, {"problems": [BRIEF], "margin": -0.1}, "greater than or equal")


def test_an_inertia_has_three_rows() -> None:
    for rows in (IDENTITY[:2], [*IDENTITY, [0.0, 0.0, 0.0]], [[1.0, 0.0]] * 3):
        reject(Attached, PART | {"inertia": rows}, "items")
