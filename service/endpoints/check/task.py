"""Collision checks and projections as requests ask for them, in workers."""

from typing import Any

import numpy as np
from pydantic_core import to_json

from armwright_wire.scenes.check import CheckRequest
from armwright_wire.scenes.scene import ProjectRequest
from obstacles.projection.fcl_projection import FclProjector
from obstacles.projection.projection import Projector
from obstacles.scenes.placement import only_frame
from obstacles.scenes.scene import Pair
from planning.configuration_check import configuration_checker
from service.endpoints.attached_objects import robot_in_scene
from service.fields import picked
from service.storage.caches import worker_cache
from service.storage.caches.cache_key import Reference
from service.translate.contacts import allowed_answer
from service.translate.frames import first_configuration
from service.translate.poses import notes_of
from service.workers import current
from service.workers.answer import in_frame
from service.workers.result import TaskProblem
from service.workers.task import GRACE, task

#: Projections of one answer: at 100 bytes each, a hundred megabytes.
_MAX_PROJECTIONS = 1_000_000
#: Of one answer by FCL: at 30 microseconds each, some seconds.
_MAX_FCL_PROJECTIONS = 100_000
#: Fields of the verdict on one configuration.
_VERDICT = ("valid", "clearance", "clearance_pair", "collisions", "limit_violations")


@task(grace=GRACE)
def check(robot: Reference, scene: Reference | None, content: bytes) -> bytes | TaskProblem:
    """Answer a request for collision checks.

    Raises:
        InvalidRobotState: Wrong length.
        InvalidScene: The inline scene or an attached object is not valid.
    """
    body = CheckRequest.model_validate_json(content)
    chain = worker_cache.chain(robot)
    joints = chain.configuration(body.joints)
    cell = robot_in_scene(robot, scene, body, first_configuration(chain, body.joints))
    checker = configuration_checker(cell.robot, cell.scene, body.margin)
    look = checker.check if body.depth else checker.verdict
    meter = checker.meter if body.depth else None
    verdicts: list[dict[str, Any]] = []
    depths: list[dict[Pair, float]] = []
    rows, deadline, longest = joints.reshape(-1, chain.n), current.deadline(), 0.0
    for q in rows:
        # Deep contacts take tenths of a second each: the next may take as long as any before it.
        if deadline.sooner_than(longest):
            return _late(len(verdicts), len(rows), depth=body.depth)
        remaining = deadline.remaining
        verdicts.append(picked(look(q), *_VERDICT))
        if meter is not None:
            depths.append(meter.depths(q))
        longest = max(longest, remaining - deadline.remaining)
    told = cell.pairs if meter is None else allowed_answer(meter.report(depths))
    same = {"allowed_collisions": told, **in_frame(chain), **notes_of(body, cell.notes)}
    if joints.ndim == 1:
        return to_json(verdicts[0] | same, inf_nan_mode="null")
    together = {name: [one[name] for one in verdicts] for name in verdicts[0]}
    return to_json(together | same, inf_nan_mode="null")


def _late(done: int, count: int, *, depth: bool) -> TaskProblem:
    """The problem that time was up before all configurations were looked at."""
    instead = ', or leave depths out with "depth": false' if depth else ""
    return TaskProblem(
        "TIMED_OUT",
        f"the deadline passed when {done} of {count} configurations were checked",
        f"Allow more time with the field timeout, send fewer at once{instead}.",
        {"stage": "check", "checked": done},
    )


@task
def project(scene: Reference, content: bytes) -> bytes | TaskProblem:
    """Answer a request for the orthogonal projections of points onto every obstacle."""
    body = ProjectRequest.model_validate_json(content)
    surroundings = worker_cache.scene(scene)
    obstacles, frame = surroundings.obstacles, only_frame(surroundings)
    count = len(body.points) * len(obstacles)
    most = _MAX_FCL_PROJECTIONS if body.engine == "fcl" else _MAX_PROJECTIONS
    if count > most:
        return TaskProblem(
            "PAYLOAD_TOO_LARGE",
            f"{len(body.points)} points and {len(obstacles)} obstacles make {count} projections, "
            f"at most {most} are answered at once",
            "Send the points in several requests.",
            {"stage": "request"},
        )
    if not obstacles:
        return to_json({"projections": [[] for _ in body.points], "frame": frame})
    projector = FclProjector(obstacles) if body.engine == "fcl" else Projector(obstacles)
    projections, distances = projector(np.array(body.points))
    rows = zip(projections.tolist(), distances.tolist(), strict=True)
    answers = [
        [
            {"obstacle": obstacle.id, "projection": point, "distance": distance}
            for obstacle, point, distance in zip(obstacles, *row, strict=True)
        ]
        for row in rows
    ]
    return to_json({"projections": answers, "frame": frame})
