"""Mounted tools, against pinocchio with the tool as links of the URDF, and coal on their solids."""

import pickle
from dataclasses import replace
from typing import Any

import coal
import numpy as np
import pinocchio as pin
import pytest

from armwright.robot import load_robot
from dynamics.inverse import inverse_dynamics
from dynamics.terms import gravity_vector, mass_matrix
from kinematics.arrays import Array
from kinematics.errors import (
    ArmwrightError,
    InvalidLinkName,
    InvalidObjectName,
    InvalidOption,
    InvalidScene,
)
from kinematics.forward import forward
from kinematics.ik.inverse import IkOptions, inverse_kinematics
from kinematics.jacobian import geometric
from kinematics.model.chain import Inertia
from kinematics.pose import from_rpy, to_rpy, transform
from kinematics.robots import builtin_urdf
from obstacles.collision.checker import Checker
from obstacles.robots.attachment import Attachment, hold
from obstacles.robots.finger_geometry import with_fingers
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.robots.tool import FORMS, SIZES, Jaw, Solid, Tool, built_in_tool, mount, with_tip
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Box, Cylinder, HalfSpace, Sphere

T_TIP = transform(from_rpy([0.3, -0.4, 0.9]), [0.03, -0.02, 0.21])
COM, TENSOR = (
    np.array([0.01, 0.02, 0.09]),
    np.array([[0.004, 2e-4, -1e-4], [2e-4, 0.005, 3e-4], [-1e-4, 3e-4, 0.003]]),
)
BODY, T_BODY = (0.12, 0.05, 0.14), transform(from_rpy([0.2, 0.1, -0.3]), [0.01, 0.0, 0.08])


def tool(**changes: Any) -> Tool:
    fields: dict[str, Any] = {
        "name": "gripper_a",
        "tcp": {"tip": T_TIP, "side": transform(None, [0.1, 0.0, 0.05])},
        "solids": (Solid(Box(BODY), T_BODY),),
        "inertia": Inertia(1.7, COM, TENSOR),
    }
    return Tool(**fields | changes)


def urdf_with_tool(robot: str, flange: str) -> str:
    """The robot's URDF with the tool's mass and tip as fixed links."""
    xyz, rpy = (" ".join(map(str, v)) for v in (T_TIP[:3, 3], to_rpy(T_TIP[:3, :3])))
    J, c = TENSOR, " ".join(map(str, COM))
    inertia = (
        f'<inertial><origin xyz="{c}"/><mass value="1.7"/><inertia ixx="{J[0, 0]}" ixy="{J[0, 1]}" '
        f'ixz="{J[0, 2]}" iyy="{J[1, 1]}" iyz="{J[1, 2]}" izz="{J[2, 2]}"/></inertial>'
    )
    links = f'<link name="hand_tool">{inertia}</link><link name="tip_of_tool"/>'
    joints = (
        f'<joint name="m" type="fixed"><parent link="{flange}"/><child link="hand_tool"/></joint>'
        '<joint name="t" type="fixed"><parent link="hand_tool"/><child link="tip_of_tool"/>'
        f'<origin xyz="{xyz}" rpy="{rpy}"/></joint>'
    )
    return builtin_urdf(robot).replace("</robot>", links + joints + "</robot>")


def configurations(robot: RobotGeometry, count: int) -> Array:
    lower, upper = robot.chain.sampling_bounds()
    return np.random.default_rng(38).uniform(lower, upper, (count, robot.chain.n))


@pytest.mark.parametrize("name", ["ur5e", "iiwa14"])
def test_kinematics_and_dynamics_are_those_of_a_urdf_with_the_tool(name: str) -> None:
    robot = load_robot(name)
    arm = mount(robot, tool(), "tip")
    assert arm.chain.tip_link == "gripper_a/tip"
    model = pin.buildModelFromXML(urdf_with_tool(name, robot.chain.tip_link))
    data, frame = model.createData(), model.getFrameId("tip_of_tool")
    rates = np.random.default_rng(1).normal(size=(2, arm.chain.n))
    for q in configurations(arm, 40):
        pin.framesForwardKinematics(model, data, q)
        np.testing.assert_allclose(forward(arm.chain, q), data.oMf[frame].homogeneous, atol=1e-12)
        J = pin.computeFrameJacobian(model, data, q, frame, pin.LOCAL_WORLD_ALIGNED)
        np.testing.assert_allclose(geometric(arm.chain, q), J, atol=1e-12)
        M = pin.crba(model, data, q)
        M = np.triu(M) + np.triu(M, 1).T
        np.testing.assert_allclose(mass_matrix(arm.chain, q), M, atol=1e-10)
        G = pin.computeGeneralizedGravity(model, data, q)
        np.testing.assert_allclose(gravity_vector(arm.chain, q), G, atol=1e-10)
        torques = inverse_dynamics(arm.chain, q, *rates)
        np.testing.assert_allclose(torques, pin.rnea(model, data, q, *rates), atol=1e-9)


@pytest.mark.parametrize("name", ["ur5e", "panda", "kr6_sixx"])
def test_inverse_kinematics_is_for_the_tip(name: str) -> None:
    arm = mount(load_robot(name), tool(), "tip")
    for q in configurations(arm, 20):
        wanted = forward(arm.chain, q)
        found = inverse_kinematics(arm.chain, wanted, IkOptions(), seed_joints=q)
        assert found.solutions
        for solution in found.solutions:
            np.testing.assert_allclose(forward(arm.chain, solution.joints), wanted, atol=1e-6)


def test_solids_collide_where_coal_says_so() -> None:
    arm = mount(load_robot("ur5e"), tool(), "side")
    T_box = transform(from_rpy([0.3, 0.2, 0.1]), [0.3, 0.2, 0.5])
    scene = Scene((Obstacle("block", Box((0.6, 0.5, 0.4)), T_box),))
    own = [i for i, link in enumerate(arm.links) if link == "gripper_a"]
    alone = replace(
        arm,
        pieces=tuple(arm.pieces[i] for i in own),
        links=("gripper_a",) * len(own),
        joints=arm.joints[own],
        solids=arm.solids[own],
    )
    whole, checker, met = Checker.of(arm, scene), Checker.of(alone, scene), 0
    body, block = coal.Box(*BODY), coal.Box(0.6, 0.5, 0.4)
    place = coal.Transform3s(T_box[:3, :3], T_box[:3, 3])
    asked = coal.DistanceRequest()
    for q in configurations(arm, 120):
        T = forward(arm.chain, q, "gripper_a") @ T_BODY
        at = coal.Transform3s(T[:3, :3], T[:3, 3])
        distance = coal.distance(body, at, block, place, asked, coal.DistanceResult())
        found, pair = checker.clearance(q)
        assert pair == ("gripper_a", "block")
        assert found == pytest.approx(max(distance, 0.0), abs=1e-5)
        assert checker.valid(q) == (distance > 0.0)
        assert checker.valid(q) or not whole.valid(q)
        met += distance < 0.0
    assert 2 < met < 118


def test_jaws_stand_as_far_apart_as_the_opening() -> None:
    arm = mount(load_robot("ur5e"), built_in_tool("parallel_jaw", "jaw_a", opening=0.08))
    assert arm.fingers.positions == {"jaw_a/opening": 0.08}
    assert arm.fingers.states["jaw_a/closed"] == {"jaw_a/opening": 0.0}
    for opening in (0.0, 0.03, 0.08):
        moved = with_fingers(arm, {"jaw_a/opening": opening})
        inner = []
        for i, link in enumerate(moved.links):
            if link in {"jaw_a/left", "jaw_a/right"}:
                piece = moved.pieces[i]
                T = np.linalg.inv(moved.chain.link("jaw_a").T_joint_link) @ piece.T_owner_piece
                x = (piece.vertices @ T[:3, :3].T + T[:3, 3])[:, 0]
                inner.append(x[np.abs(x).argmin()])
        assert max(inner) - min(inner) == pytest.approx(opening, abs=1e-12)
    with pytest.raises(InvalidOption, match="outside its limits"):
        with_fingers(arm, {"jaw_a/opening": 0.09})


def test_a_tool_stands_for_its_jaws_where_it_is_named() -> None:
    arm = mount(load_robot("ur5e"), built_in_tool("parallel_jaw", "jaw_a"))
    part = Obstacle("part", Sphere(0.02), transform(None, [0.0, 0.0, 0.145]))
    held = hold(arm, Scene(), [Attachment(part, "jaw_a/tip", ("jaw_a",))])
    assert {("jaw_a", "part"), ("jaw_a/left", "part")} <= held.scene.allowed_collisions
    box = Scene((Obstacle("box", Box((0.1, 0.1, 0.1))),))
    named = hold(arm, box, (), [("box", "jaw_a")]).scene.allowed_collisions
    assert named == {("box", "jaw_a"), ("box", "jaw_a/left"), ("box", "jaw_a/right")}
    every = hold(arm, box, (), [("*", "box")]).scene.allowed_collisions
    assert every == {tuple(sorted(("box", name))) for name in arm.names}
    some = hold(arm, box, (), [("wrist_*", "bo*")]).scene.allowed_collisions
    wrists = ("wrist_1_link", "wrist_2_link", "wrist_3_link")
    assert some == {("box", name) for name in wrists}
    with pytest.raises(InvalidObjectName, match="elbow_"):
        hold(arm, box, (), [("elbow_*", "box")])


def test_a_point_of_a_held_object_can_be_the_tip() -> None:
    robot = load_robot("ur5e")
    arm = with_tip(robot, "peg/tip", "tool0", T_TIP)
    q = np.array([0.1, -1.0, 1.2, 0.3, 0.4, 0.5])
    np.testing.assert_allclose(forward(arm.chain, q), forward(robot.chain, q) @ T_TIP, atol=1e-14)


@pytest.mark.parametrize("form", FORMS)
def test_built_in_tools_end_in_their_tips(form: str) -> None:
    made = built_in_tool(form, "it")
    arm = mount(load_robot("ur5e"), made)
    assert pickle.loads(pickle.dumps(arm)) == arm
    assert Checker.of(arm, Scene()).valid(np.array([0.0, -1.2, 1.2, -1.5, -1.5, 0.0]))
    assert made.inertia is not None
    assert made.inertia.mass == SIZES[form]["mass"]
    assert built_in_tool(form, "it", mass=0.0).inertia is None
    bigger = {size: 1.1 * value for size, value in SIZES[form].items() if size != "angle"}
    grown = built_in_tool(form, "it", None, **bigger).tcp["tip"][:3, 3]
    np.testing.assert_allclose(grown, 1.1 * made.tcp["tip"][:3, 3], rtol=1e-12)


def test_unknown_forms_and_sizes_are_refused() -> None:
    with pytest.raises(InvalidOption, match="no built-in tool 'claw'"):
        built_in_tool("claw", "it")
    with pytest.raises(InvalidOption, match="a torch has no size 'opening'"):
        built_in_tool("torch", "it", opening=0.1)
    with pytest.raises(InvalidScene, match="cylinder height"):
        built_in_tool("spindle", "it", length=0.0)
    with pytest.raises(InvalidOption, match="half-space"):
        Solid(HalfSpace([0.0, 0.0, 1.0], 0.0))


JAW = Jaw(np.eye(4), np.array([1.0, 0.0, 0.0]))


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"name": "tool"}, "can't be called 'tool'"),
        ({"name": "a/b"}, "can't be called 'a/b'"),
        ({"tcp": {}}, "has no tip"),
        ({"tcp": {"opening": T_TIP}}, "'opening' can't be the name"),
        ({"jaws": {"tip": JAW}, "opening": (0.0, 0.1)}, "'tip' can't be the name"),
        ({"jaws": {"left": JAW}}, "give both or neither"),
        ({"opening": (0.0, 0.1)}, "give both or neither"),
        ({"jaws": {"left": JAW}, "opening": (0.1, 0.0)}, r"opening is \[0.1, 0.0\] m"),
        ({"grip": "jaws"}, "has no fingers"),
        ({"jaws": {"l": Jaw(np.eye(4), np.zeros(3))}, "opening": (0.0, 0.1)}, "its axis is 0"),
    ],
)
def test_odd_tools_are_refused(changes: dict[str, Any], told: str) -> None:
    with pytest.raises(InvalidOption, match=told):
        tool(**changes)


@pytest.mark.parametrize(
    ("changes", "tcp", "told"),
    [
        ({}, None, "'gripper_a' has 2 tips"),
        ({}, "end", "'gripper_a' has no tip 'end'"),
        ({"link": "nowhere"}, "tip", "no link 'nowhere'"),
        ({"link": "base"}, "tip", "'base', which no joint"),
        ({"name": "tool0"}, "tip", "has a link, joint or attached object 'tool0'"),
    ],
)
def test_odd_mounts_are_refused(changes: dict[str, Any], tcp: str | None, told: str) -> None:
    with pytest.raises(ArmwrightError, match=told):
        mount(load_robot("ur5e"), tool(**changes), tcp)


def test_a_second_tool_is_mounted_on_the_tip_of_the_first() -> None:
    robot = load_robot("ur5e")
    changer = Tool(
        "changer", {"face": transform(None, [0.0, 0.0, 0.04])}, (Solid(Cylinder(0.04, 0.04)),)
    )
    arm = mount(mount(robot, changer), tool(), "tip")
    q = np.array([0.1, -1.0, 1.2, 0.3, 0.4, 0.5])
    wanted = forward(robot.chain, q) @ transform(None, [0.0, 0.0, 0.04]) @ T_TIP
    np.testing.assert_allclose(forward(arm.chain, q), wanted, atol=1e-14)
    with pytest.raises(InvalidLinkName, match="already"):
        mount(arm, tool(), "tip")
