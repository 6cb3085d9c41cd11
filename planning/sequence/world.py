"""The world between stages: what the robot holds, where the objects stand, what may touch."""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.pose import inverse
from obstacles.attachment import Attachment, hold
from obstacles.checker import Checker
from obstacles.robot_geometry import RobotGeometry
from obstacles.scene import Obstacle, Scene
from planning.sequence.stage import Load, Pair

_NO_PAIRS: frozenset[Pair] = frozenset()


@dataclass(frozen=True, slots=True, eq=False)
class Held:
    """An object that the robot holds.

    Args:
        attachment: The object in the frame of the link that holds it.
        load: Its mass; None where it weighs nothing.
    """

    attachment: Attachment
    load: Load | None = None

    @property
    def name(self) -> str:
        """Name of the object."""
        return self.attachment.held.id


class Contact(NamedTuple):
    """A pose of the tool relative to an object that a target named, exact to the last bit.

    Args:
        object: Name of the object.
        T: T_object_tool of a grasp, or T_root_object of a place, shape (4, 4).
        support: What the object stands on, if that was named.
    """

    object: str
    T: Array
    support: str | None = None


@dataclass(frozen=True, slots=True, eq=False)
class World:
    """The robot, what it holds and its surroundings between two stages.

    Args:
        robot: The robot alone, its gripper as it is.
        scene: The objects that are not held; those in ``held`` are not among them.
        held: What the robot holds.
        touching: Pairs of a link and an object not held that may touch until a free motion begins.
        supported: Pairs of a held object and what it stands on that may touch until the next
            straight motion ends.
        grasped: The grasp that the tool is at.
        placed: The place that the held object is at.
    """

    robot: RobotGeometry
    scene: Scene
    held: tuple[Held, ...] = ()
    touching: frozenset[Pair] = _NO_PAIRS
    supported: frozenset[Pair] = _NO_PAIRS
    grasped: Contact | None = None
    placed: Contact | None = None
    key: tuple[object, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        held = tuple((item.name, item.attachment.held.T_world_obstacle.tobytes(),
                      item.attachment.touches) for item in self.held)  # fmt: skip
        marks = tuple(
            None if mark is None else (mark.object, mark.T.tobytes(), mark.support)
            for mark in (self.grasped, self.placed)
        )
        key = (self.robot.content_hash, self.scene.content_hash, held, self.touching)
        object.__setattr__(self, "key", (*key, self.supported, *marks))

    def holds(self, name: str) -> Held:
        """The held object of a name that is known to be held."""
        return next(item for item in self.held if item.name == name)

    # ------------------------------------------------------------------------- after a stage

    def after_grasp(self, contact: Contact, touches: Iterable[str]) -> "World":
        """The world when the tool is at a grasp."""
        pairs = {sorted_pair(link, contact.object) for link in touches}
        return replace(self, touching=self.touching | pairs, grasped=contact, placed=None)

    def after_place(self, contact: Contact) -> "World":
        """The world when a held object is at its place."""
        pairs = set() if contact.support is None else {(contact.object, contact.support)}
        supported = self.supported | {sorted_pair(*pair) for pair in pairs}
        return replace(self, supported=supported, placed=contact, grasped=None)

    def after_attach(
        self, name: str, link: str | None, touches: tuple[str, ...], load: Load | None, q: Array
    ) -> "World":
        """The world when an object has become a part of the robot.

        Args:
            name: The object.
            link: The link that holds it; None for the tip.
            touches: Names that it may touch.
            load: Its mass.
            q: Where the arm stands, shape (n,).
        """
        stands = self.scene.obstacle(name)
        holder = link or self.robot.chain.tip_link
        links = tuple(a if b == name else b for a, b in sorted(self.touching) if name in (a, b))
        T = self._T_link_object(stands, holder, q)
        attachment = Attachment(
            Obstacle(name, stands.shape, T), holder, tuple(dict.fromkeys((*links, *touches)))
        )
        support = None
        if self.grasped is not None and self.grasped.object == name:
            support = self.grasped.support
        pairs = set() if support is None else {sorted_pair(name, support)}
        left = tuple(o for o in self.scene.obstacles if o.id != name)
        return replace(
            self,
            scene=replace(self.scene, obstacles=left),
            held=(*self.held, Held(attachment, load)),
            touching=frozenset(pair for pair in self.touching if name not in pair),
            supported=self.supported | pairs,
            grasped=None,
        )

    def after_detach(self, name: str, touches: tuple[str, ...], q: Array) -> "World":
        """The world when a held object has become an obstacle, where it is.

        Args:
            name: The object.
            touches: Links that may touch it until a free motion begins.
            q: Where the arm stands, shape (n,).
        """
        item = self.holds(name)
        held = item.attachment.held
        if self.placed is not None and self.placed.object == name:
            T = self.placed.T
        else:
            T = forward(self.robot.chain, q, item.attachment.link) @ held.T_world_obstacle
        links = [*item.attachment.touches, *touches]
        pairs = {sorted_pair(x, name) for x in links if x in self.robot.chain.index}
        put = Obstacle(name, held.shape, T)
        return replace(
            self,
            scene=replace(self.scene, obstacles=(*self.scene.obstacles, put)),
            held=tuple(other for other in self.held if other is not item),
            touching=self.touching | pairs,
            supported=frozenset(pair for pair in self.supported if name not in pair),
            placed=None,
        )

    def after_motion(self, *, free: bool) -> "World":
        """The world when the tool has left where it was.

        Args:
            free: Whether the motion was free, not straight.
        """
        if not (self.touching or self.supported or self.grasped or self.placed):
            return self
        touching = _NO_PAIRS if free else self.touching
        return replace(self, touching=touching, supported=_NO_PAIRS, grasped=None, placed=None)

    def with_robot(self, robot: RobotGeometry) -> "World":
        """The world with the gripper of the robot in another state."""
        return replace(self, robot=robot)

    def _T_link_object(self, stands: Obstacle, link: str, q: Array) -> Array:
        chain = self.robot.chain
        T_object_tool = None
        if self.grasped is not None and self.grasped.object == stands.id:
            T_object_tool = self.grasped.T
        holder, tip = chain.link(link), chain.link(chain.tip_link)
        if T_object_tool is None or holder.joint != tip.joint:
            return np.asarray(inverse(forward(chain, q, link)) @ stands.T_world_obstacle)
        T_link_tool = inverse(holder.T_joint_link) @ tip.T_joint_link
        return np.asarray(T_link_tool @ inverse(T_object_tool))

    def T_tool_object(self, name: str) -> Array:
        """Pose of a held object in the frame of the tool, shape (4, 4)."""
        chain, attachment = self.robot.chain, self.holds(name).attachment
        holder, tip = chain.link(attachment.link), chain.link(chain.tip_link)
        T_tool_link = inverse(tip.T_joint_link) @ holder.T_joint_link
        return np.asarray(T_tool_link @ attachment.held.T_world_obstacle)


class Cell(NamedTuple):
    """The robot with what it holds in its surroundings, for one stage.

    Args:
        robot: Held objects are among its pieces, their masses among its links.
        scene: The objects not held, with the pairs that may touch.
        checker: Of both, with the margin of the stage.
    """

    robot: RobotGeometry
    scene: Scene
    checker: Checker


class Cells:
    """Cells by world, pairs that may touch and margin, each put together once."""

    def __init__(self) -> None:
        self._cells: dict[object, Cell] = {}

    def cell(self, world: World, allowed: Iterable[Pair] = (), margin: float = 0.0) -> Cell:
        """The cell of a world.

        Args:
            world: The robot and its surroundings.
            allowed: Pairs that may touch beside those of the world.
            margin: Distance to keep from obstacles [m].

        Raises:
            InvalidObjectName: A name in ``allowed`` is unknown.
            InvalidLinkName: A name that a held object may touch is unknown.
        """
        pairs = frozenset(sorted_pair(*pair) for pair in allowed)
        key = (*world.key[:5], pairs, margin)
        cell = self._cells.get(key)
        if cell is None:
            cell = self._cells[key] = _put_together(world, pairs, margin)
        return cell


def _put_together(world: World, allowed: frozenset[Pair], margin: float) -> Cell:
    pairs = allowed | world.touching | world.supported
    holding = hold(world.robot, world.scene, [item.attachment for item in world.held], pairs)
    robot = holding.robot
    chain = robot.chain
    for item in world.held:
        if item.load is not None:
            held = item.attachment
            chain = item.load.added_to(chain, held.link, held.held.T_world_obstacle)
    if chain is not robot.chain:
        robot = replace(robot, chain=chain)
    return Cell(robot, holding.scene, Checker.of(robot, holding.scene, margin))


def sorted_pair(a: str, b: str) -> Pair:
    """A pair of names in their order."""
    return (a, b) if a < b else (b, a)
