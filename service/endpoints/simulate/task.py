"""Closed loops as requests ask for them, in workers."""

import dataclasses

from pydantic_core import to_json

from armwright_wire.simulation import SimulateRequest
from service.endpoints.attached_objects import robot_in_scene
from service.endpoints.simulate import translation
from service.endpoints.simulate.controllers import controller
from service.endpoints.simulate.notes import request_notes, simulation_notes
from service.endpoints.simulate.references import reference
from service.endpoints.simulate.tracking_tube import tube_answer
from service.storage import worker_cache
from service.storage.cache_key import Reference
from service.workers import current
from service.workers.answer import reports_cache_miss
from service.workers.result import CacheMiss, TaskProblem
from service.workers.task import GRACE, task
from tracking.simulation.simulation import simulate as close_loop


@task(grace=GRACE)
@reports_cache_miss
def simulate(
    robot: Reference, scene: Reference | None, content: bytes
) -> bytes | TaskProblem | CacheMiss:
    """Answer a request for a closed loop, and with a scene for its tracking tube.

    Args:
        robot: The robot.
        scene: The scene, where the request names a stored one.
        content: The request.

    Raises:
        ArmwrightError: The request is at fault.
    """
    body = SimulateRequest.model_validate_json(content)
    motion, begins, rest = reference(body, worker_cache.chain(robot))
    cell = robot_in_scene(robot, scene, body, motion.start)
    geometry = cell.robot
    own = worker_cache.motors(robot)
    true, model = translation.robot_and_model(geometry.chain, body, own)
    used = controller(body.controller, model, motion)
    q, qd = translation.initial_state(body.initial_state, true, motion, rest)
    options = translation.options(body, motion)
    duration = motion.duration if options.duration is None else options.duration
    result = close_loop(
        used,
        motion,
        options,
        robot=true,
        initial_position=q,
        initial_velocity=qd,
        disturbance=translation.disturbance(body.disturbance, begins, duration),
        noise=translation.noise(body),
    )
    requested = translation.request_motors(true, body)
    motors = own if requested is None else requested
    answer = translation.simulation_answer(result, used, true, begins, motors)
    answer["notes"] = request_notes(body, used) + simulation_notes(
        motion, true, used, result, begins, has_stops=options.stops is not None
    )
    if body.scene is not None:
        limited = dataclasses.replace(
            geometry, chain=dataclasses.replace(geometry.chain, limits=true.limits)
        )
        answer["tube"] = tube_answer(limited, cell.scene, motion, result, current.deadline())
    return to_json(answer, inf_nan_mode="null")
