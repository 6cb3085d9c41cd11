"""Valid configurations of the goals, with their clearance.

Failures of starts and goals that are not valid: what is wrong, by how much, what would do.

A free configuration near one that is not free.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal

import numpy as np

from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.ik.numeric import numeric
from kinematics.ik.solution import IkResult
from kinematics.model.chain import Chain
from obstacles.collision.checker import Checker
from obstacles.collision.fcl_distance import FclWorld, overlap_meter
from planning.constrained.ik import goal_configurations
from planning.goal_choice.goal_order import is_at_limit, motion_costs
from planning.planner import ENOUGH, TOUCHING, Candidate
from planning.preflight.limits import LimitViolation, goal_onto_limits
from planning.preflight.pose_configurations import pose_configurations, turned_copies
from planning.problem import JointGoal, PoseGoal, Problem
from planning.result import Failure
from planning.values.deadline import Deadline
from planning.values.limits import position_excess
from planning.values.preferences import GoalCosts

#: Clearance that a configuration found to be free has at least, margins taken off [m].
_CLEARANCE = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class NearestFree:
    """A free configuration near one that is not free.

    Args:
        joints: Shape (n,).
        distance: Euclidean, in joint space.
        tip_distance: How far the tip's origin is moved [m].
        clearance: Margins taken off [m].
    """

    joints: Array
    distance: float
    tip_distance: float
    clearance: float

    @property
    def details(self) -> dict[str, Any]:
        """The configuration as values a program can use."""
        return {
            "joints": self.joints.tolist(),
            "distance": self.distance,
            "tip_distance": self.tip_distance,
            "clearance": self.clearance,
        }


def nearest_free(checker: Checker, q: Array, seed: int = 0) -> NearestFree | None:
    """Find a free configuration near ``q``, inside the limits; None if none is found.

    It takes the least step that brings all near pairs apart, to first order, again and again. Where
    that fails, it tries random configurations farther and farther off. From the first that is free
    it goes back towards ``q`` as far as that stays free. It is near, not proved to be nearest.

    Args:
        checker: The robot in its scene, margins included.
        q: Configuration, shape (n,) [rad or m].
        seed: Of the draws; the same seed gives the same answer.
    """
    chain = checker.model.robot.chain
    spacious = Checker(checker.model, checker.slack + _CLEARANCE)
    inside = np.clip(q, chain.limits.lower, chain.limits.upper)
    free = _descend(spacious, inside)
    if free is None:
        free = _draw(spacious, inside, np.random.default_rng(seed))
    if free is None:
        return None
    free = _go_back(spacious, free, inside)
    tip_motion = forward(chain, free)[:3, 3] - forward(chain, q)[:3, 3]
    clearance, _ = checker.clearance(free)
    distance, tip_distance = np.linalg.norm(free - q), np.linalg.norm(tip_motion)
    return NearestFree(free, float(distance), float(tip_distance), clearance)


def _descend(spacious: Checker, q: Array) -> Array | None:
    """Step away from contacts until there are none; None where that does not succeed."""
    limits = spacious.model.robot.chain.limits
    # Steps of the descent away from contacts.
    for _ in range(40):
        if spacious.valid(q):
            return q
        # Distance up to which pairs are taken into account in it [m].
        near = spacious.gradient(q, 0.02)
        touching = near.distances <= _CLEARANCE
        if not touching.any():
            return None
        # What is near but apart may come nearer, though not into touch.
        change = np.where(touching, 2.0 * _CLEARANCE - near.distances, 0.0)
        approach = near.gradients @ _least_step(near.gradients[touching], change[touching]) < 0
        active = touching | approach
        step = _least_step(near.gradients[active], change[active])
        longest = float(np.abs(step).max())
        if not longest > 0.0:
            return None
        # Longest step of any joint in it [rad or m].
        step *= min(1.0, 0.2 / longest)
        q = np.clip(q + step, limits.lower, limits.upper)
    return None


def _least_step(gradients: Array, change: Array) -> Array:
    """The least step (n,) that changes the distances (k,) as asked, to first order."""
    # Singular values below this part of the largest count as zero in a step.
    return np.asarray(np.linalg.lstsq(gradients, change, rcond=1e-3)[0])


def _draw(spacious: Checker, q: Array, random: np.random.Generator) -> Array | None:
    """The nearest of the random configurations that are free, if one is."""
    chain = spacious.model.robot.chain
    low, high = chain.sampling_bounds()
    best: Array | None = None
    # Random configurations about the one that is not free, if the descent fails.
    draws = 240
    for k in range(draws):
        # Half-width of the first draw's box, as part of the joints' ranges; the last has all of
        # them.
        share = 0.02 ** (1.0 - k / draws)
        drawn = q + share * (high - low) * random.uniform(-1.0, 1.0, chain.n)
        drawn = np.clip(drawn, chain.limits.lower, chain.limits.upper)
        if best is not None and np.linalg.norm(drawn - q) >= np.linalg.norm(best - q):
            continue
        if spacious.valid(drawn):
            best = _go_back(spacious, drawn, q)
    return best


def _go_back(spacious: Checker, free: Array, q: Array) -> Array:
    """The free configuration nearest to ``q`` that a bisection finds on the way there."""
    low, high = 0.0, 1.0
    # Bisections of the way back to the configuration that was asked for.
    for _ in range(12):
        middle = 0.5 * (low + high)
        if spacious.valid(free + middle * (q - free)):
            low = middle
        else:
            high = middle
    return np.asarray(free + low * (q - free))


End = Literal["start", "goal"]


@dataclass(frozen=True, slots=True, eq=False)
class Refusal:
    """A goal that is not valid.

    Args:
        code: MoveIt's name of the error.
        failure: Says why; that takes time, and is done of one goal alone.
    """

    code: str
    failure: Callable[[], Failure]


def limit_failure(end: End, violation: LimitViolation) -> Failure:
    """The failure of a start or goal outside the joint limits."""
    where = position_excess(violation.joint, violation.value, violation.limit)
    return Failure(
        code=f"{end.upper()}_STATE_INVALID",
        message=f"at the {end}, {where}",
        hint="Bring the joint inside its limits.",
        stage=end,
        details=violation.details,
    )


def collision_failure(
    problem: Problem, end: End, q: Array, pair: tuple[str, str] | None, clearance: float
) -> Failure:
    """The failure of a start or goal in which something touches, or is nearer than its margin.

    The depth is that of the solids themselves; a margin has none.

    Args:
        problem: What is to be planned.
        end: Which end it is.
        q: Its configuration, shape (n,).
        pair: The nearest pair, where the checker knows one.
        clearance: Clearance of that pair, margins taken off [m].
    """
    solids = tuple(replace(obstacle, margin=0.0) for obstacle in problem.scene.obstacles)
    world = FclWorld(problem.robot, replace(problem.scene, obstacles=solids))
    contacts = world.collisions(q)
    details: dict[str, Any] = {}
    deep = overlap_meter(problem.robot, problem.scene).too_deep(q)
    if deep:
        (item, depth), pair = deep[0], deep[0][0].pair
        message, details = item.deeper(depth)
    elif contacts:
        pair, depth = contacts[0].pair, contacts[0].depth
        message = f"{pair[0]!r} and {pair[1]!r} overlap by {depth:.4g} m"
    else:
        assert pair is not None
        depth, distance = 0.0, world.distance_between(q, pair)
        margin = max(distance - clearance, 0.0)
        details = {"clearance": distance, "margin": margin}
        message = _apart_message(pair, distance, margin)
    nearest = nearest_free(Checker.of(problem.robot, problem.scene, problem.margin), q)
    allow = (
        "allow the pair if contact is meant (allowed_collisions, or touch_links of what is held)"
    )
    if deep:
        allow = "raise touch_depth if so deep a contact is meant (null for any depth)"
    return Failure(
        code=f"{'START_STATE' if end == 'start' else 'GOAL'}_IN_COLLISION",
        message=f"at the {end}, {message}",
        hint=f"Move the {end} away, lower the margin, or {allow}.",
        stage=end,
        details={
            "pair": list(pair),
            "depth": depth,
            "collisions": [{"pair": list(item.pair), "depth": item.depth} for item in contacts]
            + [{"pair": list(item.pair), "depth": depth} for item, depth in deep],
            "nearest_valid": None if nearest is None else nearest.details,
            **details,
        },
    )


def _apart_message(pair: tuple[str, str], distance: float, margin: float) -> str:
    message = f"{pair[0]!r} and {pair[1]!r} are {distance:.4g} m apart"
    if margin > TOUCHING:
        message += f", nearer than their margin of {margin:.4g} m"
    return message + (": they touch" if distance <= TOUCHING else "")


def unreachable_failure(chain: Chain, result: IkResult) -> Failure:
    """The failure of a pose that inverse kinematics finds no configuration for."""
    nearest = result.nearest
    return Failure(
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


def no_goal_failure(refusals: Sequence[Refusal]) -> Failure:
    """The failure of the first goal; of several, how many are not valid for which reason."""
    first = refusals[0].failure()
    if len(refusals) == 1:
        return first
    counts = dict(Counter(refusal.code for refusal in refusals))
    message = f"none of {len(refusals)} goals is valid; the first: {first.message}"
    return replace(first, message=message, details={**first.details, "goals": counts})


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
