"""Solids of a robot whose covers get into each other where the solids themselves are apart.

The flange in the fork of a wrist, a hand in the hollow of a forearm: wherever such a robot stands,
no cover parts them, and their triangles decide, a hundred times as dear. Cut more finely, what
covers them stays out of each other's way.
"""

from collections import Counter, defaultdict
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from obstacles.robots.touching_pairs import PlacedPieces

if TYPE_CHECKING:
    from obstacles.robots.robot_geometry import RobotGeometry

#: Configurations that are looked at, and in how many of them covers must touch in vain.
_SAMPLES, _OFTEN = 60, 6
_SEED = 2
#: Triangles of all such solids beyond which they stay as they are: cutting them anew would take
#: longer than an upload may, and a humanoid has many.
_MOST_TRIANGLES = 20_000
#: Pieces of a robot beyond which it stays as it is: what is packed and swept of it grows with their
#: square.
_MOST_PIECES = 200


def crowded_solids(robot: "RobotGeometry") -> set[int]:
    """Numbers of the solids whose covers often touch another's that they are apart from.

    Args:
        robot: The robot.
    """
    if not 0 < len(robot.pieces) <= _MOST_PIECES:
        return set()
    surfaces = np.array([piece.surface is not None for piece in robot.pieces])
    pairs = robot.self_pairs[surfaces[robot.self_pairs].any(axis=1)]
    if not len(pairs):
        return set()
    bare = [replace(piece, surface=None) for piece in robot.pieces]
    exact, covers = PlacedPieces(robot), PlacedPieces(robot, bare)
    lower, upper = robot.chain.sampling_bounds()
    random, in_vain = np.random.default_rng(_SEED), Counter[tuple[int, int]]()
    solids = robot.solids[pairs]
    for _ in range(_SAMPLES):
        q = random.uniform(lower, upper)
        covers.place(q)
        exact.place(q)
        near = covers.may_touch(pairs)
        together = defaultdict[tuple[int, int], list[tuple[int, int]]](list)
        for pair, (a, b) in zip(pairs[near].tolist(), solids[near].tolist(), strict=True):
            together[a, b].append((pair[0], pair[1]))
        for pair, pieces in together.items():
            known = in_vain[pair] >= _OFTEN
            in_vain[pair] += not known and covers.touch(pieces) and not exact.touch(pieces)
    crowded = {solid for pair, count in in_vain.items() if count >= _OFTEN for solid in pair}
    triangles = Counter[int]()
    for solid, piece in zip(robot.solids, robot.pieces, strict=True):
        if piece.surface is not None and int(solid) in crowded:
            triangles[int(solid)] += len(piece.surface.triangles)
    return set(triangles) if triangles.total() <= _MOST_TRIANGLES else set()
