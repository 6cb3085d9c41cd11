"""The pairs of convex pieces that must stay apart, packed for the certificate's own kernels."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics.chain import Array, Indices
from obstacles.collision_model import together
from obstacles.robot_geometry import RobotGeometry
from obstacles.scene import Scene
from obstacles.support_table import Lists


class PairArrays(NamedTuple):
    """What the certificate's kernels read (n joints, p pieces, v vertices, k pairs).

    Args:
        joint_types: 0 revolute, 1 prismatic, shape (n,).
        offsets: T_(i-1)_i of every joint at 0, shape (n, 4, 4).
        pairs: Shape (k, 2); the second is a robot's piece that moves against the first.
        margins: Distance each pair must keep, shape (k,) [m].
        own: 1 for a pair of the robot's own pieces, 0 for one with an obstacle, shape (k,).
        joints: Joint that carries each piece, -1 for what stands still, shape (p,).
        kinds: Of the pieces' cores, as ``PieceKind``, shape (p,).
        starts: Vertices of piece i are ``vertices[starts[i]:starts[i + 1]]``, shape (p + 1,).
        vertices: In the piece's frame, shape (v, 3).
        columns: The same, shape (3, v): so loops over them compile to vectors.
        sizes: Radius, half height, rounding; shape (p, 3).
        poses: Frame of each piece in that of its joint, shape (p, 4, 4).
        centers: Of a ball that holds each piece, in the frame of its joint, shape (p, 3).
        radii: Of these balls, shape (p,).
        boxes: Centre and half sizes of a box that holds each piece, in its own frame, (p, 6).
        extents: Size of the largest numbers that a piece's place is summed from, shape (p,) [m].
        rows: The pieces for the planner's distance iteration, as in ``PieceSet``.
        corners: Of the same.
        tables: Of the same.
    """

    joint_types: Indices
    offsets: Array
    pairs: Indices
    margins: Array
    own: Indices
    joints: Indices
    kinds: Indices
    starts: Indices
    vertices: Array
    columns: Array
    sizes: Array
    poses: Array
    centers: Array
    radii: Array
    boxes: Array
    extents: Array
    rows: Array
    corners: Array
    tables: Lists


@dataclass(frozen=True, slots=True, eq=False)
class PairTable:
    """The pairs of a robot in a scene.

    Args:
        arrays: Packed; the robot's pieces come first.
        names: The link or obstacle each piece belongs to.
    """

    arrays: PairArrays
    names: tuple[str, ...]

    @classmethod
    def of(cls, robot: RobotGeometry, scene: Scene, margin: float) -> "PairTable":
        """All pairs that neither robot nor scene allows to touch.

        What stands still with the base can't be moved away from obstacles and is not compared with
        them; from obstacles ``margin`` [m] is kept beyond their own.
        """
        still, owners, own_margins = scene.pieces()
        count, ids = len(robot.pieces), scene.ids
        names = robot.links + tuple(ids[owner] for owner in owners.tolist())
        joints = np.concatenate([robot.joints, np.full(len(still), -1, dtype=np.int64)])
        moving = np.flatnonzero(robot.joints >= 0)
        obstacles = np.arange(count, count + len(still))
        apart = np.column_stack([np.tile(obstacles, len(moving)), np.repeat(moving, len(still))])
        own = robot.self_pairs
        swap = joints[own[:, 0]] > joints[own[:, 1]]
        own = np.where(swap[:, None], own[:, ::-1], own)
        pairs = np.concatenate([apart, own]).astype(np.int64)
        is_own = np.arange(len(pairs)) >= len(apart)
        margins = np.where(is_own, 0.0, margin)
        margins[: len(apart)] += np.tile(own_margins, len(moving))
        kept = _forbidden(pairs, names, scene)
        both = (robot.arrays, still)
        starts = np.concatenate([robot.arrays.starts, still.starts[1:] + robot.arrays.starts[-1]])
        vertices = np.concatenate([pieces.vertices for pieces in both])
        sizes = np.concatenate([pieces.sizes for pieces in both])
        poses = np.concatenate([pieces.poses for pieces in both])
        packed = together(robot, scene)
        arrays = PairArrays(
            joint_types=robot.chain.joint_types,
            offsets=robot.chain.offsets,
            pairs=np.ascontiguousarray(pairs[kept]),
            margins=margins[kept],
            own=is_own[kept].astype(np.int64),
            joints=joints,
            kinds=np.concatenate([pieces.kinds for pieces in both]),
            starts=starts,
            vertices=vertices,
            columns=np.ascontiguousarray(vertices.T),
            sizes=sizes,
            poses=poses,
            centers=np.concatenate([pieces.centers for pieces in both]),
            radii=np.concatenate([pieces.radii for pieces in both]),
            boxes=np.concatenate([pieces.boxes for pieces in both]),
            extents=_extents(starts, vertices, sizes, poses),
            rows=packed.rows,
            corners=packed.corners,
            tables=packed.tables,
        )
        return cls(arrays, names)

    def pair_names(self, pair: int) -> tuple[str, str]:
        """The link, and the obstacle or other link, of a pair."""
        i, j = self.arrays.pairs[pair]
        return self.names[j], self.names[i]


def _forbidden(pairs: Indices, names: tuple[str, ...], scene: Scene) -> NDArray[np.bool_]:
    """Which of the pairs the scene does not allow to touch, shape (k,)."""
    kept = np.ones(len(pairs), dtype=np.bool_)
    if scene.allowed_collisions:
        all_names = np.array(names)
        for a, b in scene.allowed_collisions:
            is_a, is_b = all_names == a, all_names == b
            i, j = pairs.T
            kept &= ~((is_a[i] & is_b[j]) | (is_b[i] & is_a[j]))
    return kept


def _extents(starts: Indices, vertices: Array, sizes: Array, poses: Array) -> Array:
    """``PairArrays.extents``."""
    farthest = np.zeros(len(sizes))
    filled = np.flatnonzero(np.diff(starts))
    if len(filled):
        lengths = np.linalg.norm(vertices, axis=1)
        farthest[filled] = np.maximum.reduceat(lengths, starts[filled])
    places = np.linalg.norm(poses[:, :3, 3], axis=1)
    return np.asarray(places + farthest + sizes.sum(axis=1))
