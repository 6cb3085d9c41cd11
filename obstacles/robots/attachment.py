"""Objects that a robot holds: out of the scene and onto a link, with what each may touch.

While it is held an object is a part of the robot: it moves with its link, and is checked against
the other links, the scene and what else is held. From grasp to release it is one object with one
name. Where that name is an obstacle's, the obstacle is taken out of the scene as long as the object
is held; to release it is to plan without the attachment, with the obstacle put where it then is.
"""

import fnmatch
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

from numpy.typing import ArrayLike

from kinematics.arrays import Array, typed
from kinematics.errors import ArmwrightError, InvalidLinkName, InvalidObjectName, InvalidScene
from kinematics.forward import forward
from kinematics.pose import inverse
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
        named = [name for name in pair if ANYTHING not in name or not fnmatch.filter(known, name)]
        _check_names(named, "allowed_collisions", known, InvalidObjectName)
        contacts[pair] = contact
    scene = with_parts(arm, replace(scene, obstacles=left, contacts=contacts))
    check_allowed(arm, scene)
    return Holding(arm, scene)


def with_parts(robot: RobotGeometry, scene: Scene) -> Scene:
    """The scene with pairs that may touch spelled out: of all parts of a tool, and of patterns.

    Args:
        robot: The arm with its tool and with what it holds.
        scene: Scene whose pairs may name a tool, which stands for its jaws as well, or all links,
            obstacles and attached objects of a pattern: ``*``, ``finger_*``.
    """
    if not scene.contacts:
        return scene
    tools = {name.partition(PART)[0] for name in robot.names if PART in name}
    patterns = {p: c for p, c in scene.contacts.items() if any(ANYTHING in name for name in p)}
    wide = {p: c for p, c in scene.contacts.items() if p in patterns or not tools.isdisjoint(p)}
    if not wide:
        return scene
    own = set(robot.names)
    every = [*robot.names, *scene.ids]
    contacts = {pair: c for pair, c in scene.contacts.items() if pair not in patterns}
    for pair, contact in wide.items():
        first, second = (
            fnmatch.filter(every, name) if ANYTHING in name else parts_of(name, robot.names)
            for name in pair
        )
        for a, b in product(first, second):
            if a != b and (a in own or b in own):
                contacts.setdefault(sorted_pair(a, b), contact)
    return replace(scene, allowed_collisions=frozenset(contacts), contacts=contacts)


def check_allowed(robot: RobotGeometry, scene: Scene) -> None:
    """Refuse pairs that may touch of which a name is both an obstacle's and a link's.

    Raises:
        InvalidScene: There is such a pair: it could mean either.
    """
    if not scene.allowed_collisions:
        return
    both = (robot.chain.index.keys() | set(robot.names)).intersection(scene.ids)
    for pair in sorted(scene.allowed_collisions) if both else ():
        for name in pair:
            if name in both:
                raise InvalidScene(
                    f"allowed_collisions: {name!r} is the name of an obstacle and of a link or "
                    f"attached object: {list(pair)} could mean either",
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
                f"{where}: there is no link, obstacle or attached object {name!r}",
                hint=f"There are: {some}.",
                name=name,
                names=list(known),
            )
