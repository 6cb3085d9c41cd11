"""How the bodies of a chain with followers hang on each other, for bounds over all of them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinematics.arrays import Array, Indices
from kinematics.model.chain import Chain, JointType
from kinematics.model.mimic_joint import parents


@dataclass(frozen=True, slots=True, eq=False)
class BodyTree:
    """Bodies of a chain of n joints, b in all; without followers b = n.

    Args:
        parents: The body before each, -1 for the base, shape (b,).
        slides: Whether its joint slides, shape (b,).
        lengths: Lengths from the joint before to its joint at 0, shape (b,) [m].
        shares: Rates of its joint from those of the chain's, by absolute value, shape (b, n).
        shifts: Absolute offsets of the joints that follow others, shape (b,) [rad or m].
    """

    parents: Indices
    slides: NDArray[np.bool_]
    lengths: Array
    shares: Array
    shifts: Array

    @classmethod
    def of(cls, chain: Chain) -> "BodyTree":
        """The tree of a chain."""
        n, followers = chain.n, chain.followers
        offsets = [*chain.offsets, *(follower.T_parent_joint for follower in followers)]
        types = [*chain.joint_types, *(follower.joint_type for follower in followers)]
        shares, shifts = np.eye(chain.body_count, n), np.zeros(chain.body_count)
        for k, follower in enumerate(followers, start=n):
            shares[k, follower.leader] = abs(follower.multiplier)
            shifts[k] = abs(follower.offset)
        lengths = np.linalg.norm(np.array(offsets)[:, :3, 3], axis=1)
        slides = np.array(types) == JointType.PRISMATIC
        return cls(parents(n, followers), slides, lengths, shares, shifts)

    def rates(self, rates: Array) -> Array:
        """Largest rates of all joints from those of the chain's (..., n), shape (..., b)."""
        return np.asarray(rates @ self.shares.T)

    def positions(self, positions: Array) -> Array:
        """Largest absolute positions of all joints from those of the chain's (n,), shape (b,)."""
        # Without those that lead others, whose range may be infinite.
        led = np.where(self.shares > 0.0, positions, 0.0)
        return np.asarray((self.shares * led).sum(axis=1) + self.shifts)

    def of_leaders(self, values: Array) -> Array:
        """Sums over each joint of the chain and those that follow it, by their shares, (n,)."""
        used = np.where(self.shares > 0.0, values[:, None], 0.0)
        return np.asarray((self.shares * used).sum(axis=0))
