"""Solids of a robot whose covers get into each other where the solids themselves are apart.

The flange in the fork of a wrist, a hand in the hollow of a forearm: wherever such a robot stands,
no cover parts them, and their triangles decide, a hundred times as dear. Cut more finely, what
covers them stays out of each other's way.
"""

from collections import Counter
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from obstacles.touching_pairs import PlacedPieces

if TYPE_CHECKING:
    from obstacles.robot_geometry import RobotGeometry

#: Configurations that are looked at, and in how many of them covers must touch in vain.
_SAMPLES, _OFTEN = 60, 6
_SEED = 2
#: Triangles of all such solids beyond which they stay as they are: cutting them anew would take
#: longer than an upload may, and a humanoid has many.
_MOST_TRIANGLES = 20_000


def crowded_solids(robot: "RobotGeometry") -> set[int]:
    """Numbers of the solids whose covers often touch another's that they are apart from.

    Args:
        robot: The robot.
    """
    pairs = [
        (int(i), int(j))
        for i, j in robot.self_pairs
        if robot.pieces[i].surface is not None or robot.pieces[j].surface is not None
    ]
    if not pairs:
        return set()
    bare = [replace(piece, surface=None) for piece in robot.pieces]
    exact, covers = PlacedPieces(robot), PlacedPieces(robot, bare)
    lower, upper = robot.chain.sampling_bounds()
    random, in_vain = np.random.default_rng(_SEED), Counter[tuple[int, int]]()
    for _ in range(_SAMPLES):
        q = random.uniform(lower, upper)
        covers.place(q)
        exact.place(q)
        met = [pair for pair in pairs if covers.touch([pair])]
        solids = {(int(robot.solids[i]), int(robot.solids[j])) for i, j in met}
        touching = {
            (int(robot.solids[i]), int(robot.solids[j])) for i, j in met if exact.touch([(i, j)])
        }
        in_vain.update(solids - touching)
    crowded = {solid for pair, count in in_vain.items() if count >= _OFTEN for solid in pair}
    triangles = Counter[int]()
    for solid, piece in zip(robot.solids, robot.pieces, strict=True):
        if piece.surface is not None and int(solid) in crowded:
            triangles[int(solid)] += len(piece.surface.triangles)
    return set(triangles) if triangles.total() <= _MOST_TRIANGLES else set()
