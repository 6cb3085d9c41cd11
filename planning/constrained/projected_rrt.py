"""RRT-Connect under constraints: two trees along the set of configurations that they allow.

The trees are those of ``search.rrt_connect`` with another step: a walk along the set, as far as it
is proved. Goals that are poses give new roots while the trees grow (``GoalRegion``). Source:
"Manipulation planning on constraint manifolds", IEEE International Conference on Robotics and
Automation, 2009.
"""

from dataclasses import dataclass, field
from itertools import pairwise
from typing import ClassVar

import numpy as np

from compiled.kernel import kernel
from kinematics.arrays import Array
from planning.constrained.checker import ConstrainedChecker, narrow_rows
from planning.constrained.ik import pose_constraint
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.solvers.active_set import FEASIBLE, make_feasible
from planning.constraints.solvers.active_set_program import Goal, make_goal, make_work
from planning.planner import TOUCHING, Query
from planning.problem import PoseGoal
from planning.result import Attempt
from planning.search.rrt_connect import Guide, MoreGoals, PairOptions, TreePairs
from planning.search.walk import AllowedSet, walk_kernel
from planning.values.deadline import Deadline
from planning.values.search_trees import Explored

#: Extensions after which a pair of trees is given up for a fresh one: most pairs that meet do so
#: within these, and those that do not take many times as many.
_FIRST_BUDGET = 60
#: A path that is longer than its straight line by this factor wanders; and how many others are
#: searched for then.
_WANDERING, _OTHER_PATHS = 1.3, 6


@dataclass(frozen=True, slots=True, eq=False)
class Manifold:
    """The set of configurations that a checker's constraints allow.

    Args:
        checker: The robot in its scene with its constraints.
    """

    checker: ConstrainedChecker
    along: AllowedSet = field(init=False)

    def __post_init__(self) -> None:
        chain, constraints = self.checker.model.robot.chain, self.checker.constraints
        # Projected configurations keep a share of half a row's width: edges between them bulge.
        # They keep 1 cm [or rad] at most: where a row is wide, the way may lead along its bounds.
        zero, inner = np.zeros(chain.n), narrow_rows(constraints, 0.25, 1e-2)
        goal = make_goal(constraints, zero, zero, rows=inner)
        object.__setattr__(self, "along", AllowedSet(goal, self.checker.rows))

    def project(self, q: Array) -> Array | None:
        """Project q (n,) onto the set by Newton's method; None where that fails."""
        projected = np.array(q)
        # Iterations of Newton's method on a random configuration, which may be far away.
        if project_kernel(self.along.goal, projected, 40) > FEASIBLE:
            return None
        return projected

    def extend(self, start: Array, end: Array) -> tuple[Array, bool]:
        """Extend from ``start`` (n,) towards ``end`` (n,) along the set, as far as can be proved.

        Returns:
            The configurations after each step, without the start, shape (k, n), every step proved
            to hold the constraints and to be free; and whether it arrived.
        """
        # Steps of one extension at most.
        steps = np.empty((400, len(start)))
        model, slack = self.checker.model.arrays, self.checker.slack
        begin, target = np.array(start), np.array(end)
        count, arrived = walk_kernel(model, slack, self.along, begin, target, steps)
        return steps[:count], bool(arrived)


def projected_rrt(
    manifold: Manifold,
    start: Array,
    goals: list[Array],
    seed: int,
    deadline: Deadline,
    more_goals: MoreGoals | None = None,
    explored: Explored | None = None,
    max_extensions: int | None = None,
) -> tuple[Array | None, int]:
    """Grow trees from start and goals until they meet.

    Args:
        manifold: The set that the trees grow along.
        start: Valid configuration, shape (n,) [rad or m].
        goals: Valid configurations (n,).
        seed: Seed of the draws: the same one gives the same path.
        deadline: Instant at which the search stops.
        more_goals: Finds goals near configurations that were reached; None where goals are points.
        explored: Keeps the edges of the last pair of trees.
        max_extensions: Largest number of extensions; None for no bound.

    Returns:
        Waypoints (k, n) whose legs hold and are free, None where it found none in time; and how
        many extensions were tried.
    """
    # No search has time for so many.
    most = 10**9 if max_extensions is None else max_extensions
    roots = np.array([start, *goals])
    pairs = TreePairs(
        manifold.checker, roots, seed, deadline, most, explored, along=manifold.along,
        more_goals=more_goals,
    )  # fmt: skip
    # All is drawn from everywhere that the limits allow, and nothing beside the straight line.
    guide, budget, path = Guide(roots[:2], 0.0, 0.0), float(_FIRST_BUDGET), None
    while path is None and pairs.may_go_on:
        path = pairs.grow(PairOptions(int(budget), np.inf, domain=np.inf, guide=guide, whole=True))
        # Factor by which the next pair may take more.
        budget *= 1.6
    return path, pairs.edges


def shortest_along(manifold: Manifold, waypoints: Array, seed: int, deadline: Deadline) -> Array:
    """Shorten a path (k, n) of proved legs, and where it wanders, other paths between its ends.

    Cuts keep to the way around obstacles and along the set that the search happened upon.
    """
    best = _shortened(manifold, waypoints, seed, deadline)
    straight = _length(best[[0, -1]])
    for k in range(1, _OTHER_PATHS + 1):
        if _length(best) <= _WANDERING * straight or deadline.passed:
            break
        # Seeds of neighbouring requests are next to each other.
        other, _ = projected_rrt(
            manifold,
            best[0],
            [best[-1]],
            seed + 104_729 * k,
            deadline,
            max_extensions=2 * _FIRST_BUDGET,
        )
        if other is not None:
            other = _shortened(manifold, other, seed, deadline)
            best = min(best, other, key=_length)
    return best


def _shortened(manifold: Manifold, waypoints: Array, seed: int, deadline: Deadline) -> Array:
    short = shortcut_along(manifold, waypoints, seed, deadline)
    # A tenth longer than the straight line: there is little to gain.
    if _length(short) < 1.1 * _length(short[[0, -1]]):
        return short
    return shortcut_along(manifold, tightened(manifold, short, deadline), seed, deadline)


def _length(points: Array) -> float:
    """Length of the polyline through points (k, n)."""
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


def shortcut_along(manifold: Manifold, waypoints: Array, seed: int, deadline: Deadline) -> Array:
    """Shorten a path (k, n) of proved legs by straight cuts and by extensions.

    The legs of what comes back are proved too.
    """
    points = list(waypoints)
    random = np.random.default_rng(seed)
    idle = 0
    # Cuts that are tried to shorten a path.
    for _ in range(160):
        # Cuts in a row without any gain after which a path counts as short.
        if len(points) < 3 or idle >= 50 or deadline.passed:
            break
        cut = _cut(manifold, points, random)
        idle = idle + 1 if cut is None else 0
        points = points if cut is None else cut
    return np.array(points)


def tightened(manifold: Manifold, waypoints: Array, deadline: Deadline) -> Array:
    """Pull a path (k, n) of proved legs tight: each corner towards the middle of its neighbours.

    The legs of what comes back are proved too.
    """
    points = list(waypoints)
    # Rounds at most; one that gains less than a hundredth of the length is the last.
    for _ in range(20):
        before = _length(np.array(points))
        for i in range(1, len(points) - 1):
            a, b = points[i - 1], points[i + 1]
            for share in (1.0, 0.3):
                q = manifold.project(points[i] + share * (0.5 * (a + b) - points[i]))
                if q is None or deadline.passed:
                    continue
                shorter = _length(np.array([a, q, b])) < _length(np.array([a, points[i], b]))
                if shorter and manifold.checker.free(a, q) and manifold.checker.free(q, b):
                    points[i] = q
                    break
        if _length(np.array(points)) > 0.99 * before:
            break
    return np.array(points)


def _cut(
    manifold: Manifold, points: list[Array], random: np.random.Generator
) -> list[Array] | None:
    """Join two random places of a path along the set; None where that is no shorter."""
    lengths = np.array([np.linalg.norm(b - a) for a, b in pairwise(points)])
    ends = np.cumsum(lengths)
    first, last = np.sort(random.uniform(0.0, ends[-1], 2))
    i, j = int(np.searchsorted(ends, first)), int(np.searchsorted(ends, last))
    if i == j:
        return None
    a, b = (
        points[leg] + (1.0 - (ends[leg] - at) / lengths[leg]) * (points[leg + 1] - points[leg])
        for leg, at in ((i, first), (j, last))
    )
    # A cut has to gain this share of the path's length.
    max_length = last - first - 1e-3 * ends[-1]
    if np.linalg.norm(b - a) > max_length:
        return None
    between: list[Array] = []
    if not manifold.checker.free(a, b):
        steps, arrived = manifold.extend(a, b)
        legs = np.diff(np.vstack([a, steps]), axis=0)
        if not arrived or np.linalg.norm(legs, axis=1).sum() > max_length:
            return None
        between = list(steps[:-1])
    return [*points[: i + 1], a, *between, b, *points[j + 1 :]]


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
        chain, path = self.checker.model.robot.chain, self.checker.constraints
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


@kernel
def project_kernel(goal: Goal, q: Array, steps: int) -> float:
    """Project q (n,) onto the set in place; the worst residual that is left."""
    work = make_work(None, goal)
    return make_feasible(None, goal, q, steps, work, np.empty_like(q), np.empty_like(q))
