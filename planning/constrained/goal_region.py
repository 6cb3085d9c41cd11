"""Goal regions: configurations of a goal's pose, found while trees grow.

A pose has endlessly many configurations on an arm with joints to spare, and several branches on any
arm. Under constraints most of those drawn at random can't be reached from the start; the one that
Newton's method finds from a configuration that can be mostly can.
"""

from dataclasses import dataclass, field

import numpy as np

from kinematics.arrays import Array
from planning.constrained.checker import ConstrainedChecker
from planning.constrained.pose_goals import pose_constraint
from planning.constrained.projected_rrt import project_kernel
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.solvers.active_set import FEASIBLE
from planning.constraints.solvers.active_set_program import Goal, make_goal
from planning.preflight_result import TOUCHING
from planning.problem import PoseGoal


@dataclass(frozen=True, slots=True, eq=False)
class GoalRegion:
    """Goal poses of which any configuration will do.

    Args:
        checker: The robot in its scene with its constraints.
        poses: The poses, at least one.
    """

    checker: ConstrainedChecker
    poses: tuple[PoseGoal, ...]
    goals: tuple[Goal, ...] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "goals", tuple(self._goal(pose) for pose in self.poses))

    def _goal(self, pose: PoseGoal) -> Goal:
        """The pose beside the constraints of the path, as a target of Newton's method."""
        chain, path = self.checker.model.chain, self.checker.constraints
        zero = np.zeros(chain.n)
        of_pose = ConstraintSet(chain, (pose_constraint(pose),)).packed
        return make_goal(path, zero, zero, rows=np.vstack([self.checker.rows, of_pose]))

    def goal_near(self, q: Array, number: int) -> Array | None:
        """Find a free configuration of a pose by Newton's method from q; None where it fails.

        Args:
            q: Configuration to begin at, shape (n,) [rad or m].
            number: Number of the pose, modulo how many there are.
        """
        projected = np.array(q)
        goal = self.goals[number % len(self.goals)]
        # Iterations of Newton's method from a configuration to a pose.
        if project_kernel(goal, projected, 40) > FEASIBLE:
            return None
        return projected if self.checker.clearance(projected)[0] > TOUCHING else None
