"""Tool motions of many arms, on rails and over turntables: closed forms and pinocchio."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from kinematics.forward import forward
from kinematics.ik.closed_form.analytic import branches
from kinematics.jacobian import geometric
from kinematics.pose import from_rpy, transform
from kinematics.robots import builtin_chain, builtin_urdf
from kinematics.trajectory.trajectory import Trajectory
from kinematics.tree.serial_chain import serial_chain
from kinematics.urdf.urdf import parse_urdf
from obstacles.robots.robot_geometry import RobotGeometry, robot_geometry
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Cylinder
from planning.options import CartesianOptions, Options, ToolMotionOptions
from planning.pipeline.pipeline import plan
from planning.problem import JointGoal, PoseGoal, Problem
from planning.proof.tool.tool_deviation import path_deviation
from planning.result import Failure, Plan
from planning.timing.options import TimingOptions
from planning.tool_motions.timed_tool_motions import TimedToolMotions
from planning.tool_motions.tool_motion import line
from planning.tool_motions.tool_path import Tolerances, ToolRun
from planning.tool_motions.tool_tolerance import SeamOptions, SeamWaypoint, ToolTolerance
from planning.tool_paths.tool_following import follow
from planning.values.deadline import Deadline
from tests.planning.pinocchio_arm import PinocchioArm
from tests.planning.scenes import HOME, box, builtin, planned_motion, planning_failure

SPATIAL = ["panda", "ur5e", "iiwa14", "kr6_sixx", "puma560", "stanford", "elbow_wrist"]
FREE = Tolerances(1e-4, None)


def options(method: str = "toppra", more: dict[str, Any] | None = None, **asked: Any) -> Options:
    timing = TimingOptions(method, **(more or {}))  # type: ignore[arg-type]
    return Options(
        planner="cartesian", cartesian=CartesianOptions(**asked), timing=timing, timeout=30.0
    )


def moved(T: np.ndarray, shift: list[float], turn: list[float] | None = None) -> np.ndarray:
    """A pose shifted, and turned about its own origin, in the base frame."""
    R = from_rpy(turn) @ T[:3, :3] if turn is not None else T[:3, :3]
    return transform(R, T[:3, 3] + shift)


def led(problem: Problem, how: Options) -> Plan:
    answer = planned_motion(problem, how)
    assert answer.certificate.verified
    limits = problem.robot.chain.limits
    times = np.linspace(0.0, answer.trajectory.duration, 500)
    for order, bound in ((1, limits.velocity), (2, limits.acceleration)):
        assert (np.abs(answer.trajectory.sample(times, order)) <= bound * (1.0 + 1e-9)).all()
    deviation = answer.certificate.path_deviation
    assert deviation is not None
    assert deviation.position <= how.cartesian.max_deviation
    assert np.abs(answer.trajectory.sample([0.0, answer.trajectory.duration], 1)).max() < 1e-9
    return answer


def off_line(poses: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Distances of poses from a segment [m], and from slerp's orientations there [rad]."""
    poses = poses.reshape(-1, 4, 4)
    along = end[:3, 3] - start[:3, 3]
    away = poses[:, :3, 3] - start[:3, 3]
    s = np.clip(away @ along / (along @ along), 0.0, 1.0)[:, None]
    turn = Rotation.from_matrix(end[:3, :3] @ start[:3, :3].T).as_rotvec()
    R = Rotation.from_rotvec(s * turn) * Rotation.from_matrix(start[:3, :3])
    error = (R.inv() * Rotation.from_matrix(poses[:, :3, :3])).magnitude()
    return np.column_stack([np.linalg.norm(away - s * along, axis=1), error])


def dense(trajectory: Trajectory, count: int = 800) -> np.ndarray:
    return np.asarray(trajectory.sample(np.linspace(0.0, trajectory.duration, count)))


@pytest.mark.parametrize("name", SPATIAL)
@pytest.mark.parametrize("method", ["toppra", "jerk_limited"])
def test_lines_of_many_arms_are_straight(name: str, method: str) -> None:
    """Between two poses that an arm reaches in one branch it goes straight, proved."""
    robot = robot_geometry(builtin_chain(name))
    chain = robot.chain
    low, high = chain.sampling_bounds()
    random = np.random.default_rng(5)
    done = 0.0
    while done < 2:
        q = low + (high - low) * random.uniform(0.3, 0.7, chain.n)
        ends = np.clip(q + random.uniform(-0.3, 0.3, chain.n), low, high)
        T, T_end = forward(chain, q), forward(chain, ends)
        problem = Problem(robot, Scene(), q, (PoseGoal(T_end),))
        answer = plan(problem, options(method))
        if isinstance(answer, Failure):
            assert answer.details["reason"] in {"limit", "unreachable", "singularity"}
            done += 0.5
            continue
        led(problem, options(method))
        done += 1
        assert answer.fraction == 1.0
        deviation = answer.certificate.path_deviation
        assert deviation is not None
        errors = off_line(forward(chain, dense(answer.trajectory)), T, T_end)
        assert errors[:, 0].max() <= deviation.position + 1e-12
        assert errors[:, 1].max() <= float(deviation.orientation or 0.0) + 1e-9
        # Sharp: not some bound, but about what is reached, or a tenth of what is allowed.
        assert deviation.position <= max(1.3 * errors[:, 0].max(), 1.01e-5)


@pytest.mark.parametrize("name", ["scara", "planar_rr"])
def test_arms_with_fewer_joints(name: str) -> None:
    """A SCARA keeps its tool upright; two joints lead the tool's origin alone."""
    robot = robot_geometry(builtin_chain(name))
    chain = robot.chain
    q = np.array([0.3, 0.9, 0.05, 0.2]) if name == "scara" else np.array([0.3, 1.2])
    free = name == "planar_rr"
    T = forward(chain, q)
    T_end = moved(T, [-0.1, 0.15, 0.02], [0.0, 0.0, 0.5])
    if free:
        T_end = forward(chain, np.array([-0.2, 1.9]))
    how = options(orientation="free" if free else "slerp", more={"tool_speed": 0.25})
    answer = led(Problem(robot, Scene(), q, (PoseGoal(T_end),)), how)
    poses = forward(chain, dense(answer.trajectory))
    errors = off_line(poses, T, T_end).max(axis=0)
    assert errors[0] <= 1e-4
    assert answer.certificate.limits["tool_speed"].worst_ratio <= 1.0 + 1e-9
    if not free:
        assert errors[1] <= 1e-3
    else:
        assert answer.certificate.path_deviation is not None
        assert answer.certificate.path_deviation.orientation is None


@pytest.mark.parametrize("method", ["toppra", "spline", "jerk_limited"])
def test_a_line_an_arc_and_a_full_circle(method: str) -> None:
    robot, chain = builtin("panda"), builtin_chain("panda")
    T = forward(chain, HOME)
    center = T[:3, 3] + [0.0, 0.1, 0.0]
    half = moved(T, [0.0, 0.2, 0.0])
    motions = (
        ToolMotionOptions("circ", half, via=(center + 0.1 * np.eye(3)[0]).tolist()),
        ToolMotionOptions("lin", T),
        ToolMotionOptions("circ", T, center=center.tolist(), normal=[0.0, 0.0, 1.0]),
    )
    problem = Problem(robot, Scene(), HOME, (PoseGoal(T),))
    allowed = 1e-4 if method != "spline" else 1e-3
    answer = led(problem, options(method, motions=motions, max_deviation=allowed))
    reports = answer.tool_motions
    assert [item.kind for item in reports] == ["circ", "lin", "circ"]
    assert reports[2].length == pytest.approx(0.2 * np.pi)
    assert reports[-1].ends == pytest.approx(answer.trajectory.duration)
    for item in (reports[0], reports[2]):
        times = np.linspace(item.begins, item.ends, 300)
        tool = forward(chain, answer.trajectory.sample(times))[:, :3, 3] - center
        assert np.abs(np.linalg.norm(tool[:, :2], axis=1) - 0.1).max() <= allowed
        assert np.abs(tool[:, 2]).max() <= allowed
        angles = np.unwrap(np.arctan2(tool[:, 1], tool[:, 0]))
        swept = np.pi if item is reports[0] else 2.0 * np.pi
        assert angles[-1] - angles[0] == pytest.approx(swept, abs=1e-2)
        assert (np.diff(angles) > -1e-6).all()
    # Corners are met: the tool is at rest where one motion ends.
    for item in reports:
        assert np.abs(answer.trajectory.sample([item.ends], 1)).max() < 1e-9


def test_an_arm_stops_where_it_can_reach_no_farther() -> None:
    """Closed form: two links of known length reach their sum, and no farther."""
    robot = robot_geometry(builtin_chain("planar_rr"))
    chain = robot.chain
    q = np.array([0.4, 1.0])
    reach = float(np.linalg.norm(forward(chain, np.array([0.4, 0.0]))[:3, 3]))
    T = forward(chain, q)
    direction = T[:3, 3] / np.linalg.norm(T[:3, 3])
    T_end = transform(T[:3, :3], direction * 1.5 * reach)
    problem = Problem(robot, Scene(), q, (PoseGoal(T_end),))
    answer = planning_failure(problem, options(orientation="free"))
    assert (answer.code, answer.stage) == ("PLANNING_FAILED", "cartesian")
    assert answer.details["reason"] == "unreachable"
    begun = float(np.linalg.norm(T[:3, 3]))
    share = (reach - begun) / (1.5 * reach - begun)
    assert answer.details["fraction"] == pytest.approx(share, abs=2e-4)
    assert answer.details["fraction"] <= share
    nearest = answer.details["nearest"]
    np.testing.assert_allclose(
        forward(chain, np.array(nearest["joints"]))[:3, 3], nearest["pose"]["position"], atol=1e-9
    )
    partial = led(problem, options(orientation="free", allow_partial=True))
    assert partial.fraction == pytest.approx(answer.details["fraction"])
    assert partial.stopped is not None
    assert partial.stopped["reason"] == "unreachable"
    assert partial.tool_motions[0].fraction == partial.fraction
    end = forward(chain, partial.trajectory.end)[:3, 3]
    np.testing.assert_allclose(end, nearest["pose"]["position"], atol=1e-4)


def test_a_limit_is_told_by_its_joint() -> None:
    robot = robot_geometry(builtin_chain("scara"))
    chain = robot.chain
    q = np.array([0.3, 0.9, 0.05, 0.2])
    T = forward(chain, q)
    sign = float(np.sign(T[2, 3] - forward(chain, np.array([0.3, 0.9, 0.06, 0.2]))[2, 3]))
    low = float(chain.limits.lower[2])
    problem = Problem(robot, Scene(), q, (PoseGoal(moved(T, [0, 0, sign * 0.5])),))
    answer = planning_failure(problem, options())
    assert answer.details["reason"] == "limit"
    assert answer.details["joint"] == chain.joint_names[2]
    assert answer.details["limit"] == low
    # It moves a metre a metre, so it gets as far as its limit.
    assert answer.details["fraction"] == pytest.approx((0.05 - low) / 0.5, abs=1e-3)


@pytest.mark.parametrize("method", ["toppra", "jerk_limited"])
def test_through_a_wrist_singularity(method: str) -> None:
    """The wrist of the KR 6 goes straight through its singularity: one joint turns through 0."""
    robot = robot_geometry(builtin_chain("kr6_sixx"))
    chain = robot.chain
    middle = np.array([0.2, -1.2, 1.5, 0.0, 0.0, 0.3])
    values = np.linalg.svd(geometric(chain, middle), compute_uv=False)
    assert values[-1] < 1e-9
    q = middle + np.array([0.0, 0.05, 0.1, 0.0, 0.3, 0.0])
    T, T_middle = forward(chain, q), forward(chain, middle)
    # On through the middle and as far again, about the same axis.
    turn = Rotation.from_matrix(T_middle[:3, :3] @ T[:3, :3].T).as_rotvec()
    R_end = Rotation.from_rotvec(turn).as_matrix() @ T_middle[:3, :3]
    T_end = transform(R_end, 2.0 * T_middle[:3, 3] - T[:3, 3])
    answer = led(Problem(robot, Scene(), q, (PoseGoal(T_end),)), options(method))
    assert answer.trajectory.end[4] < -0.1, "the wrist is bent the other way"
    assert np.abs(answer.trajectory.end[[3, 5]] - q[[3, 5]]).max() < 1e-3, "and does not flip"


def test_what_is_in_the_way_is_named() -> None:
    robot = builtin("panda")
    T = forward(robot.chain, HOME)
    T_end = moved(T, [0.0, 0.4, 0.0])
    at = T[:3, 3]
    scene = Scene((box("wall", (0.4, 0.02, 0.4), (at[0], at[1] + 0.3, at[2])),))
    problem = Problem(robot, scene, HOME, (PoseGoal(T_end),))
    answer = planning_failure(problem, options())
    assert answer.details["reason"] == "collision"
    assert "wall" in answer.details["pair"]
    assert 0.2 < answer.details["fraction"] < 0.73
    partial = led(problem, options(allow_partial=True))
    assert partial.fraction is not None
    assert partial.fraction == pytest.approx(answer.details["fraction"])
    # As near as the slack of planning.
    assert 0.0 < partial.certificate.min_clearance < 5e-4
    end = forward(robot.chain, partial.trajectory.end)[:3, 3]
    assert (end - at)[1] == pytest.approx(0.4 * partial.fraction, abs=1e-4)
    planned_motion(Problem(robot, Scene(), HOME, (PoseGoal(T_end),)), options())


def test_a_goal_in_joints_is_met_in_its_branch_or_refused() -> None:
    robot = robot_geometry(builtin_chain("ur5e"))
    q = np.array([0.1, -1.2, 1.4, -1.6, -1.5, 0.2])
    end = q + np.array([0.2, 0.1, -0.1, 0.05, 0.1, 0.0])
    answer = led(Problem(robot, Scene(), q, (JointGoal(end),)), options())
    np.testing.assert_allclose(answer.trajectory.end, end, atol=1e-5)
    other = next(
        joints
        for joints in branches(robot.chain, forward(robot.chain, end)).joints
        if np.abs(joints - end).max() > 0.5
    )
    refused = planning_failure(Problem(robot, Scene(), q, (JointGoal(np.array(other)),)), options())
    assert refused.details["reason"] == "branch"


def test_no_motion_and_a_turn_on_the_spot() -> None:
    robot = builtin("panda")
    T = forward(robot.chain, HOME)
    still = led(Problem(robot, Scene(), HOME, (PoseGoal(T),)), options())
    assert still.fraction == 1.0
    assert still.trajectory.duration < 0.1
    T_end = moved(T, [0, 0, 0], [0.0, 0.5, 0.3])
    answer = led(Problem(robot, Scene(), HOME, (PoseGoal(T_end),)), options())
    tool = forward(robot.chain, dense(answer.trajectory))
    assert np.linalg.norm(tool[:, :3, 3] - T[:3, 3], axis=1).max() <= 1e-4
    axis = Rotation.from_matrix(T_end[:3, :3] @ T[:3, :3].T).as_rotvec()
    turns = Rotation.from_matrix(tool[:, :3, :3] @ T[:3, :3].T).as_rotvec()
    across = np.linalg.norm(np.cross(turns, axis / np.linalg.norm(axis)), axis=1)
    assert across.max() <= 1e-3


def test_the_proof_finds_what_is_off() -> None:
    """Another path between the same ends: the deviation it tells is the one of closed form."""
    chain = builtin_chain("panda")
    T = forward(chain, HOME)
    found = follow(
        chain, ToolRun.of(line(T, moved(T, [0, 0.3, 0]))), HOME, FREE, Deadline.after(10.0)
    )
    ends = np.stack([found.start, found.end])
    c = np.stack([ends[0], ends[1] - ends[0]], axis=-1)[None]
    straight = Trajectory(chain.joint_names, np.array([0.0, 1.0]), c)
    T_end = forward(chain, found.end)
    tight = TimedToolMotions((line(T, T_end),), np.array([0.0, 1.0]), 1e-4)
    deviation = path_deviation(chain, straight, tight)
    assert not deviation.verified
    wide = path_deviation(chain, straight, replace(tight, max_position=0.5))
    most = float(off_line(forward(chain, dense(straight, 4000)), T, T_end)[:, 0].max())
    assert wide.verified
    assert most <= wide.position <= max(1.26 * most, 0.051)


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
