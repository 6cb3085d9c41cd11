"""More goals while a tree grows: configurations of a goal's pose in the branch the tree is in.

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
from planning.constraints.active_set import HELD, Goal, make_goal
from planning.constraints.constraint_set import ConstraintSet
from planning.problem import PoseGoal
from planning.ready import TOUCHING

_PROJECTIONS = 40


@dataclass(frozen=True, slots=True, eq=False)
class GoalRegion:
    """Poses of which any configuration will do.

    Args:
        checker: The robot in its scene with its constraints.
        poses: One at least.
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

    def near(self, q: Array, number: int) -> Array | None:
        """A configuration of a pose that Newton's method finds from q, if it finds a free one.

        Args:
            q: Shape (n,).
            number: Of the pose, counted round and round.
        """
        made = np.array(q)
        if project_kernel(self.goals[number % len(self.goals)], made, _PROJECTIONS) > HELD:
            return None
        return made if self.checker.clearance(made)[0] > TOUCHING else None
