"""RRT-Connect along the set that constraints allow, as a planner."""

from dataclasses import dataclass
from typing import ClassVar

from planning.constrained.checker import ConstrainedChecker
from planning.constrained.goal_region import GoalRegion
from planning.constrained.projected_rrt import Manifold, MoreGoals, projected_rrt
from planning.planner import Query
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
