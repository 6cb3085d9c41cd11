"""The two trees of RRT-Connect: grown by states looked at, proved along the way they meet on.

A step is taken where a few states of it are free, which costs a fifth of a proof. Where the trees
meet, the steps from root to root are proved, and one that is not is cut off with all that grew from
it; after a few cuts every step is proved before it is taken. So a path is proved in every place,
and most of what is not on it costs no proof. Source: "Single-query PRM planner with lazy collision
checking", International Symposium on Robotics Research, 2001.
"""

import math
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from compiled.kernel import kernel
from compiled.random import State, uniform_kernel
from compiled.simd import LANES, choose, fill, lane, load, on_stack, store
from kinematics.arrays import Array, Indices
from obstacles.collision.edge_check import FREE
from obstacles.collision.lanes.check import blocked_between
from obstacles.collision.line_check import prove_line
from obstacles.collision.model.kernel_work import Workspace, workspace
from obstacles.collision.model.model_arrays import ModelArrays
from planning.search.shortcut import distance, path_length
from planning.search.walk import AllowedSet, walk_kernel


class Growth(IntEnum):
    """Outcome of growing a pair of trees."""

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
#: Steps of a walk at most.
_MOST_STEPS = 400
#: Cuts after which every step is proved before it is taken.
_MAX_CUTS = 3


class Tally(IntEnum):
    """Entry of ``Trees.tally``."""

    #: Edges that were checked, by this pair.
    EDGES = 0
    #: By the pair before it, if that has met.
    EDGES_BEFORE = 1
    #: Nodes of the path, 0 where there is none.
    PATH = 2
    #: Node of the start's tree at which the trees meet, and that of the goals' tree.
    HERE = 3
    THERE = 4
    #: Steps of this pair that were cut off.
    CUTS = 5
    #: Root of the goals' tree that the start's tree grows to next, -1 where it grows to a draw.
    AIM = 6
    #: Roots that are planted.
    ROOTS = 7


class Trees(NamedTuple):
    """The tree of the start (0) and that of the goals (1), with room for c nodes each.

    Args:
        points: Shape (2, c, n).
        blocks: Blocks for ``nearest_node``, shape (2, c n) with c a multiple of 8.
        parents: Node that each was reached from, -1 for roots, shape (2, c).
        met: Whether a step from a node failed, shape (2, c).
        proved: Whether the step to a node is proved, shape (2, c).
        sizes: Number of nodes, shape (2,).
        random: State of the random generator, shape (1,).
        tally: Edges that were checked, and more, shape (8,).
        path: The shortest path so far, shape (2 c, n).
    """

    points: Array
    blocks: Array
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
        slack: Distance to keep beyond the margins; below 0 about as much penetration is let be [m].
        proves: Whether the path on which the trees meet is proved, or only looked at more closely.
        guide: Configurations along a way that draws lie beside, evenly spread, shape (k, n).
        width: How far beside it at most in each joint [rad or m].
        beside: Share of the draws that lie there.
    """

    low: Array
    high: Array
    domain: float
    step: float
    slack: float
    proves: bool
    guide: Array
    width: float
    beside: float


def new_trees(size: int, n: int, budget: int, random: State) -> Trees:
    """Room for trees with so many edges, which ``grow_kernel`` plants.

    Args:
        size: Number of roots: the start and the goals.
        n: Number of joints.
        budget: Edges that a pair may look at.
        random: State of the random generator, shape (1,).
    """
    capacity = budget + size
    capacity += -capacity % LANES
    return Trees(
        points=np.empty((2, capacity, n)),
        blocks=np.empty((2, capacity * n)),
        parents=np.empty((2, capacity), dtype=np.int64),
        met=np.empty((2, capacity), dtype=np.bool_),
        proved=np.empty((2, capacity), dtype=np.bool_),
        sizes=np.zeros(2, dtype=np.int64),
        random=random,
        tally=np.zeros(8, dtype=np.int64),
        path=np.empty((2 * capacity, n)),
    )


@kernel
def grow_kernel(
    model: ModelArrays, trees: Trees, draws: Draws, roots: Array, along: AllowedSet | None,
    budget: int, until: int,
) -> int:  # fmt: skip
    """Grow a pair of trees until they meet; if the path is long, another one with as many edges.

    Args:
        model: The packed robot and scene.
        trees: Changed in place.
        draws: Parameters of draws and steps.
        roots: The start and the goals, shape (1 + g, n); behind those of earlier calls, new ones.
        along: The set that steps are walks along; None for straight ones.
        budget: Edges that the first pair may look at.
        until: Edges of a pair after which the clock is looked at, those of earlier calls counted.

    Returns:
        GOING, SPENT or FOUND.
    """
    work, vectors, tally = workspace(model), np.empty((2, roots.shape[1])), trees.tally
    if trees.sizes[0] == 0:
        _plant(trees, roots)
    # A goal that was found since the last call becomes a root, and the start's tree grows to it.
    while tally[Tally.ROOTS] < roots.shape[0]:
        tally[Tally.AIM] = _add(trees, 1, roots[tally[Tally.ROOTS]], -1)
        tally[Tally.ROOTS] += 1
    while True:
        # The second pair has as many edges as the first path took.
        most = tally[Tally.EDGES_BEFORE] if tally[Tally.PATH] > 0 else budget
        if _grow(model, work, draws, trees, along, vectors, min(until, most)):
            first = tally[Tally.PATH] == 0
            _keep_path(trees)
            # A walk costs as much as many edges, and shortening has other ways of its own.
            if not first or along is not None or not is_detour(trees.path, tally[Tally.PATH]):
                return Growth.FOUND
            tally[Tally.EDGES_BEFORE] = tally[Tally.EDGES]
            _plant(trees, roots)
        elif tally[Tally.EDGES] >= most:
            return Growth.FOUND if tally[Tally.PATH] > 0 else Growth.SPENT
        else:
            return Growth.GOING


@kernel(allocates=False)
def _plant(trees: Trees, roots: Array) -> None:
    """Begin anew with roots (1 + g, n): the start, and the goals."""
    trees.sizes[0], trees.sizes[1] = 0, 0
    # The first step is one from the start straight to a goal, and so is what it meets.
    trees.tally[Tally.EDGES], trees.tally[Tally.CUTS], trees.tally[Tally.AIM] = 0, 0, 0
    trees.tally[Tally.ROOTS] = roots.shape[0]
    for root in range(roots.shape[0]):
        _add(trees, min(root, 1), roots[root], -1)


@kernel(allocates=False)
def _add(trees: Trees, side: int, q: Array, parent: int) -> int:
    """Add a node at q (n,), the way to it unproved; its number."""
    node = trees.sizes[side]
    for j in range(q.shape[0]):
        trees.points[side, node, j] = q[j]
    place_node(trees.blocks[side], node, q)
    trees.parents[side, node] = parent
    trees.met[side, node], trees.proved[side, node] = False, False
    trees.sizes[side] = node + 1
    return int(node)


@kernel(allocates=False)
def _grow(
    model: ModelArrays, work: Workspace, draws: Draws, trees: Trees, along: AllowedSet | None,
    vectors: Array, until: int,
) -> bool:  # fmt: skip
    """Grow both trees until they meet on a proved path or ``until`` edges; whether they meet.

    ``vectors`` is room for a target and for the end of a step, (2, n).
    """
    target, tally, failed = vectors[0], trees.tally, 0
    while tally[Tally.EDGES] < until:
        side = 0 if trees.sizes[0] <= trees.sizes[1] else 1
        # After three failed steps in a row the larger tree has a turn: it may come by where the
        # smaller one can't get out at random.
        if failed == 3:
            side, failed = 1 - side, 0
        if tally[Tally.AIM] >= 0:
            side = 0
            for j in range(target.shape[0]):
                target[j] = trees.points[1, tally[Tally.AIM], j]
            near, _ = nearest_node(trees.blocks[0], trees.sizes[0], target)
            tally[Tally.AIM] = -1
        else:
            near = _draw(trees, side, draws, target)
        reached = _step(model, work, draws, trees, along, side, near, vectors)
        if reached < 0:
            failed += 1
            continue
        failed = 0
        for j in range(target.shape[0]):
            target[j] = trees.points[side, reached, j]
        node, left = nearest_node(trees.blocks[1 - side], trees.sizes[1 - side], target)
        while node >= 0 and left > 0.0 and tally[Tally.EDGES] < until:
            node = _step(model, work, draws, trees, along, 1 - side, node, vectors)
            left = distance(trees.points[1 - side, max(node, 0)], target)
        if node >= 0 and left == 0.0:
            tally[Tally.HERE] = reached if side == 0 else node
            tally[Tally.THERE] = node if side == 0 else reached
            if _proves(model, work, draws, trees, 0, int(tally[Tally.HERE])) and _proves(
                model, work, draws, trees, 1, int(tally[Tally.THERE])
            ):
                return True
    return False


@kernel(allocates=False)
def _draw(trees: Trees, side: int, draws: Draws, target: Array) -> int:
    """Draw a configuration (n,) to grow towards; the node that is nearest to it."""
    low, high, guide, near = draws.low, draws.high, draws.guide, 0
    # Draws are rejected where the nearest node has met something, a hundred in a row at most.
    for _ in range(100):
        beside = uniform_kernel(trees.random) < draws.beside
        along = (guide.shape[0] - 1) * uniform_kernel(trees.random) if beside else 0.0
        leg = min(int(along), guide.shape[0] - 2)
        along -= leg
        for j in range(target.shape[0]):
            part = uniform_kernel(trees.random)
            target[j] = low[j] + (high[j] - low[j]) * part
            if beside:
                middle = guide[leg, j] + along * (guide[leg + 1, j] - guide[leg, j])
                target[j] = middle + draws.width * (2.0 * part - 1.0)
                target[j] = min(max(target[j], low[j]), high[j])
        near, away = nearest_node(trees.blocks[side], trees.sizes[side], target)
        if away <= draws.domain or not trees.met[side, near]:
            break
    return near


@kernel(allocates=False)
def _step(
    model: ModelArrays, work: Workspace, draws: Draws, trees: Trees, along: AllowedSet | None,
    side: int, at: int, vectors: Array,
) -> int:  # fmt: skip
    """Add a step from node ``at`` towards ``vectors[0]``; its number, -1 if it is not taken."""
    if along is not None:
        return _walk(model, draws, trees, along, side, at, vectors[0])
    origin, end = trees.points[side, at], vectors[1]
    write_step(origin, vectors[0], draws.step, end)
    trees.tally[Tally.EDGES] += 1
    proves = draws.proves and trees.tally[Tally.CUTS] >= _MAX_CUTS
    looks = _LOOKS_BEFORE_PROOF if proves else _LOOKS
    free = not blocked_between(model, work, origin, end, draws.slack, 1, looks)
    if free and proves:
        verdict = prove_line(model, work, origin, end, draws.slack, _MAX_INTERVALS, on_stack(4))
        free = verdict == FREE
    if not free:
        trees.met[side, at] = True
        return -1
    node = _add(trees, side, end, at)
    trees.proved[side, node] = bool(proves)
    return node


@kernel
def _walk(
    model: ModelArrays, draws: Draws, trees: Trees, along: AllowedSet, side: int, at: int,
    target: Array,
) -> int:  # fmt: skip
    """Add the steps of a walk from node ``at`` towards a target (n,); the last one, -1 for none."""
    trees.tally[Tally.EDGES] += 1
    left = trees.points.shape[1] - trees.sizes[side]
    steps = np.empty((min(left, _MOST_STEPS), target.shape[0]))
    count, _ = walk_kernel(model, draws.slack, along, trees.points[side, at], target, steps)
    node = -1
    for step in range(count):
        node = _add(trees, side, steps[step], at if step == 0 else node)
        trees.proved[side, node] = True
    return node


@kernel(allocates=False)
def _proves(
    model: ModelArrays, work: Workspace, draws: Draws, trees: Trees, side: int, entry: int
) -> bool:
    """Prove the steps from node ``entry`` back to a root; one that is not proved is cut off.

    Where nothing is to be proved, the middles of what was looked at are looked at.
    """
    points, parents, proved = trees.points[side], trees.parents[side], trees.proved[side]
    node, slack = entry, draws.slack
    while parents[node] >= 0:
        if not proved[node]:
            a, b = points[parents[node]], points[node]
            if draws.proves:
                verdict = prove_line(model, work, a, b, slack, _MAX_INTERVALS, on_stack(4))
                free = verdict == FREE
            else:
                looks = 2 * _LOOKS
                free = not blocked_between(model, work, a, b, slack, looks, looks)
            if not free:
                trees.met[side, parents[node]] = True
                trees.tally[Tally.CUTS] += 1
                _cut(trees, side, node)
                return False
            proved[node] = True
        node = parents[node]
    return True


@kernel(allocates=False)
def _cut(trees: Trees, side: int, first: int) -> None:
    """Take a node out of a tree, and all that grew from it: nothing is nearest to it any more."""
    points, parents = trees.points[side], trees.parents[side]
    # Parent of a node that was cut off; that of a root is -1.
    cut = -2
    for node in range(first, trees.sizes[side]):
        above = parents[node]
        if node == first or (above >= 0 and parents[above] == cut):
            parents[node] = cut
            for j in range(points.shape[1]):
                points[node, j] = np.inf
            place_node(trees.blocks[side], node, points[node])


@kernel(allocates=False)
def _keep_path(trees: Trees) -> None:
    """Keep the way on which the trees meet, if it is shorter than the one before."""
    points, parents, tally, path = trees.points, trees.parents, trees.tally, trees.path
    count, below = 0, tally[Tally.HERE]
    while below >= 0:
        count, below = count + 1, parents[0, below]
    # Written behind the path before. Where the trees meet, both have a node, which counts once.
    begin = tally[Tally.PATH]
    node, at = tally[Tally.HERE], begin + count
    while node >= 0:
        at -= 1
        for j in range(path.shape[1]):
            path[at, j] = points[0, node, j]
        node = parents[0, node]
    node, end = parents[1, tally[Tally.THERE]], begin + count
    while node >= 0:
        for j in range(path.shape[1]):
            path[end, j] = points[1, node, j]
        node, end = parents[1, node], end + 1
    if begin > 0 and path_length(path[begin:], end - begin) >= path_length(path, begin):
        return
    for row in range(begin, end):
        for j in range(path.shape[1]):
            path[row - begin, j] = path[row, j]
    tally[Tally.PATH] = end - begin


@kernel(allocates=False)
def write_step(origin: Array, target: Array, step: float, end: Array) -> None:
    """Write where a step from ``origin`` towards ``target`` ends, all (n,)."""
    length = distance(origin, target)
    arrives = length <= step
    share = 1.0 if arrives else step / length
    for j in range(target.shape[0]):
        end[j] = target[j] if arrives else origin[j] + share * (target[j] - origin[j])


@kernel(allocates=False)
def is_detour(path: Array, count: int) -> bool:
    """Whether a path of so many waypoints (k, n) is a detour that is worth another search."""
    # Of shorter paths, shortening does what another pair of trees would do.
    return path_length(path, count) > 3.0 * distance(path[0], path[count - 1])


@kernel(allocates=False)
def place_node(blocks: Array, node: int, q: Array) -> None:
    """Write node number ``node``, the next of its tree or one before it, at q (n,).

    Args:
        blocks: Blocks of eight nodes, a vector for each joint, flat.
        node: Number of the node.
        q: Shape (n,); infinite for a node that is nearest to nothing.
    """
    at = node // LANES * LANES * q.shape[0]
    if node % LANES == 0 and q[0] < np.inf:
        # Those to come are nearest to nothing yet.
        for j in range(q.shape[0]):
            store(blocks, at + LANES * j, fill(np.inf))
    for j in range(q.shape[0]):
        blocks[at + LANES * j + node % LANES] = q[j]


@kernel(allocates=False)
def nearest_node(blocks: Array, count: int, q: Array) -> tuple[int, float]:
    """The first of ``count`` nodes that are nearest to q (n,), and how far away it is.

    Node 0 and infinity where none is anywhere.
    """
    n = q.shape[0]
    best, number = fill(np.inf), fill(0.0)
    for first in range(0, count, LANES):
        square, at = fill(0.0), first * n
        for j in range(n):
            away = load(blocks, at + LANES * j) - q[j]
            square = square + away * away
        closer = square < best
        best, number = choose(closer, square, best), choose(closer, float(first), number)
    least, node = np.inf, 0
    for k in range(LANES):
        square_k, node_k = lane(best, k), int(lane(number, k)) + k
        if square_k < least or (square_k == least and square_k < np.inf and node_k < node):
            least, node = square_k, node_k
    return node, math.sqrt(least)
