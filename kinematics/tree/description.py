"""A robot as its file describes it: a tree of links and joints, checked but not yet a chain."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TypeAlias

from kinematics.arrays import Array, Remade, frozen
from kinematics.model.chain import Inertia
from kinematics.pose import from_axis_angle, transform

#: The joint types of URDF; the last two are read but can't be part of a chain.
JOINT_TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")


@dataclass(frozen=True, slots=True)
class BoxGeometry:
    """A box about its centre, with its full ``size`` along x, y, z [m]."""

    size: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class SphereGeometry:
    """A ball about its centre, ``radius`` [m]."""

    radius: float


@dataclass(frozen=True, slots=True)
class CylinderGeometry:
    """A cylinder about its centre, along z, ``radius`` and full ``length`` [m]."""

    radius: float
    length: float


@dataclass(frozen=True, slots=True)
class CapsuleGeometry:
    """A segment of ``length`` along z about its centre, rounded by ``radius`` [m].

    From tip to tip it measures length + 2 radius.
    """

    radius: float
    length: float


@dataclass(frozen=True, slots=True)
class MeshGeometry:
    """A mesh by its ``uri``, as written in the file, scaled along x, y, z.

    A negative scale mirrors: whoever loads the mesh has to turn its faces round.
    """

    uri: str
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0)


Geometry: TypeAlias = (
    BoxGeometry | SphereGeometry | CylinderGeometry | CapsuleGeometry | MeshGeometry
)


@dataclass(frozen=True, slots=True, eq=False)
class CollisionElement:
    """One solid of a link.

    Args:
        T_link_element: The solid's frame in the link's frame, shape (4, 4).
        geometry: Shape of the solid.
    """

    T_link_element: Array
    geometry: Geometry

    def __post_init__(self) -> None:
        object.__setattr__(self, "T_link_element", frozen(self.T_link_element))


@dataclass(frozen=True, slots=True, eq=False)
class LinkDescription:
    """A rigid body.

    Args:
        name: The link's name.
        inertia: Inertia in the link's frame; None where the file gives none.
        collisions: Solids of the link.
        drawn: Whether the file says how it looks.
    """

    name: str
    inertia: Inertia | None = None
    collisions: tuple[CollisionElement, ...] = ()
    drawn: bool = False


@dataclass(frozen=True, slots=True)
class Mimic:
    """Position = multiplier * (position of ``joint``) + offset."""

    joint: str
    multiplier: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class JointDescription:
    """A connection between two links; a limit that is NaN is not given.

    The lower limit of a description may be above its upper one: then `range` is not known.

    Args:
        name: The joint's name.
        type: One of ``JOINT_TYPES``.
        parent: Name of the link it is fastened to.
        child: Name of the link it carries.
        T_parent_joint: The joint's (and child's) frame at position 0, shape (4, 4).
        axis: Unit vector in the joint's frame, shape (3,); x where it means nothing.
        lower: Lowest position [rad or m].
        upper: Highest position [rad or m].
        velocity: Largest speed [rad/s or m/s].
        acceleration: Largest acceleration [rad/s^2 or m/s^2].
        jerk: Largest jerk [rad/s^3 or m/s^3].
        effort: Largest torque or force [N m or N].
        damping: Viscous friction [N m s/rad or N s/m].
        friction: Dry (Coulomb) friction [N m or N].
        mimic: The joint it follows, if it follows one.
        soft_range: Range in which a safety controller holds the joint [rad or m], if there is one.
    """

    name: str
    type: str
    parent: str
    child: str
    T_parent_joint: Array
    axis: Array
    lower: float
    upper: float
    velocity: float
    acceleration: float
    jerk: float
    effort: float
    damping: float = 0.0
    friction: float = 0.0
    mimic: Mimic | None = None
    soft_range: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "T_parent_joint", frozen(self.T_parent_joint))
        object.__setattr__(self, "axis", frozen(self.axis))

    @property
    def moves(self) -> bool:
        """Whether the joint has one degree of freedom of its own or by following another."""
        return self.type in ("revolute", "continuous", "prismatic")

    @property
    def range(self) -> tuple[float, float]:
        """Lowest and highest position [rad or m]; NaN where they contradict each other."""
        return (math.nan, math.nan) if self.lower > self.upper else (self.lower, self.upper)

    def motion(self, position: float) -> Array:
        """T_parent_child at a position [rad or m], shape (4, 4)."""
        if position == 0.0:
            return self.T_parent_joint
        if self.type == "prismatic":
            return self.T_parent_joint @ transform(position=position * self.axis)
        return self.T_parent_joint @ transform(from_axis_angle(self.axis, position))


@dataclass(frozen=True, slots=True, eq=False)
class RobotDescription(Remade):
    """A tree of links and joints, in the order of the file.

    Args:
        name: The robot's name.
        root: Name of the one link that no joint carries.
        links: Links by name.
        joints: Joints by name; each link but the root is the child of exactly one.
        lint: Remarks on what is odd about the file but no fault, one sentence each.
    """

    name: str
    root: str
    links: Mapping[str, LinkDescription]
    joints: Mapping[str, JointDescription]
    lint: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "links", MappingProxyType(dict(self.links)))
        object.__setattr__(self, "joints", MappingProxyType(dict(self.joints)))

    def children(self, link: str) -> tuple[JointDescription, ...]:
        """The joints fastened to ``link``, in the order of the file."""
        return tuple(joint for joint in self.joints.values() if joint.parent == link)

    def leader(self, joint: JointDescription) -> tuple[str, float, float]:
        """The joint at the end of a line of mimics, and q = multiplier q_leader + offset.

        A joint that mimics none leads itself, by 1 and 0.
        """
        multiplier, offset, leader = 1.0, 0.0, joint
        while leader.mimic is not None:
            offset += multiplier * leader.mimic.offset
            multiplier *= leader.mimic.multiplier
            leader = self.joints[leader.mimic.joint]
        return leader.name, multiplier, offset

    def parent_joint(self, link: str) -> JointDescription | None:
        """The joint that carries ``link``; None for the root."""
        return next((joint for joint in self.joints.values() if joint.child == link), None)

    def way_to_root(self, link: str) -> list[JointDescription]:
        """Joints from a link up to the root."""
        path: list[JointDescription] = []
        while (joint := self.parent_joint(link)) is not None:
            path.append(joint)
            link = joint.parent
        return path
