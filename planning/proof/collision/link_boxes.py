"""Boxes over the pieces of each link, for robots that are cut into many.

A humanoid with hands has some five hundred pieces, and tens of thousands of pairs of them: nearly
all are settled at once where boxes about their links are.
"""

from itertools import combinations

import numpy as np

from kinematics.arrays import Indices
from kinematics.caches.bounded_cache import bounded_cache
from obstacles.convex.piece import PieceArrays
from obstacles.robots.robot_geometry import RobotGeometry
from planning.proof.collision.elements import Elements, boxes_over

#: Pieces of a robot up to which each stands for itself: opening boxes would cost more.
_FEW = 64


@bounded_cache(maxsize=64)
def link_parts(robot: RobotGeometry) -> Indices:
    """Starts of the parts that own pairs are of, and the end of the last one, shape (l + 1,).

    A part is a piece, or all pieces of a link that follow each other.
    """
    p = len(robot.pieces)
    if p <= _FEW:
        return np.arange(p + 1)
    same = [
        (robot.links[k], robot.joints[k]) == (robot.links[k - 1], robot.joints[k - 1])
        for k in range(1, p)
    ]
    return np.array([0, *(k for k, as_before in enumerate(same, 1) if not as_before), p])


@bounded_cache(maxsize=64)
def part_pairs(robot: RobotGeometry) -> tuple[Indices, frozenset[tuple[str, str]]]:
    """Pairs of parts that must not touch, shape (k, 2), and names of their links, sorted.

    All that move against each other and that the robot does not allow to touch; chosen here as well
    as by the planner, on purpose. The second of a pair moves against the first.
    """
    allowed, first = {frozenset(pair) for pair in robot.allowed}, link_parts(robot)[:-1]
    joints, links = robot.joints[first].tolist(), [robot.links[k] for k in first]
    pairs = [
        (a, b) if joints[a] <= joints[b] else (b, a)
        for a, b in combinations(range(len(first)), 2)
        if joints[a] != joints[b] and frozenset((links[a], links[b])) not in allowed
    ]
    names = ((links[a], links[b]) for a, b in pairs)
    rows = np.array(pairs, dtype=np.int64).reshape(-1, 2)
    return rows, frozenset((min(pair), max(pair)) for pair in names)


def with_link_boxes(robot: RobotGeometry, own: Elements) -> tuple[Elements, Indices]:
    """A robot's elements with trees of boxes over its parts behind them, and the tops of the parts.

    Args:
        robot: The robot.
        own: Elements of the robot, pieces first.

    Returns:
        The elements, and the one that holds all of each part, shape (l,).
    """
    starts = link_parts(robot)
    tops, blocks, base = starts[:-1].copy(), [own], len(own.kinds)
    for part, (begin, end) in enumerate(
        zip(starts[:-1].tolist(), starts[1:].tolist(), strict=True)
    ):
        if end - begin == 1:
            continue
        pieces = PieceArrays.pack(robot.pieces[begin:end])
        grown = boxes_over(pieces, np.zeros(end - begin), begin, base)
        count = len(grown.kinds)
        blocks.append(
            grown._replace(
                joints=np.full(count, robot.joints[begin]),
                parts=np.full(count, begin),
                row=np.full(count, -1),
            )
        )
        tops[part], base = base, base + count
    return _behind_each_other(blocks), tops


def _behind_each_other(blocks: list[Elements]) -> Elements:
    """Elements one behind the other, of which all but the first have no corners."""
    if len(blocks) == 1:
        return blocks[0]
    joined = {
        name: np.concatenate([getattr(block, name) for block in blocks])
        for name in Elements._fields
    }
    below = [blocks[0].below]
    for block in blocks[1:]:
        below.append(block.below[1:] + below[-1][-1])
    own = blocks[0]
    joined["below"] = np.concatenate(below)
    joined["starts"] = np.append(
        own.starts, np.full(len(joined["kinds"]) - len(own.kinds), own.starts[-1])
    )
    return Elements(**joined)
