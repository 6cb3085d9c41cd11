"""Checks of the joints that a task gives, before anything is searched for.

Where the arm stands at the start, and goals that are joints, are known without a search. A goal is
checked with what is known of its surroundings by then: the obstacles that no earlier stage takes
along, the gripper as the stage finds it, and nothing in it. A goal that is wrong so is wrong
whatever the stages before it do.
"""

from dataclasses import replace

from kinematics.arrays import Array
from obstacles.collision.checker import Checker
from obstacles.robots.allowed_pairs import contacts_of
from obstacles.robots.robot_geometry import RobotGeometry, sorted_pair
from obstacles.scenes.scene import Scene
from planning.preflight.goals import find_goals
from planning.preflight.preflight import check_start
from planning.problem import JointGoal, Problem
from planning.result import Failure
from planning.sequence.node import changed, contact_pairs
from planning.sequence.result import SequenceFailure
from planning.sequence.stage import Attach, Gripper, Move, Stage, describe_stage
from planning.sequence.task import Task
from planning.sequence.world import Cells
from planning.values.deadline import Deadline


def check_given_joints(
    task: Task, cells: Cells, deadline: Deadline, *, goals: bool
) -> SequenceFailure | None:
    """The failure of a start, or of goals of a stage, that no search can cure; None where none is.

    Args:
        task: The stages.
        cells: Cells that were put together.
        deadline: Time at which to check no more goals.
        goals: Whether goals are checked too, or the start alone.
    """
    wrong = _start_failure(task, cells)
    if wrong is not None:
        return _told(task, 0, wrong)
    for k, stage in enumerate(task.stages if goals else ()):
        if deadline.passed:
            break
        wrong = _goal_failure(task, k, stage, deadline)
        if wrong is not None:
            return _told(task, k, wrong)
    return None


def _start_failure(task: Task, cells: Cells) -> Failure | None:
    """Fault of the start, as the first stage finds it."""
    first = task.stages[0]
    # Before a gripper moves nothing has changed; what is attached is checked as held.
    world = task.world.entered(first.settings.robot)
    world = world if isinstance(first, Gripper) else changed(world, first, task.start)
    pairs = contacts_of(first.settings.allowed, "request") | contact_pairs(first)
    cell = cells.cell(world, pairs, first.settings.margin)
    goal = (JointGoal(task.start),)
    problem = Problem(cell.robot, cell.scene, task.start, goal, first.settings.margin)
    valid = check_start(problem, cell.checker)
    return valid if isinstance(valid, Failure) else None


def _goal_failure(task: Task, k: int, stage: Stage, deadline: Deadline) -> Failure | None:
    """Fault of all goals of a stage, where they are joints."""
    if not isinstance(stage, Move) or not stage.goals:
        return None
    if not all(isinstance(goal, JointGoal) for goal in stage.goals):
        return None
    if any(isinstance(one, Gripper) and one.until is not None for one in task.stages[:k]):
        return None  # where its fingers are goes by the grasp
    robot, scene = _surroundings(task, k)
    margin = stage.settings.margin
    problem = Problem(robot, scene, task.start, stage.goals, margin)
    found = find_goals(problem, Checker.of(robot, scene, margin), task.start, task.seed, deadline)
    return found if isinstance(found, Failure) else None


def _surroundings(task: Task, k: int) -> tuple[RobotGeometry, Scene]:
    """The robot as a stage finds it, holding nothing, and what stands where it stood."""
    world, taken = task.world, set[str]()
    for stage in task.stages[: k + 1]:
        world = world.entered(stage.settings.robot)
        if isinstance(stage, Gripper) and stage.robot is not None:
            world = world.with_robot(stage.robot)
        if isinstance(stage, Attach):
            taken.add(stage.object)
    scene = task.world.scene
    stands = tuple(obstacle for obstacle in scene.obstacles if obstacle.id not in taken)
    pairs = {sorted_pair(*pair) for pair in task.stages[k].settings.allowed}
    return world.robot, replace(
        scene, obstacles=stands, allowed_collisions=scene.allowed_collisions | pairs
    )


def _told(task: Task, k: int, wrong: Failure) -> SequenceFailure:
    """A failure of one plan as that of the task."""
    details = {"index": k, "reason": wrong.message, "count": 1, **wrong.details}
    message = f"{describe_stage(task.stages, k)}: {wrong.message}"
    at: Array | None = task.start if k == 0 else None
    return SequenceFailure(wrong.code, message, wrong.hint, k, details, (), nearest=at, reached=k)
