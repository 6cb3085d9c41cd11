"""Poses of the links of robots whose fingers stand elsewhere, in workers."""

from typing import Any

import numpy as np
from pydantic_core import to_json

from armwright_wire.kinematics import FkRequest
from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from kinematics.forward import link_poses
from kinematics.model.chain import Chain
from kinematics.pose import inverse
from kinematics.tree.fingers import Fingers
from service.endpoints.kinematics.task import fk_document
from service.storage import worker_cache
from service.storage.cache_key import Reference
from service.workers.answer import reports_cache_miss
from service.workers.result import CacheMiss
from service.workers.task import task


@task
@reports_cache_miss
def finger_poses(robot: Reference, content: bytes) -> bytes | CacheMiss:
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
