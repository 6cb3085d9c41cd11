"""The artificial potential as requests ask for it, in workers."""

from dataclasses import replace
from typing import Any

import numpy as np
from pydantic_core import to_json

from armwright_wire.robots.potential import PotentialRequest
from kinematics.arrays import Array
from kinematics.model.chain import Chain
from planning.field.control_points import ControlPoints
from planning.field.options import PRESETS, FieldOptions
from planning.field.planner import potential_of
from planning.field.potential import Field
from service.endpoints.attached_objects import RobotInScene, requested_scene
from service.storage.caches import worker_cache
from service.storage.caches.cache_key import Reference
from service.translate.frames import first_configuration
from service.workers.task import task


@task
def potential(robot: Reference, scene: Reference | None, content: bytes) -> bytes:
    """Answer a request for the potential, its slope and the forces that make it.

    Raises:
        InvalidRobotState: Wrong length.
        InvalidScene: The inline scene is not valid.
        InvalidOption: Weights are given for another number of control points.
    """
    body = PotentialRequest.model_validate_json(content)
    geometry = worker_cache.robot(robot).geometry
    chain = geometry.chain
    joints = chain.configuration(body.joints)
    goal = chain.configuration(body.goal_joints, "goal_joints")
    obstacles = requested_scene(scene, body, chain, first_configuration(chain, body.joints))
    field, where = potential_of(geometry, obstacles, goal, _options(body))
    rows = joints.reshape(-1, chain.n)
    answers = [_value(chain, field, where, obstacles.ids, q) for q in rows]
    told = {"allowed_collisions": RobotInScene(geometry, obstacles).overlaps(rows)}
    if joints.ndim == 1:
        return to_json(answers[0] | told)
    return to_json({name: [answer[name] for answer in answers] for name in answers[0]} | told)


def _options(body: PotentialRequest) -> FieldOptions:
    """The options asked for, the others as their preset has them."""
    given = {} if body.options is None else body.options.model_dump(exclude_none=True)
    preset = PRESETS[given.pop("preset", "notes")]
    return replace(preset, engine=body.engine, **given)


def _value(
    chain: Chain, field: Field, where: ControlPoints, ids: tuple[str, ...], q: Array
) -> dict[str, Any]:
    value = field.at(q)
    points = [
        {
            "joint": chain.joint_of(int(where.joints[i])),
            "origin": value.points[i].tolist(),
            "radius": float(where.radii[i]),
            "goal": field.goals[i].tolist(),
            "attractive_force": value.attractive_forces[i].tolist(),
            "repulsive_force": value.repulsive_forces[i].tolist(),
            "projection": value.projections[i].tolist() if obstacle >= 0 else None,
            "distance": float(value.distances[i]) if obstacle >= 0 else None,
            "obstacle": ids[obstacle] if obstacle >= 0 else None,
        }
        for i, obstacle in enumerate(value.nearest)
    ]
    return {
        "potential": value.potential,
        # Minus nothing is nothing, not -0.
        "gradient": np.subtract(0.0, value.joint_force).tolist(),
        "joint_force": value.joint_force.tolist(),
        "control_points": points,
    }
