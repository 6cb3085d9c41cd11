"""Tours as requests ask for them, in workers."""

from functools import partial
from typing import Any

from pydantic_core import to_json

from armwright_wire.plans.tour import TourRequest
from planning.result import Failure
from planning.tours.planner import plan_tour
from planning.tours.result import Tour
from service.endpoints.attached_objects import RobotInScene, robot_in_scene
from service.endpoints.plan.task import request_hash, versions
from service.endpoints.tours.translation import (
    configuration,
    tour_answer,
    tour_options,
    tour_problem,
)
from service.storage.caches import worker_cache
from service.storage.caches.cache_key import Reference
from service.translate import problems
from service.translate.poses import rounding_notes
from service.workers import current
from service.workers.answer import in_frame
from service.workers.result import TaskProblem, timed_out
from service.workers.task import GRACE, task


@task(grace=GRACE)
def tour(robot: Reference, scene: Reference | None, content: bytes) -> bytes | TaskProblem:
    """Answer a request for a tour.

    Args:
        robot: The robot.
        scene: The scene, where the request names a stored one.
        content: The request.

    Raises:
        ArmwrightError: The request is at fault.
    """
    body = TourRequest.model_validate_json(content)
    geometry = worker_cache.robot(robot).geometry
    start = configuration(body.start, geometry.chain, geometry.states, "start")
    cell = robot_in_scene(robot, scene, body, start)
    problem = tour_problem(body, cell.robot, cell.scene, start)
    deadline = current.deadline()
    if deadline.passed:
        return timed_out("the tour was begun", "configurations")
    options = tour_options(body, cell.robot.chain, deadline.remaining)

    def written(found: Tour) -> bytes:
        answer = tour_answer(found, problem, body.timing.sample_period, body.scene)
        answer["notes"] = [*rounding_notes(body), *cell.notes, *answer["notes"]]
        surroundings = _surroundings(body, cell, deterministic=found.deterministic)
        return to_json(answer | surroundings, inf_nan_mode="null")

    outcome = plan_tour(
        problem, options, current.report, lambda found: current.offer(partial(written, found))
    )
    return _refusal(outcome) if isinstance(outcome, Failure) else written(outcome)


def _refusal(failure: Failure) -> TaskProblem:
    details: dict[str, Any] = problems.plain(failure.details)
    return TaskProblem(
        failure.code, failure.message, failure.hint, details | {"stage": failure.stage}
    )


def _surroundings(body: TourRequest, cell: RobotInScene, *, deterministic: bool) -> dict[str, Any]:
    """Fields of the answer that say what it is about."""
    return {
        **in_frame(cell.robot.chain),
        "reproducibility": {
            "seed": body.seed,
            "deterministic": deterministic,
            "robot_hash": cell.robot.content_hash,
            "scene_hash": cell.scene.content_hash,
            "request_hash": request_hash(body),
            "versions": versions(),
        },
    }
