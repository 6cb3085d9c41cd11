"""A bench with pegs and a chuck, and the work on it: what tests of tasks and programs plan."""

from functools import cache

import numpy as np

import armwright as aw
from kinematics.pose import transform
from planning.options import CartesianOptions, Options, ToolMotionOptions
from planning.sequence.stage import Follow, Into, Signal, Stage, StageSettings
from planning.tool_motions.tool_tolerance import SeamOptions, SeamWaypoint, ToolTolerance

HOME = np.array([0.0, -1.4, 1.5, -1.67, -1.57, 0.0])
Z = np.array([0.0, 0.0, 1.0])
DOWN = np.diag([1.0, -1.0, -1.0])


@cache
def arm() -> aw.RobotGeometry:
    """The UR5e alone."""
    return aw.load_robot("ur5e")


@cache
def gripping() -> aw.RobotGeometry:
    """The UR5e with jaws."""
    return aw.mount(arm(), aw.built_in_tool("parallel_jaw", "jaw"))


@cache
def deburring() -> aw.RobotGeometry:
    """The UR5e with a spindle."""
    return aw.mount(arm(), aw.built_in_tool("spindle", "spindle"))


def down(x: float, y: float, z: float, turn: float = 0.0) -> np.ndarray:
    """A pose of the tool that points down."""
    c, s = np.cos(turn), np.sin(turn)
    return transform(np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ DOWN, [x, y, z])


def scene() -> aw.Scene:
    """The bench, a peg on it, a block to deburr and a chuck of four walls, open at the top."""
    chuck = [
        aw.Obstacle(f"chuck_{k}", aw.Box(size), aw.pose([0.45 + x, -0.25 + y, 0.05]))
        for k, (x, y, size) in enumerate(
            [(0.03, 0, (0.02, 0.08, 0.06)), (-0.03, 0, (0.02, 0.08, 0.06)),
             (0, 0.03, (0.04, 0.02, 0.06)), (0, -0.03, (0.04, 0.02, 0.06))]
        )
    ]  # fmt: skip
    return aw.Scene(
        [
            aw.Obstacle("bench", aw.Box((0.7, 1.0, 0.04)), aw.pose([0.55, 0.0, 0.0])),
            aw.Obstacle("peg", aw.Cylinder(0.015, 0.12), aw.pose([0.45, 0.2, 0.08])),
            aw.Obstacle("block", aw.Box((0.1, 0.1, 0.08)), aw.pose([0.6, 0.0, 0.06])),
            *chuck,
        ]
    )


def line(*poses: np.ndarray, blend: float = 0.0, **settings: object) -> Follow:
    """A stage of lines through poses of the tool."""
    motions = tuple(ToolMotionOptions("lin", T) for T in poses)
    options = Options(cartesian=CartesianOptions(motions, blend=blend))
    return Follow("line", StageSettings(options=options, **settings))  # type: ignore[arg-type]


def arc(via: list[float], pose: np.ndarray) -> Follow:
    """A stage of an arc through a point."""
    motion = ToolMotionOptions("circ", pose, via=via)
    return Follow("arc", StageSettings(options=Options(cartesian=CartesianOptions((motion,)))))


def seam(*points: list[float]) -> Follow:
    """A seam with a free spin, at 50 mm/s."""
    free = ToolTolerance(np.r_[np.zeros(5), -np.inf], np.r_[np.zeros(5), np.inf])
    waypoints = tuple(SeamWaypoint(down(*p)) for p in points)
    options = Options(cartesian=CartesianOptions(seam=SeamOptions(waypoints, free, 0.05, 0.2)))
    return Follow("seam", StageSettings(options=options))


def work() -> tuple[Stage, ...]:
    """Take the peg, push it into the chuck, say so and wait; then deburr the block."""
    grasps = np.array([transform(DOWN, [0, 0, 0.035])] * 1)
    edge = 0.105
    return (
        aw.Move(),
        aw.Straight("approach", Z, "tool", 0.04, 0.08),
        aw.Grasp("peg", grasps, ("jaw",), ("bench",)),
        aw.Gripper("close", until="contact"),
        aw.Attach("peg", load=aw.Load(0.3)),
        aw.Straight("lift", Z, "normal", 0.05, 0.1),
        aw.Move(),
        aw.Straight("approach", -Z, "support", 0.02, 0.04),
        aw.Place(None, np.array([aw.pose([0.45, -0.25, 0.145])]), support=("chuck_0",)),
        aw.Straight("insert", -Z, "root", 0.02, 0.02, into=Into(("chuck_0", "chuck_1"))),
        Signal("signal", 3, 1.0, 0.2),
        Signal("wait_for", 1),
        aw.Gripper("open"),
        aw.Detach(),
        aw.Straight("retreat", -Z, "tool", 0.05, 0.1),
        aw.Move((aw.JointGoal(HOME),)),
        aw.Move((aw.PoseGoal(down(0.54, -0.06, edge + 0.05)),), settings=StageSettings(
            robot=deburring())),
        line(down(0.54, -0.06, edge), down(0.66, -0.06, edge), down(0.66, 0.06, edge), blend=0.01),
        arc([0.6, 0.08, edge], down(0.54, 0.06, edge)),
        seam([0.54, 0.06, edge], [0.54, -0.06, edge]),
        Signal("set", "spindle", 0.0),
        aw.Straight("retreat", -Z, "tool", 0.05, 0.1),
        aw.Move((aw.JointGoal(HOME),)),
    )  # fmt: skip


@cache
def worked() -> aw.SequencePlan:
    """The whole work, planned."""
    found = aw.plan_task(aw.Task(aw.World(gripping(), scene()), HOME, work()), aw.TaskOptions(60.0))
    assert isinstance(found, aw.SequencePlan), found
    return found
