"""Facts of a witness: for each pair of solids, directions that part them over cells of time.

A cell whose pairs are not all settled (``bound``) is halved, for those pairs alone: of most pairs a
few cells cover all of the motion.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import comb

from kinematics.arrays import Array, Indices
from kinematics.caches.bounded_cache import bounded_cache
from kinematics.forward import joint_frames
from kinematics.model.chain import Chain
from kinematics.trajectory.trajectory import Trajectory
from obstacles.convex.piece import PieceArrays, PieceKind
from obstacles.robots.allowed_pairs import sorted_pair
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene
from planning.proof.collision.proposals import ProposalRows, packed_pieces
from planning.values.deadline import Deadline
from planning.witness.bound import SETTLED, TOUCHING, Motion, Solids, settle

#: Cells are halved at most so often.
MAX_DEPTH = 16
Cell = tuple[float, float]


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
        cells: Begin and end of each cell [s].
        pairs: Number of each fact's pair, shape (f,).
        within: Number of its cell, shape (f,).
        directions: Direction in the frame of the body where both bodies meet, shape (f, 3).
        known: Whether the direction settles the pair; else nothing does, shape (f,).
    """

    cells: tuple[Cell, ...]
    pairs: Indices
    within: Indices
    directions: Array
    known: NDArray[np.bool_]


def solids_of(robot: RobotGeometry, scene: Scene) -> Solids:
    """Solids of a robot, each in the frame of its body, and behind them those of a scene."""
    arrays = PieceArrays.joined([robot.arrays, scene.pieces()[0]])
    packed, e = packed_pieces(robot, scene, frozenset()), len(arrays)
    numbers = np.arange(e, dtype=np.int64)
    # Balls as checkers have them: a cone's is that of a cylinder.
    centers, radii = arrays.centers.copy(), arrays.radii.copy()
    cones = arrays.kinds == PieceKind.CONE
    centers[cones] = arrays.poses[cones, :3, 3]
    radii[cones] = np.hypot(arrays.sizes[cones, 0], arrays.sizes[cones, 1]) + arrays.sizes[cones, 2]
    still = np.full(e - len(robot.pieces), -1, dtype=np.int64)
    return Solids(
        bodies_of(robot.chain),
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


def bodies_of(chain: Chain) -> Indices:
    """Type of the joint that moves each body, and the body before it, shape (2, b)."""
    own = [(int(kind), j - 1) for j, kind in enumerate(chain.joint_types)]
    rows = own + [(mimic.joint_type, mimic.parent) for mimic in chain.mimic_joints]
    return np.ascontiguousarray(np.array(rows, dtype=np.int64).reshape(-1, 2).T)


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
    robot: RobotGeometry,
    scene: Scene,
    pairs: Pairs,
    deadline: Deadline | None = None,
) -> Facts:
    """Facts that settle pairs over all of a motion, and the cells where none was found.

    Args:
        trajectory: The motion.
        robot: The robot.
        scene: Scene around the robot.
        pairs: The pairs.
        deadline: Instant from which on cells are left as they are.
    """
    solids, e = solids_of(robot, scene), len(robot.pieces) + len(scene.pieces()[1])
    poses, centers = np.zeros((e, 4, 4)), np.zeros((e, 3))
    cells, everything = list[Cell](), np.arange(len(pairs.rows))
    none = everything[:0], everything[:0], np.zeros((0, 3)), np.zeros(0, dtype=np.bool_)
    blocks: list[tuple[Indices, Indices, Array, NDArray[np.bool_]]] = [none]
    waiting = [(0, 0, everything, np.zeros((len(everything), 3)))]
    while waiting and len(everything):
        depth, number, rows, way = waiting.pop()
        begin = trajectory.duration * (number / 2**depth)
        cell = (begin, trajectory.duration * ((number + 1) / 2**depth))
        motion = Motion(*_motion(trajectory, robot.chain, cell), poses, centers)
        found = settle(solids, motion, pairs.rows[rows], pairs.needs[rows], way)
        last = depth == MAX_DEPTH or (deadline is not None and deadline.passed)
        done = (found == SETTLED) | (found == TOUCHING) | last
        if done.any():
            within = np.full(int(done.sum()), len(cells))
            blocks.append((rows[done], within, way[done], found[done] == SETTLED))
            cells.append(cell)
        if not done.all():
            left = rows[~done], way[~done]
            waiting.append((depth + 1, 2 * number + 1, left[0], left[1].copy()))
            waiting.append((depth + 1, 2 * number, *left))
    return Facts(tuple(cells), *(np.concatenate(column) for column in zip(*blocks, strict=True)))


def _motion(trajectory: Trajectory, chain: Chain, cell: Cell) -> tuple[Array, Array, Array]:
    """Fields ``frames``, ``steps`` and ``most`` of ``Motion``."""
    breaks, c = trajectory.breaks, trajectory.coefficients
    begin, end = cell
    first = int(np.searchsorted(breaks[1:-1], begin, side="right"))
    last = int(np.searchsorted(breaks[1:-1], end, side="left"))
    since = breaks[first : last + 1]
    s = np.maximum(begin - since, 0.0)
    h = np.minimum(end, breaks[first + 1 : last + 2]) - since - s
    steps = np.einsum("sjk,ski->sij", c[first : last + 1], _to_bernstein(s, h, c.shape[2]))
    middle = trajectory.sample([0.5 * (begin + end)])[0]
    steps -= middle
    for mimic in chain.mimic_joints:
        own = mimic.multiplier * steps[:, :, mimic.leader : mimic.leader + 1]
        steps = np.concatenate([steps, own], axis=2)
    most = np.abs(steps).max(axis=(0, 1))
    return joint_frames(chain, middle), np.ascontiguousarray(steps), most


def _to_bernstein(s: Array, h: Array, k: int) -> Array:
    """Matrices from powers of time to Bernstein coefficients on [s, s + h], shape (m, k, k).

    Args:
        s: Begin of each stretch, shape (m,).
        h: Length of each stretch, shape (m,).
        k: Number of coefficients.
    """
    power, (shift, rise) = np.arange(k), _binomials(k)
    exponent = np.maximum(power[:, None] - power, 0)
    moved = shift * s[:, None, None] ** exponent * h[:, None, None] ** power
    return np.asarray(moved @ rise)


@bounded_cache(maxsize=8)
def _binomials(k: int) -> tuple[Array, Array]:
    """C(row, column), and C(i, m) / C(k - 1, m) for powers m and coefficients i, (k, k) each."""
    power = np.arange(k)
    shift = np.asarray(comb(power[:, None], power), dtype=np.float64)
    return shift, shift.T / comb(k - 1, power)[:, None]
