"""Collision geometry of a robot, or what it looks like, as triangles, in workers."""

from typing import Any

import numpy as np
from pydantic_core import to_json

from armwright_wire.robots.kinematics import FkRequest
from armwright_wire.robots.robot import BodySurface, GeometryAnswer, GeometryKind
from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from kinematics.forward import link_poses
from kinematics.model.chain import Chain, Link
from kinematics.pose import inverse
from kinematics.tree.fingers import Fingers
from obstacles.robots.visual_geometry import VisualBody
from obstacles.scenes.scene import Scene
from service.endpoints.kinematics.task import fk_document
from service.storage.caches import worker_cache
from service.storage.caches.cache_key import Reference
from service.viewer.bodies import Body, bodies, packed
from service.workers.task import task


@task
def finger_poses(robot: Reference, content: bytes) -> bytes:
    """Answer a request for forward kinematics that says where fingers stand.

    Args:
        robot: The robot.
        content: The request.

    Raises:
        InvalidRobotState: Wrong length.
        InvalidLinkName: No such link.
        InvalidOption: A joint is no finger's, or stands outside its limits; lists are of another
            length than the configurations.
    """
    body = FkRequest.model_validate_json(content)
    geometry = worker_cache.robot(robot).geometry
    poses = _with_fingers(geometry.chain, geometry.fingers, body)
    return to_json(fk_document(geometry.chain, body, poses))


def _with_fingers(chain: Chain, fingers: Fingers, body: FkRequest) -> Array:
    """Poses of all links, those behind fingers where these stand: shape (..., links, 4, 4)."""
    poses = link_poses(chain, body.joints)
    rows = poses.reshape(-1, *poses.shape[-3:])
    index = {link.name: i for i, link in enumerate(chain.links)}
    for row, positions in zip(rows, _positions(body, len(rows)), strict=True):
        moved = fingers.link_poses(chain, fingers.with_positions(positions))
        for name, T_joint_link in moved.items():
            T_root_joint = row[index[name]] @ inverse(chain.link(name).T_joint_link)
            row[index[name]] = T_root_joint @ T_joint_link
    return rows.reshape(poses.shape)


def _positions(body: FkRequest, count: int) -> list[dict[str, float]]:
    given: dict[str, Any] = dict(body.fingers or {})
    for name, value in given.items():
        if isinstance(value, list) and (len(value) != count or np.ndim(body.joints) == 1):
            raise InvalidOption(
                f"fingers: {name!r} has {len(value)} positions for {count} configurations",
                hint="Give one number, or one for each configuration.",
                joint=name,
            )
    return [
        {name: float(v[i] if isinstance(v, list) else v) for name, v in given.items()}
        for i in range(count)
    ]


@task
def robot_geometry(robot: Reference, name: str, kind: GeometryKind = "collision") -> bytes:
    """The collision geometry of a robot as triangles in the frames of its links, or its visual one.

    Args:
        robot: The robot.
        name: Name of the robot.
        kind: "visual" for what it looks like; there, links that look like nothing that is known
            have their collision geometry, and a robot none of whose links does has no bodies.
    """
    geometry = worker_cache.robot(robot).geometry
    drawn = bodies(geometry, Scene())
    surfaces: list[BodySurface] = []
    if kind == "visual":
        looks = worker_cache.visuals(robot).bodies
        seen = {body.link for body in looks}
        drawn = [body for body in drawn if looks and body.name not in seen]
        surfaces = [_visual(body) for body in looks]
    surfaces += [_surface(geometry.chain, body) for body in drawn]
    answer = GeometryAnswer(robot=name, hash=geometry.content_hash, kind=kind, bodies=surfaces)
    return answer.model_dump_json().encode()


def _visual(body: VisualBody) -> BodySurface:
    return BodySurface(
        link=body.link,
        frame=body.link,
        vertices=packed(body.surface.vertices.astype("<f4")),
        faces=packed(body.surface.faces.astype("<u4")),
        simplified=body.simplified,
        color=None if body.color is None else list(body.color),
    )


def _surface(chain: Chain, body: Body) -> BodySurface:
    link = _frame_link(chain, body)
    T = inverse(link.T_joint_link)
    vertices = body.surface.vertices @ T[:3, :3].T + T[:3, 3]
    return BodySurface(
        link=body.name,
        frame=link.name,
        vertices=packed(vertices.astype("<f4")),
        faces=packed(body.surface.faces.astype("<u4")),
        simplified=body.simplified,
    )


def _frame_link(chain: Chain, body: Body) -> Link:
    """The body's own link, or another one that moves with the same joint."""
    own = chain.links[chain.index[body.name]]
    if own.joint == body.joint:
        return own
    return next(link for link in chain.links if link.joint == body.joint)
