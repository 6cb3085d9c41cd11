"""Pairs of trees for one request: each grown anew, and all their edges counted."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache, lru_cache
from typing import NamedTuple

import numpy as np

from compiled.kernel import direct
from compiled.random import State
from kinematics.arrays import Array
from obstacles.collision.checker import Checker, any_model
from obstacles.collision.model.collision_model import ModelArrays
from planning.search.trees import Draws, Growth, Tally, Trees, grow_kernel, new_trees
from planning.values.deadline import Deadline
from planning.values.search_box import nearby_box, search_box
from planning.values.search_trees import Explored

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
    """

    checker: Checker
    roots: Array
    seed: int
    deadline: Deadline
    max_edges: int
    explored: Explored | None
    proves: bool
    edges: int = field(default=0, init=False)
    runs: int = field(default=0, init=False)

    @property
    def may_go_on(self) -> bool:
        """Whether there are edges and time left."""
        return self.edges < self.max_edges and not self.deadline.passed

    def grow(self, options: PairOptions) -> Array | None:
        """Grow one pair; the path on which it meets, shape (k, n), if it does."""
        checker, roots = self.checker, self.roots
        budget = min(options.budget, self.max_edges - self.edges)
        trees = new_trees(len(roots), checker.model.chain.n, budget, self._random())
        outcome: int = Growth.GOING
        grow, draws, until = _grow(), self._draws(options), 0
        while outcome == Growth.GOING and not self.deadline.passed:
            # Edges looked at between two checks of the clock.
            until += 250
            outcome = grow(checker.model.arrays, trees, draws, roots, budget, until)
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

    def _random(self) -> State:
        return np.array(_random_state(self.seed, self.runs), np.uint64)

    def _draws(self, options: PairOptions) -> Draws:
        roots, guide = self.roots, options.guide
        low, high = (search_box if options.whole else nearby_box)(self.checker.model.chain, roots)
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


@cache
def _grow() -> Callable[[ModelArrays, Trees, Draws, Array, int, int], int]:
    """``grow_kernel`` without the look at its arguments' types."""
    roots = np.zeros((2, 1))
    trees = new_trees(2, 1, 1, np.zeros(1, np.uint64))
    draws = Draws(roots[0], roots[0], 0.0, 0.0, 0.0, True, roots, 0.0, 0.0)
    return direct(grow_kernel, any_model(), trees, draws, roots, 1, 1)


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
