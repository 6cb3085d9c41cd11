"""Real problems, each with what its motion is held to in words that the judge understands."""

import io
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
import pinocchio as pin
import trimesh

from kinematics.arrays import Array
from kinematics.model.dh import DhRow, DhTable, chain_from_dh
from kinematics.pose import transform
from kinematics.robots import builtin_urdf
from kinematics.tree.serial_chain import serial_chain
from kinematics.urdf.urdf import parse_urdf
from obstacles.robots.robot_geometry import RobotGeometry, robot_geometry
from obstacles.scenes.scene import Scene
from obstacles.shapes.shape import Cylinder
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.kinds.constraint import (
    ConeConstraint,
    Constraint,
    PlaneRegion,
    PositionConstraint,
    ToolSpeedConstraint,
    TorqueConstraint,
)
from planning.options import CartesianOptions, Options
from planning.problem import JointGoal, PoseGoal, Problem
from planning.timing.options import TimingOptions
from planning.values.preferences import PreferredClearance
from tests.planning.proof.sabotage.judge import Arm, Residual, Truth
from tests.planning.scenes import HOME, box, builtin, pillar

#: Seconds that a plan may take; none takes one, but machines are busy.
TIMEOUT = 60.0


@dataclass(frozen=True)
class Case:
    """A problem, how it is to be planned, and what the judge holds its motion to.

    Args:
        arm: The robot for the judge.
        problem: The problem.
        options: How to plan it.
        truth: What its motion is held to.
    """

    arm: Arm
    problem: Problem
    options: Options
    truth: Truth


def case(name: str) -> Case:
    """A case by its name."""
    return _CASES[name]()


def names() -> tuple[str, ...]:
    """Names of all cases."""
    return tuple(_CASES)


# ------------------------------------------------------------------------------------ the robots


@cache
def _arm(name: str) -> Arm:
    robot = builtin(name)
    return Arm(
        builtin_urdf(name), robot.chain.joint_names, robot.chain.tip_link, frozenset(robot.allowed)
    )


#: A shoulder, an elbow and a wrist turning about z, y, y: rows (a, alpha, d) of a standard table.
_DH = ((0.0, -0.5 * np.pi, 0.4), (0.4, 0.0, 0.0), (0.35, 0.0, 0.0))
_DH_RADIUS = 0.04
_DH_LIMITS = {"lower": -2.9, "upper": 2.9, "velocity": 2.0, "acceleration": 8.0}


@cache
def _dh_robot() -> RobotGeometry:
    """The robot of the table, with a cylinder along each of its arms."""
    rows = tuple(DhRow("revolute", a=a, alpha=alpha, d=d, **_DH_LIMITS) for a, alpha, d in _DH)
    chain = chain_from_dh("elbow_dh", DhTable("standard", rows))
    along = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    pieces = []
    for i in (1, 2):
        a = _DH[i][0]
        T = chain.link(f"link_{i + 1}").T_joint_link @ transform(along, [-0.5 * a, 0.0, 0.0])
        pieces += [piece.placed(T) for piece in Cylinder(_DH_RADIUS, 0.8 * a).pieces()]
    links, joints = ("link_2", "link_3"), np.array([1, 2])
    return RobotGeometry(chain, tuple(pieces), links, joints, np.array([0, 1]), {})


@cache
def _dh_arm() -> Arm:
    """The description that the table is equal to: joint i + 1 lies at Tz(d) Tx(a) Rx(alpha)."""
    text, origin = '<robot name="elbow_dh"><link name="base"/>', 'xyz="0 0 0"'
    parent = "base"
    for i, (a, alpha, d) in enumerate(_DH, 1):
        solid = ""
        if a > 0.0:
            solid = (
                f'<collision><origin xyz="{0.5 * a} 0 {d}" rpy="0 {0.5 * np.pi} 0"/><geometry>'
                f'<cylinder radius="{_DH_RADIUS}" length="{0.8 * a}"/></geometry></collision>'
            )
        text += (
            f'<link name="link_{i}">{solid}</link>'
            f'<joint name="joint_{i}" type="revolute"><origin {origin}/><axis xyz="0 0 1"/>'
            f'<parent link="{parent}"/><child link="link_{i}"/>'
            '<limit lower="-2.9" upper="2.9" velocity="2" effort="100"/></joint>'
        )
        parent, origin = f"link_{i}", f'xyz="{a} 0 {d}" rpy="{alpha} 0 0"'
    text += (
        f'<link name="tool"/><joint name="end" type="fixed"><origin {origin}/>'
        f'<parent link="{parent}"/><child link="tool"/></joint></robot>'
    )
    return Arm(text, _dh_robot().chain.joint_names, "tool", frozenset())


_HOOK = "hook.stl"


def _hook() -> trimesh.Trimesh:
    """A U of one body in the plane of x and z, open towards +z."""
    parts = [((0.3, 0.06, 0.04), (0.0, 0.0, 0.0))]
    parts += [((0.04, 0.06, 0.3), (x, 0.0, 0.13)) for x in (-0.13, 0.13)]
    solids = []
    for size, center in parts:
        solid = trimesh.creation.box(size)
        solid.apply_translation(center)
        solids.append(solid)
    return trimesh.util.concatenate(solids)


_HOOK_TEXT = (
    '<robot name="hook"><link name="base"/><link name="arm"/><link name="hand"><collision>'
    f'<geometry><mesh filename="{_HOOK}"/></geometry></collision></link>'
    '<joint name="turn" type="revolute"><axis xyz="0 0 1"/><parent link="base"/>'
    '<child link="arm"/><limit lower="-3" upper="3" velocity="2" acceleration="8" effort="1"/>'
    '</joint><joint name="lift" type="prismatic"><origin xyz="0.6 0 0.2"/><axis xyz="0 0 1"/>'
    '<parent link="arm"/><child link="hand"/>'
    '<limit lower="0" upper="0.8" velocity="1" acceleration="4" effort="1"/></joint></robot>'
)


@cache
def _hook_robot() -> RobotGeometry:
    """A hand of a mesh that is not convex, which turns about the base and goes up and down."""
    description = parse_urdf(_HOOK_TEXT)
    data = bytes(_hook().export(file_type="stl"))
    return robot_geometry(serial_chain(description), description, {_HOOK: data})


@cache
def _hook_arm() -> Arm:
    chain = _hook_robot().chain
    solid = trimesh.load(
        io.BytesIO(bytes(_hook().export(file_type="stl"))), file_type="stl", force="mesh"
    )
    meshes = {_HOOK: (np.array(solid.vertices), np.array(solid.faces))}
    return Arm(_HOOK_TEXT, chain.joint_names, chain.tip_link, frozenset(), meshes)


# ---------------------------------------------------------------------------------- the problems

_ASIDE = np.array([1.2, -0.3, 0.0, -2.0, 0.0, 1.8, 0.785])
_POST = pillar(0.6, 0.505)
_UR_START = np.array([-0.6, -1.2, 1.6, -1.97, -1.57, 0.0])
_UR_GOAL = np.array([0.7, -1.2, 1.6, -1.97, -1.57, 0.0])
_UR_LOWER = np.array([0.7, -0.8, 1.2, -1.97, -1.57, 0.0])
_WALL = Scene((box("wall", (0.3, 0.06, 0.5), (-0.45, -0.1, 0.25)),))
_ELBOW_START = np.array([-0.7, 0.6, 0.5, 0.0, 0.9, 0.0])
_ELBOW_GOAL = np.array([0.7, 0.6, 0.5, 0.0, 0.9, 0.0])
#: About the fingers where Panda is at home.
_BRICK = Scene((box("brick", (0.04, 0.04, 0.04), (0.3, 0.0, 0.5)),))
_FOLDED = np.array([2.8, 1.2, 0.8, -0.8, 0.7, 1.2, 0.5])
_UNFOLDED = np.array([2.4, -1.3, -0.7, -0.1, 2.8, 0.3, -2.2])


@dataclass(frozen=True)
class _Request:
    """What a case asks for beyond start and goal.

    Args:
        margin: Distance to keep from obstacles [m].
        timing: Options of the timing.
        limits: Joint limits in place of the robot's, by quantity.
        constraints: Of the path.
        residual: Largest violation of the constraints at a pose of the tool, at most 0 if held.
        tool_speed: Limit of the tool's speed that constraints ask for [m/s].
        planner: Name of the planner.
        seed: Of the planner's random numbers.
    """

    margin: float = 0.0
    timing: TimingOptions | None = None
    limits: Mapping[str, Array] = field(default_factory=dict)
    constraints: tuple[Constraint, ...] = ()
    residual: Residual | None = None
    tool_speed: float | None = None
    planner: str = "auto"
    seed: int = 0


_PLAIN = _Request()


def _joint_case(
    arm: Arm,
    robot: RobotGeometry,
    scene: Scene,
    start: Array,
    goal: Array,
    asked: _Request = _PLAIN,
) -> Case:
    how, constraints, margin = (
        asked.timing or TimingOptions("toppra"),
        asked.constraints,
        asked.margin,
    )
    wanted = ConstraintSet(robot.chain, constraints) if constraints else None
    problem = Problem(robot, scene, start, (JointGoal(goal),), margin=margin, constraints=wanted)
    options = Options(
        planner=asked.planner,
        timing=how,
        limits=dict(asked.limits),
        timeout=TIMEOUT,
        seed=asked.seed,
        clearance=PreferredClearance(0.0),  # motions that graze, so that a lie matters
    )
    torques = how.torque_limits or any(isinstance(c, TorqueConstraint) for c in constraints)
    truth = Truth(
        scene,
        start,
        _derivatives(robot, how, asked.limits),
        margin,
        effort=_effort(robot, asked.limits) if torques else None,
        tool_speed=asked.tool_speed if asked.tool_speed is not None else how.tool_speed,
        residual=asked.residual,
    )
    return Case(arm, problem, options, truth)


def _derivatives(
    robot: RobotGeometry, how: TimingOptions, limits: Mapping[str, Array]
) -> dict[int, Array]:
    """Limits by the order of the derivative; of jerk where the method holds it."""
    own = robot.chain.limits
    kinds = ["velocity", "acceleration"] + (["jerk"] if how.method == "jerk_limited" else [])
    return {i: np.array(limits.get(name, getattr(own, name))) for i, name in enumerate(kinds, 1)}


def _effort(robot: RobotGeometry, limits: Mapping[str, Array]) -> Array:
    return np.array(limits.get("effort", robot.chain.limits.effort))


def _of(name: str, scene: Scene, start: Array, goal: Array, **more: Any) -> Callable[[], Case]:
    return lambda: _joint_case(_arm(name), builtin(name), scene, start, goal, _Request(**more))


def _line_case(
    start: Array, shift: tuple[float, float, float], scene: Scene, timing: TimingOptions
) -> Case:
    """Panda's tool led straight by a shift in the base frame, with its orientation kept."""
    arm, robot = _arm("panda"), builtin("panda")
    T = arm.moving.pose(start)
    T_end = T.copy()
    T_end[:3, 3] += shift
    how = CartesianOptions(max_deviation=1e-5, max_orientation_deviation=1e-3)
    options = Options(planner="cartesian", cartesian=how, timing=timing, timeout=TIMEOUT)
    problem = Problem(robot, scene, start, (PoseGoal(T_end),))
    along = np.array(shift)
    length = float(along @ along)

    def deviation(tool: Array) -> float:
        away = tool[:3, 3] - T[:3, 3]
        s = np.clip(away @ along / length, 0.0, 1.0) if length > 0.0 else 0.0
        off = float(np.linalg.norm(away - s * along)) - how.max_deviation
        turned = float(np.linalg.norm(pin.log3(T[:3, :3].T @ tool[:3, :3])))
        return max(off, turned - how.max_orientation_deviation)

    limits = _derivatives(robot, timing, {})
    return Case(arm, problem, options, Truth(scene, start, limits, deviation=deviation))


#: Half the opening of the cone that keeps the tool upright [rad].
_TILT = np.radians(10.0)
_UP, _DOWN = np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, -1.0])
_UPRIGHT = ConeConstraint(_UP, _DOWN, _TILT)
#: Panda's tool points down in both; the straight joint motion between them tilts it by 20 degrees.
_UPRIGHT_START = np.array([-0.404, 0.422, -0.263, -1.852, -0.043, 2.267, 0.785])
_UPRIGHT_GOAL = np.array([0.26, -0.577, 1.176, -1.466, 0.577, 1.408, 0.785])


def _tilt(tool: Array) -> float:
    return float(np.arccos(np.clip(-tool[2, 2], -1.0, 1.0)) - _TILT)


#: Height of UR5e's tool in both, and how far it may be off that in between [m]. Halfway along the
#: straight joint motion it is off by 6 mm, a quarter of the way by 37 mm.
_HEIGHT, _THICKNESS = 0.662, 0.02
_LEVEL_START = np.array([1.07, -0.5, 0.04, -3.33, -2.35, 1.46])
_LEVEL_GOAL = np.array([-0.94, -0.82, -0.06, -0.06, -0.76, 1.42])
_LEVEL = PositionConstraint(PlaneRegion([0.0, 0.0, _HEIGHT], _UP, _THICKNESS))


def _off_level(tool: Array) -> float:
    return float(abs(tool[2, 3] - _HEIGHT) - _THICKNESS)


_SPEED = 0.25
_CASES: dict[str, Callable[[], Case]] = {
    "panda around a post": _of("panda", _POST, HOME, _ASIDE),
    "panda around a post, jerk limited": _of(
        "panda", _POST, HOME, _ASIDE, timing=TimingOptions("jerk_limited")
    ),
    "panda around a post, by splines": _of(
        "panda", _POST, HOME, _ASIDE, timing=TimingOptions("spline")
    ),
    "panda past a post with a margin": _of(
        "panda", pillar(0.6, 0.56), HOME, _ASIDE, margin=0.05
    ),
    "panda unfolding": _of("panda", Scene(), _FOLDED, _UNFOLDED),
    "ur5e around a wall": _of("ur5e", _WALL, _UR_START, _UR_GOAL, seed=1),
    "ur5e around a wall, by random trees": _of(
        "ur5e", _WALL, _UR_START, _UR_GOAL, planner="rrt_connect"
    ),
    "panda around a post another way": _of("panda", _POST, HOME, _ASIDE, seed=3),
    "ur5e around a wall another way": _of("ur5e", _WALL, _UR_START, _UR_GOAL, seed=2),
    "elbow around a post another way": _of(
        "elbow_wrist", pillar(0.0, 0.5), _ELBOW_START, _ELBOW_GOAL, seed=1
    ),
    "elbow around a post": _of("elbow_wrist", pillar(0.0, 0.5), _ELBOW_START, _ELBOW_GOAL),
    "dh arm around a post": lambda: _joint_case(
        _dh_arm(), _dh_robot(), pillar(0.0, 0.55), np.array([-0.8, -0.6, 0.9]),
        np.array([0.8, -0.6, 0.9]),
    ),
    "hook over a bar": lambda: _joint_case(
        _hook_arm(), _hook_robot(), Scene((box("bar", (0.4, 0.04, 0.1), (0.6, 0.0, 0.3)),)),
        np.array([-1.0, 0.05]), np.array([1.0, 0.05]), _Request(seed=1),
    ),
    "ur5e with weak joints": _of(
        "ur5e", Scene(), _UR_START, _UR_LOWER,
        timing=TimingOptions("toppra", torque_limits=True),
        limits={"effort": np.array([9.0, 60.0, 25.0, 5.0, 5.0, 5.0])},
    ),
    "ur5e with weak joints, by splines": _of(
        "ur5e", Scene(), _UR_START, _UR_LOWER,
        timing=TimingOptions("spline", torque_limits=True),
        limits={"effort": np.array([6.0, 60.0, 25.0, 5.0, 5.0, 5.0])},
    ),
    "ur5e with a slow tool": _of(
        "ur5e", Scene(), _UR_START, _UR_GOAL, timing=TimingOptions("toppra", tool_speed=_SPEED)
    ),
    "panda with a slow tool, jerk limited": _of(
        "panda", Scene(), HOME, _ASIDE, timing=TimingOptions("jerk_limited", tool_speed=_SPEED)
    ),
    "ur5e with constraints on speed and torque": _of(
        "ur5e", Scene(), _UR_START, _UR_GOAL, tool_speed=_SPEED,
        constraints=(ToolSpeedConstraint(_SPEED), TorqueConstraint()),
    ),
    "panda upright": _of(
        "panda", Scene(), _UPRIGHT_START, _UPRIGHT_GOAL, constraints=(_UPRIGHT,), residual=_tilt
    ),
    "ur5e level": _of(
        "ur5e", Scene(), _LEVEL_START, _LEVEL_GOAL, constraints=(_LEVEL,), residual=_off_level
    ),
    "panda along a blocked line": lambda: _line_case(
        HOME, (0.05, 0.35, -0.2), Scene((box("brick", (0.1, 0.1, 0.1), (0.35, 0.2, 0.4)),)),
        TimingOptions("toppra"),
    ),
    "panda straight through a post": _of(
        "panda", _POST, HOME, _ASIDE, planner="straight_line"
    ),
    "panda starting in a box": _of("panda", _BRICK, HOME, _ASIDE, planner="straight_line"),
    "panda ending in a box": _of("panda", _BRICK, _ASIDE, HOME, planner="straight_line"),
    "panda along a line": lambda: _line_case(
        HOME, (0.05, 0.35, -0.2), Scene(), TimingOptions("toppra")
    ),
    "panda along a line, by splines": lambda: _line_case(
        HOME, (0.05, 0.35, -0.2), Scene(), TimingOptions("spline")
    ),
}  # fmt: skip
