"""Collision geometry of a robot as triangles, in workers."""

import base64

import numpy as np

from kinematics.arrays import Array, Indices
from kinematics.chain import Chain, Link
from kinematics.pose import inverse
from obstacles.scene import Scene
from service.schemas.geometry import BodySurface, GeometryAnswer
from service.storage import worker_cache
from service.storage.cache_key import Reference
from service.tasks.answer import reports_cache_miss
from service.tasks.result import CacheMiss
from service.viewer.bodies import Body, bodies
from service.workers.task import task


@task
@reports_cache_miss
def robot_geometry(robot: Reference, name: str) -> bytes | CacheMiss:
    """The collision geometry of a robot as triangles in the frames of its links.

    Args:
        robot: The robot.
        name: Its name.
    """
    geometry = worker_cache.robot(robot).geometry
    surfaces = [_surface(geometry.chain, body) for body in bodies(geometry, Scene())]
    answer = GeometryAnswer(robot=name, hash=geometry.content_hash, bodies=surfaces)
    return answer.model_dump_json().encode()


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
