"""Seams of arms on a rail, and of work on a turntable, against pinocchio."""

import math

import numpy as np

from kinematics.pose import transform
from kinematics.robots import builtin_urdf
from kinematics.tree.serial_chain import serial_chain
from kinematics.urdf.urdf import parse_urdf
from obstacles.robots.robot_geometry import RobotGeometry, robot_geometry
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Cylinder
from planning.options import CartesianOptions, Options
from planning.problem import PoseGoal, Problem
from planning.result import Plan
from planning.tool_motions.tool_tolerance import SeamOptions, SeamWaypoint, ToolTolerance
from tests.planning.pinocchio_arm import PinocchioArm
from tests.planning.scenes import planned_motion

RAIL = """<link name="rail"/><joint name="carrier" type="prismatic"><parent link="rail"/>
<child link="{base}"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" velocity="1" effort="1000"/></joint></robot>"""
# The work is the root: seen from it, the floor with the arm turns the other way round.
TURNTABLE = """<link name="work"/><link name="floor"/>
<joint name="carrier" type="revolute"><parent link="work"/><child link="floor"/><axis xyz="0 0 -1"/>
<limit lower="-6.2" upper="6.2" velocity="2" effort="1000"/></joint>
<joint name="stand" type="fixed"><parent link="floor"/><child link="{base}"/>
<origin xyz="-0.6 0 -0.2"/></joint></robot>"""
# Work and arm side by side on the floor, as a cell's description has them.
BESIDE = """<link name="floor"/><link name="work"/>
<joint name="table" type="revolute"><parent link="floor"/><child link="work"/>
<origin xyz="0.6 0 0.2"/><axis xyz="0 0 1"/>
<limit lower="-6.2" upper="6.2" velocity="2" effort="1000"/></joint>
<joint name="stand" type="fixed"><parent link="floor"/><child link="{base}"/></joint></robot>"""
FREE_SPIN = ToolTolerance.of({}, ("rz",), tilt=0.2)
DOWN = np.diag([1.0, -1.0, -1.0])


def carried(name: str, base: str, carrier: str, dofs: list[str]) -> tuple[RobotGeometry, str]:
    """A built-in arm with a joint before its base, and its description."""
    urdf = builtin_urdf(name).replace("</robot>", carrier.format(base=base))
    description = parse_urdf(urdf)
    limits = {joint: {"acceleration": 8.0, "jerk": 500.0} for joint in ["carrier", *dofs]}
    chain = serial_chain(description, joint_limits=limits)
    return robot_geometry(chain, description, {}, None), urdf


def check(
    robot: RobotGeometry,
    urdf: str,
    points: np.ndarray,
    start: np.ndarray,
    scene: Scene | None = None,
) -> Plan:
    """Follow points with the tool down; every instant is held to them by pinocchio."""
    waypoints = tuple(SeamWaypoint(transform(DOWN, p)) for p in points)
    seam = SeamOptions(waypoints, FREE_SPIN, tool_speed=0.2)
    problem = Problem(robot, scene or Scene(), start, (PoseGoal(waypoints[-1].T_base_tip),))
    how = CartesianOptions(seam=seam)
    answer = planned_motion(problem, Options(planner="cartesian", cartesian=how, timeout=20.0))
    assert answer.certificate.verified
    oracle = PinocchioArm(urdf=urdf, chain=robot.chain)
    ways = np.diff(points, axis=0)
    for time in np.linspace(answer.tool_motions[0].begins, answer.trajectory.duration, 201):
        T = oracle.pose(answer.trajectory.sample([min(time, answer.trajectory.duration)])[0])
        off = T[:3, 3] - points[:-1]
        s = np.clip((off * ways).sum(axis=1) / (ways**2).sum(axis=1), 0.0, 1.0)
        assert np.linalg.norm(off - s[:, None] * ways, axis=1).min() <= 1.1e-4
        assert -T[2, 2] >= math.cos(0.2 + 1.1e-3)
    return answer


def test_an_arm_on_a_rail_follows_a_seam_that_it_does_not_reach_from_one_place() -> None:
    joints = [f"iiwa_joint_{k}" for k in range(1, 8)]
    robot, urdf = carried("iiwa14", "iiwa_link_0", RAIL, joints)
    points = np.array([[0.55, y, 0.3] for y in np.linspace(-0.9, 0.9, 60)])
    start = np.array([0.0, 0.1, 0.6, 0.0, -1.5, 0.1, 1.0, 0.0])
    answer = check(robot, urdf, points, start)
    assert np.ptp(answer.path.waypoints[:, 0]) > 0.5


def test_an_arm_on_a_rail_finds_the_few_free_configurations_there_are() -> None:
    joints = [f"iiwa_joint_{k}" for k in range(1, 8)]
    robot, urdf = carried("iiwa14", "iiwa_link_0", RAIL, joints)
    start = np.array([0.0, 0.1, 0.6, 0.0, -1.5, 0.1, 1.0, 0.0])
    post = Obstacle("post", Cylinder(0.03, 0.8), transform(None, [0.45, 0.45, 0.4]))
    points = np.array([[0.46, y, 0.27] for y in np.linspace(-0.14, 0.36, 60)])
    check(robot, urdf, points, start, Scene((post,)))


def test_a_turntable_carries_the_work_under_the_tool() -> None:
    chain = serial_chain(parse_urdf(builtin_urdf("ur5e")))
    base = chain.base_link
    robot, urdf = carried("ur5e", base, TURNTABLE, list(chain.joint_names))
    angles = np.linspace(0.0, 1.5 * math.pi, 90)
    points = np.column_stack([0.2 * np.cos(angles), 0.2 * np.sin(angles), 0.0 * angles])
    start = np.array([0.0, 0.2, -1.2, 1.5, -1.9, -1.57, 0.2])
    answer = check(robot, urdf, points, start)
    # Poses are in the work's frame, which moves with the joint: the table turns under the tool.
    assert np.ptp(answer.path.waypoints[:, 0]) > 0.5


def test_work_on_a_turntable_beside_the_arm_is_followed_as_the_file_has_it() -> None:
    chain = serial_chain(parse_urdf(builtin_urdf("ur5e")))
    urdf = builtin_urdf("ur5e").replace("</robot>", BESIDE.format(base=chain.base_link))
    description = parse_urdf(urdf)
    limits = {"*": {"acceleration": 8.0, "jerk": 500.0}}
    cell = serial_chain(description, base_link="work", joint_limits=limits)
    assert cell.joint_names == ("table", *chain.joint_names)
    assert (cell.root_link, cell.tip_link) == ("work", chain.tip_link)
    robot = robot_geometry(cell, description, {}, None)
    angles = np.linspace(0.0, 1.5 * math.pi, 90)
    points = np.column_stack([0.2 * np.cos(angles), 0.2 * np.sin(angles), 0.0 * angles])
    answer = check(robot, urdf, points, np.array([0.0, 0.2, -1.2, 1.5, -1.9, -1.57, 0.2]))
    assert np.ptp(answer.path.waypoints[:, 0]) > 0.5
