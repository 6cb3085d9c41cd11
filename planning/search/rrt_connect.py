"""RRT-Connect: two trees that grow towards each other until they meet, in one kernel.

One tree takes a step towards a random configuration; the other one then goes step by step towards
where that ended. A step is taken where it is proved free. The smaller tree is the one to grow: the
end that stands in a narrow place gets the attempts that it needs. A node from which a step failed
is only grown towards configurations near it: far ones keep choosing the same nodes at the border of
the tree, and meet the same obstacles. Sources: "RRT-Connect: an efficient approach to
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
from kinematics.compiled.simd import on_stack
from kinematics.random import State, uniform_kernel
from obstacles.checker import Checker
from obstacles.edge_check import COLLIDING, FREE
from obstacles.kernel_work import Workspace, workspace
from obstacles.line_check import certify_line
from obstacles.model_arrays import ModelArrays
from obstacles.state_check import blocked_at
from planning.deadline import Deadline
from planning.explored import Explored
from planning.planner import Planner, Query
from planning.result import Attempt
from planning.search_box import nearby_box, search_box

#: Longest step of one pair of trees after another, Euclidean in joint space. In clutter short ones
#: come through several times sooner; a few places let pass nothing but very short ones.
_STEPS = (0.5, 0.25, 0.5, 0.1)
#: Of so many pairs of trees the last draws from all that the limits allow, the others within half a
#: turn of start and goals: arms with joints of two turns find the short way round, and a way that
#: winds up further is not lost.
_NEARBY = 7
#: A step whose proof needs more intervals grazes something all along: it is not taken.
_MAX_INTERVALS = 800
#: States of a step that are looked at before it is proved, its end first: half of them collide.
_LOOKS = 2
#: Failed steps in a row after which the larger tree has a turn: it may come by where the smaller
#: one can't get out at random.
_PATIENCE = 3
#: Share of the mean distance of two random configurations beyond which a node that has met
#: something is not grown any more.
_DOMAIN = 0.65
#: Draws in a row that may be rejected for that.
_MAX_DRAWS = 100
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

# Entries of Trees.tally.
#: Edges that were checked.
_EDGES = 0
#: Node of the start's tree at which the trees meet.
_HERE = 1
#: Node of the goals' tree at which the trees meet.
_THERE = 2


class Trees(NamedTuple):
    """The tree of the start (0) and that of the goals (1), with room for c nodes each.

    Args:
        points: Shape (2, c, n).
        parents: Node that each was reached from, -1 for roots, shape (2, c).
        met: Whether a step from a node failed, shape (2, c).
        sizes: Number of nodes, shape (2,).
        random: State of the random generator, shape (1,).
        tally: Edges that were checked, and the nodes at which the trees meet, shape (3,).
    """

    points: Array
    parents: Indices
    met: NDArray[np.bool_]
    sizes: Indices
    random: State
    tally: Indices


class _Draws(NamedTuple):
    """Parameters of draws and of the steps towards them.

    Args:
        low: Lower bounds, shape (n,) [rad or m].
        high: Upper bounds, shape (n,) [rad or m].
        domain: Farther than this a node that has met something is not grown [rad or m].
        step: Longest step [rad or m].
        slack: Distance to keep beyond the margins [m].
    """

    low: Array
    high: Array
    domain: float
    step: float
    slack: float


class RrtResult(NamedTuple):
    """The path that trees found, and what it cost.

    Args:
        waypoints: Shape (k, n), every leg proved free; None where they did not meet.
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
) -> RrtResult:
    """Grow trees from a configuration and from the goals until they meet, and once more.

    The second pair of trees has as many edges as the first path took; the shorter path is the
    answer.

    Args:
        checker: The robot in its scene.
        start: Valid configuration, shape (n,) [rad or m].
        goals: Valid configurations (n,).
        seed: The same seed gives the same path.
        deadline: When to stop.
        max_edges: Edges after which to stop; the second pair may take as many again.
        explored: Keeps the edges of the last pair of trees.
    """
    chain, known = checker.model.chain, [start, *goals]
    near, whole = nearby_box(chain, known), search_box(chain, known)
    edges, runs, budget = 0, 0, float(_FIRST_BUDGET)
    while edges < max_edges and not deadline.passed:
        share = min(int(budget), max_edges - edges)
        trees = _new_trees(start, goals, (seed, runs), share)
        step = _STEPS[runs % len(_STEPS)]
        box = whole if runs % _NEARBY == _NEARBY - 1 else near
        path = _run(checker, trees, box, step, deadline, share)
        _keep(trees, explored)
        edges, runs = edges + int(trees.tally[_EDGES]), runs + 1
        budget *= _BUDGET_GROWTH
        if path is not None:
            trees = _new_trees(start, goals, (seed, runs), edges)
            other = _run(checker, trees, box, step, deadline, edges)
            _keep(trees, explored)
            edges, runs = edges + int(trees.tally[_EDGES]), runs + 1
            return RrtResult(_shorter(path, other), edges, runs)
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
        max_edges = min(max_edges, query.max_edges or max_edges)
        result = rrt_connect(
            query.checker,
            ready.start,
            ready.goals,
            query.seed,
            query.deadline,
            max_edges,
            query.explored,
        )
        detail = f"{result.edges} edges checked"
        detail += "." if result.runs == 1 else f" in {result.runs} runs."
        is_short = query.max_edges is not None
        if result.waypoints is not None or query.deadline.passed or is_short or not query.exact:
            return Attempt(result.waypoints, detail)
        other = self.fallback.plan(query)
        return replace(other, detail=f"{detail} OMPL: {other.detail}")


def _shorter(path: Array, other: Array | None) -> Array:
    paths = [path] if other is None else [path, other]
    return min(paths, key=lambda path: float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum()))


def _keep(trees: Trees, explored: Explored | None) -> None:
    """Keep the edges of both trees, where somebody asked for them."""
    if explored is None:
        return
    explored.begin(RrtConnect.name)
    for side, part in enumerate(("start", "goals")):
        size = int(trees.sizes[side])
        explored.add_tree(trees.points[side, :size], trees.parents[side, :size], part)


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
    capacity, n = budget + len(goals) + 1, len(start)
    points = np.empty((2, capacity, n))
    points[0, 0], points[1, : len(goals)] = start, goals
    return Trees(
        points=points,
        parents=np.full((2, capacity), -1),
        met=np.zeros((2, capacity), dtype=np.bool_),
        sizes=np.array([1, len(goals)]),
        random=np.random.SeedSequence(seed).generate_state(1, np.uint64).astype(np.uint64),
        tally=np.zeros(3, dtype=np.int64),
    )


def _branch(trees: Trees, side: int, entry: int) -> list[Array]:
    """The configurations from where the trees meet, an entry of the tally, down to a root."""
    branch, node = [], int(trees.tally[entry])
    while node >= 0:
        branch.append(trees.points[side, node])
        node = int(trees.parents[side, node])
    return branch


@kernel
def grow_kernel(
    model: ModelArrays,
    slack: float,
    trees: Trees,
    low: Array,
    high: Array,
    domain: float,
    step: float,
    until: int,
) -> bool:
    """Grow both trees until they meet or ``until`` edges were looked at; whether they meet.

    Args:
        model: The packed robot and scene.
        slack: Distance to keep beyond the margins [m].
        trees: RrtResult in place.
        low: Lower bounds of the draws, shape (n,) [rad or m].
        high: Upper bounds of the draws, shape (n,) [rad or m].
        domain: Farther than this a node that has met something is not grown [rad or m].
        step: Longest step [rad or m].
        until: Edges, those of earlier calls counted.
    """
    draws = _Draws(low, high, domain, step, slack)
    return _grow(model, workspace(model), draws, trees, np.zeros((2, low.shape[0])), until)


@kernel(allocates=False)
def _grow(
    model: ModelArrays, work: Workspace, draws: _Draws, trees: Trees, vectors: Array, until: int
) -> bool:
    """``grow_kernel`` with a workspace, and room for a target and the end of a step, (2, n)."""
    target, failed = vectors[0], 0
    while trees.tally[_EDGES] < until:
        side = 0 if trees.sizes[0] <= trees.sizes[1] else 1
        if failed == _PATIENCE:
            side, failed = 1 - side, 0
        near = _draw(trees, side, draws, target)
        reached = _step(model, work, draws, trees, side, near, vectors)
        if reached < 0:
            failed += 1
            continue
        failed = 0
        for j in range(target.shape[0]):
            target[j] = trees.points[side, reached, j]
        node, left = _nearest(trees, 1 - side, target)
        while node >= 0 and left > 0.0 and trees.tally[_EDGES] < until:
            node = _step(model, work, draws, trees, 1 - side, node, vectors)
            left = _square(trees.points[1 - side], max(node, 0), target)
        if node >= 0 and left == 0.0:
            trees.tally[_HERE] = reached if side == 0 else node
            trees.tally[_THERE] = node if side == 0 else reached
            return True
    return False


@kernel(allocates=False)
def _draw(trees: Trees, side: int, draws: _Draws, target: Array) -> int:
    """Draw a configuration (n,) to grow towards; the node that is nearest to it."""
    low, high = draws.low, draws.high
    near = 0
    for _ in range(_MAX_DRAWS):
        for j in range(target.shape[0]):
            target[j] = low[j] + (high[j] - low[j]) * uniform_kernel(trees.random)
        near, away = _nearest(trees, side, target)
        if away <= draws.domain or not trees.met[side, near]:
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


@kernel(allocates=False)
def _step(
    model: ModelArrays,
    work: Workspace,
    draws: _Draws,
    trees: Trees,
    side: int,
    at: int,
    vectors: Array,
) -> int:
    """Add a step from node ``at`` towards ``vectors[0]``; its number, -1 if it is not proved."""
    origin, target, end = trees.points[side, at], vectors[0], vectors[1]
    square, outcome = _square(trees.points[side], at, target), on_stack(4)
    asked = on_stack(1).view(np.int64)
    arrives = square <= draws.step * draws.step
    share = 1.0 if arrives else draws.step / math.sqrt(square)
    for j in range(target.shape[0]):
        end[j] = target[j] if arrives else origin[j] + share * (target[j] - origin[j])
    trees.tally[_EDGES] += 1
    verdict = COLLIDING
    if blocked_at(model, work, origin, end, draws.slack, 1, _LOOKS, asked) < 0.0:
        verdict = certify_line(model, work, origin, end, draws.slack, _MAX_INTERVALS, outcome)
    if verdict != FREE:
        trees.met[side, at] = True
        return -1
    node = trees.sizes[side]
    for j in range(target.shape[0]):
        trees.points[side, node, j] = end[j]
    trees.parents[side, node] = at
    trees.sizes[side] = node + 1
    return int(node)
