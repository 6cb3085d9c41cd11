"""Report of the configuration that was chosen for a pose: its costs, and why no other one."""

from collections.abc import Sequence

import numpy as np

from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.ik.closed_form.analytic import branches, parameter
from kinematics.ik.closed_form.structure import structure
from kinematics.ik.numeric.numeric import ORIENTATION_TOLERANCE, POSITION_TOLERANCE
from kinematics.model.chain import Chain
from kinematics.pose import rotation_error
from planning.goal_choice.goal_order import (
    NEAR_LIMIT,
    clearance_lacks,
    limit_nearness,
    limit_shares,
    manipulability_lacks,
    own_branch,
    turn_counts,
)
from planning.preflight_result import Ready
from planning.problem import PoseGoal, Problem
from planning.result import ChosenConfiguration
from planning.timing.rest_to_rest import motion_times
from planning.values.goal_costs import GoalCosts

#: The reason of a small move.
_OWN_BRANCH = (
    "The move is small: the configuration next to its start, which takes at most 1.2 times as long "
    "as the quickest."
)


def chosen_configuration(
    chain: Chain,
    found: Array,
    q: Array,
    start: Array,
    times: Array,
    clearance: float,
    weights: GoalCosts,
    replaced: tuple[float, float] | None = None,
) -> ChosenConfiguration:
    """Costs of one of several configurations, and why it is not another one.

    Args:
        chain: The robot.
        found: All free configurations that were found, shape (k, n) [rad or m].
        q: The one that was chosen, one of them, shape (n,).
        start: Where the motion to it begins, shape (n,).
        times: Of the straight motions from there to each of them, shape (k,) [s].
        clearance: At the one that was chosen, margins taken off [m].
        weights: Of the costs.
        replaced: Times of the motions beside a configuration at a limit, and beside this one, which
            took its place [s]; None where it took none.
    """
    k = int(np.abs(found - q).max(axis=1).argmin())
    parts = {
        "motion_time": weights.motion_time * times,
        "joint_limits": weights.joint_limits * limit_nearness(chain, found),
        "manipulability": weights.manipulability * manipulability_lacks(chain, found),
        "turns": weights.turns * turn_counts(chain, start, found),
    }
    total = np.sum(list(parts.values()), axis=0)
    shares = limit_shares(chain, found)
    stays = own_branch(chain, start, found, times) == k
    own = {name: float(values[k]) for name, values in parts.items()}
    own["clearance"] = float(weights.clearance * clearance_lacks(np.array([clearance]))[0])
    cheaper = int(np.count_nonzero(total < total[k] - 1e-9))
    return ChosenConfiguration(
        branch=branch_name(chain, q),
        limit_share=float(shares[k]),
        costs=own,
        found=len(found),
        cheaper=cheaper,
        at_limit=int(np.count_nonzero(shares < NEAR_LIMIT)),
        reason=_OWN_BRANCH
        if stays and cheaper and replaced is None
        else _reason(len(found), cheaper, bool(shares[k] < NEAR_LIMIT), replaced),
    )


def _reason(found: int, cheaper: int, at_limit: bool, replaced: tuple[float, float] | None) -> str:
    if replaced is not None:
        return (
            "In place of one within 2 % of a joint limit: the motions beside it take "
            f"{replaced[1]:.3f} s, and {replaced[0]:.3f} s with that one."
        )
    if found == 1:
        return "The only free configuration that was found."
    if at_limit:
        return (
            "Within 2 % of a joint limit: with none of the others that were planned to do the "
            "motions beside it take at most 1.2 times as long."
        )
    if not cheaper:
        return f"It costs the least of {found} free configurations."
    return (
        f"{cheaper} of {found} free configurations cost less up to here; the search expected more "
        "of the whole with them, or found no motion."
    )


def branch_name(chain: Chain, q: Array) -> str | None:
    """Name of the branch of the closed form that a configuration (n,) is of; None without one."""
    form = structure(chain)
    if form is None:
        return None
    values = np.array([parameter(chain, q)]) if form.redundant else None
    table = branches(chain, forward(chain, q), seed_joints=q, parameters=values)
    if not len(table.joints):
        return None
    off = np.abs(table.joints - q).max(axis=1)
    k = int(off.argmin())
    return table.label(k) if off[k] < 1e-4 else None


def plan_configuration(
    problem: Problem,
    ready: Ready,
    posed: Sequence[Array],
    last: Array,
    weights: GoalCosts,
    replaced: tuple[float, float] | None = None,
) -> ChosenConfiguration | None:
    """Costs of the configuration that a plan ends in, as the order of goals counts them.

    Args:
        problem: What was planned.
        ready: Its start, and the configurations that were found.
        posed: Those of them that are of poses, each (n,) [rad or m].
        last: Where the plan ends, shape (n,) [rad or m].
        weights: Of the costs.
        replaced: Times of a plan to a configuration at a limit, and of this one, which took its
            place [s]; None where it took none.

    Returns:
        None where it ends in none of a pose's configurations: goals that are joints leave no
        choice, and path constraints choose others.
    """
    if not posed:
        return None
    found = np.array(posed)
    k = int(np.abs(found - last).max(axis=1).argmin())
    # Joint values of goals come back to the last bits.
    if np.abs(found[k] - last).max() > 1e-9:
        return None
    clearance = next(own for own, q in ready.found if np.array_equal(q, found[k]))
    chain = problem.robot.chain
    return chosen_configuration(
        chain, found, found[k], ready.start, motion_times(chain, ready.start, found), clearance,
        weights, replaced,
    )  # fmt: skip


def deviation_note(problem: Problem, last: Array) -> str | None:
    """A note where a plan ends off its pose, within the goal's tolerances; None where it does not.

    Args:
        problem: What was planned. Path constraints take the tolerances as they are, and no note.
        last: Configuration of a pose that the plan ends in, shape (n,) [rad or m].
    """
    if problem.constraints is not None:
        return None
    tip, ends = forward(problem.robot.chain, last), list[tuple[float, float, float]]()
    for goal in problem.goals:
        if isinstance(goal, PoseGoal):
            away = float(np.linalg.norm(tip[:3, 3] - goal.T_base_tip[:3, 3]))
            turn = rotation_error(tip[:3, :3], goal.T_base_tip[:3, :3])
            angle = float(np.linalg.norm(turn))
            share = max(away / goal.position_tolerance, angle / goal.orientation_tolerance)
            ends.append((share, away, angle))
    _, away, angle = min(ends)
    # Right at the pose is a configuration of inverse kinematics, its last joint values rounded.
    if away <= 2.0 * POSITION_TOLERANCE and angle <= 2.0 * ORIENTATION_TOLERANCE:
        return None
    return (
        f"No configuration is right at the pose: the tip ends {away:.3g} m and {angle:.3g} rad "
        "off, within the goal's tolerances."
    )
