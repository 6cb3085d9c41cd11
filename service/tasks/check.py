"""Collision checks and projections as requests ask for them, in workers."""

import dataclasses
from typing import Any

import numpy as np
from pydantic_core import to_json

from kinematics.arrays import Array
from obstacles.checker import Checker
from obstacles.fcl_distance import FclWorld
from obstacles.projection import project as project_points
from obstacles.robot_geometry import RobotGeometry
from obstacles.scene import Scene
from planning.ready import TOUCHING
from service.schemas.check import CheckRequest
from service.schemas.scene import ProjectRequest
from service.storage import worker_cache
from service.storage.cache_key import CacheMiss, Reference, TaskProblem
from service.storage.disk_cache import Recent
from service.tasks.answer import answering
from service.tasks.attached_objects import holding

#: Distances from here on are exact as the kernel finds them; below, the depth is asked for [m].
_TOUCHING = 1e-6
#: Projections of one answer: at 100 bytes each, a hundred megabytes.
_MAX_PROJECTIONS = 1_000_000
_JUDGES = Recent(8)


@dataclasses.dataclass(frozen=True, slots=True)
class Judge:
    """What it takes to check configurations of one robot in one scene.

    Args:
        robot: The robot with what it holds.
        bare: Kernel verdicts without the obstacles' margins.
        strict: The same with them and that of the request, which concern obstacles alone.
        world: Depths, without margins.
    """

    robot: RobotGeometry
    bare: Checker
    strict: Checker
    world: FclWorld

    @classmethod
    def of(cls, robot: RobotGeometry, scene: Scene, margin: float) -> "Judge":
        """The judge of a robot that keeps ``margin`` [m] more than theirs from obstacles."""
        plain = dataclasses.replace(
            scene, obstacles=tuple(dataclasses.replace(o, margin=0.0) for o in scene.obstacles)
        )
        bare = Checker.of(robot, plain)
        margins = margin > 0.0 or any(obstacle.margin > 0.0 for obstacle in scene.obstacles)
        strict = Checker.of(robot, scene, margin) if margins else bare
        return cls(robot, bare, strict, FclWorld(robot, plain))


@answering
def check(robot: Reference, scene: Reference | None, content: bytes) -> bytes | CacheMiss:
    """Answer a request for collision checks.

    Raises:
        InvalidRobotState: Wrong length.
        InvalidScene: The inline scene or an attached object is not valid.
    """
    body = CheckRequest.model_validate_json(content)
    geometry = worker_cache.robot(robot).geometry
    joints = geometry.chain.configuration(body.joints)
    place = worker_cache.scene(scene or (None if isinstance(body.scene, str) else body.scene))
    held = holding(geometry, place, body.attached, body.allowed_collisions)
    key = (held.robot.content_hash, held.scene.content_hash, body.margin)
    judge = _JUDGES.get(key, lambda: Judge.of(held.robot, held.scene, body.margin))
    verdicts = [_verdict(judge, q) for q in joints.reshape(-1, geometry.chain.n)]
    if joints.ndim == 1:
        return to_json(verdicts[0] | {"allowed_collisions": held.allowed})
    answer = {name: [verdict[name] for verdict in verdicts] for name in verdicts[0]}
    return to_json(answer | {"allowed_collisions": held.allowed})


def _verdict(judge: Judge, q: Array) -> dict[str, Any]:
    chain = judge.robot.chain
    clearance, pair = judge.bare.clearance(q)
    collisions = []
    if clearance <= _TOUCHING:
        contacts = judge.world.collisions(q)
        collisions = [{"pair": list(found.pair), "depth": found.depth} for found in contacts]
        if collisions:
            clearance, pair = -contacts[0].depth, contacts[0].pair
        else:
            nearest = judge.world.clearance(q)
            clearance, pair = nearest.distance, nearest.pair
    room = clearance if judge.strict is judge.bare else judge.strict.clearance(q)[0]
    outside = np.flatnonzero((q < chain.limits.lower) | (q > chain.limits.upper))
    broken = [_broken(judge.robot, q, int(j)) for j in outside]
    return {
        "valid": not collisions and not broken and room > TOUCHING,
        "clearance": clearance if np.isfinite(clearance) else None,
        "clearance_pair": None if pair is None else list(pair),
        "collisions": collisions,
        "limit_violations": broken,
    }


def _broken(robot: RobotGeometry, q: Array, j: int) -> dict[str, Any]:
    limits, value = robot.chain.limits, float(q[j])
    limit = limits.lower[j] if value < limits.lower[j] else limits.upper[j]
    return {"joint": robot.chain.joint_names[j], "value": value, "limit": float(limit)}


@answering
def project(scene: Reference, content: bytes) -> bytes | TaskProblem | CacheMiss:
    """Answer a request for the orthogonal projections of points onto every obstacle."""
    body = ProjectRequest.model_validate_json(content)
    obstacles = worker_cache.scene(scene).obstacles
    count = len(body.points) * len(obstacles)
    if count > _MAX_PROJECTIONS:
        return TaskProblem(
            "PAYLOAD_TOO_LARGE",
            f"{len(body.points)} points and {len(obstacles)} obstacles make {count} projections, "
            f"at most {_MAX_PROJECTIONS} are answered at once",
            "Send the points in several requests.",
            {"stage": "request"},
        )
    if not obstacles:
        return to_json({"projections": [[] for _ in body.points]})
    projections, distances = project_points(np.array(body.points), obstacles)
    rows = zip(projections.tolist(), distances.tolist(), strict=True)
    answers = [
        [
            {"obstacle": obstacle.id, "projection": point, "distance": distance}
            for obstacle, point, distance in zip(obstacles, *row, strict=True)
        ]
        for row in rows
    ]
    return to_json({"projections": answers})
