"""Objects that a robot holds: out of the scene and onto a link, with what each may touch.

While it is held an object is a part of the robot: it moves with its link, and is checked against
the other links, the scene and what else is held. From grasp to release it is one object with one
name. Where that name is an obstacle's, the obstacle is taken out of the scene as long as the object
is held; to release it is to plan without the attachment, with the obstacle put where it then is.
"""

import fnmatch
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain, product

from numpy.typing import ArrayLike

from kinematics.arrays import Array, typed
from kinematics.errors import ArmwrightError, InvalidLinkName, InvalidObjectName, InvalidScene
from kinematics.forward import forward
from kinematics.pose import inverse
from kinematics.readers.lint import meant
from obstacles.robots.allowed_pairs import TOUCH_DEPTH, contacts_of
from obstacles.robots.robot_geometry import RobotGeometry, sorted_pair
from obstacles.robots.tool import PART, parts_of
from obstacles.scenes.scene import AllowedContact, Obstacle, Scene

#: Links, obstacles and attached objects that an error names.
_TOLD = 60
#: In a pair that may touch: any letters of a name, and alone whatever there is.
ANYTHING = "*"


@dataclass(frozen=True, slots=True, eq=False)
class Attachment:
    """An object and the link that holds it.

    Args:
        held: The object; its pose is in the frame of ``link``, its margin is not used.
        link: The link that holds it.
        touches: Names of links, obstacles and other attached objects that it may touch.
        touch_depth: How deep it may overlap these [m]; infinite for any depth.
    """

    held: Obstacle
    link: str
    touches: tuple[str, ...] = ()
    touch_depth: float = TOUCH_DEPTH

    @property
    def frame(self) -> tuple[str, str, Array]:
        """The object's frame as `with_frames` takes it."""
        return self.held.id, self.link, self.held.T_world_obstacle


@dataclass(frozen=True, slots=True, eq=False)
class Holding:
    """A robot with what it holds, and the scene without that.

    Args:
        robot: Attached objects are among its pieces.
        scene: Scene without the objects that are held; pairs that may touch are in it.
    """

    robot: RobotGeometry
    scene: Scene


@typed
def grasp(
    robot: RobotGeometry, scene: Scene, name: str, link: str, q: ArrayLike
) -> tuple[Obstacle, Array]:
    """An obstacle as a link holds it that closed on it in a configuration.

    T_link_object = T_base_link(q)^-1 T_base_object.

    Args:
        robot: The arm.
        scene: Scene of the obstacle.
        name: The obstacle.
        link: The link that holds it.
        q: The configuration, shape (n,).

    Returns:
        The obstacle with its pose in the link's frame, and that pose (4, 4).

    Raises:
        InvalidObjectName: The scene has no such obstacle.
        InvalidLinkName: No such link.
        InvalidRobotState: Wrong length or not finite.
    """
    stands = scene.obstacle(name)
    configuration = robot.chain.state(q, "grasp_joints")
    T_base_link = forward(robot.chain, configuration, link)
    T_link_object = inverse(T_base_link) @ stands.T_world_obstacle
    return Obstacle(name, stands.shape, T_link_object), T_link_object


@typed
def release(
    robot: RobotGeometry, scene: Scene, attachment: Attachment, q: ArrayLike
) -> tuple[Scene, Obstacle]:
    """The scene with an attached object put back where the robot holds it in a configuration.

    Args:
        robot: The arm.
        scene: Scene without the object.
        attachment: The object and its link.
        q: The configuration, shape (n,).

    Raises:
        InvalidScene: The scene has an obstacle of that name.
        InvalidRobotState: Wrong length or not finite.
    """
    configuration = robot.chain.state(q)
    held = attachment.held
    T = forward(robot.chain, configuration, attachment.link) @ held.T_world_obstacle
    put = Obstacle(held.id, held.shape, T)
    return replace(scene, obstacles=(*scene.obstacles, put)), put


@typed
def hold(
    robot: RobotGeometry,
    scene: Scene,
    attachments: Sequence[Attachment] = (),
    allowed: Iterable[tuple[str, str]] = (),
) -> Holding:
    """The robot holding objects, and the scene that is left.

    Args:
        robot: The arm, perhaps holding something already.
        scene: All obstacles, those that are held by now perhaps among them.
        attachments: Objects to hold.
        allowed: More pairs of names that may touch, perhaps with their contacts.

    Raises:
        InvalidScene: The name of an attached object is a link's, or stands twice; or one that may
            touch is an obstacle's and a link's.
        InvalidLinkName: A link that holds something, or a name that may touch it, is unknown.
        InvalidObjectName: A name in ``allowed`` is unknown.
    """
    taken = {attachment.held.id for attachment in attachments}
    left = tuple(obstacle for obstacle in scene.obstacles if obstacle.id not in taken)
    contacts, arm = dict(scene.contacts), robot
    for attachment in attachments:
        touches = [part for name in attachment.touches for part in parts_of(name, robot.names)]
        links = [name for name in touches if name in robot.chain.index]
        contact = AllowedContact("touch_links", attachment.touch_depth)
        contacts |= {sorted_pair(attachment.held.id, name): contact for name in touches}
        arm = arm.attach(attachment.held, attachment.link, links)
    known = dict.fromkeys([*arm.chain.index, *arm.names, *(obstacle.id for obstacle in left)])
    for attachment in attachments:
        what = f"touch_links of attached object {attachment.held.id!r}"
        _check_names(attachment.touches, what, known, InvalidLinkName)
    for pair, contact in contacts_of(allowed, "request").items():
        named = [name for name in pair if not stands_for(name, arm, known)]
        groups = dict.fromkeys(arm.groups)
        _check_names(named, "allowed_collisions", known | groups, InvalidObjectName)
        contacts[pair] = contact
    scene = with_parts(arm, replace(scene, obstacles=left, contacts=contacts))
    check_allowed(arm, scene)
    return Holding(arm, scene)


def stands_for(name: str, robot: RobotGeometry, every: Collection[str]) -> list[str]:
    """Links, obstacles and attached objects that a name in a pair that may touch stands for.

    Args:
        name: Name of one of them, of a tool, which stands for its jaws as well, of a group of the
            robot's SRDF, or a pattern: ``*``, ``finger_*``. A link or attached object counts before
            a group of its name.
        robot: The arm with its tool and with what it holds.
        every: All links, obstacles and attached objects.

    Returns:
        Their names; none where there is nothing of that name.
    """
    if ANYTHING in name:
        return fnmatch.filter(every, name)
    if _is_group(name, robot):
        links = robot.groups[name]
        return [part for link in links for part in parts_of(link, robot.names) if part in every]
    return parts_of(name, robot.names) if name in every else []


def _is_group(name: str, robot: RobotGeometry) -> bool:
    return name in robot.groups and name not in robot.chain.index and name not in robot.names


def with_parts(robot: RobotGeometry, scene: Scene) -> Scene:
    """The scene with pairs that may touch spelled out: of tools, groups of links and patterns.

    Args:
        robot: The arm with its tool and with what it holds.
        scene: Scene whose pairs have names as `stands_for` takes them.

    Raises:
        InvalidScene: A name in a pair is an obstacle's and a group's.
    """
    if not scene.allowed_collisions:
        return scene
    check_allowed(robot, scene)
    tools = {name.partition(PART)[0] for name in robot.names if PART in name}
    named = set(chain.from_iterable(scene.allowed_collisions))
    many = {name for name in named if ANYTHING in name or _is_group(name, robot)}
    if named.isdisjoint(many | tools):
        return scene
    own = set(robot.names)
    every = dict.fromkeys([*robot.names, *scene.ids])
    given = {p: scene.contacts.get(p, AllowedContact()) for p in sorted(scene.allowed_collisions)}
    contacts = {pair: contact for pair, contact in given.items() if many.isdisjoint(pair)}
    for pair, contact in given.items():
        if (many | tools).isdisjoint(pair):
            continue
        first, second = (stands_for(name, robot, every) for name in pair)
        for a, b in product(first, second):
            if a != b and (a in own or b in own):
                contacts.setdefault(sorted_pair(a, b), contact)
    return replace(scene, allowed_collisions=frozenset(contacts), contacts=contacts)


def check_allowed(robot: RobotGeometry, scene: Scene) -> None:
    """Refuse pairs that may touch of which a name is both an obstacle's and a link's or group's.

    Raises:
        InvalidScene: There is such a pair: it could mean either.
    """
    if not scene.allowed_collisions:
        return
    own = robot.chain.index.keys() | set(robot.names) | robot.groups.keys()
    both = own.intersection(scene.ids)
    for pair in sorted(scene.allowed_collisions) if both else ():
        for name in pair:
            if name in both:
                raise InvalidScene(
                    f"allowed_collisions: {name!r} is the name of an obstacle and of a link, group "
                    f"or attached object: {list(pair)} could mean either",
                    hint="Give the obstacle another id.",
                    name=name,
                    pair=list(pair),
                )


def _check_names(
    wanted: Iterable[str], where: str, known: Mapping[str, None], error: type[ArmwrightError]
) -> None:
    for name in wanted:
        if name not in known:
            some = ", ".join(list(known)[:_TOLD]) + (", …" if len(known) > _TOLD else "")
            raise error(
                f"{where}: there is no link, obstacle or attached object {name!r}"
                f"{meant(name, list(known))}",
                hint=f"There are: {some}.",
                name=name,
                names=list(known),
            )
