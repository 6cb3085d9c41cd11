"""Closed loops as requests ask for them, in workers."""

import dataclasses
import math
from typing import Any

import numpy as np
from pydantic_core import to_json

from kinematics.chain import Limits
from kinematics.interpolation import interpolate
from kinematics.trajectory import Trajectory
from obstacles.robot_geometry import RobotGeometry
from obstacles.scene import Scene
from planning.deadline import Deadline
from planning.proof.certificate import certify
from service.schemas.simulation import SimulateRequest
from service.storage.cache_key import Reference
from service.tasks.answer import reports_cache_miss
from service.tasks.attached_objects import robot_in_scene
from service.tasks.result import CacheMiss, TaskProblem
from service.translate import simulations, trajectories
from service.workers import current
from service.workers.task import GRACE, task
from tracking.result import SimulationOutcome, SimulationResult
from tracking.simulation import simulate as close_loop
from tracking.tube import tube

#: Between samples this close [s] the cubic misses an arm's motion by micrometres.
_DENSE = 0.0101
#: Shorter pieces of time are rounding errors [s].
_NO_TIME = 1e-9


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
    cell = robot_in_scene(robot, scene, body)
    geometry = cell.robot
    motion, begins = trajectories.trajectory(body.trajectory, geometry.chain)
    true, model = simulations.robot_and_model(geometry.chain, body)
    used = simulations.controller(body.controller, model, motion)
    q, qd = simulations.initial_state(body.initial_state, true, motion)
    result = close_loop(
        used,
        motion,
        simulations.options(body, motion),
        robot=true,
        initial_position=q,
        initial_velocity=qd,
        disturbance=simulations.disturbance(body.disturbance),
        noise=simulations.noise(body),
    )
    answer = simulations.simulation_answer(result, used, true, begins)
    if body.scene is not None:
        answer["tube"] = _tube(geometry, cell.scene, motion, result, current.deadline())
    return to_json(answer, inf_nan_mode="null")


def _tube(
    arm: RobotGeometry,
    scene: Scene,
    motion: Trajectory,
    result: SimulationResult,
    deadline: Deadline,
) -> dict[str, Any]:
    """Tracking tube, with the clearance that it leaves of the reference's."""
    # Only clearance matters here: /v1/validate holds motions to limits.
    chain = dataclasses.replace(arm.chain, limits=Limits.unlimited(arm.chain.n))
    free = dataclasses.replace(arm, chain=chain)
    certificate = certify(motion, free, scene, deadline=deadline)
    around = tube(arm, motion, result.max_tracking_error)
    clearance = certificate.min_clearance
    remaining = around.remaining_clearance(clearance)
    reason = None
    if result.outcome is not SimulationOutcome.COMPLETED:
        reason = f"the simulation did not reach the end: {result.outcome.value}"
    elif certificate.violation is not None:
        reason = f"the reference itself is not certified: {certificate.violation.message}"
    elif not remaining > 0.0:
        reason = (
            "the robot may be displaced by as much as its reference clears, or more: track "
            "better, or plan with a margin"
        )
    return {
        "joint_error": around.joint_error.tolist(),
        "reach": around.reach.tolist(),
        "displacement": around.displacement,
        "reference_clearance": clearance if math.isfinite(clearance) else None,
        "remaining_clearance": remaining if math.isfinite(remaining) else None,
        "tracked_clearance": _tracked_clearance(free, scene, result, deadline),
        "clears": reason is None,
        "reason": reason,
    }


def _tracked_clearance(
    free: RobotGeometry, scene: Scene, result: SimulationResult, deadline: Deadline
) -> float | None:
    """Certified clearance of the cubic through the samples; None where they are too far apart."""
    steps = np.diff(result.times)
    if len(steps) == 0 or steps.max() > _DENSE:
        return None
    # The end may come right after the last regular sample: a piece of no length is none.
    kept = np.append(True, steps > _NO_TIME)
    tracked = interpolate(
        free.chain.joint_names,
        result.times[kept],
        result.position[kept],
        "cubic",
        result.velocity[kept],
    )
    certificate = certify(tracked, free, scene, deadline=deadline)
    violation = certificate.violation
    if violation is not None and violation.kind == "time":
        return None
    return certificate.min_clearance if math.isfinite(certificate.min_clearance) else None
