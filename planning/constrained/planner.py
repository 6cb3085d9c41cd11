"""RRT-Connect along the set that constraints allow, as a planner.

Goals that are poses are regions to it: the trees get new goals near what they have reached.
"""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from kinematics.arrays import Array
from planning.constrained.checker import ConstrainedChecker
from planning.constrained.pose_goals import pose_constraint
from planning.constrained.projected_rrt import Manifold, MoreGoals, project_kernel, projected_rrt
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.solvers.active_set import FEASIBLE
from planning.constraints.solvers.active_set_program import Goal, make_goal
from planning.planner import Query
from planning.preflight_result import TOUCHING
from planning.problem import PoseGoal
from planning.result import Attempt


@dataclass(frozen=True, slots=True)
class ProjectedRrt:
    """The planner of paths under constraints; goals that are poses are regions to it.

    Args:
        name: Name of the planner in whose place it plans.
    """

    name: str
    needs_goals: ClassVar[bool] = True

    def plan(self, query: Query) -> Attempt:
        """Grow two trees along the allowed set; the query's checker has the constraints."""
        checker, ready = query.checker, query.ready
        assert isinstance(checker, ConstrainedChecker)
        # Edges of trees without constraints that take as long as one extension along constraints.
        waypoints, extensions = projected_rrt(
            Manifold(checker),
            ready.start,
            ready.goals,
            query.seed,
            query.deadline,
            _more_goals(checker, query),
            query.explored,
            None if query.bound is None else query.bound // 20,
        )
        return Attempt(waypoints, f"{extensions} extensions along the constraints.")


def _more_goals(checker: ConstrainedChecker, query: Query) -> MoreGoals | None:
    poses = tuple(goal for goal in query.problem.goals if isinstance(goal, PoseGoal))
    return GoalRegion(checker, poses).goal_near if poses else None


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
