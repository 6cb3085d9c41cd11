"""The two trees of RRT-Connect: grown by states looked at, proved along the way they meet on.

A step is taken where a few states of it are free, which costs a fifth of a proof. Where the trees
meet, the steps from root to root are proved, and one that is not is cut off with all that grew from
it; after a few cuts every step is proved before it is taken. So a path is proved in every place,
and most of what is not on it costs no proof. Source: "Single-query PRM planner with lazy collision
checking", International Symposium on Robotics Research, 2001.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics.arrays import Array, Indices
from kinematics.compiled.kernel import kernel
from kinematics.compiled.simd import on_stack
from kinematics.random import State, uniform_kernel
from obstacles.edge_check import COLLIDING, FREE
from obstacles.kernel_work import Workspace, workspace
from obstacles.line_check import certify_line
from obstacles.model_arrays import ModelArrays
from obstacles.state_check import blocked_at

# Outcomes of growing trees.
#: The clock is to be looked at.
GOING = 0
#: The first pair has had its edges and has not met.
SPENT = 1
#: There is a path, and another pair has looked for a shorter one.
FOUND = 2

#: A step whose proof needs more intervals grazes something all along: it is not taken.
_MAX_INTERVALS = 800
#: States of a step that are looked at, its end first, where that is all, and before a proof: half
#: of the steps collide.
_LOOKS, _LOOKS_BEFORE_PROOF = 4, 2
#: Cuts after which every step is proved before it is taken.
_MAX_CUTS = 3
#: Failed steps in a row after which the larger tree has a turn: it may come by where the smaller
#: one can't get out at random.
_PATIENCE = 3
#: Draws in a row that may be rejected because the nearest node has met something.
_MAX_DRAWS = 100
#: Share of the draws that lie about the straight line from the start to the first goal, and how far
#: beside it at most in each joint, as a share of its length. Most paths are there, and shorter;
#: the other draws find those that are not.
_DRAWS_BESIDE, _BESIDE = 0.7, 0.5
#: A path so many times as long as the straight line is worth another pair of trees: shortening does
#: for the others what that would do.
_LONG = 3.0
#: Parent of a node that was cut off; that of a root is -1.
_CUT = -2

# Entries of Trees.tally.
#: Edges that were checked, by this pair.
EDGES = 0
#: By the pair before it, if that has met.
EDGES_BEFORE = 1
#: Nodes of the path, 0 where there is none.
PATH = 2
#: Node of the start's tree at which the trees meet, and that of the goals' tree.
_HERE, _THERE = 3, 4
#: Steps of this pair that were cut off.
_CUTS = 5


class Trees(NamedTuple):
    """The tree of the start (0) and that of the goals (1), with room for c nodes each.

    Args:
        points: Shape (2, c, n).
        parents: Node that each was reached from, -1 for roots, shape (2, c).
        met: Whether a step from a node failed, shape (2, c).
        proved: Whether the step to a node is proved, shape (2, c).
        sizes: Number of nodes, shape (2,).
        random: State of the random generator, shape (1,).
        tally: Edges that were checked, and more, shape (6,).
        path: The shortest path so far, shape (2 c, n).
    """

    points: Array
    parents: Indices
    met: NDArray[np.bool_]
    proved: NDArray[np.bool_]
    sizes: Indices
    random: State
    tally: Indices
    path: Array


class Draws(NamedTuple):
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


def new_trees(roots: Array, budget: int, random: State) -> Trees:
    """Room for trees with so many edges.

    Args:
        roots: The start and the goals, shape (1 + g, n) [rad or m].
        budget: Edges that a pair may look at.
        random: State of the random generator, shape (1,).
    """
    capacity, n = budget + len(roots), roots.shape[1]
    trees = Trees(
        points=np.empty((2, capacity, n)),
        parents=np.empty((2, capacity), dtype=np.int64),
        met=np.empty((2, capacity), dtype=np.bool_),
        proved=np.empty((2, capacity), dtype=np.bool_),
        sizes=np.empty(2, dtype=np.int64),
        random=random,
        tally=np.zeros(6, dtype=np.int64),
        path=np.empty((2 * capacity, n)),
    )
    plant_kernel(trees, roots)
    return trees


@kernel
def grow_kernel(
    model: ModelArrays, trees: Trees, draws: Draws, roots: Array, budget: int, until: int
) -> int:
    """Grow a pair of trees until they meet; if the path is long, another one with as many edges.

    Args:
        model: The packed robot and scene.
        trees: Changed in place.
        draws: Parameters of draws and steps.
        roots: The start and the goals, shape (1 + g, n).
        budget: Edges that the first pair may look at.
        until: Edges of a pair after which the clock is looked at, those of earlier calls counted.

    Returns:
        GOING, SPENT or FOUND.
    """
    work, vectors, tally = workspace(model), np.empty((2, roots.shape[1])), trees.tally
    while True:
        # The second pair has as many edges as the first path took.
        most = tally[EDGES_BEFORE] if tally[PATH] > 0 else budget
        if _grow(model, work, draws, trees, vectors, min(until, most)):
            first = tally[PATH] == 0
            _keep_path(trees)
            if not first or not _is_long(trees.path, tally[PATH]):
                return FOUND
            tally[EDGES_BEFORE] = tally[EDGES]
            _plant(trees, roots)
        elif tally[EDGES] >= most:
            return FOUND if tally[PATH] > 0 else SPENT
        else:
            return GOING


@kernel
def plant_kernel(trees: Trees, roots: Array) -> None:
    """Begin anew with roots (1 + g, n): the start, and the goals."""
    _plant(trees, roots)


@kernel(allocates=False)
def _plant(trees: Trees, roots: Array) -> None:
    trees.sizes[0], trees.sizes[1] = 0, 0
    trees.tally[EDGES], trees.tally[_CUTS] = 0, 0
    for root in range(roots.shape[0]):
        _add(trees, min(root, 1), roots[root], -1)


@kernel(allocates=False)
def _add(trees: Trees, side: int, q: Array, parent: int) -> int:
    """Add a node at q (n,), the way to it unproved; its number."""
    node = trees.sizes[side]
    for j in range(q.shape[0]):
        trees.points[side, node, j] = q[j]
    trees.parents[side, node] = parent
    trees.met[side, node], trees.proved[side, node] = False, False
    trees.sizes[side] = node + 1
    return int(node)


@kernel(allocates=False)
def _grow(
    model: ModelArrays, work: Workspace, draws: Draws, trees: Trees, vectors: Array, until: int
) -> bool:
    """Grow both trees until they meet on a proved path or ``until`` edges; whether they meet.

    ``vectors`` is room for a target and the end of a step, (2, n).
    """
    target, tally, failed = vectors[0], trees.tally, 0
    while tally[EDGES] < until:
        side = 0 if trees.sizes[0] <= trees.sizes[1] else 1
        if failed == _PATIENCE:
            side, failed = 1 - side, 0
        near = 0
        if tally[EDGES] == 0:
            # The first step is one from the start straight to a goal, and so is what it meets.
            for j in range(target.shape[0]):
                target[j] = trees.points[1, 0, j]
        else:
            near = _draw(trees, side, draws, target)
        reached = _step(model, work, draws, trees, side, near, vectors)
        if reached < 0:
            failed += 1
            continue
        failed = 0
        for j in range(target.shape[0]):
            target[j] = trees.points[side, reached, j]
        node, left = _nearest(trees, 1 - side, target)
        while node >= 0 and left > 0.0 and tally[EDGES] < until:
            node = _step(model, work, draws, trees, 1 - side, node, vectors)
            left = _square(trees.points[1 - side], max(node, 0), target)
        if node >= 0 and left == 0.0:
            tally[_HERE] = reached if side == 0 else node
            tally[_THERE] = node if side == 0 else reached
            if _proves(model, work, draws.slack, trees, 0, int(tally[_HERE])) and _proves(
                model, work, draws.slack, trees, 1, int(tally[_THERE])
            ):
                return True
    return False


@kernel(allocates=False)
def _draw(trees: Trees, side: int, draws: Draws, target: Array) -> int:
    """Draw a configuration (n,) to grow towards; the node that is nearest to it."""
    low, high = draws.low, draws.high
    start, goal, near = trees.points[0, 0], trees.points[1, 0], 0
    width = _BESIDE * math.sqrt(_square(trees.points[0], 0, goal))
    for _ in range(_MAX_DRAWS):
        beside = uniform_kernel(trees.random) < _DRAWS_BESIDE
        share = uniform_kernel(trees.random) if beside else 0.0
        for j in range(target.shape[0]):
            part = uniform_kernel(trees.random)
            target[j] = low[j] + (high[j] - low[j]) * part
            if beside:
                middle = start[j] + share * (goal[j] - start[j])
                target[j] = min(max(middle + width * (2.0 * part - 1.0), low[j]), high[j])
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
    model: ModelArrays, work: Workspace, draws: Draws, trees: Trees, side: int, at: int,
    vectors: Array,
) -> int:  # fmt: skip
    """Add a step from node ``at`` towards ``vectors[0]``; its number, -1 if it is not taken."""
    origin, target, end = trees.points[side, at], vectors[0], vectors[1]
    square, outcome = _square(trees.points[side], at, target), on_stack(4)
    asked = on_stack(1).view(np.int64)
    arrives = square <= draws.step * draws.step
    share = 1.0 if arrives else draws.step / math.sqrt(square)
    for j in range(target.shape[0]):
        end[j] = target[j] if arrives else origin[j] + share * (target[j] - origin[j])
    trees.tally[EDGES] += 1
    proves = trees.tally[_CUTS] >= _MAX_CUTS
    looks, verdict = _LOOKS_BEFORE_PROOF if proves else _LOOKS, COLLIDING
    if blocked_at(model, work, origin, end, draws.slack, 1, looks, asked) < 0.0:
        verdict = FREE
        if proves:
            verdict = certify_line(model, work, origin, end, draws.slack, _MAX_INTERVALS, outcome)
    if verdict != FREE:
        trees.met[side, at] = True
        return -1
    node = _add(trees, side, end, at)
    trees.proved[side, node] = proves
    return node


@kernel(allocates=False)
def _proves(
    model: ModelArrays, work: Workspace, slack: float, trees: Trees, side: int, entry: int
) -> bool:
    """Prove the steps from node ``entry`` back to a root; one that is not proved is cut off."""
    points, parents, proved = trees.points[side], trees.parents[side], trees.proved[side]
    node, outcome = entry, on_stack(4)
    while parents[node] >= 0:
        if not proved[node]:
            a, b = points[parents[node]], points[node]
            if certify_line(model, work, a, b, slack, _MAX_INTERVALS, outcome) != FREE:
                trees.met[side, parents[node]] = True
                trees.tally[_CUTS] += 1
                _cut(trees, side, node)
                return False
            proved[node] = True
        node = parents[node]
    return True


@kernel(allocates=False)
def _cut(trees: Trees, side: int, first: int) -> None:
    """Take a node out of a tree, and all that grew from it: nothing is nearest to it any more."""
    points, parents = trees.points[side], trees.parents[side]
    for node in range(first, trees.sizes[side]):
        above = parents[node]
        if node == first or (above >= 0 and parents[above] == _CUT):
            parents[node] = _CUT
            for j in range(points.shape[1]):
                points[node, j] = np.inf


@kernel(allocates=False)
def _keep_path(trees: Trees) -> None:
    """Keep the way on which the trees meet, if it is shorter than the one before."""
    points, parents, tally, path = trees.points, trees.parents, trees.tally, trees.path
    count, below = 0, tally[_HERE]
    while below >= 0:
        count, below = count + 1, parents[0, below]
    # Written behind the path before. Where the trees meet, both have a node, which counts once.
    begin = tally[PATH]
    node, at = tally[_HERE], begin + count
    while node >= 0:
        at -= 1
        for j in range(path.shape[1]):
            path[at, j] = points[0, node, j]
        node = parents[0, node]
    node, end = parents[1, tally[_THERE]], begin + count
    while node >= 0:
        for j in range(path.shape[1]):
            path[end, j] = points[1, node, j]
        node, end = parents[1, node], end + 1
    if begin > 0 and _length(path, begin, end) >= _length(path, 0, begin):
        return
    for row in range(begin, end):
        for j in range(path.shape[1]):
            path[row - begin, j] = path[row, j]
    tally[PATH] = end - begin


@kernel(allocates=False)
def _is_long(path: Array, count: int) -> bool:
    """Whether a path of so many waypoints (k, n) is a detour that is worth another search."""
    return _length(path, 0, count) > _LONG * math.sqrt(_square(path, 0, path[count - 1]))


@kernel(allocates=False)
def _length(path: Array, begin: int, end: int) -> float:
    length = 0.0
    for row in range(begin + 1, end):
        length += math.sqrt(_square(path, row - 1, path[row]))
    return length
