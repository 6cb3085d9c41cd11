"""RRT-Connect: two trees that grow towards each other until they meet, in one kernel (`trees`).

One tree takes a step towards a random configuration; the other one then goes step by step towards
where that ended. The path on which they meet is proved free. The smaller tree is the one to grow:
the end that stands in a narrow place gets the attempts that it needs. A node from which a step
failed is only grown towards configurations near it: far ones keep choosing the same nodes at the
border of the tree, and meet the same obstacles. Most draws lie about the straight line from start
to goal. Sources: "RRT-Connect: an efficient approach to
single-query path planning", IEEE International Conference on Robotics and Automation, 2000;
"Dynamic-domain RRTs: efficient exploration by controlling the sampling domain", the same
conference, 2005.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from typing import ClassVar, NamedTuple

import numpy as np

from kinematics.arrays import Array
from kinematics.compiled.kernel import direct
from obstacles.checker import Checker, any_model
from obstacles.collision_model import ModelArrays
from planning.deadline import Deadline
from planning.explored import Explored
from planning.planner import Planner, Query
from planning.result import Attempt
from planning.search.trees import (
    EDGES,
    EDGES_BEFORE,
    GOING,
    PATH,
    Draws,
    Trees,
    grow_kernel,
    new_trees,
)
from planning.search_box import nearby_box, search_box

#: Longest step of one pair of trees after another, Euclidean in joint space. In clutter short ones
#: come through several times sooner; a few places let pass nothing but very short ones.
_STEPS = (0.5, 0.25, 0.5, 0.1)
#: Of so many pairs of trees the last draws from all that the limits allow, the others within half a
#: turn of start and goals: arms with joints of two turns find the short way round, and a way that
#: winds up further is not lost.
_NEARBY = 7
#: Share of the mean distance of two random configurations beyond which a node that has met
#: something is not grown any more.
_DOMAIN = 0.65
#: The edges that trees need are spread widely: a pair that has looked at so many without meeting is
#: given up for a fresh one, which may look at somewhat more. Counted in edges, not in time, the
#: answer depends on the seed alone.
_FIRST_BUDGET = 2000
#: Factor by which the next pair may look at more.
_BUDGET_GROWTH = 1.2
#: Edges after which the cascade's own trees give way to OMPL's, and those grown in the hulls of the
#: robot's solids to such as are grown with its exact pieces.
_MAX_EDGES = 200_000
_MAX_EDGES_IN_HULLS = 20_000
#: Edges looked at between two looks at the clock.
_EDGES_A_LOOK = 250


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
        seed: The same seed gives the same path.
        deadline: When to stop.
        max_edges: Edges after which to stop; the last pair may take as many again.
        explored: Keeps the edges of the last pair of trees.
        proves: Whether the path is proved; otherwise states of it are looked at.
    """
    chain, roots, model = checker.model.chain, np.array([start, *goals]), checker.model.arrays
    grow, slack = _grow(), float(checker.slack)
    edges, runs, budget = 0, 0, float(_FIRST_BUDGET)
    while edges < max_edges and not deadline.passed:
        share = min(int(budget), max_edges - edges)
        box = search_box if runs % _NEARBY == _NEARBY - 1 else nearby_box
        low, high = box(chain, roots)
        domain = _DOMAIN * math.dist(high.tolist(), low.tolist()) / math.sqrt(6.0)
        draws = Draws(low, high, domain, _STEPS[runs % len(_STEPS)], slack, proves)
        random = np.array(_random_state(seed, runs), np.uint64)
        trees = new_trees(len(roots), chain.n, share, random)
        outcome, until = GOING, 0
        while outcome == GOING and not deadline.passed:
            until += _EDGES_A_LOOK
            outcome = grow(model, trees, draws, roots, share, until)
        before, nodes = int(trees.tally[EDGES_BEFORE]), int(trees.tally[PATH])
        edges, runs = edges + before + int(trees.tally[EDGES]), runs + (2 if before else 1)
        _keep(trees, checker, 2 if before else 1, explored)
        if nodes > 0:
            return RrtResult(trees.path[:nodes].copy(), edges, runs)
        budget *= _BUDGET_GROWTH
    return RrtResult(None, edges, runs)


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
        ready, max_edges = query.ready, self.max_edges
        if not query.exact:
            max_edges = self.max_edges_in_hulls
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
        if result.waypoints is not None or query.deadline.passed or is_short or not query.exact:
            return Attempt(result.waypoints, detail, proved=query.proves)
        other = self.fallback.plan(query)
        return replace(other, detail=f"{detail} OMPL: {other.detail}")


@cache
def _grow() -> Callable[[ModelArrays, Trees, Draws, Array, int, int], int]:
    """``grow_kernel`` without the look at its arguments' types."""
    roots = np.zeros((2, 1))
    trees = new_trees(2, 1, 1, np.zeros(1, np.uint64))
    draws = Draws(roots[0], roots[0], 0.0, 0.0, 0.0, True)
    return direct(grow_kernel, any_model(), trees, draws, roots, 1, 1)


#: Most requests leave the seed as it is, and making a state takes longer than some searches.
@lru_cache(maxsize=1024)
def _random_state(seed: int, run: int) -> tuple[int]:
    """The state (1,) of a generator of random numbers by which a pair of trees begins."""
    return (int(np.random.SeedSequence((seed, run)).generate_state(1, np.uint64)[0]),)


def _keep(trees: Trees, checker: Checker, runs: int, explored: Explored | None) -> None:
    """Keep the edges of both trees as far as they are proved free, where somebody asked for it."""
    if explored is None:
        return
    for _ in range(runs):
        explored.begin(RrtConnect.name)
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
