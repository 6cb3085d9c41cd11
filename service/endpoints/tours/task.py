"""Tours as requests ask for them, in workers."""

from functools import partial

from pydantic_core import to_json

from armwright_wire.plans.tour import TourRequest
from planning.result import Failure
from planning.tours.planner import plan_tour
from planning.tours.result import Tour
from service.endpoints.attached_objects import robot_in_scene
from service.endpoints.plan.task import refusal, reproducibility
from service.endpoints.tours.translation import (
    tour_answer,
    tour_options,
    tour_problem,
)
from service.storage.caches import worker_cache
from service.storage.caches.cache_key import Reference
from service.translate import certificates, timings
from service.translate.poses import rounding_notes
from service.translate.states import configuration
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
    start = None
    if body.start is not None:
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
        bounds = timings.given_limits(body.limits, cell.robot.chain.joint_names)
        for leg, told in zip(found.legs, answer["legs"], strict=True) if body.witness else ():
            told["certificate"]["witness"] = certificates.part_witness(
                leg.trajectory, (cell.robot, cell.scene), leg.certificate, bounds, deadline
            )
        answer |= in_frame(cell.robot.chain)
        answer["reproducibility"] = reproducibility(
            body, cell.robot, cell.scene, deterministic=found.deterministic
        )
        return to_json(answer, inf_nan_mode="null")

    outcome = plan_tour(
        problem, options, current.report, lambda found: current.offer(partial(written, found))
    )
    return refusal(outcome) if isinstance(outcome, Failure) else written(outcome)
