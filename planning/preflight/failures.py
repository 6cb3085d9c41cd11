"""Failures of starts and goals that are not valid: what is wrong, by how much, what would do."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

from kinematics.arrays import Array
from kinematics.ik.solution import IkResult
from kinematics.model.chain import Chain
from obstacles.collision.checker import Checker
from obstacles.collision.fcl_distance import FclWorld, overlap_meter
from planning.preflight.limits import LimitViolation
from planning.preflight.nearest_free import nearest_free
from planning.preflight_result import TOUCHING
from planning.problem import Problem
from planning.result import Failure
from planning.values.limits import position_excess

End = Literal["start", "goal"]

_COLLISION_CODES: dict[End, str] = {
    "start": "START_STATE_IN_COLLISION",
    "goal": "GOAL_IN_COLLISION",
}


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
        code=_COLLISION_CODES[end],
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


def time_up_failure(checked: int, count: int) -> Failure:
    """The failure of a search that had time for some of its goals only."""
    return Failure(
        code="TIMED_OUT",
        message=f"time was up when {checked} of {count} goals had been checked",
        hint="Allow more time, or give fewer goals.",
        stage="goal",
    )


def packing_failure(seconds: float) -> Failure:
    """The failure of a problem whose time is up once its solids were made ready for checks."""
    return Failure(
        code="TIMED_OUT",
        message=f"time was up when robot and scene had been made ready for collision checks, "
        f"which took {seconds:.2g} s",
        hint="Ask again: this process keeps what it made. Or allow more time, or give the scene "
        "coarser meshes.",
        stage="preflight",
        details={"seconds": seconds},
    )


def no_goal_failure(refusals: Sequence[Refusal]) -> Failure:
    """The failure of the first goal; of several, how many are not valid for which reason."""
    first = refusals[0].failure()
    if len(refusals) == 1:
        return first
    counts = dict(Counter(refusal.code for refusal in refusals))
    message = f"none of {len(refusals)} goals is valid; the first: {first.message}"
    return replace(first, message=message, details={**first.details, "goals": counts})
