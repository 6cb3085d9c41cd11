"""A robot, a scene and what it holds, packed for the kernels: pieces, who carries them, pairs."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from kinematics.chain import Array, Chain, Indices
from obstacles.piece import Piece, PieceArrays

_T = TypeVar("_T", bound=np.generic)


class ModelArrays(NamedTuple):
    """What a kernel reads (n joints, p pieces, v vertices, k pairs).

    Pieces of the robot come first, in the frame of the joint that carries them; what stands
    still (joint -1) is in the base frame. Pair (i, j) has ``joints[i] < joints[j]``, so that
    piece j is the one that moves when piece i is looked at from.
    """

    joint_types: Indices
    offsets: Array
    joints: Indices
    kinds: Indices
    starts: Indices
    vertices: Array
    sizes: Array
    poses: Array
    centers: Array
    radii: Array
    boxes: Array
    pairs: Indices
    margins: Array


@dataclass(frozen=True, slots=True, eq=False)
class CollisionModel:
    """Everything a collision verdict depends on but the configuration.

    Args:
        chain: The robot.
        pieces: All convex pieces, shape of each in the frame of its joint or of the base.
        joints: The joint that carries each piece, -1 for what stands still, shape (p,).
        names: The link or obstacle each piece belongs to, p of them.
        arrays: The same, packed.
    """

    chain: Chain
    pieces: tuple[Piece, ...]
    joints: Indices
    names: tuple[str, ...]
    arrays: ModelArrays

    @classmethod
    def build(
        cls,
        chain: Chain,
        pieces: Sequence[Piece],
        joints: Sequence[int],
        names: Sequence[str],
        pairs: Sequence[tuple[int, int]] | Indices,
        margins: Sequence[float] | Array,
    ) -> "CollisionModel":
        """Pack pieces and the pairs (k, 2) of them that must stay ``margins`` (k,) [m] apart.

        Pairs on one rigid body can't move against each other and are left out.
        """
        carrier = np.array(joints, dtype=np.int64)
        carrier.setflags(write=False)
        wanted = np.array(pairs, dtype=np.int64).reshape(-1, 2)
        order = np.argsort(carrier[wanted], axis=1, kind="stable")
        wanted = np.take_along_axis(wanted, order, axis=1)
        moving = carrier[wanted[:, 0]] != carrier[wanted[:, 1]]
        packed = PieceArrays.pack(pieces)
        arrays = ModelArrays(
            joint_types=chain.joint_types,
            offsets=chain.offsets,
            joints=carrier,
            kinds=packed.kinds,
            starts=packed.starts,
            vertices=packed.vertices,
            sizes=packed.sizes,
            poses=packed.poses,
            centers=packed.centers,
            radii=packed.radii,
            boxes=packed.boxes,
            pairs=_readonly(wanted[moving]),
            margins=_readonly(np.array(margins, dtype=np.float64).reshape(-1)[moving]),
        )
        return cls(chain, tuple(pieces), carrier, tuple(names), arrays)

    def pair_name(self, pair: int) -> tuple[str, str]:
        """Names of the two bodies of a pair, the robot's link first."""
        i, j = self.arrays.pairs[pair]
        return self.names[j], self.names[i]


def _readonly(array: NDArray[_T]) -> NDArray[_T]:
    array = np.ascontiguousarray(array)
    array.setflags(write=False)
    return array
