"""The world between stages: what the robot holds, where the objects stand, what may touch."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from kinematics.arrays import Array
from kinematics.caches.bounded_cache import bounded_cache
from kinematics.forward import forward
from kinematics.model.chain import Chain, with_frames
from kinematics.pose import inverse
from obstacles.collision.checker import Checker
from obstacles.projection.projection import project
from obstacles.robots.allowed_pairs import TOUCH_DEPTH, contacts_of
from obstacles.robots.attachment import Attachment, hold
from obstacles.robots.finger_geometry import moved_links, swept_cover, with_fingers
from obstacles.robots.robot_geometry import RobotGeometry, sorted_pair
from obstacles.robots.tool import PART, with_tip
from obstacles.scenes.scene import AllowedContact, Obstacle, Scene
from planning.sequence.stage import Into, Load, Pair, StageSettings


@dataclass(frozen=True, slots=True, eq=False)
class Held:
    """An object that the robot holds.

    Args:
        attachment: The object in the frame of the link that holds it.
        load: Mass and inertia; None where it weighs nothing.
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
        support: Names of the objects under it, where that was named.
        touch_depth: How deep it may be in that [m].
    """

    object: str
    T: Array
    support: tuple[str, ...] = ()
    touch_depth: float = TOUCH_DEPTH

    @property
    def supported(self) -> dict[Pair, AllowedContact]:
        """Pairs of the object and what it stands on."""
        contact = AllowedContact("support", self.touch_depth)
        return {sorted_pair(self.object, name): contact for name in self.support}


@dataclass(frozen=True, slots=True, eq=False)
class World:
    """The robot, what it holds and its surroundings between two stages.

    Args:
        robot: The robot alone, its gripper as it is.
        scene: The objects that are not held; those in ``held`` are not among them.
        held: Objects that the robot holds.
        touching: Pairs of a link and an object not held that may touch until a free motion begins.
        supported: Pairs of a held object and what it stands on that may touch until the next
            straight motion ends.
        grasped: The grasp that the tool is at.
        placed: The place that the held object is at.
    """

    robot: RobotGeometry
    scene: Scene
    held: tuple[Held, ...] = ()
    touching: Mapping[Pair, AllowedContact] = field(default_factory=dict)
    supported: Mapping[Pair, AllowedContact] = field(default_factory=dict)
    grasped: Contact | None = None
    placed: Contact | None = None
    key: tuple[object, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        held = tuple((item.name, item.attachment.held.T_world_obstacle.tobytes(),
                      item.attachment.touches, item.attachment.touch_depth)
                     for item in self.held)  # fmt: skip
        marks = tuple(
            None if mark is None else (mark.object, mark.T.tobytes(), *mark[2:])
            for mark in (self.grasped, self.placed)
        )
        pairs = frozenset(self.touching.items()), frozenset(self.supported.items())
        key = (self.robot.content_hash, self.scene.content_hash, held, *pairs)
        object.__setattr__(self, "key", (*key, *marks))

    def holds(self, name: str) -> Held:
        """The held object of a name that is known to be held."""
        return next(item for item in self.held if item.name == name)

    # ------------------------------------------------------------------------- after a stage

    def after_grasp(self, contact: Contact, touching: Mapping[Pair, AllowedContact]) -> "World":
        """The world when the tool is at a grasp, where some pairs may touch from now on."""
        return replace(self, touching={**self.touching, **touching}, grasped=contact, placed=None)

    def after_place(self, contact: Contact) -> "World":
        """The world when a held object is at its place."""
        supported = {**self.supported, **contact.supported}
        return replace(self, supported=supported, placed=contact, grasped=None)

    def after_attach(
        self,
        name: str,
        link: str | None,
        touching: tuple[tuple[str, ...], float],
        load: Load | None,
        q: Array,
    ) -> "World":
        """The world when an object has become a part of the robot.

        Args:
            name: The object.
            link: The link that holds it; None for the tip.
            touching: Names that it may touch, and how deep [m].
            load: Mass and inertia.
            q: Configuration of the arm, shape (n,).
        """
        stands = self.scene.obstacle(name)
        holder = link or self.robot.chain.tip_link
        links = tuple(a if b == name else b for a, b in sorted(self.touching) if name in (a, b))
        # Of the depths of its grasp and its own, the larger one holds.
        depths = [self.touching[sorted_pair(link, name)].touch_depth for link in links]
        depths += touching[1:] if touching[0] or not depths else ()
        T = self._T_link_object(stands, holder, q)
        attachment = Attachment(
            Obstacle(name, stands.shape, T), holder,
            tuple(dict.fromkeys((*links, *touching[0]))), max(depths),
        )  # fmt: skip
        grasped = self.grasped is not None and self.grasped.object == name
        pairs = self.grasped.supported if self.grasped is not None and grasped else {}
        left = tuple(o for o in self.scene.obstacles if o.id != name)
        return replace(
            self,
            scene=replace(self.scene, obstacles=left),
            held=(*self.held, Held(attachment, load)),
            touching=_without(self.touching, name),
            supported={**self.supported, **pairs},
            grasped=None,
        )

    def after_detach(self, name: str, touching: tuple[tuple[str, ...], float], q: Array) -> "World":
        """The world when a held object has become an obstacle, where it is.

        Args:
            name: The object.
            touching: Links that may touch it until a free motion begins, and how deep [m].
            q: Configuration of the arm, shape (n,).
        """
        item = self.holds(name)
        held = item.attachment.held
        if self.placed is not None and self.placed.object == name:
            T = self.placed.T
        else:
            T = forward(self.robot.chain, q, item.attachment.link) @ held.T_world_obstacle
        held_by = dict.fromkeys(item.attachment.touches, item.attachment.touch_depth)
        depths = {**dict.fromkeys(*touching), **held_by}
        pairs = {
            sorted_pair(link, name): AllowedContact("touch_links", depth)
            for link, depth in depths.items()
            if link in self.robot.chain.index
        }
        put = Obstacle(name, held.shape, T)
        return replace(
            self,
            scene=replace(self.scene, obstacles=(*self.scene.obstacles, put)),
            held=tuple(other for other in self.held if other is not item),
            touching={**self.touching, **pairs},
            supported=_without(self.supported, name),
            placed=None,
        )

    def after_motion(self, *, free: bool) -> "World":
        """The world when the tool has left where it was.

        Args:
            free: Whether the motion was free, not straight.
        """
        if not (self.touching or self.supported or self.grasped or self.placed):
            return self
        touching = {} if free else self.touching
        return replace(self, touching=touching, supported={}, grasped=None, placed=None)

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

    def after_insert(self, into: Into) -> "World":
        """The world when what is held was pushed into something, which it may touch from now on."""
        contact, names = AllowedContact("into", into.touch_depth), into.names
        pairs = {sorted_pair(item.name, name): contact for item in self.held for name in names}
        return replace(self, supported={**self.supported, **pairs})

    def entered(self, settings: StageSettings) -> "World":
        """The world when the robot has the tool and tip of a stage.

        Another tool stands as it is mounted. A tip of what is not held is not there yet.

        Args:
            settings: Settings of the stage.
        """
        robot, tip, leads = settings.robot, settings.tip, self.robot.chain.tip_link
        if robot is None:
            return self
        if robot.chain.tip_link != leads and robot.fingers.positions:
            own = self.robot.fingers.positions
            stands = {name: own.get(name, at) for name, at in robot.fingers.positions.items()}
            robot = with_fingers(robot, stands)
        if tip is not None and any(item.name == tip.object for item in self.held):
            held = self.holds(tip.object).attachment
            place = held.link, (held.held.T_world_obstacle @ tip.T_object_tip).tobytes()
            robot = _led_by(robot, f"{tip.object}{PART}tip", *place)
        now, before = robot.chain.tip, self.robot.chain.tip
        if now.name == leads and np.array_equal(now.T_joint_link, before.T_joint_link):
            return self
        return replace(self, robot=robot, grasped=None)

    def direction(self, along: Array, frame: str, of: str | None, T_tool: Array) -> Array:
        """The direction of a straight motion in the root frame, shape (3,).

        Args:
            along: Direction in its frame, shape (3,).
            frame: Its frame, or "normal" for the outward normal nearest to the tip.
            of: Object whose frame or surface is meant.
            T_tool: Pose of the tool, shape (4, 4).
        """
        if frame == "tool":
            return np.asarray(T_tool[:3, :3] @ along)
        if frame == "root" or of is None:
            return np.array(along)
        if any(item.name == of for item in self.held):
            held = self.holds(of).attachment.held
            stands = replace(held, T_world_obstacle=T_tool @ self.T_tool_object(of))
        else:
            stands = self.scene.obstacle(of)
        if frame != "normal":
            return np.asarray(stands.T_world_obstacle[:3, :3] @ along)
        # Where the tip is on the surface, a point so far before it tells the side [m].
        for back in (0.0, 1e-4):
            tip = T_tool[:3, 3] - back * T_tool[:3, 2]
            nearest, distance = (x[0, 0] for x in project(tip[None], (stands,)))
            outward = (tip - nearest) * np.sign(distance)
            length = float(np.linalg.norm(outward))
            if length > 1e-9:
                break
        else:
            return np.asarray(-np.sign(along[2]) * T_tool[:3, 2])
        return np.asarray(np.sign(along[2]) * outward / length)

    def T_tool_object(self, name: str) -> Array:
        """Pose of a held object in the frame of the tool, shape (4, 4)."""
        chain, attachment = self.robot.chain, self.holds(name).attachment
        holder, tip = chain.link(attachment.link), chain.link(chain.tip_link)
        T_tool_link = inverse(tip.T_joint_link) @ holder.T_joint_link
        return np.asarray(T_tool_link @ attachment.held.T_world_obstacle)


@bounded_cache(maxsize=64)
def _led_by(robot: RobotGeometry, name: str, link: str, T_link_tip: bytes) -> RobotGeometry:
    """The robot with a tip of what it holds."""
    return with_tip(robot, name, link, np.frombuffer(T_link_tip).reshape(4, 4))


#: Fingers this near to an object touch it; of two that hold it one may be so far away [m].
_TOUCHING, _GAP = 1e-6, 1e-3
#: Steps towards a contact: fingers that slide take two, those of a linkage some dozen.
_MOST_STEPS = 200
#: Fingers that hold something between them.
_HOLDING = 2


# The same few grasps come again with every combination of choices.
@bounded_cache(maxsize=256)
def contact_positions(
    robot: RobotGeometry,
    stands: Obstacle,
    T_object_tool: bytes,
    last: tuple[tuple[str, float], ...],
) -> dict[str, float] | str:
    """Positions at which closing fingers first touch an object; or why they do not hold it.

    By conservative advancement: no point of a finger goes farther than a bound on the whole way, so
    the share of the way that their distance takes at least is free.

    Args:
        robot: The robot alone, its fingers where they begin to close.
        stands: The object.
        T_object_tool: Pose of the tool in its frame, the bytes of 16 numbers.
        last: Positions of all that lead at the end of the way [rad or m].
    """
    first, end = dict(robot.fingers.positions), dict(last)
    moved = moved_links(robot, frozenset(name for name in first if first[name] != end[name]))
    links = [name for name in robot.names if name in moved]
    if not links:
        return "no finger with solids moves"
    chain, q = robot.chain, np.zeros(robot.chain.n)
    T = forward(chain, q) @ inverse(np.frombuffer(T_object_tool).reshape(4, 4))
    scene = Scene((Obstacle(stands.id, stands.shape, T),))
    way = 2.0 * swept_cover(robot, first, end, (0.0, 1.0))[1]
    share = 0.0
    for _ in range(_MOST_STEPS):
        at = {name: first[name] + share * (end[name] - first[name]) for name in first}
        closed = with_fingers(robot, at)
        gap = _distance(closed, links, scene, q)
        if gap <= _TOUCHING or share == 1.0:
            break
        share = min(share + gap / way, 1.0)
    if gap > _TOUCHING:
        return f"the fingers close without touching {stands.id!r}: {gap:.3g} m are left"
    if share == 0.0:
        return f"the fingers touch {stands.id!r} before they close"
    gaps = {link: _distance(closed, [link], scene, q) for link in links}
    near = sorted(gaps, key=lambda link: gaps[link])[:_HOLDING]
    if len(near) == _HOLDING and gaps[near[1]] > _GAP:
        return (
            f"{near[1]!r} is {gaps[near[1]]:.3g} m away from {stands.id!r} where {near[0]!r} "
            "touches it: the grasp is not in its middle"
        )
    return at


def _distance(robot: RobotGeometry, links: Sequence[str], scene: Scene, q: Array) -> float:
    """Distance of some links from a scene [m]; 0 where they touch."""
    own = [i for i, link in enumerate(robot.links) if link in links]
    alone = replace(
        robot,
        pieces=tuple(robot.pieces[i] for i in own),
        links=tuple(robot.links[i] for i in own),
        joints=robot.joints[own],
        solids=robot.solids[own],
    )
    return max(Checker.of(alone, scene).clearance(q)[0], 0.0)


class Cell(NamedTuple):
    """The robot with what it holds in its surroundings, for one stage.

    Args:
        robot: Held objects are among its pieces, their masses among its links.
        scene: The objects not held, with the pairs that may touch.
        checker: Checker of both, with the margin of the stage.
        chain: The robot's chain with the frames of held objects as links, for constraints.
    """

    robot: RobotGeometry
    scene: Scene
    checker: Checker
    chain: Chain


class Cells:
    """Cells by world, pairs that may touch and margin, each put together once."""

    def __init__(self) -> None:
        self._cells: dict[object, Cell] = {}

    def cell(self, world: World, allowed: Iterable[Pair] = (), margin: float = 0.0) -> Cell:
        """The cell of a world.

        Args:
            world: The robot and its surroundings.
            allowed: Pairs that may touch beside those of the world, perhaps with their contacts.
            margin: Distance to keep from obstacles [m].

        Raises:
            InvalidObjectName: A name in ``allowed`` is unknown.
            InvalidLinkName: A name that a held object may touch is unknown.
        """
        pairs = contacts_of(allowed, "request")
        key = (*world.key[:5], frozenset(pairs.items()), margin)
        cell = self._cells.get(key)
        if cell is None:
            cell = self._cells[key] = _put_together(world, pairs, margin)
        return cell


def _put_together(world: World, allowed: dict[Pair, AllowedContact], margin: float) -> Cell:
    pairs = {**world.touching, **world.supported, **allowed}
    holding = hold(world.robot, world.scene, [item.attachment for item in world.held], pairs)
    robot = holding.robot
    chain = robot.chain
    for item in world.held:
        if item.load is not None:
            held = item.attachment
            chain = item.load.added_to(chain, held.link, held.held.T_world_obstacle)
    if chain is not robot.chain:
        robot = replace(robot, chain=chain)
    framed = with_frames(chain, (item.attachment.frame for item in world.held))
    return Cell(robot, holding.scene, Checker.of(robot, holding.scene, margin), framed)


def _without(pairs: Mapping[Pair, AllowedContact], name: str) -> dict[Pair, AllowedContact]:
    return {pair: contact for pair, contact in pairs.items() if name not in pair}
