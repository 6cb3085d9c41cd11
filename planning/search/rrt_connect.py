"""RRT-Connect: two trees that grow towards each other until they meet, in one kernel (`trees`).

One tree takes a step towards a random configuration; the other one then goes step by step towards
where that ended. The path on which they meet is proved free. The smaller tree is the one to grow:
the end that stands in a narrow place gets the attempts that it needs. A node from which a step
failed is only grown towards configurations near it: far ones keep choosing the same nodes at the
border of the tree, and meet the same obstacles. Most draws lie about the straight line from start
to goal.

A narrow passage that random draws hardly ever hit is wide where solids may get into each other by
two centimetres. A way that is found there guides the draws of the next pair of trees, which allows
less, and so on down to the clearance asked for. Sources: "RRT-Connect: an efficient approach to
single-query path planning", IEEE International Conference on Robotics and Automation, 2000;
"Dynamic-domain RRTs: efficient exploration by controlling the sampling domain", the same
conference, 2005; "On finding narrow passages with probabilistic roadmap planners", Workshop on the
Algorithmic Foundations of Robotics, 1998; "Finding narrow passages with probabilistic roadmaps: the
small-step retraction method", Autonomous Robots, 2005.

Pairs of trees for one request: each grown anew, and all their edges counted.

The first planner: a straight motion in joint space, proved free or given up at once.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import ClassVar, NamedTuple

import numpy as np

from compiled.kernel import directly
from kinematics.arrays import Array
from obstacles.collision.checker import Checker, Motion
from planning.planner import Planner, Query
from planning.result import Attempt
from planning.search.trees import Draws, Growth, Tally, Trees, grow_kernel, new_trees
from planning.search.walk import AllowedSet
from planning.values.deadline import Deadline
from planning.values.search_box import search_box
from planning.values.search_trees import Explored


def straight_line(
    checker: Checker, start: Array, goals: list[Array]
) -> tuple[Array | None, list[Motion]]:
    """Try the straight joint motion to each goal in turn.

    Args:
        checker: The robot in its scene.
        start: Configuration, shape (n,) [rad or m].
        goals: Configurations (n,), the most wanted first.

    Returns:
        The two ends of the first motion that is proved free, or None, and what was found out
        about each.
    """
    motions = []
    for goal in goals:
        motion = checker.straight(start, goal)
        motions.append(motion)
        if motion.free:
            return np.array([start, goal]), motions
    return None, motions


@dataclass(frozen=True, slots=True)
class StraightLine:
    """The planner "straight_line"."""

    name: ClassVar[str] = "straight_line"
    needs_goals: ClassVar[bool] = True

    def plan(self, query: Query) -> Attempt:
        """Try the straight joint motion to each goal in turn."""
        waypoints, motions = straight_line(query.checker, query.ready.start, query.ready.goals)
        if waypoints is not None or motions[0].pair is None:
            return Attempt(waypoints, "Proved free.")
        return Attempt(None, f"Blocked: {motions[0].pair[0]} and {motions[0].pair[1]}.")


#: Finds a goal near a configuration (n,), given how many goals there are; None where there is none.
MoreGoals = Callable[[Array, int], Array | None]
#: Goals at most, those given among them.
_MOST_GOALS = 400
#: Edges looked at between two checks of the clock, and walks between two searches for a goal.
_EDGES_AT_ONCE, _WALKS_AT_ONCE = 250, 16
#: Nodes that there is room for a walk: most have some ten.
_NODES_A_WALK = 40
#: Share of the mean distance of two random configurations beyond which a node that has met
#: something is not grown any more.
DOMAIN = 0.4


class Guide(NamedTuple):
    """A way that most draws lie beside.

    Args:
        points: Points along the guide, evenly spread, shape (k, n).
        width: How far beside it draws are at most in each joint [rad or m].
        share: Share of the draws.
    """

    points: Array
    width: float
    share: float


class PairOptions(NamedTuple):
    """Budget, steps, clearance and draws of a pair of trees.

    Args:
        budget: Edges that it may check.
        step: Longest step, Euclidean in joint space.
        penetration: Depth that is taken off the clearance [m].
        domain: How far a node that has met something is grown, as a share of the mean distance of
            two random configurations.
        guide: A way to draw beside; None for the straight line from the start to the first goal.
        whole: Whether draws are from all that the limits allow, or within half a turn of the roots.
    """

    budget: int
    step: float
    penetration: float = 0.0
    domain: float = DOMAIN
    guide: Guide | None = None
    whole: bool = False


@dataclass(slots=True, eq=False)
class TreePairs:
    """Pairs of trees between a start and goals.

    Args:
        checker: The robot in its scene.
        roots: The start and the goals, shape (1 + g, n).
        seed: Seed that, with the number of a pair, decides all that the pair draws.
        deadline: Instant at which the search stops.
        max_edges: Largest number of edges of all pairs together.
        explored: Keeps the edges of the last pair that is grown with the clearance asked for.
        proves: Whether the paths of such pairs are proved.
        along: The set that steps are walks along; None for straight ones.
        more_goals: Finds goals near configurations that were reached; None where goals are points.
    """

    checker: Checker
    roots: Array
    seed: int
    deadline: Deadline
    max_edges: int
    explored: Explored | None
    proves: bool = True
    along: AllowedSet | None = None
    more_goals: MoreGoals | None = None
    edges: int = field(default=0, init=False)
    runs: int = field(default=0, init=False)

    @property
    def may_go_on(self) -> bool:
        """Whether there are edges and time left."""
        return self.edges < self.max_edges and not self.deadline.passed

    def grow(self, options: PairOptions) -> Array | None:
        """Grow one pair; the path on which it meets, shape (k, n), if it does."""
        checker, walks = self.checker, self.along is not None
        budget = min(options.budget, self.max_edges - self.edges)
        trees = new_trees(
            max(len(self.roots), _MOST_GOALS if self.more_goals else 0),
            checker.model.robot.chain.n,
            _NODES_A_WALK * budget if walks else budget,
            np.array(_random_state(self.seed, self.runs), np.uint64),
        )
        draws, until = self._draws(options), 0
        while True:
            until += _WALKS_AT_ONCE if walks else _EDGES_AT_ONCE
            given = checker.model.arrays, trees, draws, self.roots, self.along, budget, until
            # The door is that of the search without constraints.
            outcome = grow_kernel(*given) if walks else directly(grow_kernel, *given)
            if outcome != Growth.GOING or self.deadline.passed:
                break
            if self.more_goals is not None and len(self.roots) < _MOST_GOALS:
                self._aim(trees, self.more_goals, until)
        before, nodes = int(trees.tally[Tally.EDGES_BEFORE]), int(trees.tally[Tally.PATH])
        runs = 2 if before else 1
        self.edges += before + int(trees.tally[Tally.EDGES])
        self.runs += runs
        if self.explored is not None:
            for _ in range(runs):
                self.explored.begin("rrt_connect")
            if options.penetration == 0.0:
                _keep(trees, checker, self.explored)
        return trees.path[:nodes].copy() if nodes > 0 else None

    def _aim(self, trees: Trees, more_goals: MoreGoals, number: int) -> None:
        """Add a goal near a node of the start's tree to the roots, if there is one."""
        # Another node each time: the factor is a prime.
        node = 7_919 * number % int(trees.sizes[0])
        goal = more_goals(trees.points[0, node], len(self.roots) - 1)
        if goal is not None:
            self.roots = np.vstack([self.roots, goal])

    def _draws(self, options: PairOptions) -> Draws:
        roots, guide, chain = self.roots, options.guide, self.checker.model.robot.chain
        low, high = search_box(chain, roots, nearby=not options.whole)
        if guide is None:
            length = math.dist(roots[0].tolist(), roots[1].tolist())
            # Share of the draws that lie beside a guide. Most paths are there, and shorter; the
            # other draws find those that are not.
            # How far they lie beside the straight line at most in each joint, as a share of its
            # length.
            guide = Guide(roots[:2], 0.5 * length, 0.7)
        domain = options.domain * math.dist(high.tolist(), low.tolist()) / math.sqrt(6.0)
        proves = self.proves and options.penetration == 0.0
        slack = float(self.checker.slack) - options.penetration
        return Draws(low, high, domain, options.step, slack, proves, *guide)


#: Most requests leave the seed as it is, and making a state takes longer than some searches.
@lru_cache(maxsize=1024)
def _random_state(seed: int, run: int) -> tuple[int]:
    """The state (1,) of a generator of random numbers by which a pair of trees begins."""
    return (int(np.random.SeedSequence((seed, run)).generate_state(1, np.uint64)[0]),)


def _keep(trees: Trees, checker: Checker, explored: Explored) -> None:
    """Keep the edges of both trees as far as they are proved free."""
    for side, part in enumerate(("start", "goals")):
        points, parents = trees.points[side], trees.parents[side]
        joined = parents[: int(trees.sizes[side])] == -1
        for node in np.flatnonzero(parents[: len(joined)] >= 0):
            above = parents[node]
            if not joined[above]:
                continue
            joined[node] = trees.proved[side, node] or checker.free(points[above], points[node])
            if joined[node]:
                explored.add(points[above], points[node], part)


#: How deep solids may be in each other, from one pair of trees to the next [m]. Links are some
#: times as thick as the first, so that no way leads through the middle of one.
_PENETRATIONS = (0.02, 0.015, 0.01, 0.005, 0.0025, 0.0)
#: Longest step of one pair of trees after another, Euclidean in joint space. Long ones are through
#: in half of the edges where there is room, with longer paths; in clutter short ones are sooner.
_STEPS = (0.5, 1.0, 0.25)
#: Domain of the first pair of trees: most paths are found by far draws, soon or never.
_FIRST_DOMAIN = 0.65
#: Of so many pairs of trees the last draws from all that the limits allow, the others within half a
#: turn of start and goals: arms with joints of two turns find the short way round, and a way that
#: winds up further is not lost.
_NEARBY = 7
#: The edges that trees need are spread widely: a pair that has looked at so many without meeting is
#: given up for a fresh one, which may check more. Counted in edges, not in time, the
#: answer depends on the seed alone.
_FIRST_BUDGET = 2000
#: Factor by which the next pair may check more, up to the most: the nearest of many nodes takes
#: longer to find.
_BUDGET_GROWTH, _MOST_BUDGET = 1.5, 10_000
#: Edges after which the cascade's own trees give way to OMPL's, and those grown in the hulls of the
#: robot's solids to such as are grown with its exact pieces.
_MAX_EDGES = 200_000
_MAX_EDGES_IN_HULLS = 20_000
#: Edges that come to nothing before narrow passages are looked for where they are wider: from then
#: on whenever that has had no more edges than the rest.
_NARROW = 3000


class RrtResult(NamedTuple):
    """The path that trees found, and what it cost.

    Args:
        waypoints: Shape (k, n), every leg proved free, if that was asked for; None where they did
            not meet.
        edges: Edges that were checked.
        runs: Pairs of trees that were grown.
    """

    waypoints: Array | None
    edges: int
    runs: int


def rrt_connect(
    checker: Checker,
    start: Array,
    goals: list[Array],
    seed: int,
    deadline: Deadline,
    max_edges: int,
    explored: Explored | None = None,
    *,
    proves: bool = True,
) -> RrtResult:
    """Grow trees from a configuration and from the goals until they meet.

    Where the path is long, another pair of trees has as many edges as it took; the shorter path is
    the answer.

    Args:
        checker: The robot in its scene.
        start: Valid configuration, shape (n,) [rad or m].
        goals: Valid configurations (n,).
        seed: Seed of the draws: the same one gives the same path.
        deadline: Instant at which the search stops.
        max_edges: Edges after which to stop; the last pair may take as many again.
        explored: Keeps the edges of the last pair of trees.
        proves: Whether the path is proved; otherwise states of it are checked.
    """
    roots = np.array([start, *goals])
    pairs = TreePairs(checker, roots, seed, deadline, max_edges, explored, proves)
    turn, budget, plain, path = 0, float(_FIRST_BUDGET), 0, None
    while path is None and pairs.may_go_on:
        before, whole = pairs.edges, turn % _NEARBY == _NEARBY - 1
        domain = _FIRST_DOMAIN if turn == 0 else DOMAIN
        step = _STEPS[turn % len(_STEPS)]
        path = pairs.grow(PairOptions(int(budget), step, domain=domain, whole=whole))
        turn, plain = turn + 1, plain + pairs.edges - before
        budget = min(budget * _BUDGET_GROWTH, _MOST_BUDGET)
        if path is None and plain >= max(_NARROW, pairs.edges - plain) and pairs.may_go_on:
            path = find_narrow_passage(pairs)
    return RrtResult(path, pairs.edges, pairs.runs)


@dataclass(frozen=True, slots=True)
class RrtConnect:
    """The planner "rrt_connect" of the cascade.

    Args:
        fallback: Planner that goes on with the exact robot where the trees do not meet.
        max_edges: Edges after which the fallback has its turn.
        max_edges_in_hulls: Edges after which to stop where the robot is in its solids' hulls.
    """

    fallback: Planner
    max_edges: int = _MAX_EDGES
    max_edges_in_hulls: int = _MAX_EDGES_IN_HULLS
    name: ClassVar[str] = "rrt_connect"
    needs_goals: ClassVar[bool] = True

    def plan(self, query: Query) -> Attempt:
        """Grow the trees, and let the fallback go on where they do not meet."""
        ready, is_exact = query.ready, query.checker is query.ready.checkers[-1]
        max_edges = self.max_edges if is_exact else self.max_edges_in_hulls
        bounds = [bound for bound in (query.max_edges, query.bound) if bound is not None]
        max_edges = min([max_edges, *bounds])
        result = rrt_connect(
            query.checker,
            ready.start,
            ready.goals,
            query.seed,
            query.deadline,
            max_edges,
            query.explored,
            proves=query.proves,
        )
        detail = f"{result.edges} edges checked"
        detail += "." if result.runs == 1 else f" in {result.runs} runs."
        is_short = len(bounds) > 0
        if result.waypoints is not None or query.deadline.passed or is_short or not is_exact:
            return Attempt(result.waypoints, detail, proved=query.proves)
        other = self.fallback.plan(query)
        return replace(other, detail=f"{detail} OMPL: {other.detail}")


def find_narrow_passage(pairs: TreePairs) -> Array | None:
    """Look for a way with ever less penetration; its path, shape (k, n), if it is found.

    Args:
        pairs: Grow the trees.
    """
    guide = None
    for penetration in _PENETRATIONS[:-1]:
        path = _grow(pairs, penetration, guide)
        if path is None:
            return None
        # Nine of ten draws lie beside the guide, by 0.6 rad [or m] in each joint at most.
        guide = Guide(_evenly_spread(path), 0.6, 0.9)
    return _grow(pairs, _PENETRATIONS[-1], guide)


def _grow(pairs: TreePairs, penetration: float, guide: Guide | None) -> Array | None:
    """The path that the next pair finds, if there are edges and time for it."""
    if not pairs.may_go_on:
        return None
    # Long steps are through sooner where there is space; beside a guide there is little.
    step = 1.0 if guide is None else 0.5
    # Edges that each pair may check.
    return pairs.grow(PairOptions(10_000, step, penetration, guide=guide))


def _evenly_spread(path: Array) -> Array:
    """Points along a path (k, n), as far from each other along it, its ends among them."""
    lengths = np.linalg.norm(np.diff(path, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(lengths)])
    # Distance between the points of a guide at most.
    count = max(2, int(np.ceil(along[-1] / 0.25)) + 1)
    at = np.linspace(0.0, along[-1], count)
    return np.ascontiguousarray(np.stack([np.interp(at, along, q) for q in path.T], axis=1))
