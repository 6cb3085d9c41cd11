"""Timing of given paths, and motions in other shapes, as requests ask for them, in workers."""

from dataclasses import replace
from typing import Any

import numpy as np
from pydantic_core import to_json

from armwright_wire.motions.retime import (
    ConvertRequest,
    FitRequest,
    RetimePath,
    RetimeRequest,
    SimplifyRequest,
)
from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from kinematics.model.chain import Chain
from kinematics.trajectory.export import csv_text, joint_trajectory
from kinematics.trajectory.trajectory import Trajectory
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene
from planning.proof.certificate import Certificate, certify
from planning.retiming.retime import retime as time_again
from planning.retiming.retime import with_path_stops
from planning.retiming.retimed import Retimed
from planning.retiming.simplify import TipTolerance, fit_motion
from planning.retiming.simplify import simplify as simplified
from planning.retiming.state_motion import time_states
from planning.values.limits import MotionLimits
from service.endpoints.attached_objects import robot_in_scene
from service.fields import picked
from service.storage.caches import worker_cache
from service.storage.caches.cache_key import Reference
from service.translate import certificates, timings, trajectories
from service.translate.poses import rounding_notes
from service.workers import current
from service.workers.result import TaskProblem, overdue
from service.workers.task import GRACE, task

#: Rows of one answer: at half a kilobyte each, fifty megabytes.
_MAX_ROWS = 100_000


@task
def retime(robot: Reference | None, content: bytes) -> bytes:
    """Answer a request to time a path, or the motion between two states.

    Args:
        robot: The robot, if one is named.
        content: The request.

    Raises:
        ArmwrightError: The request is at fault, or the path can't be timed within its limits.
    """
    body = RetimeRequest.model_validate_json(content)
    chain = None if robot is None else worker_cache.robot(robot).chain
    timed = _time_path(body, chain) if body.path is not None else _time_states(body, chain)
    limits = timings.given_limits(body.limits, timed.trajectory.joint_names)
    timed = with_path_stops(timed, body.stops, chain, limits)
    motion, begins = timed.trajectory, timed.begins
    period, count = body.timing.sample_period, body.timing.sample_count
    answer = {
        "status": "success" if timed.certificate.verified else "unverified",
        "trajectory": trajectories.trajectory_answer(motion, period, begins, count),
        "certificate": certificates.certificate_answer(timed.certificate, begins)
        | certificates.stops_answer(timed.stops, begins),
        **picked(timed, "factor", "needed_factor"),
        "timing": timings.timing_answer(timed.timing, motion, begins),
        "notes": timed.notes,
        "peaks": {name: row.tolist() for name, row in timed.peaks.items()},
    }
    return to_json(answer, inf_nan_mode="null")


def _time_path(body: RetimeRequest, chain: Chain | None) -> Retimed:
    assert body.path is not None
    path = timings.path_to_time(body.path, chain, body.limits_at)
    limits = timings.given_limits(body.limits, path.joint_names)
    return time_again(path, timings.timing_options(body.timing), limits, chain)


def _time_states(body: RetimeRequest, chain: Chain | None) -> Retimed:
    assert body.start is not None
    names = timings.joint_names(body.joint_names, len(body.start.position), chain, "")
    states = timings.joint_state(body.start, "from"), timings.joint_state(body.end, "to")
    limits = timings.given_limits(body.limits, names)
    options = replace(timings.timing_options(body.timing), method="jerk_limited")
    synchronization = body.synchronization or "phase"
    return time_states(names, states, options, limits, chain, synchronization)


@task(grace=GRACE)
def simplify(
    robot: Reference | None, scene: Reference | None, content: bytes
) -> bytes | TaskProblem:
    """Answer a request to simplify a path.

    Args:
        robot: The robot, if one is named.
        scene: The scene, where the request names a stored one.
        content: The request.

    Raises:
        ArmwrightError: The request is at fault.
    """
    body = SimplifyRequest.model_validate_json(content)
    chain = None if robot is None else worker_cache.chain(robot)
    _, points = timings.joint_path(body.path, chain)
    cell = None if robot is None else robot_in_scene(robot, scene, body, points[0])
    tool = body.tool_tolerance
    found = simplified(
        points,
        body.tolerance,
        None if cell is None else cell.robot,
        None if cell is None else cell.scene,
        tool_tolerance=None if tool is None else TipTolerance(tool.position, tool.orientation),
        margin=body.margin,
        deadline=current.deadline(),
    )
    proof = found.certificate
    if (late := overdue(proof)) is not None:
        return late
    notes = [] if cell is None else [*rounding_notes(body), *cell.notes]
    answer = {
        "status": "success" if proof is None or proof.verified else "unverified",
        "joints": found.waypoints.tolist(),
        "waypoints": found.numbers.tolist(),
        "left_out": len(points) - len(found.numbers),
        "deviation": found.deviation,
        "tool_deviation": None
        if tool is None or found.tool_use is None
        else {
            name: None if within is None else within * found.tool_use
            for name, within in (("position", tool.position), ("orientation", tool.orientation))
        },
        "certificate": None
        if proof is None
        else certificates.certificate_answer(proof, scene=body.scene),
        "notes": [*notes, *found.notes],
    }
    return to_json(answer, inf_nan_mode="null")


@task(grace=GRACE)
def fit(robot: Reference | None, content: bytes) -> bytes:
    """Answer a request to fit a recorded motion, or to time its geometry anew.

    Args:
        robot: The robot, if one is named.
        content: The request.

    Raises:
        ArmwrightError: The request is at fault.
    """
    body = FitRequest.model_validate_json(content)
    rows = np.array(timings.equal_rows(body.samples.position, "samples.position"))
    geometry = None if robot is None else worker_cache.robot(robot).geometry
    timed: dict[str, Any] = {"timing": None, "notes": []}
    if body.retime is None:
        found = fit_motion(
            body.samples.time,
            rows,
            body.tolerance,
            geometry,
            joint_names=body.joint_names,
            rest=body.rest,
            deadline=current.deadline(),
        )
        motion, deviation, proof = found.trajectory, found.deviation, found.certificate
    else:
        motion, proof, timed = _time_record(body, rows, geometry)
        assert proof.path is not None
        deviation = body.tolerance if proof.path.deviation is None else proof.path.deviation
    begins = body.samples.time[0]
    answer = {
        "status": "success" if proof is None or proof.verified else "unverified",
        "trajectory": trajectories.trajectory_answer(motion, None, begins),
        "deviation": deviation,
        "certificate": proof and certificates.certificate_answer(proof, begins),
    }
    return to_json(answer | timed, inf_nan_mode="null")


def _time_record(
    body: FitRequest, rows: Array, robot: RobotGeometry | None
) -> tuple[Trajectory, Certificate, dict[str, Any]]:
    """The motion along a record, timed anew, its proof, and how it was timed."""
    assert body.retime is not None
    chain = None if robot is None else robot.chain
    path = timings.path_to_time(
        RetimePath(joints=rows.tolist(), joint_names=body.joint_names, tolerance=body.tolerance),
        chain,
    )
    limits = timings.given_limits(body.limits, path.joint_names)
    timed = time_again(path, timings.timing_options(body.retime), limits, chain)
    motion, proof = timed.trajectory, timed.certificate
    if robot is not None:
        held = MotionLimits(limits if timed.timing is None else timed.timing.limits)
        whole = certify(motion, robot, Scene(), limits=held, deadline=current.deadline())
        proof = replace(whole, path=proof.path)
    timing = timings.timing_answer(timed.timing, motion, body.samples.time[0])
    return motion, proof, {"timing": timing, "notes": list(timed.notes)}


@task
def convert(content: bytes) -> bytes:
    """Answer a request to tell a motion in another shape.

    Raises:
        ArmwrightError: The request is at fault.
    """
    body = ConvertRequest.model_validate_json(content)
    motion = trajectories.named_trajectory(body.trajectory)
    if motion.duration / body.sample_period > _MAX_ROWS:
        raise InvalidOption(
            f"sample_period: {body.sample_period:g} s over {motion.duration:g} s gives more than "
            f"{_MAX_ROWS} rows",
            hint=f"Give at least {motion.duration / _MAX_ROWS:.3g} s.",
        )
    if body.format == "csv":
        return csv_text(motion, body.sample_period).encode()
    return to_json(joint_trajectory(motion, body.sample_period, body.frame_id))
