"""The serial chain: the one description of a robot that every evaluator reads.

Every joint is normalised to turn about, or slide along, the z axis of its own frame; the
fixed transforms between the joints carry everything else. With A_i the fixed offset and
M_i(q_i) the motion of joint i,

    T_root_i(q) = A_1 M_1(q_1) A_2 M_2(q_2) ... A_i M_i(q_i).

Mimic joints: joints off a chain whose position is that of a joint of it, scaled and shifted.

The rods of a parallelogram, a cover that turns back as its arm turns: with j the joint that leads,

    q = m q_j + b,      T_root_k = T_root_parent A_k M_k(q).

They add no degree of freedom, but a body each. Bodies are numbered: -1 stands still, body i < n is
what joint i of the chain carries, and body n + k what mimic joint k does.
"""

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from enum import IntEnum
from math import isfinite
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinematics.arrays import Array, Indices, Remade, frozen
from kinematics.errors import InvalidLinkName, InvalidRobotState, MissingLimit


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


#: Chains longer than this are refused: no arm has so many joints, a bomb may.
MAX_JOINTS = 64


class JointType(IntEnum):
    """Type of a joint: it turns about its z axis or slides along it."""

    REVOLUTE = 0
    PRISMATIC = 1


@dataclass(frozen=True, slots=True, eq=False)
class Limits:
    """Joint limits, each of shape (n,); NaN says "not given", +-inf "none".

    Args:
        lower: Lowest position [rad or m].
        upper: Highest position [rad or m].
        velocity: Largest speed [rad/s or m/s].
        acceleration: Largest acceleration [rad/s^2 or m/s^2].
        jerk: Largest jerk [rad/s^3 or m/s^3].
        effort: Largest torque or force [N m or N].
    """

    lower: Array
    upper: Array
    velocity: Array
    acceleration: Array
    jerk: Array
    effort: Array

    def __post_init__(self) -> None:
        for item in fields(self):
            object.__setattr__(self, item.name, frozen(getattr(self, item.name)))

    @classmethod
    def unlimited(cls, n: int) -> "Limits":
        """Positions without bounds, all else not given, for ``n`` joints."""
        missing = np.full(n, np.nan)
        return cls(np.full(n, -np.inf), np.full(n, np.inf), missing, missing, missing, missing)

    def require(self, quantity: str, joint_names: Sequence[str]) -> Array:
        """The limits of one quantity, shape (n,), all of them given.

        Raises:
            MissingLimit: Some joint has none; the message names them all.
        """
        values: Array = getattr(self, quantity)
        missing = [joint_names[int(i)] for i in np.flatnonzero(np.isnan(values))]
        if missing:
            raise MissingLimit(
                f"no {quantity} limit is known for joint(s) {', '.join(missing)}",
                hint=_limit_hint(quantity, missing[0]),
                quantity=quantity,
                joints=missing,
            )
        return values


def _limit_hint(quantity: str, joint: str) -> str:
    """Hint for a limit that is missing; no rule makes a velocity."""
    rule = {"acceleration": "10 x velocity", "jerk": "10 x acceleration"}.get(quantity)
    hint = (
        "Give it when the robot is created, or change the robot: "
        f'"joint_limits": {{"{joint}": {{"{quantity}": ...}}}}, with "*" for all joints'
    )
    return hint + (f', or "default_limits": {{"{quantity}": "{rule}"}}.' if rule else ".")


@dataclass(frozen=True, slots=True, eq=False)
class Inertia:
    """Mass properties of a rigid body.

    Args:
        mass: [kg].
        center_of_mass: Centre of mass in the body's frame, shape (3,) [m].
        tensor: Tensor about the centre of mass, in the body's axes, shape (3, 3) [kg m^2].
    """

    mass: float
    center_of_mass: Array
    tensor: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "center_of_mass", frozen(self.center_of_mass))
        object.__setattr__(self, "tensor", frozen(self.tensor))

    @classmethod
    def merged(cls, parts: Sequence[tuple["Inertia", Array]]) -> "Inertia":
        """Mass properties of several bodies as of one, each with its pose (4, 4)."""
        if not parts:
            return cls(0.0, np.zeros(3), np.zeros((3, 3)))
        masses = np.array([body.mass for body, _ in parts])
        mass = float(masses.sum())
        # Bodies without mass (rotors given as inertia alone) have their centre where they say.
        weights = masses / mass if mass > 0.0 else np.full(len(parts), 1.0 / len(parts))
        centers = np.array([T[:3, :3] @ body.center_of_mass + T[:3, 3] for body, T in parts])
        center, tensors = weights @ centers, []
        for (body, T), c in zip(parts, centers, strict=True):
            # Parallel axis theorem: + m (|d|^2 I - d d^T).
            d = c - center
            about = body.mass * (d @ d * np.eye(3) - np.outer(d, d))
            tensors.append(T[:3, :3] @ body.tensor @ T[:3, :3].T + about)
        return cls(mass, center, np.sum(tensors, axis=0))


@dataclass(frozen=True, slots=True, eq=False)
class Link:
    """A named frame that moves with one joint of the chain.

    Args:
        name: The link's name.
        joint: The body it is part of: the index of the joint that carries it, -1 for what stands
            still, n + k for what mimic joint k of the chain carries.
        T_joint_link: The link's frame in that joint's frame, shape (4, 4).
        inertia: Mass properties in the link's frame; None where the description has none.
    """

    name: str
    joint: int
    T_joint_link: Array
    inertia: Inertia | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "T_joint_link", frozen(self.T_joint_link))


@dataclass(frozen=True, slots=True, eq=False)
class Chain(Remade):
    """A serial robot arm as a handful of arrays (n joints, in order from base to tip).

    Args:
        name: The robot's name.
        joint_names: n names.
        joint_types: n values of ``JointType``, shape (n,).
        offsets: A_i, frame of joint i at q_i = 0 in the frame of joint i-1, of the first one in
            the root frame, shape (n, 4, 4).
        links: Every link of the robot, side branches at their held values included.
        base_link: Name of the link that the chain begins at.
        tip_link: Name of the link that goals are for.
        limits: Joint limits.
        continuous: True where a revolute joint turns without end, shape (n,).
        gravity: Gravity in the root frame, shape (3,) [m/s^2].
        motor_inertia: Reflected at each joint, shape (n,) [kg m^2 or kg].
        viscous_friction: Viscous friction at each joint, shape (n,) [N m s/rad or N s/m].
        coulomb_friction: Dry friction at each joint, shape (n,) [N m or N].
        dh_convention: "standard" or "modified" where links link_1 ... link_n are the frames of a
            Denavit-Hartenberg table that the chain was built from; None for other chains.
        root_link: Name of the link whose frame all poses are in; the base link where empty.
        root_aliases: Other names of that frame, as fixed virtual joints of an SRDF give them.
        mimic_joints: Joints off the chain that mimic one of it (``kinematics.model.chain``).

    Also known: ``n``, the number of joints; ``body_count``, that of bodies that move, one for each
    joint and mimic joint; ``index``, where each link stands in ``links``; ``model``, all that
    forward kinematics reads in one array (1 + n + len(links) + 2 len(mimic_joints), 14): n and
    the tip's number, then a joint's type and offset or a link's joint and frame in a row,
    frames by their upper three rows, and last the links' numbers in the order of their joints;
    where there are mimic joints, their number and first row behind n and the tip, and two rows
    for each: type, frame and parent, then leader, multiplier and offset; ``content_hash``;
    ``memo``, where what was made of a chain last can wait for the next call: finding it by hash
    costs more than a frame.
    """

    name: str
    joint_names: tuple[str, ...]
    joint_types: Indices
    offsets: Array
    links: tuple[Link, ...]
    base_link: str
    tip_link: str
    limits: Limits
    continuous: NDArray[np.bool_]
    gravity: Array = field(default_factory=lambda: np.array([0.0, 0.0, -9.81]))
    motor_inertia: Array = field(default_factory=lambda: np.zeros(0))
    viscous_friction: Array = field(default_factory=lambda: np.zeros(0))
    coulomb_friction: Array = field(default_factory=lambda: np.zeros(0))
    dh_convention: str | None = None
    root_link: str = ""
    root_aliases: tuple[str, ...] = ()
    mimic_joints: tuple[MimicJoint, ...] = ()
    n: int = field(init=False, repr=False)
    body_count: int = field(init=False, repr=False)
    index: Mapping[str, int] = field(init=False, repr=False)
    model: Array = field(init=False, repr=False)
    content_hash: str = field(init=False, repr=False)
    memo: dict[str, Any] = field(init=False, repr=False, default_factory=dict)

    def __post_init__(self) -> None:
        n = len(self.joint_names)
        object.__setattr__(self, "n", n)
        object.__setattr__(self, "body_count", n + len(self.mimic_joints))
        types = np.array(self.joint_types, dtype=np.int64)
        types.setflags(write=False)
        continuous = np.array(self.continuous, dtype=np.bool_)
        continuous.setflags(write=False)
        object.__setattr__(self, "joint_types", types)
        object.__setattr__(self, "continuous", continuous)
        for name in ("offsets", "gravity", "motor_inertia", "viscous_friction", "coulomb_friction"):
            value = getattr(self, name)
            object.__setattr__(self, name, frozen(value if np.size(value) else np.zeros(n)))
        object.__setattr__(self, "root_link", self.root_link or self.base_link)
        by_name = {link.name: i for i, link in enumerate(self.links)}
        object.__setattr__(self, "index", MappingProxyType(by_name))
        if self.tip_link in by_name and self.links[by_name[self.tip_link]].joint >= n:
            raise InvalidLinkName(
                f"{self.tip_link!r} can't be the tip: it hangs on a joint that mimics another",
                hint="Name a link that joints of the chain carry.",
                link=self.tip_link,
            )
        object.__setattr__(self, "model", _model(self))
        object.__setattr__(self, "content_hash", _content_hash(self))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Chain) and other.content_hash == self.content_hash

    def __hash__(self) -> int:
        return hash(self.content_hash)

    def joint_of(self, body: int) -> str:
        """Name of the joint that moves a body, one of the chain's or a mimic joint."""
        if body < len(self.joint_names):
            return self.joint_names[body]
        return self.mimic_joints[body - len(self.joint_names)].name

    @property
    def tip(self) -> Link:
        """The link that goals are for."""
        return self.links[self.index[self.tip_link]]

    def link(self, name: str) -> Link:
        """The link called ``name``.

        Raises:
            InvalidLinkName: There is none; the message lists those there are.
        """
        if name not in self.index:
            raise InvalidLinkName(
                f"robot {self.name!r} has no link {name!r}",
                hint=f"Its links are: {', '.join(self.index)}.",
                link=name,
                links=list(self.index),
            )
        return self.links[self.index[name]]

    def configuration(self, q: ArrayLike, name: str = "joints") -> Array:
        """Check one joint vector (n,) or a batch (..., n) and answer it as a float64 array.

        Raises:
            InvalidRobotState: The last dimension is not n, or a value is not finite.
        """
        try:
            array = np.array(q, dtype=np.float64, order="C")
        except (TypeError, ValueError):
            raise InvalidRobotState(
                f"{name} is not an array of numbers with rows of equal length",
                hint=f"Give {self.n} numbers, one for each joint of {self.name!r}, or rows of "
                "them.",
            ) from None
        if array.ndim == 0 or array.shape[-1] != self.n:
            raise InvalidRobotState(
                f"{name} has {array.shape[-1] if array.ndim else 'no'} value(s), "
                f"robot {self.name!r} has {self.n} joints",
                hint=f"The order is: {', '.join(self.joint_names)}.",
                joint_names=list(self.joint_names),
            )
        # Of one vector Python is quicker than numpy is at a call.
        few = array.ndim == 1
        if not (all(map(isfinite, array.tolist())) if few else np.isfinite(array).all()):
            bad = self.joint_names[int(np.argwhere(~np.isfinite(array))[0][-1])]
            raise InvalidRobotState(f"{name} is not finite at joint {bad!r}", joint=bad)
        return array

    def state(self, q: ArrayLike, name: str = "joints") -> Array:
        """Check one joint vector (n,) and answer it as ``configuration`` does.

        Raises:
            InvalidRobotState: Wrong length, not finite, or several configurations.
        """
        array = self.configuration(q, name)
        if array.ndim != 1:
            raise InvalidRobotState(
                f"{name} has the shape {array.shape}, one configuration of robot {self.name!r} has "
                f"({self.n},)",
                hint="Give one configuration.",
            )
        return array

    def each_joint(self, value: ArrayLike, name: str) -> Array:
        """Check one number for all joints or one for each, and answer it for each, (n,).

        Raises:
            InvalidRobotState: It is a batch, of another length, or not finite.
        """
        return self.state(np.full(self.n, value) if np.ndim(value) == 0 else value, name)

    def sampling_bounds(self) -> tuple[Array, Array]:
        """Bounds to draw joints from, both (n,): the limits, or one turn where there are none.

        The turn is that from -pi to pi; where the one limit of a joint lies beyond it, the turn
        next to that limit.
        """
        lower, upper = self.limits.lower, self.limits.upper
        below = np.where(upper <= -np.pi, upper - 2.0 * np.pi, -np.pi)
        above = np.where(lower >= np.pi, lower + 2.0 * np.pi, np.pi)
        return np.where(np.isfinite(lower), lower, below), np.where(
            np.isfinite(upper), upper, above
        )


def _model(chain: Chain) -> Array:
    order = np.argsort([link.joint for link in chain.links], kind="stable")
    joints = zip(chain.joint_types, chain.offsets, strict=True)
    rows = [(chain.n, chain.index.get(chain.tip_link, -1), *[0.0] * 12)]
    rows += [(kind, *A[:3].flat, 0.0) for kind, A in joints]
    rows += [
        (link.joint, *link.T_joint_link[:3].flat, k)
        for link, k in zip(chain.links, order, strict=True)
    ]
    if chain.mimic_joints:
        rows[0] = (*rows[0][:2], len(chain.mimic_joints), len(rows), *[0.0] * 10)
    for each in chain.mimic_joints:
        rows.append((each.joint_type, *each.T_parent_joint[:3].flat, each.parent))
        rows.append((each.leader, each.multiplier, each.offset, *[0.0] * 11))
    return frozen(rows)


def with_frames(chain: Chain, frames: Iterable[tuple[str, str, Array]]) -> Chain:
    """Chain with more frames as links, such as those of what the robot holds.

    Args:
        chain: The robot.
        frames: For each its name, the link that carries it, and T_link_frame, shape (4, 4).

    Raises:
        InvalidLinkName: There is no such link, or a name is a link's already.
    """
    taken, added = set(chain.index), []
    for name, link, T_link_frame in frames:
        carrier = chain.link(link)
        if name in taken:
            raise InvalidLinkName(
                f"{name!r} is a link of robot {chain.name!r} already, and nothing else",
                hint="Give it a name of its own.",
                link=name,
            )
        taken.add(name)
        added.append(Link(name, carrier.joint, carrier.T_joint_link @ T_link_frame))
    return replace(chain, links=(*chain.links, *added)) if added else chain


def _content_hash(chain: Chain) -> str:
    digest = hashlib.sha256()
    source = () if chain.dh_convention is None else (chain.dh_convention,)
    root = () if chain.root_link == chain.base_link else ("root", chain.root_link)
    source = (*source, *root, *chain.root_aliases)
    for text in (chain.name, *chain.joint_names, chain.base_link, chain.tip_link, *source):
        digest.update(text.encode() + b"\0")
    arrays = [chain.joint_types, chain.continuous, chain.offsets, chain.gravity]
    arrays += [chain.motor_inertia, chain.viscous_friction]
    if chain.coulomb_friction.any():
        arrays.append(chain.coulomb_friction)
    arrays += [getattr(chain.limits, item.name) for item in fields(chain.limits)]
    for array in arrays:
        digest.update(np.ascontiguousarray(array).tobytes())
    for each in chain.mimic_joints:
        digest.update(each.text().encode() + each.T_parent_joint.tobytes())
    for link in chain.links:
        digest.update(f"{link.name}\0{link.joint}\0".encode() + link.T_joint_link.tobytes())
        if link.inertia is not None:
            digest.update(np.float64(link.inertia.mass).tobytes())
            digest.update(link.inertia.center_of_mass.tobytes() + link.inertia.tensor.tobytes())
    return digest.hexdigest()


def stack_vectors(chain: Chain, **vectors: ArrayLike) -> tuple[Array, tuple[int, ...]]:
    """Check joint vectors, each (n,) or (..., n), and stack them.

    Returns:
        Shape (m, k, n) for the k vectors in their order and m the size of the batch, and the
        leading dimensions of the batch.

    Raises:
        InvalidRobotState: A vector has the wrong length, is not finite or fits no other's batch.
    """
    checked = [chain.configuration(value, name) for name, value in vectors.items()]
    lead = checked[0].shape[:-1]
    if any(value.shape[:-1] != lead for value in checked):
        lead = _common_lead(vectors, checked)
    stack = np.empty((*lead, len(checked), chain.n))
    for i, value in enumerate(checked):
        stack[..., i, :] = value
    return stack.reshape(-1, len(checked), chain.n), lead


def _common_lead(names: Iterable[str], arrays: Sequence[Array]) -> tuple[int, ...]:
    try:
        return np.broadcast_shapes(*(array.shape[:-1] for array in arrays))
    except ValueError:
        shapes = ", ".join(
            f"{name} {array.shape}" for name, array in zip(names, arrays, strict=True)
        )
        raise InvalidRobotState(
            f"the batches do not fit each other: {shapes}",
            hint="Give every one the same leading dimensions, or a single vector.",
        ) from None
