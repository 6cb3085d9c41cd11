"""Poses, scenes, trajectories and problems from the wire, against scipy and what was sent."""

import base64
import io
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given
from pydantic import TypeAdapter
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from armwright_wire.motions.trajectory import TrajectoryBody
from armwright_wire.plans.plan import PlanRequest
from armwright_wire.pose import Pose
from armwright_wire.scenes.scene import Scene, Shape
from kinematics.errors import InvalidOption, InvalidScene, InvalidTrajectory
from kinematics.robots import builtin_chain
from obstacles.scenes.scene import Scene as ObstacleScene
from obstacles.shapes import shape as shapes
from planning.problem import JointGoal, PoseGoal
from service.translate.poses import pose_answer, scene, shape, transform
from service.translate.problems import options, problem
from service.translate.trajectories import named_trajectory, trajectory, trajectory_answer
from tests.planning.scenes import builtin
from tests.properties import transforms

SHAPE: TypeAdapter[Any] = TypeAdapter(Shape)
AT = {"position": [1.0, 2.0, 3.0]}


CUBE = trimesh.creation.box((0.2, 0.3, 0.4))


def made(**fields: Any) -> Any:
    return shape(SHAPE.validate_python(fields))


@given(T=transforms)
def test_every_form_of_an_orientation_is_the_rotation_it_names(T: Any) -> None:
    rotation = Rotation.from_matrix(T[:3, :3])
    vector = rotation.as_rotvec()
    turn = float(np.linalg.norm(vector))
    axis = vector / turn if turn > 1e-9 else np.array([0.0, 0.0, 1.0])
    # Near a gimbal lock any pair of angles with the right sum will do.
    zyz = rotation.as_euler("ZYZ", suppress_warnings=True).tolist()
    rpy = rotation.as_euler("xyz", suppress_warnings=True).tolist()
    for orientation in (
        {"quaternion_xyzw": rotation.as_quat().tolist()},
        {"rotation_matrix": T[:3, :3].tolist()},
        {"euler_zyz": zyz},
        {"rpy": rpy},
        {"axis_angle": [*(2.0 * axis).tolist(), turn]},
    ):
        body = Pose.model_validate({"position": T[:3, 3].tolist()} | orientation)
        np.testing.assert_allclose(transform(body), T, atol=1e-7)


@given(T=transforms)
def test_a_pose_that_was_answered_can_be_asked_again(T: Any) -> None:
    answer = pose_answer(T)
    again = transform(Pose.model_validate(answer.model_dump()))
    np.testing.assert_allclose(again, T, atol=1e-9)
    assert answer.quaternion_xyzw is not None
    assert abs(np.linalg.norm(answer.quaternion_xyzw) - 1.0) < 1e-9


# ----------------------------------------------------------------------------------- scenes


def obstacle(**changes: Any) -> dict[str, Any]:
    return {"id": "ball", "shape": {"type": "sphere", "radius": 0.1}, "pose": AT} | changes


def test_shapes_keep_their_measures() -> None:
    box = made(type="box", size=[0.1, 0.2, 0.3])
    assert isinstance(box, shapes.Box)
    np.testing.assert_array_equal(box.size, [0.1, 0.2, 0.3])
    sphere = made(type="sphere", radius=0.1)
    assert isinstance(sphere, shapes.Sphere)
    assert sphere.radius == 0.1
    for name, kind in (
        ("cylinder", shapes.Cylinder), ("capsule", shapes.Capsule), ("cone", shapes.Cone),
    ):  # fmt: skip
        round_one = made(type=name, radius=0.1, height=0.4)
        assert type(round_one) is kind
        assert (round_one.radius, round_one.height) == (0.1, 0.4)


def test_points_and_vertices_arrive_in_order() -> None:
    points = [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]]
    cloud = made(type="point_cloud", points=points, radius=0.02)
    assert isinstance(cloud, shapes.PointCloud)
    np.testing.assert_array_equal(cloud.points, points)
    assert cloud.radius == 0.02
    convex = made(type="convex", vertices=points)
    assert isinstance(convex, shapes.Convex)
    np.testing.assert_array_equal(convex.vertices, points)


@pytest.mark.parametrize("ascii_file", [False, True])
def test_a_mesh_file_is_the_mesh_it_describes(ascii_file: bool) -> None:
    file = io.BytesIO()
    CUBE.export(file, file_type="stl_ascii" if ascii_file else "stl")
    mesh = made(type="mesh", stl_base64=base64.b64encode(file.getvalue()).decode())
    assert isinstance(mesh, shapes.Mesh)
    again = trimesh.Trimesh(mesh.vertices, mesh.faces)
    np.testing.assert_allclose(again.volume, CUBE.volume, rtol=1e-6)
    np.testing.assert_allclose(again.bounds, CUBE.bounds, atol=1e-7)
    given_faces = made(type="mesh", vertices=CUBE.vertices.tolist(), faces=CUBE.faces.tolist())
    assert isinstance(given_faces, shapes.Mesh)
    np.testing.assert_array_equal(given_faces.faces, CUBE.faces)


def test_pairs_of_the_request_are_added_to_those_of_moveit() -> None:
    text = (
        "name: table\n"
        "world:\n"
        "  collision_objects:\n"
        "    - id: box\n"
        "      primitives: [{type: box, dimensions: [0.1, 0.2, 0.3]}]\n"
        "      primitive_poses: [{position: [1, 2, 3], orientation: [0, 0, 0, 1]}]\n"
    )
    body = Scene.model_validate({"moveit": text, "allowed_collisions": [["box", "hand"]]})
    domain = scene(body)
    assert [item.id for item in domain.obstacles] == ["box"]
    assert ("box", "hand") in domain.allowed_collisions


def test_an_obstacle_at_fault_is_told_by_its_name() -> None:
    empty = {"type": "mesh", "stl_base64": base64.b64encode(b"solid nothing").decode()}
    with pytest.raises(InvalidScene, match="obstacle 'empty'") as caught:
        scene(Scene.model_validate({"obstacles": [obstacle(), obstacle(id="empty", shape=empty)]}))
    assert str(caught.value).count("'empty'") == 1


CHAIN = builtin_chain("planar_rr")
NAMES = list(CHAIN.joint_names)


def body(**fields: Any) -> TrajectoryBody:
    return TrajectoryBody.model_validate(fields)


def segment(t0: float, t1: float, *rows: list[float]) -> dict[str, Any]:
    return {"t0": t0, "t1": t1, "coefficients": list(rows)}


def test_segments_begin_when_they_say_and_joints_follow_the_robot() -> None:
    two = [segment(3.0, 4.0, [1.0, 2.0], [5.0]), segment(4.0, 6.0, [3.0, 0.0, 1.0], [5.0, -1.0])]
    motion, begins = trajectory(body(joint_names=NAMES[::-1], segments=two), CHAIN)
    assert begins == 3.0
    assert motion.duration == 3.0
    assert motion.joint_names == CHAIN.joint_names
    # The first row of the request is the robot's second joint.
    np.testing.assert_allclose(motion.sample(np.array([0.5])), [[5.0, 2.0]])
    np.testing.assert_allclose(motion.sample(np.array([2.0])), [[4.0, 4.0]])
    np.testing.assert_allclose(motion.sample(np.array([2.0]), 1), [[-1.0, 2.0]])


def test_samples_become_the_spline_that_is_named() -> None:
    times, rows = [0.0, 1.0, 3.0, 4.0], [[0.0, 1.0], [1.0, 0.5], [-1.0, 0.0], [0.5, 2.0]]
    samples = {"time": times, "position": rows}
    motion, _ = trajectory(body(samples=samples, interpolation="natural_spline"), CHAIN)
    expected = CubicSpline(times, rows, bc_type="natural")
    at = np.linspace(0.0, 4.0, 33)
    np.testing.assert_allclose(motion.sample(at), expected(at), atol=1e-12)
    named = body(samples=samples, interpolation="natural_spline", joint_names=NAMES)
    np.testing.assert_array_equal(named_trajectory(named).coefficients, motion.coefficients)


def test_names_of_a_motion_without_a_robot_are_different() -> None:
    with pytest.raises(InvalidTrajectory, match="named twice"):
        named_trajectory(body(joint_names=["a", "a"], segments=[segment(0, 1, [0.0], [0.0])]))


def test_an_answer_can_be_sent_again_and_is_sampled_as_asked() -> None:
    first, _ = trajectory(body(segments=[segment(0.0, 2.0, [0.0, 1.0], [1.0, 0.0, -0.5])]), CHAIN)
    answer = trajectory_answer(first, 0.5)
    again, _ = trajectory(TrajectoryBody.model_validate(answer | {"samples": None}), CHAIN)
    np.testing.assert_array_equal(again.breaks, first.breaks)
    np.testing.assert_array_equal(again.coefficients, first.coefficients)
    samples = answer["samples"]
    np.testing.assert_allclose(samples["time"], [0.0, 0.5, 1.0, 1.5, 2.0])
    np.testing.assert_allclose(samples["position"], first.sample(np.array(samples["time"])))
    np.testing.assert_allclose(samples["acceleration"], [[0.0, -1.0]] * 5)
    assert trajectory_answer(first, None)["samples"] is None
    with pytest.raises(InvalidOption, match="more than 100000 samples"):
        trajectory_answer(first, 1e-6)


ROBOT = builtin("planar_rr")


def request(**fields: Any) -> PlanRequest:
    least = {"robot": "planar_rr", "start": {"joints": [0.0, 0.1]}, "goal": {"joints": [0.5, 0.6]}}
    return PlanRequest.model_validate(least | fields)


def test_goals_of_each_form() -> None:
    pose = {"position": [1.0, 0.2, 0.0], "rpy": [0.0, 0.0, 0.3]}
    either = {"any_of": [{"joints": [0.1, 0.2]}, {"pose": pose, "position_tolerance": 0.01}]}
    made = problem(request(goal=either, margin=0.02), ROBOT, ObstacleScene(), ROBOT.chain)
    assert made.margin == 0.02
    np.testing.assert_array_equal(made.start, [0.0, 0.1])
    first, second = made.goals
    assert isinstance(first, JointGoal)
    np.testing.assert_array_equal(first.joints, [0.1, 0.2])
    assert isinstance(second, PoseGoal)
    assert second.position_tolerance == 0.01
    c, s = np.cos(0.3), np.sin(0.3)
    expected = [[c, -s, 0, 1.0], [s, c, 0, 0.2], [0, 0, 1, 0], [0, 0, 0, 1]]
    np.testing.assert_allclose(second.T_base_tip, expected, atol=1e-15)


def test_options_carry_the_time_that_is_left() -> None:
    made = options(request(planner="RRTConnect", planner_options={"range": 0.5}, seed=3),
                   ROBOT.chain, 1.5)  # fmt: skip
    assert (made.planner, made.timeout, made.seed) == ("rrt_connect", 1.5, 3)
    assert made.planner_options == {"range": 0.5}
    assert made.refine is None
    assert options(request(refine=True), ROBOT.chain, 1.0).refine is not None
    assert options(request(refine=False), ROBOT.chain, 1.0).refine is None
