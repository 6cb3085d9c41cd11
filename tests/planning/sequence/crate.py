"""A crate on a table beside a wall, and the stages that carry it over: what the tests plan."""

from functools import cache

import numpy as np

import armwright as aw
from kinematics.arrays import Array
from obstacles.robots.robot_geometry import RobotGeometry
from planning.problem import JointGoal
from planning.sequence.result import SequenceFailure, SequencePlan, TaskOptions
from planning.sequence.search import plan_task
from planning.sequence.stage import (
    Attach,
    Detach,
    Grasp,
    Gripper,
    Load,
    Move,
    Place,
    Stage,
    StageSettings,
    Straight,
)
from planning.sequence.target import grasp_region, place_region
from planning.sequence.task import Task
from planning.sequence.world import World

HOME = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
DOWN = np.diag([1.0, -1.0, -1.0, 1.0])
PICK, PLACE = (0.5, -0.25), (0.5, 0.25)


@cache
def panda() -> RobotGeometry:
    """The Panda with its hand."""
    return aw.load_robot("panda")


def scene(*more: aw.Obstacle) -> aw.Scene:
    """The table, the wall, the crate and perhaps more."""
    return aw.Scene(
        [
            aw.Obstacle("table", aw.Box((0.6, 1.0, 0.04)), aw.pose([0.6, 0.0, 0.08])),
            aw.Obstacle("wall", aw.Box((0.4, 0.03, 0.15)), aw.pose([0.6, 0.0, 0.175])),
            aw.Obstacle("crate", aw.Box((0.05, 0.05, 0.1)), aw.pose([*PICK, 0.15])),
            *more,
        ]
    )


def world(*more: aw.Obstacle) -> World:
    """The Panda before the table, holding nothing."""
    return World(panda(), scene(*more))


def grasps(count: int = 18) -> Array:
    """Grasps from above, all around."""
    top = aw.pose([0.0, 0.0, 0.02]) @ DOWN
    return grasp_region(top, (0.0, 0.0, 1.0), (0.0, 2.0 * np.pi), samples=(count, 1))


def places(count: int = 12) -> Array:
    """Poses of the crate behind the wall, turned by any angle."""
    at = aw.pose([*PLACE, 0.15])
    return place_region(at, (0.0, 0.0), (0.0, 2.0 * np.pi), samples=(1, 1, count))


def stages(grips: Array | None = None, poses: Array | None = None) -> tuple[Stage, ...]:
    """Pick the crate, place it behind the wall and go home."""
    return (
        Move(),
        Straight("approach", [0, 0, 1], "tool", 0.05, 0.1),
        Grasp(
            "crate", grasps() if grips is None else grips, ("panda_hand",), "table",
            StageSettings("pick"),
        ),
        Gripper("close"),
        Attach("crate", load=Load(0.4)),
        Straight("lift", [0, 0, 1], "root", 0.05, 0.15),
        Move(),
        Straight("approach", [0, 0, -1], "root", 0.05, 0.1),
        Place(None, places() if poses is None else poses, support="table"),
        Gripper("open"),
        Detach(),
        Straight("retreat", [0, 0, -1], "tool", 0.05, 0.1),
        Move((JointGoal(HOME),)),
    )  # fmt: skip


@cache
def plan() -> SequencePlan:
    """The whole task, planned."""
    answer = plan_task(Task(world(), HOME, stages()), TaskOptions(30.0))
    assert isinstance(answer, SequencePlan)
    return answer


def planned_task(task: Task, options: TaskOptions) -> SequencePlan:
    """A plan of a task where one is expected."""
    answer = plan_task(task, options)
    assert isinstance(answer, SequencePlan), answer
    return answer


def task_failure(task: Task, options: TaskOptions) -> SequenceFailure:
    """A failure of a task where one is expected."""
    answer = plan_task(task, options)
    assert isinstance(answer, SequenceFailure)
    return answer
