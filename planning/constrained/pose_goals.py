"""Configurations for a goal that is a pose, where those of plain inverse kinematics won't do."""

import numpy as np

from kinematics.arrays import Array
from planning.constrained.ik import ConstrainedSolution, IkOptions, constrained_ik
from planning.constraints.constraint import Constraint
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.limit import ClearanceConstraint
from planning.constraints.relative_pose import RelativePoseConstraint
from planning.problem import PoseGoal, Problem

#: Of a goal's tolerances, shared among three axes: what rounding needs is kept back.
_SHARE = 0.999 / np.sqrt(3.0)
_GOALS, _STARTS = 8, 60


def pose_constraint(goal: PoseGoal) -> RelativePoseConstraint:
    """The constraint that a configuration of a pose holds, inside the goal's tolerances."""
    return RelativePoseConstraint(
        goal.T_base_tip,
        position_tolerances=_SHARE * goal.position_tolerance,
        orientation_tolerances=_SHARE * goal.orientation_tolerance,
    )


def goal_configurations(
    problem: Problem, goal: PoseGoal, start: Array, seed: int, held: tuple[Constraint, ...] = ()
) -> tuple[ConstrainedSolution, ...]:
    """Configurations of a pose that hold constraints and keep clear, nearest to the start first.

    Args:
        problem: Its robot, scene and margin count.
        goal: The pose.
        start: Where to look first, shape (n,).
        seed: Of the random starts.
        held: On the path.
    """
    clear = ClearanceConstraint(problem.margin)
    wanted = ConstraintSet(problem.robot.chain, (*held, pose_constraint(goal), clear))
    options = IkOptions(seed_joints=start, most=_GOALS, seed=seed, starts=_STARTS, solver="descent")
    return constrained_ik(problem.robot, wanted, problem.scene, options).solutions
