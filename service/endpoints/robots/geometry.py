"""Collision geometry of a robot, or what it looks like, as triangles, in workers."""

import base64

import numpy as np

from armwright_wire.robot import BodySurface, GeometryAnswer, GeometryKind
from kinematics.arrays import Array, Indices
from kinematics.model.chain import Chain, Link
from kinematics.pose import inverse
from obstacles.robots.visual_geometry import VisualBody
from obstacles.scenes.scene import Scene
from service.storage import worker_cache
from service.storage.cache_key import Reference
from service.viewer.bodies import Body, bodies
from service.workers.answer import reports_cache_miss
from service.workers.result import CacheMiss
from service.workers.task import task


@task
@reports_cache_miss
def robot_geometry(
    robot: Reference, name: str, kind: GeometryKind = "collision"
) -> bytes | CacheMiss:
    """The collision geometry of a robot as triangles in the frames of its links, or its visual one.

    Args:
        robot: The robot.
        name: Its name.
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
        vertices=_base64(body.surface.vertices.astype("<f4")),
        faces=_base64(body.surface.faces.astype("<u4")),
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
        vertices=_base64(vertices.astype("<f4")),
        faces=_base64(body.surface.faces.astype("<u4")),
        simplified=body.simplified,
    )


def _frame_link(chain: Chain, body: Body) -> Link:
    """The body's own link, or another one that moves with the same joint."""
    own = chain.links[chain.index[body.name]]
    if own.joint == body.joint:
        return own
    return next(link for link in chain.links if link.joint == body.joint)


def _base64(values: Array | Indices) -> str:
    return base64.b64encode(np.ascontiguousarray(values).tobytes()).decode()
