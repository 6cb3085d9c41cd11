"""Identification as requests ask for it, in workers."""

import json
from typing import Any

import numpy as np
from pydantic_core import to_json

from armwright_wire.motions.excitation import ExcitationRequest
from armwright_wire.pose import Pose
from armwright_wire.robots.calibration import CalibrateRequest
from armwright_wire.robots.identification import (
    IdentifyRequest,
    LogBody,
)
from armwright_wire.robots.payload import Payload
from dynamics.identification.identify import Identification, identify_payload
from dynamics.identification.identify import identify as identify_robot
from dynamics.identification.log import Log
from dynamics.identification.unknowns import DRIVES
from kinematics.arrays import Array
from kinematics.calibration.calibrate import NAMES, SIX, Measured, margins, poses_of
from kinematics.calibration.calibrate import calibrate as calibrate_arm
from kinematics.errors import InvalidOption
from kinematics.model.chain import Chain
from obstacles.robots.robot_geometry import RobotGeometry
from planning.excitation import ExcitationOptions, excite
from planning.result import Failure
from service.endpoints.attached_objects import robot_in_scene
from service.endpoints.plan.task import refusal
from service.storage.caches import worker_cache
from service.storage.caches.cache_key import Reference
from service.translate import certificates, poses, trajectories
from service.translate.payload import inertias_answer, link_inertia
from service.workers import current
from service.workers.answer import in_frame
from service.workers.result import TaskProblem, timed_out
from service.workers.task import GRACE, task


@task
def identify(robot: Reference, content: bytes) -> bytes:
    """Answer a request to identify a robot or its load.

    Args:
        robot: The robot.
        content: The request.

    Raises:
        ArmwrightError: The request is at fault.
    """
    body = IdentifyRequest.model_validate_json(content)
    chain = worker_cache.chain(robot)
    logs = [_log(one, chain) for one in body.logs]
    if body.find == "payload":
        offsets = "offset" in (body.drives or ())
        found = identify_payload(chain, logs, link=body.link, offsets=offsets, cutoff=body.cutoff)
    else:
        drives = tuple(DRIVES) if body.drives is None else body.drives
        found = identify_robot(chain, logs, drives=drives, cutoff=body.cutoff)
    return to_json(identification_answer(found, len(logs)) | in_frame(chain))


def identification_answer(found: Identification, logs: int) -> dict[str, object]:
    """Fields of the answer to an identification from so many logs."""
    columns = (found.torques, found.residuals, found.consistent_residuals, found.offsets)
    names = ("torque", "residual", "consistent_residual", "offset")
    rows = np.array(columns).T.tolist()
    payload, inertias = None, None
    if found.load is not None:
        payload = Payload(link=found.link, **link_inertia(found.load).model_dump())
    if found.bodies is not None:
        origin = (
            f"identified from {logs} log(s) of {found.samples} instants, residuals of "
            f"{found.consistent_residuals.min():.3g} to {found.consistent_residuals.max():.3g}"
        )
        inertias = inertias_answer(found.bodies, origin)
    return {
        "parameters": [
            {name: getattr(each, name) for name in each.__slots__} for each in found.parameters
        ],
        "not_excited": found.not_excited,
        "joints": [
            {"joint": joint, **dict(zip(names, row, strict=True))}
            for joint, row in zip(found.robot.joint_names, rows, strict=True)
        ],
        "condition": found.condition,
        "samples": found.samples,
        "inertias": inertias,
        "payload": payload,
        "notes": found.notes,
    }


def _log(body: LogBody, chain: Chain) -> Log:
    if body.torques is not None:
        torques = chain.configuration(body.torques, "torques")
    else:
        assert body.gains is not None
        gains: Array = np.array(body.gains)
        if len(gains) != chain.n:
            raise InvalidOption(
                f"there are {len(gains)} gains for the {chain.n} joints of robot {chain.name!r}",
                hint=f"One each, in the order {', '.join(chain.joint_names)}.",
            )
        torques = gains * chain.configuration(body.currents or [], "currents")
    times = body.period if body.times is None else body.times
    return Log(body.positions, torques, times, body.velocities, body.accelerations)


@task(grace=GRACE)
def excitation(robot: Reference, scene: Reference | None, content: bytes) -> bytes | TaskProblem:
    """Answer a request for an exciting motion.

    Args:
        robot: The robot.
        scene: The scene, where the request names a stored one.
        content: The request.

    Raises:
        ArmwrightError: The request is at fault.
    """
    body = ExcitationRequest.model_validate_json(content)
    start = None if body.start is None else np.array(body.start)
    cell = robot_in_scene(robot, scene, body, start)
    names = ("period", "harmonics", "velocity_scaling", "acceleration_scaling", "margin",
             "evaluations", "seed")  # fmt: skip
    options = ExcitationOptions(
        drives=tuple(DRIVES) if body.drives is None else body.drives,
        **{name: getattr(body, name) for name in names},
    )
    deadline = current.deadline()
    found = excite(cell.robot, cell.scene, start, options, deadline=deadline)
    if isinstance(found, Failure):
        if deadline is not None and deadline.passed:
            return timed_out("an exciting motion was proved", "excitation")
        return refusal(found)
    answer = {
        "trajectory": trajectories.trajectory_answer(found.trajectory, body.sample_period),
        "certificate": certificates.certificate_answer(found.certificate, scene=body.scene),
        "condition": found.condition,
        "base_parameters": found.names,
        "notes": [*poses.rounding_notes(body), *cell.notes],
    }
    return to_json(answer, inf_nan_mode="null")


@task(grace=GRACE)
def calibrate(robot: Reference, content: bytes) -> bytes:
    """Answer a request to calibrate a robot.

    Args:
        robot: The robot.
        content: The request.

    Raises:
        ArmwrightError: The request is at fault.
    """
    body = CalibrateRequest.model_validate_json(content)
    prepared = worker_cache.robot(robot)
    geometry = prepared.geometry
    chain = geometry.chain
    made = body.tolerance
    tolerance = (1e-3, 1e-3) if made is None else (made.position, made.rotation)
    found = calibrate_arm(
        chain,
        body.joints,
        _measured(body),
        link=body.link,
        unknown=body.unknown,
        tolerance=tolerance,
    )
    sure, described = margins(chain, found, _reaches(geometry))
    frames = [*chain.joint_names, "tip", "frame"]
    numbers = (found.corrections, found.standard_errors, found.determined)
    names = ("value", "standard_error", "determined")
    rows = zip(*(each.ravel().tolist() for each in numbers), strict=True)
    X = poses_of(found.corrections)
    noise = dict(zip(("position", "rotation"), found.noise, strict=True))
    origin = f"measured in {len(body.joints)} configurations, {found.after:.2g} m are left"
    stored = json.loads(prepared.answer)["calibration"]
    answer = {
        "corrections": [
            {
                "joint": frames[i // 6],
                "parameter": NAMES[i % 6],
                **dict(zip(names, row, strict=True)),
            }
            for i, row in enumerate(rows)
            if frames[i // SIX] != "frame" or "frame" in body.unknown
        ],
        "identifiable": found.identifiable,
        "noise": noise,
        "error_before": found.before,
        "error_after": found.after,
        "margins": [
            {"joint": name, "calibrated": a, "described": b}
            for name, a, b in zip(chain.joint_names, sure.tolist(), described.tolist(), strict=True)
        ],
        "calibration": {"origin": origin, **_behind(stored, chain, X)},
        "tip": poses.pose_answer(X[-2]),
        "measurement_frame": poses.pose_answer(X[-1]),
        "notes": poses.rounding_notes(body),
    }
    return to_json(answer | in_frame(chain))


def _measured(body: CalibrateRequest) -> Measured:
    plane = None
    if body.plane is not None:
        normal = np.array(body.plane.normal)
        length = float(np.linalg.norm(normal))
        if length == 0.0:
            raise InvalidOption("plane.normal is 0", hint="Give a direction.")
        plane = np.append(normal, normal @ np.array(body.plane.point)) / length
    points, distances, anchor = (
        None if rows is None else np.array(rows)
        for rows in (body.positions, body.distances, body.anchor)
    )
    measured = None if body.poses is None else np.array([poses.transform(T) for T in body.poses])
    noise = None if body.noise is None else (body.noise.position, body.noise.rotation)
    return Measured(measured, points, distances, anchor, plane, noise)


def _reaches(geometry: RobotGeometry) -> Array:
    """How far the solids of each joint's bodies reach from its frame's origin, shape (n,) [m]."""
    reaches = np.zeros(geometry.chain.n)
    for piece, joint in zip(geometry.pieces, geometry.joints.tolist(), strict=True):
        if 0 <= joint < len(reaches):
            center, radius = piece.bounding_sphere()
            reaches[joint] = max(reaches[joint], float(np.linalg.norm(center)) + radius)
    return reaches


def _behind(stored: Any, chain: Chain, X: Array) -> dict[str, object]:
    """Corrections (n + 2, 4, 4) behind those that a robot has already, as robots take them."""
    before = stored if isinstance(stored, dict) else {"joints": {}, "file": stored}
    joints = {}
    for name, T in zip(chain.joint_names, X, strict=False):
        first = before["joints"].get(name)
        T_first = np.eye(4) if first is None else poses.transform(Pose.model_validate(first))
        joints[name] = poses.pose_answer(T_first @ T).model_dump()
    return {"joints": joints, "file": before.get("file")}
