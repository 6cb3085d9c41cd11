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
from obstacles.convex.piece import PieceArrays, PieceKind
from obstacles.robots.allowed_pairs import sorted_pair
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene
from planning.proof.collision.pair_table import joints_of
from planning.proof.collision.proposals import ProposalRows, packed_pieces
from planning.values.deadline import Deadline
from planning.witness.bound import SETTLED, Search, Solids, search

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
    arrays = PieceArrays.joined([robot.arrays, scene.pieces()[0]])
    packed, e = packed_pieces(robot, scene, frozenset()), len(arrays)
    numbers = np.arange(e, dtype=np.int64)
    # Balls as checkers have them: a cone's is that of a cylinder.
    centers, radii = arrays.centers.copy(), arrays.radii.copy()
    cones = np.flatnonzero(arrays.kinds == PieceKind.CONE)
    centers[cones] = arrays.poses[cones, :3, 3]
    radii[cones] = np.hypot(arrays.sizes[cones, 0], arrays.sizes[cones, 1]) + arrays.sizes[cones, 2]
    still = np.full(e - len(robot.pieces), -1, dtype=np.int64)
    return Solids(
        *joints_of(robot.chain),
        np.concatenate([robot.joints, still]),
        arrays.kinds,
        arrays.starts,
        np.ascontiguousarray(arrays.vertices.T),
        arrays.sizes,
        arrays.poses,
        centers,
        radii,
        ProposalRows(packed.rows, numbers, np.full(e, -1), packed.corners, packed.tables),
    )


def pairs_of(robot: RobotGeometry, scene: Scene, margin: float) -> Pairs:
    """All pairs of solids that neither robot nor scene allows to touch.

    Args:
        robot: The robot.
        scene: Scene around the robot.
        margin: Distance to keep from obstacles beyond their own margins [m].
    """
    own = robot.self_pairs
    if scene.allowed_collisions:
        names = robot.links
        kept = [sorted_pair(names[a], names[b]) not in scene.allowed_collisions for a, b in own]
        own = own[np.array(kept, dtype=np.bool_)]
    _, owners, margins = scene.pieces()
    apart = _apart(robot, scene.ids, scene.allowed_collisions)
    first, second = np.nonzero(apart[:, owners])
    around = np.column_stack([first, second + len(robot.pieces)])
    needs = np.concatenate([np.zeros(len(own)), margins[second] + margin])
    return Pairs(np.ascontiguousarray(np.concatenate([own, around]).astype(np.int64)), needs)


@bounded_cache(maxsize=8)
def _apart(
    robot: RobotGeometry, ids: tuple[str, ...], allowed: frozenset[tuple[str, str]]
) -> Array:
    """Whether pieces that move and obstacles have to stay apart, shape (p, obstacles)."""
    rows = [[sorted_pair(link, name) not in allowed for name in ids] for link in robot.links]
    apart = np.array(rows, dtype=np.bool_).reshape(len(robot.links), len(ids))
    return np.asarray(apart & (robot.joints >= 0)[:, None])


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
