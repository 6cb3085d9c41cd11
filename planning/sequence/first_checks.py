"""Checks of what a task asks for, before anything is searched for.

Where the arm stands at the start, and goals that are joints, are known without a search. A goal is
checked with what is known of its surroundings by then: the obstacles that no earlier stage takes
along, the gripper as the stage finds it, and nothing in it. A goal that is wrong so is wrong
whatever the stages before it do. So are grasps, places and poses of which all are out of reach, and
grasps between whose fingers the object does not fit.
"""

from collections import Counter
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from kinematics.ik.closed_form.arm_parts import out_of_reach
from kinematics.ik.numeric.numeric import reach
from kinematics.model.chain import Chain
from obstacles.collision.checker import Checker
from obstacles.robots.allowed_pairs import contacts_of
from obstacles.robots.attachment import with_parts
from obstacles.robots.grasps import jaw_span, surface_of
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Obstacle, Scene
from planning.preflight.goals import find_goals
from planning.preflight.preflight import check_start
from planning.problem import JointGoal, PoseGoal, Problem
from planning.result import Failure
from planning.sequence.node import changed, contact_pairs
from planning.sequence.record import hint_of
from planning.sequence.result import SequenceFailure, Trial
from planning.sequence.stage import Attach, Grasp, Gripper, Move, Place, Stage, describe_stage
from planning.sequence.target import target_count
from planning.sequence.task import Task
from planning.sequence.world import Cells, contact_positions
from planning.values.deadline import Deadline

#: Poses of a stage whose distance from the arm's reach is computed one by one: 0.1 s.
_MOST_POSES = 128
#: Places by grasps of a stage whose distance is compared with the arm's length.
_MOST_PLACES = 10_000
#: Poses out of reach by less than this are on its edge [m].
_EDGE = 1e-6
#: Grasps of a stage that fingers are closed on, of those whose poses can be reached.
_MOST_GRASPS = 256


def check_first(
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
    return _impossible(task, deadline) if goals else None


def _start_failure(task: Task, cells: Cells) -> Failure | None:
    """Fault of the start, as the first stage finds it."""
    first = task.stages[0]
    # Before a gripper moves nothing has changed; what is attached is checked as held.
    world = task.world.entered(first.settings)
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
        world = world.entered(stage.settings)
        if isinstance(stage, Gripper) and stage.robot is not None:
            world = world.with_robot(stage.robot)
        if isinstance(stage, Attach):
            taken.add(stage.object)
    scene = task.world.scene
    stands = tuple(obstacle for obstacle in scene.obstacles if obstacle.id not in taken)
    contacts = dict(scene.contacts) | contacts_of(task.stages[k].settings.allowed, "request")
    return world.robot, with_parts(world.robot, replace(scene, obstacles=stands, contacts=contacts))


def _told(task: Task, k: int, wrong: Failure) -> SequenceFailure:
    """A failure of one plan as that of the task."""
    details = {"index": k, "reason": wrong.message, "count": 1, **wrong.details}
    message = f"{describe_stage(task.stages, k)}: {wrong.message}"
    at: Array | None = task.start if k == 0 else None
    return SequenceFailure(wrong.code, message, wrong.hint, k, details, (), nearest=at, reached=k)


def _impossible(task: Task, deadline: Deadline) -> SequenceFailure | None:
    """The first stage that asks for what is out of reach, or does not fit between the fingers."""
    world, grasp, unknown = task.world, None, False
    taken = {item.name for item in world.held}
    for k, (stage, after) in enumerate(pairwise((*task.stages, None))):
        assert stage is not None
        if deadline.passed:
            break
        world = world.entered(stage.settings)
        robot, known = world.robot, None
        if isinstance(stage, Gripper):
            world = world.with_robot(stage.robot or robot)
            # Where fingers stop that close on something, is known by then alone.
            unknown = stage.until is not None or (unknown and len(robot.fingers.positions) > 1)
        elif isinstance(stage, Attach):
            taken.add(stage.object)
        elif isinstance(stage, Grasp):
            grasp = stage, robot.chain.tip_link
        gripped = grasp[0] if grasp is not None and grasp[1] == robot.chain.tip_link else None
        poses = _tool_poses(task, stage, taken, gripped)
        if poses is not None and len(poses):
            known = _beyond_reach(robot.chain, poses)
        closes = isinstance(after, Gripper) and after.until is not None and not unknown
        if known is None and closes and isinstance(stage, Grasp) and stage.object not in taken:
            assert isinstance(after, Gripper)
            stands = task.world.scene.obstacle(stage.object)
            known = _too_wide(robot, stage, after, stands)
        if known is not None:
            reason, details = known
            message = (
                f"no combination can be done: {describe_stage(task.stages, k)} fails: {reason}"
            )
            hint = hint_of(stage, reason)
            far = "reach" in details
            outcome, told = ("out_of_reach",) * 2 if far else ("failed", reason)
            trials = tuple(Trial((i,), k, outcome, {told: 1}) for i in range(target_count(stage)))
            details |= {"index": k, "reason": reason, "count": len(trials)}
            return SequenceFailure("PLANNING_FAILED", message, hint, k, details, trials, reached=k)
    return None


def _tool_poses(task: Task, stage: Stage, taken: set[str], grasp: Grasp | None) -> Array | None:
    """Poses that the tool has in a stage, shape (k, 4, 4); None where they hang on the search.

    Args:
        task: The stages.
        stage: The stage.
        taken: Objects that stages up to this one take along.
        grasp: The last grasp before.
    """
    scene = task.world.scene
    if isinstance(stage, Grasp):
        if stage.object in taken:
            return None
        return np.asarray(scene.obstacle(stage.object).T_world_obstacle @ stage.frames)
    if isinstance(stage, Place):
        if grasp is None or grasp.object != stage.object or stage.reference in taken:
            return None
        if len(stage.poses) * len(grasp.frames) > _MOST_PLACES:
            return None
        places = stage.poses
        if stage.reference is not None:
            places = scene.obstacle(stage.reference).T_world_obstacle @ places
        return np.asarray(places[:, None] @ grasp.frames[None]).reshape(-1, 4, 4)
    if isinstance(stage, Move) and stage.goals:
        posed = [goal.T_base_tip for goal in stage.goals if isinstance(goal, PoseGoal)]
        return np.array(posed) if len(posed) == len(stage.goals) else None
    return None


def _beyond_reach(chain: Chain, poses: Array) -> tuple[str, dict[str, Any]] | None:
    """Why the tip comes to none of some poses (k, 4, 4), with numbers; None where it may."""
    center, radius = reach(chain)
    away = np.linalg.norm(poses[:, :3, 3] - center, axis=1)
    nearest = int(away.argmin())
    numbers = {"distance": float(away[nearest]), "reach": radius}
    if away[nearest] > radius + _EDGE:
        return (
            f"out_of_reach: the nearest of {len(poses)} poses is {away[nearest]:.4g} m from the "
            f"first joint, and the arm is {radius:.4g} m long"
        ), numbers
    if len(poses) > _MOST_POSES:
        return None
    gaps = []
    for pose in poses[np.argsort(away, kind="stable")]:
        gap = out_of_reach(chain, pose)
        if gap is None or gap <= _EDGE:
            return None
        gaps.append(gap)
    return (
        f"out_of_reach: the wrist of the nearest of {len(poses)} poses is {min(gaps):.4g} m beyond "
        "what upper arm and forearm reach"
    ), numbers | {"out_of_reach_by": min(gaps)}


def _too_wide(
    robot: RobotGeometry, stage: Grasp, close: Gripper, stands: Obstacle
) -> tuple[str, dict[str, Any]] | None:
    """Why no grasp holds an object between the fingers, with numbers; None where one does."""
    if close.robot is None or len(stage.frames) > _MOST_GRASPS:
        return None
    last = tuple(close.robot.fingers.positions.items())
    reasons = Counter[str]()
    for frame in stage.frames:
        found = contact_positions(robot, stands, np.ascontiguousarray(frame).tobytes(), last)
        if not isinstance(found, str):
            return None
        reasons[found] += 1
    reason, count = reasons.most_common(1)[0]
    text = f"none of {len(stage.frames)} grasps holds {stands.id!r}: {reason} ({count} times)"
    try:
        span = jaw_span(robot)
    except InvalidOption:
        return text, {}
    widths = np.ptp(
        surface_of(stands.shape).vertices @ (stage.frames[:, :3, :3] @ span.axis).T, axis=0
    )
    width, opening = float(widths.min()), span.widest
    return (
        f"{text}; it is {width:.4g} m wide there at least, and the fingers open {opening:.4g} m"
    ), {"width": width, "opening": opening}
