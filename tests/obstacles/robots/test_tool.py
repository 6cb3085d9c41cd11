"""Tools, fingers, grasps and resting places beside pinocchio, coal, trimesh and closed forms."""

import pickle
from dataclasses import replace
from functools import cache
from typing import Any

import coal
import numpy as np
import pinocchio as pin
import pytest
import trimesh
from scipy.spatial import ConvexHull

import armwright as aw
from armwright.robot import load_robot
from benchmarks.problems.example_arms import ARMS
from dynamics.inverse import inverse_dynamics
from dynamics.terms import gravity_vector, mass_matrix
from kinematics.arrays import Array
from kinematics.errors import (
    ArmwrightError,
    InvalidLinkName,
    InvalidObjectName,
    InvalidOption,
)
from kinematics.forward import forward
from kinematics.ik.inverse import IkOptions, inverse_kinematics
from kinematics.jacobian import geometric
from kinematics.model.chain import Inertia
from kinematics.pose import from_rpy, rotation_z, to_rpy, transform
from kinematics.robots import builtin_urdf
from obstacles.collision.checker import Checker
from obstacles.robots.attachment import Attachment, hold
from obstacles.robots.finger_geometry import moved_links, swept_cover, with_fingers
from obstacles.robots.grasps import (
    GraspKind,
    GraspSearch,
    JawSpan,
    find_grasps,
    jaw_span,
    object_down,
)
from obstacles.robots.resting import resting_places
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.robots.tool import FORMS, SIZES, Jaw, Solid, Tool, built_in_tool, mount, with_tip
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Box, Convex, Cylinder, HalfSpace, Mesh, Shape, Sphere

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


DOWN = np.array([0.0, 0.0, -1.0])
SPAN = JawSpan(np.array([1.0, 0.0, 0.0]), 0.07)
#: An L of two boxes, which is not convex: outer sides 0.12 and 0.1 m, arms 0.04 m thick.
ELL = np.array([[0, 0], [0.12, 0], [0.12, 0.04], [0.04, 0.04], [0.04, 0.1], [0, 0.1]])


def ell() -> Mesh:
    vertices = np.vstack([np.c_[ELL, np.full(6, z)] for z in (0.0, 0.05)])
    cap = [(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 5)]
    faces = [(c, b, a) for a, b, c in cap] + [(a + 6, b + 6, c + 6) for a, b, c in cap]
    for k in range(6):
        j = (k + 1) % 6
        faces += [(k, j, j + 6), (k, j + 6, k + 6)]
    return Mesh(vertices, np.array(faces))


def test_the_span_is_that_of_the_jaws_in_the_frame_of_the_tip() -> None:
    robot = load_robot("ur5e")
    span = jaw_span(mount(robot, built_in_tool("parallel_jaw", "jaw", opening=0.06)))
    assert span.widest == pytest.approx(0.06, abs=1e-12)
    np.testing.assert_allclose(np.abs(span.axis), [1.0, 0.0, 0.0], atol=1e-12)
    for arm in (robot, mount(robot, built_in_tool("three_jaw", "three"))):
        with pytest.raises(InvalidOption, match="no two fingers"):
            jaw_span(arm)


@pytest.mark.parametrize("kind", ["antipodal", "top", "side"])
def test_a_box_is_held_by_sides_that_the_jaws_span(kind: GraspKind) -> None:
    size = np.array([0.03, 0.06, 0.08])
    found = find_grasps(Box(size), DOWN, GraspSearch(kind), SPAN)
    assert len(found) >= 8
    for T in found:
        assert np.linalg.det(T[:3, :3]) == pytest.approx(1.0)
        np.testing.assert_allclose(T[:3, :3].T @ T[:3, :3], np.eye(3), atol=1e-12)
        axis = int(np.abs(T[:3, 0]).argmax())
        assert abs(T[axis, 0]) == pytest.approx(1.0)
        assert size[axis] < 0.07  # 0.08 along z is wider than the jaws open
        assert T[axis, 3] == pytest.approx(0.0, abs=1e-12)
        assert np.all(np.abs(T[:3, 3]) <= 0.5 * size)
        if kind != "antipodal":
            assert T[:3, 2] @ DOWN == pytest.approx(1.0 if kind == "top" else 0.0, abs=1e-12)


def test_a_cylinder_and_a_ball_are_held_through_their_middle() -> None:
    for T in find_grasps(Cylinder(0.02, 0.06), DOWN, GraspSearch("top", friction=0.1), SPAN):
        np.testing.assert_allclose(T[:2, 3], 0.0, atol=2e-3)
    for T in find_grasps(Sphere(0.03), DOWN, GraspSearch("antipodal"), SPAN):
        np.testing.assert_allclose(T[:3, 3], 0.0, atol=3e-3)


@pytest.mark.parametrize("kind", ["antipodal", "top", "side"])
def test_jaws_come_to_both_sides_of_a_mesh_that_is_not_convex(kind: GraspKind) -> None:
    """Thin plates from far away to the two points pass nothing of the body, as coal has it."""
    parts = [((0.12, 0.04, 0.05), [0.06, 0.02, 0.025]), ((0.04, 0.1, 0.05), [0.02, 0.05, 0.025])]
    found = find_grasps(ell(), DOWN, GraspSearch(kind, count=40), SPAN)
    assert len(found) > 20
    for T in found:
        line = T[:3, 0]
        widths = []
        for side in (1.0, -1.0):
            # The first touch of a needle that comes along the line from outside.
            needle, asked = coal.Sphere(1e-6), coal.DistanceRequest()
            low, high = 0.0, 0.2
            for _ in range(60):
                if high - low < 1e-7:
                    break
                at = T[:3, 3] + side * high * line
                gap = min(
                    coal.distance(needle, coal.Transform3s(np.eye(3), at), coal.Box(*size),
                                  coal.Transform3s(np.eye(3), np.array(place)), asked,
                                  coal.DistanceResult())
                    for size, place in parts
                )  # fmt: skip
                if gap < 1e-6:
                    break
                high -= gap
            widths.append(high)
        assert sum(widths) < 0.07
        assert widths[0] == pytest.approx(widths[1], abs=1e-4)


@pytest.mark.parametrize("shape", [Box((0.1, 0.1, 0.02)), Cylinder(0.05, 0.03)])
def test_a_cup_sits_on_flat_places_with_its_rim(shape: Shape) -> None:
    found = find_grasps(shape, DOWN, GraspSearch("suction", radius=0.015), None)
    assert len(found) > 8
    half = 0.01 if isinstance(shape, Box) else 0.015
    for T in found:
        assert abs(T[2, 2]) == pytest.approx(1.0)
        assert T[2, 3] == pytest.approx(-half * T[2, 2])
        assert np.abs(T[:2, 3]).max() < 0.036
    assert len(find_grasps(Sphere(0.03), DOWN, GraspSearch("suction"), None)) == 0


def test_from_above_is_meant_as_the_object_lies() -> None:
    T = transform(from_rpy([0.5 * np.pi, 0.0, 0.3]), [0.4, 0.0, 0.1])
    found = find_grasps(Box((0.03, 0.04, 0.05)), object_down(T), GraspSearch("top"), SPAN)
    for grasp in found:
        np.testing.assert_allclose((T @ grasp)[:3, 2], DOWN, atol=1e-12)


def test_the_same_seed_finds_the_same_and_depth_goes_along_the_tool() -> None:
    shape = Convex(np.random.default_rng(3).normal(size=(30, 3)) * 0.02)
    one, other = (find_grasps(shape, DOWN, GraspSearch("top", seed=5), SPAN) for _ in range(2))
    np.testing.assert_array_equal(one, other)
    deep = find_grasps(shape, DOWN, GraspSearch("top", seed=5, depth=0.01), SPAN)
    np.testing.assert_allclose(deep[:, :3, 3] - one[:, :3, 3], 0.01 * one[:, :3, 2], atol=1e-15)


def test_what_is_too_wide_or_has_no_end_is_not_grasped() -> None:
    assert len(find_grasps(Box((0.1, 0.1, 0.1)), DOWN, GraspSearch("antipodal"), SPAN)) == 0
    with pytest.raises(InvalidOption, match="half-space"):
        find_grasps(HalfSpace([0.0, 0.0, 1.0], 0.0), DOWN, GraspSearch("top"), SPAN)


_LEADER = {"panda": "panda_finger_joint1", "pr2": "r_gripper_l_finger_joint"}
_LAST = {"panda": 0.04, "pr2": 0.5}


@cache
def _robot(name: str) -> RobotGeometry:
    return ARMS[name].geometry({"acceleration": 10.0})


def _corners(robot: RobotGeometry, i: int) -> Array:
    """Corners of a piece in the frame of its joint, shape (k, 3)."""
    piece = robot.pieces[i]
    return piece.vertices @ piece.T_owner_piece[:3, :3].T + piece.T_owner_piece[:3, 3]


@pytest.mark.parametrize("name", ["panda", "pr2"])
def test_solids_go_with_their_links_and_all_else_stays(name: str) -> None:
    robot = _robot(name)
    moved = with_fingers(robot, {_LEADER[name]: _LAST[name]})
    links = moved_links(robot, frozenset([_LEADER[name]]))
    assert len(links) >= 2
    for i, link in enumerate(robot.links):
        T, T_new = (r.chain.link(link).T_joint_link for r in (robot, moved))
        own = np.linalg.inv(T) @ robot.pieces[i].T_owner_piece
        assert np.allclose(T_new @ own, moved.pieces[i].T_owner_piece, atol=1e-12)
        assert np.allclose(T, T_new) == (link not in links)
    assert moved.content_hash != robot.content_hash
    back = with_fingers(moved, dict(robot.fingers.positions))
    for one, other in zip(robot.pieces, back.pieces, strict=True):
        np.testing.assert_allclose(one.T_owner_piece, other.T_owner_piece, atol=1e-12)
    assert with_fingers(robot, dict(robot.fingers.positions)) is robot


@pytest.mark.parametrize("name", ["panda", "pr2"])
@pytest.mark.parametrize("share", [(0.0, 1.0), (0.25, 0.5), (0.7, 0.71)])
def test_a_cover_holds_every_corner_on_its_way(name: str, share: tuple[float, float]) -> None:
    robot, leader = _robot(name), _LEADER[name]
    first = dict(robot.fingers.positions)
    last = {**first, leader: _LAST[name]}
    cover, growth = swept_cover(robot, first, last, share)
    farthest = 0.0
    for s in np.linspace(*share, 23):
        at = first[leader] + s * (last[leader] - first[leader])
        there = with_fingers(robot, {leader: at})
        for i, piece in enumerate(cover.pieces):
            if not len(piece.vertices):
                continue
            off = np.linalg.norm(_corners(there, i) - _corners(cover, i), axis=1).max()
            added = piece.offset_radius - robot.pieces[i].offset_radius
            # A corner that moves by no more than the ball added is inside the cover.
            assert off <= added + 1e-12
            farthest = max(farthest, off)
    # The bound is not idle: something moves by a good part of it.
    assert growth >= farthest >= 0.3 * growth > 0.0


def test_joints_that_are_no_fingers_are_refused() -> None:
    with pytest.raises(InvalidOption, match="no joint of a gripper"):
        with_fingers(_robot("panda"), {"panda_joint7": 0.1})


TURNED = transform(rotation_z(0.4), [0.5, 0.1, 0.11])


def stands(points: np.ndarray) -> float:
    """How far the centre of mass is inside of the foot, as a tangent of the tilt."""
    body = trimesh.convex.convex_hull(points)
    foot = points[points[:, 2] < points[:, 2].min() + 1e-6, :2]
    edges = ConvexHull(foot).equations
    inside = -float((edges[:, :2] @ body.center_mass[:2] + edges[:, 2]).max())
    return inside / float(body.center_mass[2] - points[:, 2].min())


def test_what_is_put_down_stands_within_the_top_and_does_not_tip() -> None:
    random, count = np.random.default_rng(5), 0
    table = aw.Obstacle("table", aw.Box((0.5, 0.4, 0.02)), TURNED)
    for _ in range(30):
        corners = random.uniform(-0.05, 0.05, (int(random.integers(4, 12)), 3))
        corners += np.array([0.3, 0.0, 0.0])
        places = resting_places(aw.Convex(corners), [table], (2, 3), 3)
        for T in places[:: max(len(places) // 6, 1)]:
            points = corners @ T[:3, :3].T + T[:3, 3]
            foot = points[points[:, 2] < points[:, 2].min() + 1e-6]
            assert len(foot) >= 3
            # Points within a micrometre of a plane are of one face.
            assert foot[:, 2] == pytest.approx(0.12, abs=1e-6)
            local = (foot - TURNED[:3, 3]) @ TURNED[:3, :3]
            assert (np.abs(local[:, :2]) <= [0.25 + 1e-6, 0.2 + 1e-6]).all()
            assert stands(points) > 0.1
            count += 1
    assert count > 60


def test_a_box_rests_on_each_face_and_a_cylinder_on_its_ends() -> None:
    table = aw.Obstacle("table", aw.Box((0.5, 0.4, 0.02)), TURNED)
    heights = {round(float(T[2, 3]), 4) for T in resting_places(aw.Box((0.04, 0.06, 0.1)), [table])}
    assert heights == {0.14, 0.15, 0.17}
    ends = resting_places(aw.Cylinder(0.02, 0.1), [table])
    assert {round(float(T[2, 3]), 4) for T in ends} == {0.17}
    # A top that is too small carries nothing; two carry twice as much.
    small = aw.Obstacle("small", aw.Box((0.02, 0.02, 0.1)), aw.pose([0.0, 0.5, 0.1]))
    assert len(resting_places(aw.Box((0.04, 0.06, 0.1)), [small])) == 0
    other = aw.Obstacle("other", table.shape, transform(None, [0.0, 0.9, 0.0]) @ TURNED)
    assert len(resting_places(aw.Cylinder(0.02, 0.1), [table, other])) == 2 * len(ends)


@pytest.mark.parametrize(
    ("shape", "support", "told"),
    [
        (aw.Sphere(0.05), aw.Box((1.0, 1.0, 0.1)), "no face"),
        (aw.Box((0.1, 0.1, 0.1)), aw.Sphere(0.5), "no flat top"),
        (aw.Box((0.1, 0.1, 0.1)), aw.HalfSpace((0.0, 0.0, 1.0), 0.0), "no flat top"),
    ],
)
def test_what_rolls_and_what_has_no_top_is_refused(shape: Any, support: Any, told: str) -> None:
    with pytest.raises(InvalidOption, match=told):
        resting_places(shape, [aw.Obstacle("s", support, np.eye(4))])
