"""Facts of a witness: for each pair of solids, directions that part them over cells of time.

A cell whose pairs are not all settled (``bound``) is halved, for those pairs alone: of most pairs a
few cells cover all of the motion.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics.arrays import Array, Indices
from kinematics.caches.bounded_cache import bounded_cache
from kinematics.trajectory.trajectory import Trajectory
from obstacles.convex.piece import PieceKind
from obstacles.robots.robot_geometry import RobotGeometry, sorted_pair
from obstacles.scenes.scene import Scene
from planning.proof.collision.pair_table import joints_of
from planning.proof.collision.proposals import ProposalRows, packed_pieces
from planning.values.deadline import Deadline
from planning.witness.bound import SETTLED, Search, Solids, search

_CONE = int(PieceKind.CONE)
#: Cells are halved at most so often.
MAX_DEPTH = 16


class Pairs(NamedTuple):
    """Pairs of solids that have to stay apart (m pairs).

    Args:
        rows: The solids of each pair, the robot's first, shape (m, 2).
        needs: Distance to keep beyond 0, shape (m,) [m].
    """

    rows: Indices
    needs: Array


class Facts(NamedTuple):
    """Facts found (f of them).

    Args:
        cells: Begin and end of each cell, shape (c, 2) [s].
        rows: Two solids, cell, and direction in the frame of the body where both bodies meet, whole
            numbers, shape (f, 6).
        known: Whether the direction settles the pair; else nothing does, shape (f,).
    """

    cells: Array
    rows: Indices
    known: NDArray[np.bool_]


def solids_of(robot: RobotGeometry, scene: Scene) -> Solids:
    """Solids of a robot, each in the frame of its body, and behind them those of a scene."""
    blocks = robot.arrays, scene.pieces()[0]
    kinds, sizes, poses, centers, radii = (
        np.concatenate([getattr(block, name) for block in blocks])
        for name in ("kinds", "sizes", "poses", "centers", "radii")
    )
    columns = np.ascontiguousarray(np.concatenate([block.vertices for block in blocks]).T)
    starts = np.concatenate([blocks[0].starts, blocks[1].starts[1:] + blocks[0].starts[-1]])
    # Balls as checkers have them: a cone's is that of a cylinder.
    for k in np.flatnonzero(kinds == _CONE):
        centers[k], radii[k] = poses[k, :3, 3], np.hypot(*sizes[k, :2]) + sizes[k, 2]
    packed, e = packed_pieces(robot, scene, frozenset()), len(kinds)
    body, numbers = np.full(e, -1, dtype=np.int64), np.arange(e, dtype=np.int64)
    body[: len(robot.pieces)] = robot.joints
    return Solids(
        *joints_of(robot.chain), body, kinds, starts, columns, sizes, poses, centers, radii,
        ProposalRows(packed.rows, numbers, np.full(e, -1), packed.corners, packed.tables),
    )  # fmt: skip


def pairs_of(robot: RobotGeometry, scene: Scene, margin: float) -> Pairs:
    """All pairs of solids that neither robot nor scene allows to touch.

    Args:
        robot: The robot.
        scene: Scene around the robot.
        margin: Distance to keep from obstacles beyond their own margins [m].
    """
    _, owners, margins = scene.pieces()
    own, apart = _apart(robot, scene.ids, scene.allowed_collisions)
    first, second = np.nonzero(apart[:, owners])
    rows = np.empty((len(own) + len(first), 2), dtype=np.int64)
    rows[: len(own)], rows[len(own) :, 0] = own, first
    rows[len(own) :, 1] = second + len(robot.pieces)
    needs = np.zeros(len(rows))
    needs[len(own) :] = margins[second] + margin
    return Pairs(rows, needs)


@bounded_cache(maxsize=8)
def _apart(
    robot: RobotGeometry, ids: tuple[str, ...], allowed: frozenset[tuple[str, str]]
) -> tuple[Indices, NDArray[np.bool_]]:
    """Pairs of pieces (m, 2) that have to stay apart, and obstacles from pieces that move."""
    names = robot.links
    kept = [sorted_pair(names[a], names[b]) not in allowed for a, b in robot.self_pairs]
    rows = [[sorted_pair(link, name) not in allowed for name in ids] for link in names]
    apart = np.array(rows, dtype=np.bool_).reshape(len(names), len(ids))
    own = robot.self_pairs[np.array(kept, dtype=np.bool_)]
    return own, apart & (robot.joints >= 0)[:, None]


def facts_of(
    trajectory: Trajectory,
    solids: Solids,
    pairs: Pairs,
    deadline: Deadline | None = None,
) -> Facts:
    """Facts that settle pairs over all of a motion, and the cells where none was found.

    Args:
        trajectory: The motion.
        solids: The solids.
        pairs: The pairs.
        deadline: Instant from which on cells are left as they are.
    """
    motion, none = (trajectory.breaks, trajectory.coefficients), np.zeros(len(pairs.rows), np.int64)
    state = Search(
        0, none, np.arange(len(none)), np.zeros((len(none), 3)), np.empty((64, 2)),
        np.empty((1024, 7), np.int64), (0, 0),
    )  # fmt: skip
    while state.depth <= MAX_DEPTH and len(state.rows):
        late = deadline is not None and deadline.passed
        last = state.depth if late else MAX_DEPTH
        state = search(solids, motion, pairs.rows, pairs.needs, Search(*state), last)
    facts, (f, c) = state.facts, state.told
    return Facts(trajectory.duration * state.cells[:c], facts[:f, :6], facts[:f, 6] == SETTLED)
