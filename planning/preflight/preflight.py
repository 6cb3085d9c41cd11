"""Checks before planning: is the start valid, is a goal, which checkers are there to plan with."""

import time

import numpy as np

from kinematics.arrays import Array
from obstacles.collision.checker import Checker
from obstacles.collision.fcl_distance import overlap_meter
from obstacles.robots.robot_geometry import hulled
from planning.goal_choice.goal_order import order_goals
from planning.planner import ENOUGH, SLACK, TOUCHING, Candidate, Ready, ValidStart
from planning.preflight.goals import collision_failure, find_goals, limit_failure
from planning.preflight.limits import goal_onto_limits, moved_note, snap_to_limits
from planning.problem import JointGoal, PoseGoal, Problem
from planning.result import Failure
from planning.values.deadline import Deadline
from planning.values.preferences import GoalCosts


def check_start(problem: Problem, checker: Checker | None = None) -> ValidStart | Failure:
    """Check the start alone: inside its limits, or moved onto them, and free.

    Args:
        problem: The robot, the scene and the start.
        checker: Of the exact robot in the scene, where there is one already.
    """
    checker = checker or Checker.of(problem.robot, problem.scene, problem.margin)
    tolerance = problem.start_state_tolerance
    start, violation = snap_to_limits(problem.robot.chain, problem.start, tolerance)
    if violation is not None:
        return limit_failure("start", violation)
    clearance, _, pair = checker.closest(start[None], ENOUGH)
    if clearance <= TOUCHING or overlap_meter(problem.robot, problem.scene).too_deep(start):
        return collision_failure(problem, "start", start, pair, clearance)
    return ValidStart(start, checker, clearance, moved_note("start", problem.start, start))


def start_only(problem: Problem) -> Ready | Failure:
    """Check the start, for planners that need no goal configurations."""
    valid = check_start(problem)
    if isinstance(valid, Failure):
        return valid
    # What is kept more than the margin where the tool is led, and the path can't be chosen [m].
    slack = min(1e-4, 0.5 * valid.clearance)
    return Ready(valid.joints, [], (Checker(valid.checker.model, slack),), valid.notes)


def preflight(
    problem: Problem,
    seed: int,
    deadline: Deadline | None = None,
    costs: GoalCosts | None = None,
) -> Ready | Failure:
    """Check the start and find configurations of the goals, or say why planning has no point.

    Args:
        problem: The robot, the scene, start and goals.
        seed: Of inverse kinematics.
        deadline: When to look at no more goals.
        costs: By which configurations of poses are chosen; the default ones where None.
    """
    hulls = _hulls_checker(problem)
    exact = Checker.of(problem.robot, problem.scene, problem.margin)
    late = _pack(hulls or exact, deadline)
    if late is not None:
        return late
    ready = _ready_with_room(problem, exact, hulls)
    if ready is not None:
        return ready
    valid = check_start(problem, exact)
    if isinstance(valid, Failure):
        return valid
    start = valid.joints
    goals = find_goals(problem, valid.checker, start, seed, deadline, costs)
    if isinstance(goals, Failure):
        return goals
    slack = min(SLACK, 0.5 * valid.clearance, 0.5 * max(goal.clearance for goal in goals))
    kept = [goal for goal in goals if goal.clearance > slack]
    clear, best, found = [goal.joints for goal in kept], None, tuple[Candidate, ...]()
    if any(isinstance(goal, PoseGoal) for goal in problem.goals):
        found = tuple(kept)
        clearances = [goal.clearance for goal in kept]
        clear, best = order_goals(
            problem.robot.chain, start, clear, clearances, costs or GoalCosts()
        )
    else:
        clear = _nearest_first(clear, start)
    checkers = [Checker(valid.checker.model, slack)]
    if hulls is not None:
        quick = Checker(hulls.model, slack)
        if all(quick.valid(q) for q in (start, *clear)):
            checkers.insert(0, quick)
    return Ready(start, clear, tuple(checkers), valid.notes, best, found)


def _pack(checker: Checker, deadline: Deadline | None) -> Failure | None:
    """Pack a robot and a scene; the failure where that is what the time was spent on.

    Fine meshes that were never seen are cut and sorted here, which nothing interrupts.
    """
    if deadline is None:
        return None
    began = time.monotonic()
    _ = checker.model.arrays
    spent = time.monotonic() - began
    if spent <= 0.5 * (deadline.at - began) or not deadline.passed:
        return None
    return Failure(
        "TIMED_OUT",
        "time was up when robot and scene had been made ready for collision checks, "
        f"which took {spent:.2g} s",
        "Ask again: this process keeps what it made. Or allow more time, or give the scene "
        "coarser meshes.",
        "preflight",
        details={"seconds": spent},
    )


def _hulls_checker(problem: Problem) -> Checker | None:
    """The checker of the robot in its solids' hulls; None where these are the solids."""
    robot = hulled(problem.robot)
    if robot == problem.robot:  # of equal robots the one is kept that was asked about first
        return None
    return Checker.of(robot, problem.scene, problem.margin)


def _ready_with_room(problem: Problem, exact: Checker, hulls: Checker | None) -> Ready | None:
    """The problem made ready where all ends have so much clearance that nobody need know how much.

    Where even the hulls of the robot's solids have it the solids have it too: these are only packed
    if planning in hulls leads nowhere.
    """
    goals = [goal.joints for goal in problem.goals if isinstance(goal, JointGoal)]
    if len(goals) < len(problem.goals):
        return None
    chain, tolerance, ends = problem.robot.chain, problem.start_state_tolerance, list[Array]()
    start, violation = snap_to_limits(chain, problem.start, tolerance)
    for q in goals:
        end, beyond = goal_onto_limits(chain, q, tolerance)
        ends.append(end)
        violation = violation or beyond
    quick = exact if hulls is None else hulls
    if violation is not None or not Checker(quick.model, ENOUGH).all_valid(
        np.array([start, *ends])
    ):
        return None
    if problem.scene.contacts:  # which alone may have a depth
        meter = overlap_meter(problem.robot, problem.scene)
        for q in (start, *ends):
            if meter.too_deep(q):
                return None
    checkers: tuple[Checker, ...] = (Checker(exact.model, SLACK),)
    if hulls is not None:
        checkers = (Checker(hulls.model, SLACK), *checkers)
    return Ready(
        start, _nearest_first(ends, start), checkers, moved_note("start", problem.start, start)
    )


def _nearest_first(goals: list[Array], start: Array) -> list[Array]:
    if len(goals) < 2:
        return goals
    return sorted(goals, key=lambda q: float(np.linalg.norm(q - start)))
