"""Valid configurations of the goals, with their clearance."""

from functools import partial
from typing import NamedTuple

import numpy as np

from kinematics.arrays import Array
from kinematics.ik import numeric
from obstacles.checker import Checker
from planning.constrained.pose_goals import goal_configurations
from planning.deadline import Deadline
from planning.preflight.failures import (
    Refusal,
    collision_failure,
    limit_failure,
    no_goal_failure,
    time_up_failure,
    unreachable_failure,
)
from planning.preflight.limits import snap_to_limits
from planning.problem import JointGoal, PoseGoal, Problem
from planning.ready import TOUCHING
from planning.result import Failure

#: Configurations looked for when a goal is a pose.
_POSE_CANDIDATES = 12
#: Starts of inverse kinematics spent on them.
_POSE_STARTS = 120
#: Poses, of those whose configurations all collide, for which others are looked for with the
#: obstacles in sight: each search takes a tenth of a second.
_MAX_SEARCHES = 8


class Candidate(NamedTuple):
    """A valid configuration of a goal.

    Args:
        clearance: Margins taken off [m].
        joints: Shape (n,) [rad or m].
    """

    clearance: float
    joints: Array


def find_goals(
    problem: Problem, checker: Checker, start: Array, seed: int, deadline: Deadline | None
) -> list[Candidate] | Failure:
    """Find valid configurations of all goals, or say why no goal has any.

    Args:
        problem: What is to be planned.
        checker: The exact robot in the scene with its margins.
        start: Where inverse kinematics begins, shape (n,).
        seed: Of inverse kinematics.
        deadline: When to look at no more goals.
    """
    candidates: list[Candidate] = []
    refusals: list[Refusal] = []
    searches = _MAX_SEARCHES
    for i, goal in enumerate(problem.goals):
        if deadline is not None and deadline.passed:
            return time_up_failure(i, len(problem.goals))
        if isinstance(goal, JointGoal):
            answer = _joint_goal(problem, checker, goal)
        else:
            answer = _pose_goal(problem, checker, goal, start, seed)
            if isinstance(answer, Refusal) and answer.code == "GOAL_IN_COLLISION" and searches:
                searches -= 1
                answer = _search_around_obstacles(problem, goal, start, seed) or answer
        if isinstance(answer, Refusal):
            refusals.append(answer)
        else:
            candidates += answer
    return candidates or no_goal_failure(refusals)


def _joint_goal(problem: Problem, checker: Checker, goal: JointGoal) -> list[Candidate] | Refusal:
    tolerance = problem.start_state_tolerance
    q, violation = snap_to_limits(problem.robot.chain, goal.joints, tolerance)
    if violation is not None:
        return Refusal("GOAL_STATE_INVALID", partial(limit_failure, "goal", violation))
    clearance, pair = checker.clearance(q)
    if clearance <= TOUCHING:
        return _collision_refusal(problem, q, pair, clearance)
    return [Candidate(clearance, q)]


def _pose_goal(
    problem: Problem, checker: Checker, goal: PoseGoal, start: Array, seed: int
) -> list[Candidate] | Refusal:
    chain = problem.robot.chain
    result = numeric.solve(
        chain,
        goal.T_base_tip,
        numeric.SearchOptions(
            seed=seed,
            starts=_POSE_STARTS,
            position_tolerance=min(goal.position_tolerance, numeric.POSITION_TOLERANCE),
            orientation_tolerance=min(goal.orientation_tolerance, numeric.ORIENTATION_TOLERANCE),
        ),
        seed_joints=start,
        solutions=_POSE_CANDIDATES,
    )
    if not result.solutions:
        return Refusal("NO_IK_SOLUTION", partial(unreachable_failure, chain, result))
    clearances = [checker.clearance(solution.joints) for solution in result.solutions]
    valid = [
        Candidate(clearance, solution.joints)
        for (clearance, _), solution in zip(clearances, result.solutions, strict=True)
        if clearance > TOUCHING
    ]
    if valid:
        return valid
    best = max(range(len(clearances)), key=lambda i: clearances[i][0])
    clearance, pair = clearances[best]
    return _collision_refusal(problem, result.solutions[best].joints, pair, clearance)


def _collision_refusal(
    problem: Problem, q: Array, pair: tuple[str, str] | None, clearance: float
) -> Refusal:
    explain = partial(collision_failure, problem, "goal", q, pair, clearance)
    return Refusal("GOAL_IN_COLLISION", explain)


def _search_around_obstacles(
    problem: Problem, goal: PoseGoal, start: Array, seed: int
) -> list[Candidate]:
    """Configurations of a pose found with the obstacles in sight: arms with joints to spare."""
    solutions = goal_configurations(problem, goal, start, seed)
    return [Candidate(s.clearance, np.array(s.joints)) for s in solutions if s.clearance > TOUCHING]
