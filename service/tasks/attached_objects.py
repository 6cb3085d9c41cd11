"""Robots with what requests say they hold, in the scenes that are left."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynamics.payload import with_payload
from kinematics.arrays import Array
from kinematics.chain import Chain
from kinematics.errors import InvalidScene
from kinematics.forward import link_number
from obstacles.attachment import Attachment, grasp, hold
from obstacles.robot_geometry import RobotGeometry
from obstacles.scene import Obstacle, Scene
from service.schemas.attached import Attached
from service.translate import poses


@dataclass(frozen=True, slots=True, eq=False)
class Held:
    """What a request is about.

    Args:
        robot: The robot with the objects that it holds, their masses included.
        scene: What is left of the scene, with all pairs that may touch.
        allowed: The pairs that the request allows to touch, as answers echo them.
    """

    robot: RobotGeometry
    scene: Scene
    allowed: list[list[str]]


def holding(
    robot: RobotGeometry,
    scene: Scene,
    attached: Sequence[Attached] | None,
    allowed: Sequence[Sequence[str]] | None,
) -> Held:
    """The robot holding objects.

    Raises:
        InvalidScene: An object is not valid, has no shape, or its name is taken.
        InvalidLinkName: A link is unknown.
        InvalidObjectName: A name that may touch is unknown, or nothing is there to be grasped.
        InvalidOption: A mass or an inertia is none of a body.
    """
    pairs = [(pair[0], pair[1]) for pair in allowed or ()]
    told = [sorted(pair) for pair in pairs]
    if not attached and not pairs:
        return Held(robot, scene, told)
    held = [(item, _attachment(robot, scene, item)) for item in attached or ()]
    found = hold(robot, scene, [attachment for _, attachment in held], pairs)
    chain = robot.chain
    for item, attachment in held:
        if item.mass is not None:
            chain = _loaded(chain, item, attachment.held.T_world_obstacle)
    arm = found.robot if chain is robot.chain else replace(found.robot, chain=chain)
    return Held(arm, found.scene, told)


def _attachment(robot: RobotGeometry, scene: Scene, item: Attached) -> Attachment:
    link_number(robot.chain, item.link)
    stands = item.id in scene.ids
    if item.shape is None and not stands:
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
    return Attachment(Obstacle(item.id, shape, T), item.link, tuple(item.touch_links))


def _loaded(chain: Chain, item: Attached, T_link_object: Array) -> Chain:
    """The chain with an object's mass at the link that holds it."""
    assert item.mass is not None
    R, p = T_link_object[:3, :3], T_link_object[:3, 3]
    center = p if item.center_of_mass is None else R @ np.array(item.center_of_mass) + p
    tensor = None if item.inertia is None else R @ np.array(item.inertia) @ R.T
    return with_payload(chain, item.mass, center, tensor, link=item.link)
