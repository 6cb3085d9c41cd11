"""Closed loops as requests ask for them, in workers."""

import dataclasses
from typing import NamedTuple

import numpy as np
from pydantic_core import to_json

from armwright_wire.motions import simulation as schema
from armwright_wire.motions.simulation import SimulateRequest
from kinematics.arrays import Array
from kinematics.model.chain import Chain
from kinematics.trajectory.trajectory import Trajectory
from service.endpoints.attached_objects import robot_in_scene
from service.endpoints.simulate import translation
from service.endpoints.simulate.notes import request_notes, simulation_notes
from service.endpoints.simulate.tracking_tube import tube_answer
from service.endpoints.simulate.translation import controller
from service.storage.caches import worker_cache
from service.storage.caches.cache_key import Reference
from service.translate import trajectories
from service.workers import current
from service.workers.result import TaskProblem
from service.workers.task import GRACE, task
from tracking.simulation.references import hold, sine, spline, step
from tracking.simulation.simulation import simulate as close_loop


class RequestReference(NamedTuple):
    """The reference of a request.

    Args:
        motion: Motion as a trajectory.
        begins: Time of the motion's beginning, as the request counts [s].
        rest: Configuration of rest before the motion, shape (n,) [rad or m]; None at the motion's
            start.
    """

    motion: Trajectory
    begins: float
    rest: Array | None


def reference(body: SimulateRequest, chain: Chain) -> RequestReference:
    """The reference of a request, a trajectory or one by name.

    Raises:
        InvalidTrajectory: Joints or lengths do not fit the robot, or times do not ascend.
        InvalidRobotState: A vector has the wrong length.
        InvalidOption: A value is out of its range.
    """
    named = body.reference
    if named is None:
        assert body.trajectory is not None
        motion, begins = trajectories.trajectory(body.trajectory, chain)
        return RequestReference(motion, begins, None)
    if isinstance(named, schema.Step):
        motion = step(chain, named.start, named.end, named.at, named.duration)
        return RequestReference(motion, 0.0, np.array(named.start))
    if isinstance(named, schema.Hold):
        motion = hold(chain, named.joints, named.duration)
    elif isinstance(named, schema.Sine):
        shape = named.center, named.amplitude, named.frequency, named.phase
        motion = sine(chain, *shape, named.duration)
    else:
        motion = spline(chain, named.points, named.times, named.interpolation)
    return RequestReference(motion, 0.0, None)


@task(grace=GRACE)
def simulate(robot: Reference, scene: Reference | None, content: bytes) -> bytes | TaskProblem:
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
