"""RRT-Connect: two trees that grow towards each other until they meet, in one kernel.

One tree takes a step towards a random configuration; the other one then goes step by step towards
where that ended. A step is taken where it is proved free. The smaller tree is the one to grow: the
end that stands in a narrow place gets the attempts that it needs. A node from which a step failed
is only grown towards what is near it: far configurations keep choosing the same nodes at the border
of what was reached, and walk into the same walls. Sources: "RRT-Connect: an efficient approach to
single-query path planning", IEEE International Conference on Robotics and Automation, 2000;
"Dynamic-domain RRTs: efficient exploration by controlling the sampling domain", the same
conference, 2005.
"""

import math
from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics.arrays import Array, Indices
from kinematics.compiled.kernel import kernel
from kinematics.random import State, uniform_kernel
from obstacles.checker import Checker
from obstacles.edge_check import FREE, certify_in
from obstacles.kernel_work import Workspace, workspace
from obstacles.model_arrays import ModelArrays
from planning.deadline import Deadline
from planning.planner import Planner, Query
from planning.result import Attempt
from planning.search_box import search_box

#: Longest step of one pair of trees after another, Euclidean in joint space. In clutter short ones
#: come through several times sooner; a few places let pass nothing but very short ones.
_STEPS = (0.5, 0.25, 0.5, 0.1)
#: A step that needs more intervals for its proof grazes something all along: it is not taken.
_MOST_INTERVALS = 800
#: Failed steps in a row after which the larger tree has a turn: it may come by where the smaller
#: one can't get out at random.
_PATIENCE = 3
#: Share of the mean distance of two random configurations beyond which a node that has met
#: something is not grown any more, and draws in a row of which that may be said.
_DOMAIN = 0.65
_MOST_DRAWS = 100
#: The edges that trees need are spread widely: a pair that has looked at so many without meeting is
#: given up for a fresh one, which may look at somewhat more. Counted in edges, not in time, the
#: answer depends on the seed alone.
_FIRST_BUDGET = 2000
_BUDGET_GROWTH = 1.2
#: Edges after which the cascade's own trees give way to OMPL's, and those grown in the hulls of the
#: robot's solids to such as are grown with its exact pieces.
_MAX_EDGES = 200_000
_MAX_EDGES_IN_HULLS = 20_000
#: Edges looked at between two looks at the clock.
_EDGES_A_LOOK = 250

# Places in Trees.tally.
_EDGES, _HERE, _THERE = 0, 1, 2


class Trees(NamedTuple):
    """The tree of the start (0) and that of the goals (1), with room for c nodes each.

    Args:
        points: Shape (2, c, n).
        parents: Which node each was reached from, -1 for roots, shape (2, c).
        met: Whether a step from it failed, shape (2, c).
        sizes: How many nodes there are, shape (2,).
        random: State of the generator, shape (1,).
        tally: Edges looked at, and the nodes at which the trees meet, shape (3,).
    """

    points: Array
    parents: Indices
    met: NDArray[np.bool_]
    sizes: Indices
    random: State
    tally: Indices


class RrtResult(NamedTuple):
    """The path that trees found, and what it cost.

    Args:
        waypoints: Shape (k, n), every leg proved free; None where they did not meet.
        edges: How many were looked at.
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
) -> RrtResult:
    """Grow trees from a configuration and from the goals until they meet, and once more.

    The second pair of trees has as many edges as the first way took; the shorter way is the answer.

    Args:
        checker: The robot in its scene.
        start: Shape (n,), valid.
        goals: Valid configurations (n,).
        seed: The same seed gives the same path.
        deadline: When to stop.
        max_edges: Edges after which to stop; a second way may take as many again.
    """
    box = search_box(checker.model.chain, [start, *goals])
    edges, runs, budget = 0, 0, float(_FIRST_BUDGET)
    while edges < max_edges and not deadline.passed:
        own = min(int(budget), max_edges - edges)
        trees = _new_trees(start, goals, (seed, runs), own)
        step = _STEPS[runs % len(_STEPS)]
        found = _run(checker, trees, box, step, deadline, own)
        edges, runs = edges + int(trees.tally[_EDGES]), runs + 1
        budget *= _BUDGET_GROWTH
        if found is not None:
            trees = _new_trees(start, goals, (seed, runs), edges)
            other = _run(checker, trees, box, step, deadline, edges)
            edges, runs = edges + int(trees.tally[_EDGES]), runs + 1
            return RrtResult(_shorter(found, other), edges, runs)
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
        result = rrt_connect(
            query.checker, ready.start, ready.goals, query.seed, query.deadline, max_edges
        )
        detail = f"{result.edges} edges checked"
        detail += "." if result.runs == 1 else f" in {result.runs} runs."
        if result.waypoints is not None or query.deadline.passed or not query.exact:
            return Attempt(result.waypoints, detail)
        other = self.fallback.plan(query)
        return replace(other, detail=f"{detail} OMPL: {other.detail}")


def _shorter(way: Array, other: Array | None) -> Array:
    ways = [way] if other is None else [way, other]
    return min(ways, key=lambda way: float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum()))


def _run(
    checker: Checker,
    trees: Trees,
    box: tuple[Array, Array],
    step: float,
    deadline: Deadline,
    budget: int,
) -> Array | None:
    """Grow one pair of trees within a budget of edges; the path, if they meet."""
    low, high = box
    domain = _DOMAIN * math.sqrt(float(((high - low) ** 2).sum()) / 6.0)
    model, slack, until, meet = checker.model.arrays, checker.slack, 0, False
    while not meet and until < budget and not deadline.passed:
        until = min(until + _EDGES_A_LOOK, budget)
        meet = grow_kernel(model, slack, trees, low, high, domain, step, until)
    if not meet:
        return None
    return np.array(_branch(trees, 0, _HERE)[::-1] + _branch(trees, 1, _THERE)[1:])


def _new_trees(start: Array, goals: list[Array], seed: tuple[int, int], budget: int) -> Trees:
    room, n = budget + len(goals) + 1, len(start)
    points = np.empty((2, room, n))
    points[0, 0], points[1, : len(goals)] = start, goals
    return Trees(
        points=points,
        parents=np.full((2, room), -1),
        met=np.zeros((2, room), dtype=np.bool_),
        sizes=np.array([1, len(goals)]),
        random=np.random.SeedSequence(seed).generate_state(1, np.uint64).astype(np.uint64),
        tally=np.zeros(3, dtype=np.int64),
    )


def _branch(trees: Trees, side: int, place: int) -> list[Array]:
    """The way from where the trees meet down to a root."""
    way, node = [], int(trees.tally[place])
    while node >= 0:
        way.append(trees.points[side, node])
        node = int(trees.parents[side, node])
    return way


@kernel
def grow_kernel(
    model: ModelArrays, slack: float, trees: Trees, low: Array, high: Array, domain: float,
    step: float, until: int,
) -> bool:  # fmt: skip
    """Grow both trees until they meet or ``until`` edges were looked at; whether they meet.

    Args:
        model: The packed robot and scene.
        slack: Distance to keep beyond the margins [m].
        trees: RrtResult in place.
        low: Bounds to draw from, shape (n,).
        high: Likewise.
        domain: Farther than this a node that has met something is not grown.
        step: The longest.
        until: Edges, those of earlier calls counted.
    """
    work, room = workspace(model), np.zeros((3, low.shape[0]))
    target, failed = room[0], 0
    while trees.tally[_EDGES] < until:
        side = 0 if trees.sizes[0] <= trees.sizes[1] else 1
        if failed == _PATIENCE:
            side, failed = 1 - side, 0
        near = _draw(trees, side, low, high, domain, target)
        reached = _step(model, work, slack, trees, side, near, step, room)
        if reached < 0:
            failed += 1
            continue
        failed = 0
        target[:] = trees.points[side, reached]
        node, left = _nearest(trees, 1 - side, target)
        while node >= 0 and left > 0.0 and trees.tally[_EDGES] < until:
            node = _step(model, work, slack, trees, 1 - side, node, step, room)
            left = _square(trees.points[1 - side], max(node, 0), target)
        if node >= 0 and left == 0.0:
            trees.tally[_HERE] = reached if side == 0 else node
            trees.tally[_THERE] = node if side == 0 else reached
            return True
    return False


@kernel(allocates=False)
def _draw(trees: Trees, side: int, low: Array, high: Array, domain: float, target: Array) -> int:
    """Draw a configuration (n,) to grow towards; the node that is nearest to it."""
    near = 0
    for _ in range(_MOST_DRAWS):
        for j in range(target.shape[0]):
            target[j] = low[j] + (high[j] - low[j]) * uniform_kernel(trees.random)
        near, away = _nearest(trees, side, target)
        if away <= domain or not trees.met[side, near]:
            break
    return near


@kernel(allocates=False)
def _nearest(trees: Trees, side: int, q: Array) -> tuple[int, float]:
    """The node of a tree that is nearest to q (n,), and how far away it is."""
    points, best, node = trees.points[side], np.inf, 0
    for i in range(trees.sizes[side]):
        away = _square(points, i, q)
        if away < best:
            best, node = away, i
    return node, math.sqrt(best)


@kernel(allocates=False, inline="always")
def _square(points: Array, i: int, q: Array) -> float:
    square = 0.0
    for j in range(q.shape[0]):
        square += (points[i, j] - q[j]) ** 2
    return square


@kernel
def _step(
    model: ModelArrays, work: Workspace, slack: float, trees: Trees, side: int, at: int,
    step: float, room: Array,
) -> int:  # fmt: skip
    """Add a step from node ``at`` towards ``room[0]``; its number, -1 if it is not proved."""
    origin, target, motion, zero = trees.points[side, at], room[0], room[1], room[2]
    square, found = _square(trees.points[side], at, target), np.empty(4)
    arrives = square <= step * step
    share = 1.0 if arrives else step / math.sqrt(square)
    for j in range(target.shape[0]):
        motion[j] = share * (target[j] - origin[j])
    trees.tally[_EDGES] += 1
    verdict = certify_in(model, work, origin, motion, zero, zero, slack, _MOST_INTERVALS, found)
    if verdict != FREE:
        trees.met[side, at] = True
        return -1
    made = trees.sizes[side]
    for j in range(target.shape[0]):
        trees.points[side, made, j] = target[j] if arrives else origin[j] + motion[j]
    trees.parents[side, made] = at
    trees.sizes[side] = made + 1
    return int(made)
