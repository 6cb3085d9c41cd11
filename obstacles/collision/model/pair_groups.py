"""Groups of self-collision pairs of pieces, each apart where the balls about its two sides are.

The pieces of a body hang in a tree, and a pair of nodes of two trees stands for all pairs of their
pieces. Links of fine meshes are cut into many pieces: a humanoid with hands has tens of thousands
of pairs, and a few dozen balls prove nearly all of them apart.
Source: "OBBTree: A hierarchical structure for rapid interference detection", SIGGRAPH 1996, for the
descent of two trees at once; what is descended is known beforehand here, and written down.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from compiled.kernel import kernel
from kinematics.arrays import Array, Indices
from obstacles.distance.bvh import FIRST, LAST, SKIP, tree
from obstacles.distance.piece_set import CENTER, RADIUS, ball_rows

#: Pieces below a node that is not parted, and pairs of a group that is not.
_PIECES, _PAIRS = 2, 16
#: Pairs of two bodies up to which they are one group: most arms have no more, and to check all of
#: them takes less time than to check the groups that they would be.
_MANY = 256

# Columns of a group: the first of its pairs and the number after the last, and the rows of the
# balls about its two sides. Of one that is parted: -1 (PARTED), and how many groups it and those
# that part it are, which come right behind it.
FIRST_PAIR, LAST_PAIR, BALL, OTHER_BALL = 0, 1, 2, 3
PARTED, GROUP_SIZE = FIRST_PAIR, LAST_PAIR
GROUP_WIDTH = 4


class PairGroups(NamedTuple):
    """Self-collision pairs by groups (k pairs, g groups, t balls).

    Args:
        pairs: Two pieces each, in the order of their groups, shape (k, 2).
        groups: Columns as named above, shape (g, GROUP_WIDTH).
        balls: Rows of balls about the pieces of each body, and behind them of those about some of
            them, shape (t, WIDTH). Those about bodies are in the order of their joints.
        joints: The joint that carries each ball, shape (t,).
    """

    pairs: Indices
    groups: Indices
    balls: Array
    joints: Indices


class PieceTrees(NamedTuple):
    """Trees over the pieces of each body (p pieces, b bodies, t nodes).

    Args:
        places: Place of each piece in the order of the leaves, shape (p,).
        nodes: Places from one to before the other, and the two nodes that part it, -1 where it is
            not parted; shape (t, 4). The first b are the tops, in the order of ``joints``.
        balls: Rows of balls that hold what is below each node, shape (t, WIDTH).
        joints: The joint that carries each node, shape (t,).
    """

    places: Indices
    nodes: Indices
    balls: Array
    joints: Indices


def piece_trees(rows: Array, joints: Indices) -> PieceTrees:
    """Trees over the pieces of a robot.

    Args:
        rows: Rows of the pieces, shape (p, WIDTH).
        joints: The joint that carries each of them, shape (p,).
    """
    carried = np.unique(joints)
    places, made = np.empty(len(rows), dtype=np.int64), 0
    nodes, balls = np.full((len(carried), 4), -1, dtype=np.int64), list[Array]()
    carriers, below = [carried], list[Array]()
    for body, joint in enumerate(carried):
        own = np.flatnonzero(joints == joint)
        centers, radii = rows[own, CENTER : CENTER + 3], rows[own, RADIUS, None]
        grown = tree(centers - radii, centers + radii, _PIECES)
        order = own[grown.items]
        places[order] = made + np.arange(len(own))
        parted = _nodes(grown.nodes, made, len(nodes))
        held = [_around(rows[order[a - made : b - made]]) for a, b in parted[:, :2]]
        nodes[body] = parted[0]
        balls.insert(body, held[0])
        below += held[1:]
        nodes = np.concatenate([nodes, parted[1:]])
        carriers.append(np.full(len(parted) - 1, joint))
        made += len(own)
    return PieceTrees(
        places, nodes, np.vstack([rows[:0], *balls, *below]), np.concatenate(carriers)
    )


def _nodes(grown: Array, place: int, node: int) -> Indices:
    """``PieceTrees.nodes`` of one tree, places and nodes but the top numbered from here."""
    count = len(grown)
    nodes = np.full((count, 4), -1, dtype=np.int64)
    for k in range(count - 1, -1, -1):
        if grown[k, FIRST] >= 0.0:
            nodes[k, :2] = grown[k, FIRST : LAST + 1]
            continue
        left, right = k + 1, int(grown[k + 1, SKIP])
        nodes[k] = nodes[left, 0], nodes[right, 1], node + left - 1, node + right - 1
    nodes[:, :2] += place
    return nodes


def _around(rows: Array) -> Array:
    """The row (1, WIDTH) of a ball that holds the balls of ``rows``."""
    centers, radii = rows[:, CENTER : CENTER + 3], rows[:, RADIUS]
    middle = 0.5 * ((centers - radii[:, None]).min(axis=0) + (centers + radii[:, None]).max(axis=0))
    reach = float((np.linalg.norm(centers - middle, axis=1) + radii).max())
    return ball_rows(middle[None], reach)


def pair_groups(rows: Array, joints: Indices, pairs: Indices) -> PairGroups:
    """Pairs by groups, parted where two bodies have many.

    Args:
        rows: Rows of the robot's pieces, shape (p, WIDTH); those of the balls are to come behind
            them.
        joints: The joint that carries each piece, shape (p,).
        pairs: Two pieces each, in the order of their bodies, shape (k, 2).
    """
    carried, bodies = np.unique(joints, return_inverse=True)
    sides = bodies[pairs]
    starts = np.flatnonzero(np.any(np.diff(sides, axis=0, prepend=-1) != 0, axis=1))
    ends = np.append(starts, len(pairs))[1:]
    whole = np.column_stack([starts, ends, len(rows) + sides[starts]])
    many = ends - starts > _MANY
    if not many.any():
        balls = [_around(rows[bodies == body]) for body in range(len(carried))]
        return PairGroups(pairs, whole, np.vstack([rows[:0], *balls]), carried)
    trees = piece_trees(rows, joints)
    order, groups = np.arange(len(pairs)), list[Indices]()
    buffer = np.empty((2 * int((ends - starts).max()), GROUP_WIDTH), dtype=np.int64)
    places, radii = trees.places[pairs], trees.balls[:, RADIUS].copy()
    for group, parted in zip(whole, many, strict=True):
        if not parted:
            groups.append(group[None])
            continue
        top = np.append(group[BALL:] - len(rows), group[:BALL])
        count = part_pairs_kernel(trees.nodes, radii, places, order, top, buffer)
        buffer[:count, BALL:] += len(rows)
        groups.append(buffer[:count].copy())
    return PairGroups(pairs[order], np.concatenate(groups), trees.balls, trees.joints)


@kernel
def part_pairs_kernel(
    nodes: Indices, radii: Array, places: Indices, order: Indices, top: Indices, groups: Indices
) -> int:
    """Part the pairs of two bodies; how many groups they are.

    Args:
        nodes: Nodes of ``PieceTrees``.
        radii: Radii of the nodes' balls.
        places: Places of both pieces of all pairs, shape (k, 2).
        order: Numbers of all pairs, shape (k,); those of the two bodies are sorted by groups.
        top: The nodes of both bodies, the first of their pairs and the number after the last, (4,).
        groups: Filled, a row with its two nodes in place of their balls, shape (g, GROUP_WIDTH).
    """
    first, last = top[2], top[3]
    scratch = np.empty(last - first, dtype=np.int64)
    # Groups that wait: nodes, pairs, and the group that they are a part of.
    waiting = np.empty((2 * (last - first) + 2, 5), dtype=np.int64)
    waiting[0, :4], waiting[0, 4] = top, -1
    parents = np.empty(2 * (last - first), dtype=np.int64)
    sizes = np.empty(2 * (last - first), dtype=np.int64)
    height, made = 1, 0
    while height > 0:
        height -= 1
        a, b, first, last = waiting[height, :4]
        groups[made, FIRST_PAIR], groups[made, LAST_PAIR] = first, last
        groups[made, BALL], groups[made, OTHER_BALL] = a, b
        parents[made], sizes[made] = waiting[height, 4], 1
        made += 1
        while last - first > _PAIRS and (nodes[a, 2] >= 0 or nodes[b, 2] >= 0):
            side = 0 if nodes[b, 2] < 0 or (nodes[a, 2] >= 0 and radii[a] >= radii[b]) else 1
            node = a if side == 0 else b
            left, right = nodes[node, 2], nodes[node, 3]
            kept, moved = first, 0
            for entry in range(first, last):
                if places[order[entry], side] < nodes[left, 1]:
                    order[kept] = order[entry]
                    kept += 1
                else:
                    scratch[moved] = order[entry]
                    moved += 1
            order[kept:last] = scratch[:moved]
            if first < kept < last:
                for child, begin, end in ((right, kept, last), (left, first, kept)):
                    waiting[height, 0], waiting[height, 1] = a, b
                    waiting[height, side] = child
                    waiting[height, 2], waiting[height, 3] = begin, end
                    waiting[height, 4] = made - 1
                    height += 1
                break
            # The pairs of one half may all be allowed to touch: what is left has a smaller ball.
            child = left if kept == last else right
            groups[made - 1, BALL + side] = child
            if side == 0:
                a = child
            else:
                b = child
    for group in range(made - 1, -1, -1):
        if group > 0:
            sizes[parents[group]] += sizes[group]
        if sizes[group] > 1:
            groups[group, PARTED], groups[group, GROUP_SIZE] = -1, sizes[group]
    return made


def chosen_groups(groups: Indices, chosen: NDArray[np.bool_]) -> Indices:
    """Groups of those pairs that are chosen, of all of them (k,); none is empty."""
    before = np.concatenate([[0], np.cumsum(chosen)])
    kept, whole = groups.copy(), groups[:, PARTED] >= 0
    kept[whole, : LAST_PAIR + 1] = before[groups[whole, : LAST_PAIR + 1]]
    alive = whole & (kept[:, FIRST_PAIR] < kept[:, LAST_PAIR])
    counts, parted = np.concatenate([[0], np.cumsum(alive)]), np.flatnonzero(~whole)
    after = parted + groups[parted, GROUP_SIZE]
    alive[parted] = counts[after] > counts[parted]
    counts = np.concatenate([[0], np.cumsum(alive)])
    kept[parted, GROUP_SIZE] = counts[after] - counts[parted]
    return kept[alive]


def whole_groups(groups: Indices) -> Indices:
    """Numbers of the groups that no other is parted into."""
    tops, group = list[int](), 0
    while group < len(groups):
        tops.append(group)
        group += int(groups[group, GROUP_SIZE]) if groups[group, PARTED] < 0 else 1
    return np.array(tops, dtype=np.int64)
