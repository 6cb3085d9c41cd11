"""The node of a tree that is nearest to a configuration, eight nodes abreast."""

import math

import numpy as np

from compiled.kernel import kernel
from compiled.simd import LANES, choose, fill, lane, load, store
from kinematics.arrays import Array


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
