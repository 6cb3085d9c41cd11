"""Valid configurations of the goals, with their clearance."""

from functools import partial

import numpy as np

from kinematics.arrays import Array
from kinematics.ik.numeric import numeric
from kinematics.model.chain import Chain
from obstacles.collision.checker import Checker
from obstacles.collision.fcl_distance import overlap_meter
from planning.constrained.ik import goal_configurations
from planning.goal_choice.goal_order import is_at_limit, motion_costs
from planning.planner import ENOUGH, TOUCHING, Candidate
from planning.preflight.failures import (
    Refusal,
    collision_failure,
    limit_failure,
    no_goal_failure,
    unreachable_failure,
)
from planning.preflight.limits import goal_onto_limits
from planning.preflight.pose_configurations import pose_configurations, turned_copies
from planning.problem import JointGoal, PoseGoal, Problem
from planning.result import Failure
from planning.values.deadline import Deadline
from planning.values.preferences import GoalCosts

#: Free configurations of a pose at most, of those away from limits, of those at one, and copies of
#: them with a joint a turn further than it need be.
_MOST_INSIDE, _MOST_AT_LIMIT, _MOST_TURNED = 10, 2, 4


def find_goals(
    problem: Problem,
    checker: Checker,
    start: Array,
    seed: int,
    deadline: Deadline | None,
    costs: GoalCosts | None = None,
) -> list[Candidate] | Failure:
    """Find valid configurations of all goals, or say why no goal has any.

    Args:
        problem: What is to be planned.
        checker: The exact robot in the scene with its margins.
        start: Where inverse kinematics begins, shape (n,).
        seed: Of inverse kinematics.
        deadline: When to look at no more goals.
        costs: By which configurations of poses are chosen; the default ones where None.
    """
    candidates: list[Candidate] = []
    refusals: list[Refusal] = []
    # Poses, of those whose configurations all collide, for which others are looked for with the
    # obstacles in sight: each search takes a tenth of a second.
    searches = 8
    for i, goal in enumerate(problem.goals):
        if deadline is not None and deadline.passed:
            message = f"time was up when {i} of {len(problem.goals)} goals had been checked"
            return Failure("TIMED_OUT", message, "Allow more time, or give fewer goals.", "goal")
        if isinstance(goal, JointGoal):
            answer = _joint_goal(problem, checker, goal)
        else:
            answer = _pose_goal(problem, checker, goal, start, seed, costs or GoalCosts())
            if isinstance(answer, Refusal) and answer.code == "GOAL_IN_COLLISION" and searches:
                searches -= 1
                answer = _search_around_obstacles(problem, goal, start, seed) or answer
        if isinstance(answer, Refusal):
            refusals.append(answer)
        else:
            candidates += answer
    return candidates or no_goal_failure(refusals)


def pose_goals(problem: Problem, goals: list[Array]) -> list[Array]:
    """Those of the goal configurations (n,) that are of poses, not asked for as joints."""
    joint_goals = [goal for goal in problem.goals if isinstance(goal, JointGoal)]
    if len(joint_goals) == len(problem.goals):
        return []
    chain, tolerance = problem.robot.chain, problem.start_state_tolerance
    asked = [goal_onto_limits(chain, goal.joints, tolerance)[0] for goal in joint_goals]
    return [q for q in goals if not any(np.array_equal(q, other) for other in asked)]


def _joint_goal(problem: Problem, checker: Checker, goal: JointGoal) -> list[Candidate] | Refusal:
    tolerance, within = problem.start_state_tolerance, ENOUGH
    if any(isinstance(other, PoseGoal) for other in problem.goals):
        within = np.inf  # the choice among them is by clearance too
    q, violation = goal_onto_limits(problem.robot.chain, goal.joints, tolerance)
    if violation is not None:
        return Refusal("GOAL_STATE_INVALID", partial(limit_failure, "goal", violation))
    clearance, _, pair = checker.closest(q[None], within)
    if clearance <= TOUCHING or overlap_meter(problem.robot, problem.scene).too_deep(q):
        return _collision_refusal(problem, q, pair, clearance)
    return [Candidate(clearance, q)]


def _pose_goal(
    problem: Problem, checker: Checker, goal: PoseGoal, start: Array, seed: int, costs: GoalCosts
) -> list[Candidate] | Refusal:
    chain = problem.robot.chain
    options = numeric.SearchOptions(
        seed=seed,
        position_tolerance=min(goal.position_tolerance, numeric.POSITION_TOLERANCE),
        orientation_tolerance=min(goal.orientation_tolerance, numeric.ORIENTATION_TOLERANCE),
    )
    found = pose_configurations(chain, goal.T_base_tip, start, options, costs)
    if not len(found.joints):
        # No configuration is right there: one within the goal's tolerances will do.
        options = numeric.SearchOptions(
            seed=seed,
            position_tolerance=goal.position_tolerance,
            orientation_tolerance=goal.orientation_tolerance,
        )
        found = pose_configurations(chain, goal.T_base_tip, start, options, costs)
    if not len(found.joints):
        assert found.search is not None
        return Refusal("NO_IK_SOLUTION", partial(unreachable_failure, chain, found.search))
    at_limit = is_at_limit(chain, found.joints)
    meter = overlap_meter(problem.robot, problem.scene)
    valid = [
        item
        for joints, most in ((found.joints[~at_limit], _MOST_INSIDE),
                             (found.joints[at_limit], _MOST_AT_LIMIT))
        for item in _free_configurations(checker, joints, most)
        if not meter.too_deep(item.joints)
    ]  # fmt: skip
    if valid:
        return [*valid, *_turned_copies(chain, start, valid, costs)]
    closest = found.joints[:_MOST_INSIDE]
    clearances = [checker.clearance(q) for q in closest]
    best = max(range(len(clearances)), key=lambda i: clearances[i][0])
    clearance, pair = clearances[best]
    return _collision_refusal(problem, closest[best], pair, clearance)


def configurations_off_limits(
    chain: Chain, checker: Checker, T: Array, start: Array, seed: int, costs: GoalCosts
) -> list[Array]:
    """Free configurations of a pose away from joint limits, as plans find them, the cheapest first.

    Args:
        chain: The robot.
        checker: Of the exact robot in the scene with its margins.
        T: T_base_tip, shape (4, 4).
        start: Where the motion begins, shape (n,) [rad or m].
        seed: Of inverse kinematics.
        costs: By which they are sorted.
    """
    found = pose_configurations(chain, T, start, numeric.SearchOptions(seed=seed), costs).joints
    inside = found[~is_at_limit(chain, found)]
    return [free.joints for free in _free_configurations(checker, inside, _MOST_INSIDE)]


def _free_configurations(checker: Checker, joints: Array, most: int) -> list[Candidate]:
    """The first free ones of configurations (k, n) that are apart from each other."""
    chosen: list[Candidate] = []
    # Configurations of a pose that are checked together, and how many at most.
    together, max_looks = 8, 192
    left = joints[:max_looks]
    # Free configurations differ by this much in a joint at least [rad or m]: those of a redundant
    # arm would else be neighbours of the cheapest.
    apart = 0.3
    while len(left):
        rows, left = left[:together], left[together:]
        for q in rows[checker.each_valid(rows)]:
            if any(np.abs(q - other.joints).max() < apart for other in chosen):
                continue
            clearance = checker.clearance(q)[0]
            if clearance <= TOUCHING:
                continue
            chosen.append(Candidate(clearance, q))
            if len(chosen) == most:
                return chosen
            left = left[np.abs(left - q).max(axis=1) >= apart]
    return chosen


def _turned_copies(
    chain: Chain, start: Array, valid: list[Candidate], costs: GoalCosts
) -> list[Candidate]:
    """The cheapest copies with one joint a turn further, whose links are where they were."""
    copies, origins = turned_copies(chain, np.array([q for _, q in valid]), start)
    order = np.argsort(motion_costs(chain, start, copies, costs), kind="stable")
    return [Candidate(valid[origins[k]].clearance, copies[k]) for k in order[:_MOST_TURNED]]


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
