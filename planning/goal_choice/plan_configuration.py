"""The configuration of a pose that a plan ends in, why it is not another one, how far off it is."""

import numpy as np

from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.ik.numeric.numeric import ORIENTATION_TOLERANCE, POSITION_TOLERANCE
from kinematics.pose import rotation_error
from planning.goal_choice.chosen_configuration import chosen_configuration
from planning.preflight.goal_order import motion_times
from planning.preflight.goals import pose_goals
from planning.preflight_result import Ready
from planning.problem import PoseGoal, Problem
from planning.result import ChosenConfiguration
from planning.values.goal_costs import GoalCosts

#: A plan ends in a configuration that differs by no more than this in a joint [rad or m].
_SAME = 1e-9
#: Configurations that are right at a pose are off it by so many times what inverse kinematics asks
#: for at most: the last joint values are rounded.
_RIGHT = 2.0


def plan_configuration(
    problem: Problem,
    ready: Ready,
    last: Array,
    weights: GoalCosts,
    replaced: tuple[float, float] | None = None,
) -> ChosenConfiguration | None:
    """Costs of the configuration that a plan ends in, as the order of goals counts them.

    Args:
        problem: What was planned.
        ready: Its start, and the configurations that were found.
        last: Where the plan ends, shape (n,) [rad or m].
        weights: Of the costs.
        replaced: Times of a plan to a configuration at a limit, and of this one, which took its
            place [s]; None where it took none.

    Returns:
        None where it ends in none of a pose's configurations: goals that are joints leave no
        choice, and path constraints choose others.
    """
    posed = pose_goals(problem, [candidate.joints for candidate in ready.found])
    if not posed:
        return None
    found = np.array(posed)
    k = int(np.abs(found - last).max(axis=1).argmin())
    if np.abs(found[k] - last).max() > _SAME:
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
        last: Where the plan ends, shape (n,) [rad or m].
    """
    if problem.constraints is not None or not pose_goals(problem, [last]):
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
    if away <= _RIGHT * POSITION_TOLERANCE and angle <= _RIGHT * ORIENTATION_TOLERANCE:
        return None
    return (
        f"No configuration is right at the pose: the tip ends {away:.3g} m and {angle:.3g} rad "
        "off, within the goal's tolerances."
    )
