"""Mimic joints: joints off a chain whose position is that of a joint of it, scaled and shifted.

The rods of a parallelogram, a cover that turns back as its arm turns: with j the joint that leads,

    q = m q_j + b,      T_root_k = T_root_parent A_k M_k(q).

They add no degree of freedom, but a body each. Bodies are numbered: -1 stands still, body i < n is
what joint i of the chain carries, and body n + k what mimic joint k does.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from kinematics.arrays import Array, Indices, frozen


@dataclass(frozen=True, slots=True, eq=False)
class MimicJoint:
    """A joint whose position is ``multiplier`` times that of a joint of the chain, plus ``offset``.

    Args:
        name: The joint's name.
        joint_type: 0 turns about the z axis of its frame, 1 slides along it.
        parent: The body it hangs on, before its own in number.
        leader: Index of the joint of the chain that it follows.
        T_parent_joint: Frame at position 0 in the frame of that body, shape (4, 4).
        multiplier: Multiplier of the leader's position, not 0.
        offset: Added to it [rad or m].
    """

    name: str
    joint_type: int
    parent: int
    leader: int
    T_parent_joint: Array
    multiplier: float = 1.0
    offset: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "T_parent_joint", frozen(self.T_parent_joint))

    def text(self) -> str:
        """Text of all but the frame, for hashes."""
        numbers = f"{self.joint_type}\0{self.parent}\0{self.leader}"
        # The word of the first release: hashes of robots depend on it.
        return f"follower\0{self.name}\0{numbers}\0{self.multiplier!r}\0{self.offset!r}\0"


def parents(n: int, mimic_joints: Sequence[MimicJoint]) -> Indices:
    """The body before each body, shape (n + len(mimic_joints),)."""
    chain = np.arange(-1, n - 1, dtype=np.int64)
    return np.concatenate([chain, np.array([f.parent for f in mimic_joints], dtype=np.int64)])
