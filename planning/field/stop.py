"""The cause of a descent's end away from the goal: what pushed which point, and what to try."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from kinematics.arrays import Array
from kinematics.model.chain import Chain
from obstacles.collision.checker import Checker
from planning.field.control_points import ControlPoints
from planning.field.options import FieldOptions
from planning.field.potential import Field
from planning.result import Explanation

_OTHERWISE = 'ask for planner "auto"'


def explain_stop(
    chain: Chain,
    obstacles: Sequence[str],
    field: Field,
    where: ControlPoints,
    checker: Checker,
    q: Array,
    ending: str,
    options: FieldOptions,
) -> Explanation:
    """The cause of the end of a descent that did not arrive.

    Args:
        chain: The robot.
        obstacles: Names of the scene's obstacles.
        field: The potential.
        where: Its control points.
        checker: Checks motions for collisions.
        q: Where the descent ended, shape (n,) [rad or m].
        ending: "local_minimum", "no_progress", "kink", "blocked", "steps_used_up" or "timed_out".
        options: Those of the descent.

    Returns:
        In its details ``force``, the largest joint force [N m or N]; ``repelled``, the point that
        obstacles push most; ``at_limit``, joints held by a limit; ``next_contact``, the pair, or
        the joints at a limit, that the next step runs into.
    """
    value = field.at(q)
    strength = float(np.abs(value.joint_force).max())
    details: dict[str, Any] = {"force": strength}
    push = ""
    pushes = np.linalg.norm(value.repulsive_forces, axis=1)
    if pushes.max(initial=0.0) > 0.0:
        i = int(pushes.argmax())
        joint = chain.joint_of(int(where.joints[i]))
        obstacle = obstacles[int(value.nearest[i])]
        details["repelled"] = {
            "point": i,
            "joint": joint,
            "origin": value.points[i].tolist(),
            "obstacle": obstacle,
            "distance": float(value.distances[i]),
            "repulsive_force": float(pushes[i]),
            "attractive_force": float(np.linalg.norm(value.attractive_forces[i])),
        }
        push = (
            f"{obstacle!r} pushes point {i + 1}, which moves with {joint!r} and is "
            f"{value.distances[i]:.3g} m away, with {pushes[i]:.3g} N. "
        )
    if ending in ("blocked", "kink"):
        text, details["next_contact"] = _obstruction(chain, checker, q, value.joint_force, options)
        return Explanation(f"{text} {push}{_advice(ending, options)}", details)
    held = _held(chain, q, value.joint_force)
    if held:
        details["at_limit"] = held
        push = f"The force pushes {', '.join(map(repr, held))} against a limit. {push}"
    return Explanation(
        f"The largest joint force is {strength:.3g}. {push}{_advice(ending, options)}", details
    )


def _held(chain: Chain, q: Array, force: Array) -> list[str]:
    """Names of joints that stand at a limit and are pushed beyond it."""
    limits = chain.limits
    held = ((q <= limits.lower) & (force < 0.0)) | ((q >= limits.upper) & (force > 0.0))
    return [chain.joint_names[int(i)] for i in np.flatnonzero(held)]


def _obstruction(
    chain: Chain, checker: Checker, q: Array, force: Array, options: FieldOptions
) -> tuple[str, Any]:
    """The joint limits or the pair of solids that the smallest step along the force runs into."""
    limits, largest = chain.limits, max(float(np.abs(force).max()), np.finfo(float).tiny)
    step = options.longest_step * 0.5**options.halvings * force / largest
    ahead = np.clip(q + step, limits.lower, limits.upper)
    # Force on a joint below this part of the largest does not move it towards a limit.
    strong = np.abs(force) > 1e-3 * largest
    held = [chain.joint_names[int(i)] for i in np.flatnonzero(strong & (ahead == q))]
    motion = checker.segment(q, ahead)
    if motion.pair is not None and not motion.free:
        first, second = motion.pair
        return f"The next step would bring {first!r} against {second!r}.", [first, second]
    if held:
        return f"The force pushes {', '.join(map(repr, held))} against a limit.", held
    return "No small step along the force is proved free.", None


def _advice(ending: str, options: FieldOptions) -> str:
    """Options to change, with their values."""
    weights = f"repulsive_weights ({options.repulsive_weights}) or influence_distance "
    weights += f"({options.influence_distance:g} m)"
    if ending == "local_minimum":
        return (
            f"Pull and push balance: allow escapes ({options.escapes}), change {weights}, give a "
            f"waypoint as the goal first, or {_OTHERWISE}."
        )
    if ending == "steps_used_up":
        return f"Raise max_iterations ({options.max_iterations}) or the step_sizes."
    if ending == "no_progress":
        return f"Raise patience ({options.patience}), lower step_sizes, or {_OTHERWISE}."
    if ending == "kink":
        nearest = f"raise least_distance ({options.least_distance:g} m)"
        return f"Lower {weights}, {nearest}, or {_OTHERWISE}."
    if ending == "blocked":
        points = "" if options.control_points == "links" else (
            'take control_points "links" or point_radii, so that obstacles push the solids of the '
            "links and not bare points, "
        )  # fmt: skip
        return f"Raise {weights}, {points}or {_OTHERWISE}."
    return f"Allow more time, or {_OTHERWISE}."
