"""Configurations of goal poses under constraints, clear of obstacles."""

import numpy as np

from kinematics.arrays import Array
from planning.constrained.ik import ConstrainedSolution, IkOptions, constrained_ik
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.kinds.constraint import Constraint, RelativePoseConstraint
from planning.constraints.kinds.limit import ClearanceConstraint
from planning.problem import PoseGoal, Problem
from planning.values.deadline import Deadline

#: Share of a goal's tolerance for each of three axes; a thousandth is kept for rounding.
_SHARE = 0.999 / np.sqrt(3.0)


def pose_constraint(goal: PoseGoal) -> RelativePoseConstraint:
    """A goal's pose as a constraint: the largest box inside the goal's tolerances."""
    return RelativePoseConstraint(
        goal.T_base_tip,
        position_tolerances=_SHARE * goal.position_tolerance,
        orientation_tolerances=_SHARE * goal.orientation_tolerance,
    )


def goal_configurations(
    problem: Problem,
    goal: PoseGoal,
    start: Array,
    seed: int,
    constraints: tuple[Constraint, ...] = (),
    deadline: Deadline | None = None,
) -> tuple[ConstrainedSolution, ...]:
    """Find configurations of a pose that hold constraints and keep clear, nearest to start first.

    Args:
        problem: The problem; its robot, scene and margin count.
        goal: The pose.
        start: Configuration to search from, shape (n,) [rad or m].
        seed: Seed of the random starts.
        constraints: Constraints that hold along the path.
        deadline: Instant from which what was found will do.
    """
    clear = ClearanceConstraint(problem.margin)
    wanted = ConstraintSet(problem.robot.chain, (*constraints, pose_constraint(goal), clear))
    # At most eight configurations, from sixty starts of inverse kinematics.
    options = IkOptions(seed_joints=start, most=8, seed=seed, starts=60, deadline=deadline)
    return constrained_ik(problem.robot, wanted, problem.scene, options).solutions
