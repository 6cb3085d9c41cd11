"""Robots with attached objects in the scenes of requests."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from pydantic import BaseModel

from armwright_wire.scenes import scene as schema
from armwright_wire.scenes.check import Attached, WithFingers
from armwright_wire.scenes.scene import AllowedItem
from dynamics.model.payload import with_payload
from kinematics.arrays import Array
from kinematics.errors import InvalidScene
from kinematics.forward import link_number
from kinematics.model.chain import Chain, with_frames
from kinematics.root_frame import check_default_frame
from obstacles.collision.fcl_distance import OverlapMeter
from obstacles.robots.allowed_pairs import Overlap, allowed_pairs
from obstacles.robots.attachment import ANYTHING, Attachment, check_allowed, grasp, hold, with_parts
from obstacles.robots.finger_geometry import with_fingers
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.placement import with_objects
from obstacles.scenes.scene import Obstacle, Scene
from service.storage.caches import worker_cache
from service.storage.caches.cache_key import Reference
from service.translate import poses
from service.translate.contacts import (
    allowed_answer,
    contacts,
    touch_depth,
)

#: Unknown names that a note lists.
_TOLD = 12
#: Fields of requests that name obstacles.
_NAMING = ("attached", "allowed_collisions", "margins", "objects", "stages")


@dataclass(frozen=True, slots=True, eq=False)
class RobotInScene:
    """The robot with what it holds, and its surroundings.

    Args:
        robot: The robot with the objects that it holds, their masses included.
        scene: The scene without attached objects, with all pairs that may touch.
        notes: Oddities of the scene, as sentences.
        held: The objects that it holds.
    """

    robot: RobotGeometry
    scene: Scene
    notes: tuple[str, ...] = ()
    held: tuple[Attachment, ...] = ()

    @property
    def chain(self) -> Chain:
        """The robot's chain with the frames of held objects as links.

        It is for kinematics and constraints: proofs know held objects as those that are no links.
        """
        chain = self.robot.chain
        return with_frames(chain, (item.frame for item in self.held)) if self.held else chain

    @property
    def pairs(self) -> list[dict[str, Any]]:
        """Pairs that are not kept apart, as answers tell them, no depth among them."""
        pairs = allowed_pairs(self.robot, self.scene)
        return allowed_answer(Overlap(item.pair, item.reason, None) for item in pairs)

    def overlaps(self, configurations: Iterable[Array]) -> list[dict[str, Any]]:
        """The same pairs with how deep they are in the deepest of some configurations (n,)."""
        meter = OverlapMeter(self.robot, self.scene)
        return allowed_answer(meter.report(map(meter.depths, configurations)))


class SceneRequest(Protocol):
    """The fields of a request that say which scene is meant, and in which frame."""

    @property
    def scene(self) -> str | schema.Scene | None:
        """The name of a stored scene, an inline scene, or none."""

    @property
    def frame(self) -> str | None:
        """The frame of what names none."""


class CollisionRequest(SceneRequest, Protocol):
    """The fields of a request that say which scene is meant and what is attached."""

    @property
    def attached(self) -> Sequence[Attached] | None:
        """Objects that the robot holds."""

    @property
    def allowed_collisions(self) -> Sequence[AllowedItem] | None:
        """Pairs that may touch."""


def requested_scene(
    reference: Reference | None, body: SceneRequest, chain: Chain, joints: Array | None
) -> Scene:
    """The scene of a request in the root frame of its robot, an empty one where it names none.

    The frame of the request is that of an inline scene that names none; a stored scene is in its
    own.

    Args:
        reference: Reference of the stored scene, where the request names one.
        body: The request.
        chain: The robot.
        joints: Configuration of the frame "tool", shape (n,) [rad or m]; None where nothing names
            one.

    Raises:
        NotPrepared: The document of a stored scene has to be prepared first.
        InvalidScene: An inline scene is not valid.
        InvalidLinkName: A frame is unknown, or moves.
    """
    if body.frame is not None:
        check_default_frame(chain, body.frame)
    source = None if isinstance(body.scene, str) else body.scene
    frame = None if source is None else body.frame
    scene = worker_cache.placed_scene(reference or source, frame, chain, joints)
    margins = getattr(body, "margins", None)
    for name, distance in ((margins and margins.objects) or {}).items():
        scene = scene.with_margin(name, distance)
    named = (text for field in _NAMING for text in _texts(getattr(body, field, None)))
    return with_objects(scene, named)


def _texts(node: object) -> Iterator[str]:
    """All texts in fields of a request."""
    if isinstance(node, str):
        yield node
    elif isinstance(node, BaseModel):
        yield from _texts(node.__dict__)
    elif isinstance(node, dict):
        yield from _texts(list(node.values()))
    elif isinstance(node, list):
        for item in node:
            yield from _texts(item)


def robot_in_scene(
    robot: Reference,
    scene: Reference | None,
    body: CollisionRequest,
    joints: Array | None = None,
) -> RobotInScene:
    """The robot of a request with the objects it holds and its fingers where they are to stand.

    Args:
        robot: The robot.
        scene: The stored scene, where the request names one.
        body: The request.
        joints: Configuration of the frame "tool", shape (n,) [rad or m]; None where nothing names
            one.

    Raises:
        NotPrepared: A robot or a stored scene has to be prepared first.
        InvalidScene: The scene or an object is not valid, has no shape, or its name is taken.
        InvalidLinkName: A link is unknown.
        InvalidObjectName: A name that may touch is unknown, or nothing is there to be grasped.
        InvalidOption: A mass or an inertia is none of a body, or a joint is none of the gripper, or
            beyond its limits.
    """
    return with_surroundings(worker_cache.robot(robot).geometry, scene, body, joints)


def with_surroundings(
    geometry: RobotGeometry,
    scene: Reference | None,
    body: CollisionRequest,
    joints: Array | None = None,
) -> RobotInScene:
    """A robot with the objects that a request has it hold, its fingers, and the scene.

    Args:
        geometry: The robot alone.
        scene: Scene as `robot_in_scene` has it.
        body: The request.
        joints: Joints as `robot_in_scene` has them.

    Raises:
        NotPrepared: The stored scene has to be prepared first.
        InvalidScene: As `robot_in_scene`, and all its other errors.
    """
    if isinstance(body, WithFingers) and body.fingers:
        geometry = with_fingers(geometry, body.fingers)
    surroundings = requested_scene(scene, body, geometry.chain, joints)
    return attach(geometry, surroundings, body.attached, body.allowed_collisions)


def attach(
    robot: RobotGeometry,
    scene: Scene,
    attached: Sequence[Attached] | None,
    allowed: Sequence[AllowedItem] | None,
) -> RobotInScene:
    """The robot with objects attached to its links, and the scene without them.

    Args:
        robot: The robot alone.
        scene: The scene with the objects still in it.
        attached: The objects.
        allowed: Pairs of names that may touch, perhaps with a depth.

    Raises:
        InvalidScene: An object is not valid, has no shape, or its name is taken; or a name that may
            touch is an obstacle's and a link's.
        InvalidLinkName: A link is unknown.
        InvalidObjectName: A name that may touch is unknown, or nothing is there to be grasped.
        InvalidOption: A mass or an inertia is none of a body.
    """
    if not attached and not allowed:
        around = scene
        if scene.allowed_collisions:
            around = with_parts(robot, scene)
            check_allowed(robot, around)
        return RobotInScene(robot, around, scene_notes(robot, scene))
    pairs = contacts(allowed, "request")
    objects = [(item, attachment(robot, scene, item)) for item in attached or ()]
    grasped = hold(robot, scene, [held for _, held in objects], pairs)
    chain = robot.chain
    for item, held in objects:
        if item.mass is not None:
            chain = _with_mass(chain, item, held.held.T_world_obstacle)
    loaded = grasped.robot if chain is robot.chain else replace(grasped.robot, chain=chain)
    notes = scene_notes(robot, scene, [item.id for item, _ in objects])
    return RobotInScene(loaded, grasped.scene, notes, tuple(held for _, held in objects))


def scene_notes(robot: RobotGeometry, scene: Scene, held: Sequence[str] = ()) -> tuple[str, ...]:
    """Notes on what is odd about a scene: of its file, and names of pairs that nothing has.

    Args:
        robot: The robot.
        scene: The scene as it came.
        held: Names of objects that a request has the robot hold.
    """
    if not scene.allowed_collisions:
        return scene.notes
    known = {*robot.chain.index, *robot.names, *robot.groups, *scene.ids, *held}
    named = {name for pair in scene.allowed_collisions for name in pair} - known
    unknown = sorted(name for name in named if ANYTHING not in name)
    if not unknown:
        return scene.notes
    more = f" and {len(unknown) - _TOLD} more" if len(unknown) > _TOLD else ""
    names = ", ".join(map(repr, unknown[:_TOLD])) + more
    told = f"the scene lets {names} touch others: no link or obstacle has such a name"
    return (*scene.notes, told)


def attachment(robot: RobotGeometry, scene: Scene, item: Attached) -> Attachment:
    """An attached object of a request, in the frame of its link.

    Args:
        robot: The robot alone.
        scene: The scene with the object still in it, if it is an obstacle.
        item: The object.

    Raises:
        InvalidScene: The object has no shape.
        InvalidLinkName: There is no such link.
        InvalidObjectName: Nothing of that name is there to be grasped.
    """
    link_number(robot.chain, item.link)
    in_scene = item.id in scene.ids
    if item.shape is None and not in_scene:
        raise InvalidScene(
            f"attached object {item.id!r} has no shape, and the scene has no obstacle of that id",
            hint="Give its shape, or the id of an obstacle that is to be taken.",
        )
    if item.grasp_joints is not None:
        taken, T = grasp(robot, scene, item.id, item.link, np.array(item.grasp_joints))
        shape = taken.shape if item.shape is None else poses.shape(item.shape)
    else:
        assert item.pose is not None
        T = poses.transform(item.pose)
        shape = scene.obstacle(item.id).shape if item.shape is None else poses.shape(item.shape)
    held, depth = Obstacle(item.id, shape, T), touch_depth(item.touch_depth)
    return Attachment(held, item.link, tuple(item.touch_links), depth)


def _with_mass(chain: Chain, item: Attached, T_link_object: Array) -> Chain:
    """The chain with an object's mass at the link that holds it."""
    assert item.mass is not None
    R, p = T_link_object[:3, :3], T_link_object[:3, 3]
    center = p if item.center_of_mass is None else R @ np.array(item.center_of_mass) + p
    tensor = None if item.inertia is None else R @ np.array(item.inertia) @ R.T
    return with_payload(chain, item.mass, center, tensor, link=item.link)
