"""The serial chain from the root to a body that hangs on mimic joints, and what moves it.

A mimic joint's position is that of a joint of the chain, scaled and shifted, so all joints on the
way to such a body are q' = L q + c: with the Jacobian J'(q') of the serial chain on the way

    T(q) = T'(L q + c),      J(q) = J'(L q + c) L,      d/dt J = (d/dt J') L.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinematics.arrays import Array, Indices, frozen
from kinematics.errors import InvalidOption
from kinematics.model.chain import Chain, JointType, Limits, Link, parents


@dataclass(frozen=True, slots=True, eq=False)
class Branch:
    """A serial chain of k joints to a body of a robot of n.

    Args:
        chain: Chain whose last joint carries the links of the body; it has no limits.
        matrix: L, shape (k, n).
        shift: c, shape (k,) [rad or m].
    """

    chain: Chain
    matrix: Array
    shift: Array

    def positions(self, q: Array) -> Array:
        """Q' of configurations (..., n), shape (..., k) [rad or m]."""
        return np.asarray(q @ self.matrix.T + self.shift)

    def rates(self, rates: Array) -> Array:
        """Velocities of the branch's joints from those of the robot's (..., n)."""
        return np.asarray(rates @ self.matrix.T)


def is_on_branch(chain: Chain, link: str | None) -> bool:
    """Whether a link (None for the tip) hangs on a mimic joint.

    Raises:
        InvalidLinkName: There is no such link.
    """
    return bool(chain.mimic_joints) and link is not None and chain.link(link).joint >= chain.n


def require_on_chain(chain: Chain, link: str) -> None:
    """Refuse a link that hangs on a mimic joint, where such links are not known.

    Raises:
        InvalidLinkName: There is no such link.
        InvalidOption: The link hangs on a mimic joint.
    """
    if is_on_branch(chain, link):
        raise InvalidOption(
            f"link {link!r} hangs on a joint that mimics one of the chain: its pose and Jacobian "
            "are known, it collides and is planned for, but nothing can be asked of it here",
            hint=f"Name a link that a joint of the chain carries, such as {chain.tip_link!r}.",
            link=link,
        )


def branch_to(chain: Chain, link: str) -> Branch:
    """The branch to a link that ``is_on_branch``; made once for each body.

    Raises:
        InvalidLinkName: There is no such link.
    """
    body = chain.link(link).joint
    made: dict[int, Branch] = chain.memo.setdefault("branches", {})
    if body not in made:
        made[body] = _branch(chain, body)
    return made[body]


def _branch(chain: Chain, body: int) -> Branch:
    n, way = chain.n, list[int]()
    at = body
    while at >= 0:
        way.append(at)
        at = chain.mimic_joints[at - n].parent if at >= n else at - 1
    way.reverse()
    matrix, shift = np.zeros((len(way), n)), np.zeros(len(way))
    names, types, offsets = [], [], []
    for row, at in enumerate(way):
        if at < n:
            matrix[row, at] = 1.0
            one = (chain.joint_names[at], int(chain.joint_types[at]), chain.offsets[at])
        else:
            mimic = chain.mimic_joints[at - n]
            matrix[row, mimic.leader], shift[row] = mimic.multiplier, mimic.offset
            one = (mimic.name, mimic.joint_type, mimic.T_parent_joint)
        names.append(one[0])
        types.append(one[1])
        offsets.append(one[2])
    own = [link for link in chain.links if link.joint == body]
    links = [Link(link.name, len(way) - 1, link.T_joint_link, link.inertia) for link in own]
    serial = Chain(
        name=chain.name,
        joint_names=tuple(names),
        joint_types=np.array(types),
        offsets=np.array(offsets),
        links=tuple(links),
        base_link=chain.root_link,
        tip_link=links[0].name,
        limits=Limits.unlimited(len(way)),
        continuous=np.zeros(len(way), dtype=np.bool_),
        gravity=chain.gravity,
    )
    return Branch(serial, frozen(matrix), frozen(shift))


@dataclass(frozen=True, slots=True, eq=False)
class BodyTree:
    """Bodies of a chain of n joints, b in all; without mimic joints b = n.

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
        n, mimic_joints = chain.n, chain.mimic_joints
        offsets = [*chain.offsets, *(mimic.T_parent_joint for mimic in mimic_joints)]
        types = [*chain.joint_types, *(mimic.joint_type for mimic in mimic_joints)]
        shares, shifts = np.eye(chain.body_count, n), np.zeros(chain.body_count)
        for k, mimic in enumerate(mimic_joints, start=n):
            shares[k, mimic.leader] = abs(mimic.multiplier)
            shifts[k] = abs(mimic.offset)
        lengths = np.linalg.norm(np.array(offsets)[:, :3, 3], axis=1)
        slides = np.array(types) == JointType.PRISMATIC
        return cls(parents(n, mimic_joints), slides, lengths, shares, shifts)

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
