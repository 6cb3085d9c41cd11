"""What can be known before planning: is the start valid, is a goal, can it be reached."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from kinematics.arrays import Array
from kinematics.chain import Chain
from kinematics.ik import numeric
from obstacles.checker import Checker, collision_model
from obstacles.fcl_distance import FclWorld
from obstacles.robot_geometry import hulled
from planning.constrained.pose_goals import goal_configurations
from planning.deadline import Deadline
from planning.nearest_free import nearest_free
from planning.problem import JointGoal, PoseGoal, Problem
from planning.proof.limits import beyond
from planning.ready import TOUCHING, Ready, ValidStart
from planning.result import Failure

#: Configurations looked for when a goal is a pose, and starts spent on them.
_POSE_CANDIDATES = 12
_POSE_STARTS = 120
#: Of several poses whose configurations all collide, others are sought for so many: each search
#: takes a tenth of a second.
_SOUGHT_GOALS = 8
#: Planning keeps this much more than the margin, where start and goal have it to spare: it spares
#: the certificate halving its cells down to nothing where a path would graze [m].
_SLACK = 1e-3
#: What is kept more than the margin where the tool is led, and the path can't be chosen [m].
_SLACK_ALONG_MOTIONS = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class _Refusal:
    """A goal that is not valid, and how to say why: that takes time, and is done of one alone."""

    code: str
    failure: Callable[[], Failure]


def ready_start(problem: Problem) -> ValidStart | Failure:
    """Check the start alone: inside its limits, or moved onto them, and free."""
    checker = Checker.of(problem.robot, problem.scene, problem.margin)
    start, outside = _snapped(problem.robot.chain, problem.start, problem.start_state_tolerance)
    if outside is not None:
        return _limit_failure("start", outside)
    clearance, pair = checker.clearance(start)
    if clearance <= TOUCHING:
        return _collision_failure(problem, "start", start, pair, clearance)
    return ValidStart(start, checker, clearance, _moved(problem.start, start))


def start_only(problem: Problem) -> Ready | Failure:
    """Check the start, for planners that need no goal configurations."""
    valid = ready_start(problem)
    if isinstance(valid, Failure):
        return valid
    slack = min(_SLACK_ALONG_MOTIONS, 0.5 * valid.clearance)
    return Ready(valid.joints, [], (Checker(valid.checker.model, slack),), valid.notes)


def _moved(given: Array, start: Array) -> tuple[str, ...]:
    if np.array_equal(start, given):
        return ()
    moved = float(np.abs(start - given).max())
    return (f"The start was outside a limit by {moved:.3g} and was moved onto it.",)


def preflight(problem: Problem, seed: int, deadline: Deadline | None = None) -> Ready | Failure:
    """Check the start and find the goals' configurations, or say why there is no point.

    Args:
        problem: The robot, the scene, start and goals.
        seed: Of inverse kinematics.
        deadline: When to look at no more goals.
    """
    hulls = _hulls(problem)
    roomy = None if hulls is None else _roomy(problem, hulls)
    if roomy is not None:
        return roomy
    begun = ready_start(problem)
    if isinstance(begun, Failure):
        return begun
    start, checker, clearance = begun.joints, begun.checker, begun.clearance
    goals: list[tuple[float, Array]] = []
    refusals: list[_Refusal] = []
    patient = _SOUGHT_GOALS
    for i, goal in enumerate(problem.goals):
        if deadline is not None and deadline.passed:
            return _late(i, len(problem.goals))
        if isinstance(goal, JointGoal):
            found = _joint_goal(problem, checker, goal)
        else:
            found = _pose_goal(problem, checker, goal, start, seed)
            if isinstance(found, _Refusal) and found.code == "GOAL_IN_COLLISION" and patient:
                patient -= 1
                found = _clear_of_obstacles(problem, goal, start, seed) or found
        if isinstance(found, _Refusal):
            refusals.append(found)
        else:
            goals += found
    if not goals:
        return _none_valid(refusals)
    slack = min(_SLACK, 0.5 * clearance, 0.5 * max(spare for spare, _ in goals))
    kept = [q for spare, q in goals if spare > slack]
    kept.sort(key=lambda q: float(np.linalg.norm(q - start)))
    checkers = [Checker(checker.model, slack)]
    if hulls is not None:
        quick = Checker(hulls.model, slack)
        if all(quick.valid(q) for q in (start, *kept)):
            checkers.insert(0, quick)
    return Ready(start, kept, tuple(checkers), begun.notes)


def _hulls(problem: Problem) -> Checker | None:
    """The checker of the robot in its solids' hulls; None where these are the solids."""
    robot = hulled(problem.robot)
    if robot is problem.robot:
        return None
    return Checker.of(robot, problem.scene, problem.margin)


def _roomy(problem: Problem, hulls: Checker) -> Ready | None:
    """What is ready where even the hulls of the robot's solids have room at start and goals.

    Then the solids have it too: they are only packed if planning in hulls leads nowhere.
    """
    goals = problem.goals
    joints = [goal.joints for goal in goals if isinstance(goal, JointGoal)]
    if len(joints) < len(goals):
        return None
    tolerance = problem.start_state_tolerance
    snapped = [_snapped(problem.robot.chain, q, tolerance) for q in (problem.start, *joints)]
    roomy = Checker(hulls.model, 2.0 * _SLACK)
    if not all(outside is None and roomy.valid(q) for q, outside in snapped):
        return None
    start, *ends = (q for q, _ in snapped)
    ends.sort(key=lambda q: float(np.linalg.norm(q - start)))
    exact = collision_model(problem.robot, problem.scene, problem.margin)
    checkers = Checker(hulls.model, _SLACK), Checker(exact, _SLACK)
    return Ready(start, ends, checkers, _moved(problem.start, start))


def _snapped(chain: Chain, q: Array, tolerance: float) -> tuple[Array, dict[str, Any] | None]:
    """The nearest configuration inside the limits, and the limit that is broken, if one is."""
    lower, upper = chain.limits.lower, chain.limits.upper
    inside = np.clip(q, lower, upper)
    j = int(np.argmax(np.abs(inside - q)))
    if abs(inside[j] - q[j]) <= tolerance:
        return inside, None
    excess = float(abs(q[j] - inside[j]))
    broken = {"joint": chain.joint_names[j], "value": float(q[j]), "limit": float(inside[j])}
    return q, broken | {"excess": excess}


def _limit_failure(which: str, broken: dict[str, Any]) -> Failure:
    return Failure(
        code=f"{which.upper()}_STATE_INVALID",
        message=f"at the {which}, {beyond(broken['joint'], broken['value'], broken['limit'])}",
        hint="Bring the joint inside its limits.",
        stage=which,
        details=broken,
    )


def _collision_failure(
    problem: Problem, which: str, q: Array, pair: tuple[str, str] | None, clearance: float
) -> Failure:
    """Say what touches in a configuration, or what is nearer than its margin, and by how much.

    The depth is that of the solids themselves; a margin has none.
    """
    solids = tuple(replace(obstacle, margin=0.0) for obstacle in problem.scene.obstacles)
    world = FclWorld(problem.robot, replace(problem.scene, obstacles=solids))
    contacts = world.collisions(q)
    if contacts:
        a, b = contacts[0].pair
        depth = contacts[0].depth
        message = f"at the {which}, {a!r} and {b!r} overlap by {depth:.4g} m"
        details: dict[str, Any] = {}
    else:
        assert pair is not None
        (a, b), depth = pair, 0.0
        distance = world.apart(q, pair)
        margin = max(distance - clearance, 0.0)
        details = {"clearance": distance, "margin": margin}
        message = f"at the {which}, {a!r} and {b!r} are {distance:.4g} m apart"
        message += f", nearer than their margin of {margin:.4g} m" if margin > TOUCHING else ""
        message += ": they touch" if distance <= TOUCHING else ""
    nearest = nearest_free(Checker.of(problem.robot, problem.scene, problem.margin), q)
    told = [{"pair": list(contact.pair), "depth": contact.depth} for contact in contacts]
    return Failure(
        code=f"{which.upper()}{'_STATE' if which == 'start' else ''}_IN_COLLISION",
        message=message,
        hint=f"Move the {which} away, lower the margin, or allow the pair if contact is meant "
        "(allowed_collisions, or touch_links of what is held).",
        stage=which,
        details={
            "pair": [a, b],
            "depth": depth,
            "collisions": told,
            "nearest_valid": None if nearest is None else nearest.details,
            **details,
        },
    )


def _late(looked_at: int, count: int) -> Failure:
    return Failure(
        code="TIMED_OUT",
        message=f"time was up when {looked_at} of {count} goals had been looked at",
        hint="Allow more time, or give fewer goals.",
        stage="goal",
    )


def _none_valid(refusals: list[_Refusal]) -> Failure:
    """Why the first goal is not valid, and of several, how many fail for what."""
    first = refusals[0].failure()
    if len(refusals) == 1:
        return first
    counts = dict(Counter(refusal.code for refusal in refusals))
    message = f"none of {len(refusals)} goals is valid; the first: {first.message}"
    return replace(first, message=message, details={**first.details, "goals": counts})


def _joint_goal(
    problem: Problem, checker: Checker, goal: JointGoal
) -> list[tuple[float, Array]] | _Refusal:
    q, outside = _snapped(problem.robot.chain, goal.joints, problem.start_state_tolerance)
    if outside is not None:
        return _Refusal("GOAL_STATE_INVALID", partial(_limit_failure, "goal", outside))
    clearance, pair = checker.clearance(q)
    if clearance <= TOUCHING:
        return _collides(problem, q, pair, clearance)
    return [(clearance, q)]


def _collides(
    problem: Problem, q: Array, pair: tuple[str, str] | None, clearance: float
) -> _Refusal:
    told = partial(_collision_failure, problem, "goal", q, pair, clearance)
    return _Refusal("GOAL_IN_COLLISION", told)


def _pose_goal(
    problem: Problem, checker: Checker, goal: PoseGoal, start: Array, seed: int
) -> list[tuple[float, Array]] | _Refusal:
    chain = problem.robot.chain
    result = numeric.solve(
        chain,
        goal.T_base_tip,
        seed_joints=start,
        seed=seed,
        solutions=_POSE_CANDIDATES,
        starts=_POSE_STARTS,
        position_tolerance=min(goal.position_tolerance, numeric.POSITION_TOLERANCE),
        orientation_tolerance=min(goal.orientation_tolerance, numeric.ORIENTATION_TOLERANCE),
    )
    if not result.solutions:
        nearest = result.nearest
        failure = Failure(
            code="NO_IK_SOLUTION",
            message=(
                f"no configuration brings {chain.tip_link!r} to the goal's pose: the nearest is "
                f"{nearest.position_error:.4g} m and {nearest.orientation_error:.4g} rad away"
            ),
            hint=result.advice,
            stage="goal",
            details={
                "position_error": nearest.position_error,
                "orientation_error": nearest.orientation_error,
                "nearest_joints": nearest.joints.tolist(),
            },
        )
        return _Refusal(failure.code, lambda: failure)
    spares = [
        (checker.clearance(solution.joints), solution.joints) for solution in result.solutions
    ]
    valid = [(clearance, q) for (clearance, _), q in spares if clearance > TOUCHING]
    if valid:
        return valid
    (clearance, pair), q = max(spares, key=lambda entry: entry[0][0])
    return _collides(problem, q, pair, clearance)


def _clear_of_obstacles(
    problem: Problem, goal: PoseGoal, start: Array, seed: int
) -> list[tuple[float, Array]]:
    """Configurations of a pose sought with the obstacles in sight: arms with joints to spare."""
    found = goal_configurations(problem, goal, start, seed)
    return [(s.clearance, np.array(s.joints)) for s in found if s.clearance > TOUCHING]
