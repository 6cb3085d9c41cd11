"""The configuration of a pose that a plan ends in, and why it is not another one."""

import numpy as np

from kinematics.arrays import Array
from planning.chosen_configuration import chosen_configuration
from planning.goal_costs import GoalCosts
from planning.preflight.goal_order import motion_times
from planning.preflight.goals import pose_goals
from planning.problem import Problem
from planning.ready import Ready
from planning.result import ChosenConfiguration

#: A plan ends in a configuration that differs by no more than this in a joint [rad or m].
_SAME = 1e-9


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
