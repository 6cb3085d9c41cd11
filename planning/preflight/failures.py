"""Failures of starts and goals that are not valid: what is wrong, by how much, what would do.

A free configuration near one that is not free.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.ik.solution import IkResult
from kinematics.model.chain import Chain
from obstacles.collision.checker import Checker
from obstacles.collision.fcl_distance import FclWorld, overlap_meter
from planning.planner import TOUCHING
from planning.preflight.limits import LimitViolation
from planning.problem import Problem
from planning.result import Failure
from planning.values.limits import position_excess

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
