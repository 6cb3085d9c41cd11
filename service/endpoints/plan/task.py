"""Planning and validation as requests ask for them, in workers."""

import dataclasses
import hashlib
import platform
from collections.abc import Mapping
from dataclasses import asdict
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import ValidationError
from pydantic_core import from_json, to_json

from armwright_wire.motions.trajectory import TrajectoryBody
from armwright_wire.plans.plan import Collisions, PlanRequest, ValidateRequest
from kinematics.errors import InvalidRobotDescription
from kinematics.model.chain import Chain
from kinematics.trajectory.trajectory import Trajectory
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene
from planning.options import Options
from planning.pipeline import pipeline
from planning.pipeline.moving_start import Splice
from planning.problem import Problem
from planning.proof.certificate import certify, with_path
from planning.result import Descent, Failure, Plan
from planning.stops.certificate import Surroundings, certify_stops
from planning.values.limits import MotionLimits
from planning.witness.compact import Witness
from planning.witness.witness import witness
from service.endpoints.attached_objects import RobotInScene, robot_in_scene, with_surroundings
from service.storage.caches import worker_cache
from service.storage.caches.cache_key import Reference
from service.storage.caches.mounts import stage_tools, with_tool_names
from service.translate import certificates, problems, timings, trajectories
from service.translate.constraints import constraint_set
from service.translate.frames import (
    Frames,
    constraints_in_root_frame,
    first_configuration,
    names_frame,
    plan_in_root_frame,
    tool_motions_in_root_frame,
    with_states,
)
from service.translate.poses import notes_of, rounding_notes
from service.translate.tool_motions import (
    reference_answer,
    timed_tool_motions,
    tool_motions_answer,
)
from service.version import VERSION
from service.workers import current
from service.workers.answer import in_frame
from service.workers.result import PlanOutcome, TaskProblem, overdue, timed_out, validation_fault
from service.workers.task import GRACE, task

if TYPE_CHECKING:
    from armwright_wire.plans.task import TaskRequest
    from armwright_wire.plans.tour import TourRequest

#: Note on a descent of points in place of bodies.
_BODILESS = (
    "the robot has no solids: obstacles push its control points, and no collision is proved absent"
)
#: What a plan depends on beside the request.
_PACKAGES = ("numpy", "scipy", "numba", "ompl", "python-fcl")
#: How far a plan is when a stage begins, by how long the stages before it usually take.
_PROGRESS = {
    "preflight": 0.0,
    "straight_line": 0.1,
    "shortcut": 0.6,
    "clearance": 0.65,
    "path_proof": 0.68,
    "timing": 0.7,
    "certificate": 0.85,
    "stops": 0.9,
}
_SOLIDS_HINT = (
    'Give the robot solids ("visual_solids": true of a URDF, "geometry": {"capsules": radius} of a '
    'DH table), leave the obstacles out, or say "collisions": "ignore".'
)
#: The same for every planner that searches.
_SEARCHING = 0.2


@task(grace=GRACE)
def plan(
    robot: Reference, scene: Reference | None, content: bytes, left: bytes | None = None
) -> PlanOutcome | TaskProblem:
    """Answer a request for a plan.

    Args:
        robot: The robot.
        scene: The scene, where the request names a stored one.
        content: The request, which may be malformed.
        left: The motion that its start leaves, JSON, where it names one.

    Raises:
        ArmwrightError: The request is at fault.
    """
    try:
        body = PlanRequest.model_validate_json(content)
    except ValidationError as error:
        return validation_fault(error)
    return plan_outcome(robot, scene, body, framed=names_frame(content), left=left)


def plan_outcome(
    robot: Reference,
    scene: Reference | None,
    body: PlanRequest,
    *,
    framed: bool,
    left: bytes | None = None,
) -> PlanOutcome | TaskProblem:
    """The plan that a request asks for, within the deadline of the current job.

    Args:
        robot: The robot.
        scene: The stored scene, where there is one.
        body: The request.
        framed: Whether the request may name a frame.
        left: The motion that its start leaves, JSON, where it names one.

    Raises:
        NotPrepared: The robot or the scene has to be prepared first.
        ArmwrightError: The request is at fault.
    """
    read, splice = rounding_notes(body), None
    if left is not None:
        splice = _splice(worker_cache.chain(robot), body, left)
        joints = splice.motion.sample([splice.at])[0].tolist()
        start = body.start.model_copy(update={"joints": joints, "plan": None, "at": None})
        body = body.model_copy(update={"start": start})
    body, cell, problem = _posed(robot, scene, body, framed=framed)
    observer = _report_stage if current.is_followed() else None
    remaining = current.deadline().remaining
    if remaining <= 0.0:
        return timed_out("the work was done", "certificate")
    options = problems.options(body, cell.robot.chain, remaining, observer)
    if splice is not None:
        problem = splice.begins(problem)
    outcome = pipeline.plan(problem, options)
    if splice is not None:
        outcome = splice.join(outcome, problem, options)
    if isinstance(outcome, Failure):
        details = {"stages": problems.stages_answer(outcome.stages)}
        return refusal(outcome, details)
    outcome = dataclasses.replace(outcome, notes=(*read, *cell.notes, *outcome.notes))
    if problem.field_cell is not None and body.collisions == "check":
        outcome = dataclasses.replace(
            outcome,
            certificate=dataclasses.replace(outcome.certificate, verified=False),
            notes=(*outcome.notes, _BODILESS),
        )
    answer = _answer(outcome, body, cell)
    if body.witness:
        found = plan_witness(problem, options, outcome.trajectory)
        answer["certificate"]["witness"] = certificates.witness_answer(found)
    content = to_json(answer, inf_nan_mode="null")
    stages = [(stage.name, 1e-3 * stage.milliseconds) for stage in outcome.stages]
    return PlanOutcome(content, outcome.planner, tuple(stages))


def _splice(chain: Chain, body: PlanRequest, left: bytes) -> Splice:
    """The place at which a plan leaves a kept motion."""
    motion, begins = trajectories.trajectory(TrajectoryBody.model_validate_json(left), chain)
    return Splice(motion, (body.start.at or 0.0) - begins)


def plan_witness(problem: Problem, options: Options, motion: Trajectory) -> Witness:
    """Witness of a motion that was planned.

    Args:
        problem: What it was planned for.
        options: How.
        motion: The motion.
    """
    limits = pipeline.proved_limits(problem, options)
    cartesian = options.planner == "cartesian"
    if cartesian:
        limits = dataclasses.replace(limits, holds_jerk=False)
    return witness(
        motion,
        problem.robot,
        problem.scene,
        margin=problem.margin,
        limits=limits,
        constraints=problem.constraints,
        untold={
            "tool_motions": max(len(options.cartesian.motions), 1) if cartesian else 0,
            "path": int(options.path_tolerance is not None),
        },
        deadline=current.deadline(),
    )


def question(
    robot: Reference, scene: Reference | None, content: bytes
) -> tuple[PlanRequest, RobotInScene, Problem]:
    """A request for a plan as a question: its body in the root frame, the cell, and the problem.

    Args:
        robot: The robot.
        scene: The scene, where the request names a stored one.
        content: The request.

    Raises:
        ArmwrightError: The request is at fault.
    """
    body = PlanRequest.model_validate_json(content)
    return _posed(robot, scene, body, framed=names_frame(content))


def _posed(
    robot: Reference, scene: Reference | None, body: PlanRequest, *, framed: bool
) -> tuple[PlanRequest, RobotInScene, Problem]:
    geometry = worker_cache.robot(robot).geometry
    body = with_states(body, geometry.states)
    start = first_configuration(geometry.chain, body.start.joints)
    around = with_surroundings(geometry, scene, body, start)
    if framed:
        body = plan_in_root_frame(body, geometry.chain)
    collisions = body.collisions
    if body.planner == "potential_field" and around.scene.obstacles and not around.robot.has_solids:
        # The field acts on points, which need no solids; a fallback has nothing to keep clear.
        collisions = "ignore"
        given: dict[str, Any] = {"fallback": None, **(body.planner_options or {})}
        body = body.model_copy(update={"planner_options": given})
    cell = _collision_cell(around, collisions)
    problem = problems.problem(body, cell.robot, cell.scene, cell.chain)
    if collisions == "ignore":
        problem = dataclasses.replace(problem, field_cell=(around.robot, around.scene))
    return body, cell, problem


def _report_stage(stage: str) -> None:
    current.report(_PROGRESS.get(stage, _SEARCHING), stage)


@task(grace=GRACE)
def validate(robot: Reference, scene: Reference | None, content: bytes) -> bytes | TaskProblem:
    """Answer a request for the proof of a motion, with the certificate or the first violation.

    Raises:
        ArmwrightError: The request is at fault.
    """
    body = ValidateRequest.model_validate_json(content)
    chain = worker_cache.chain(robot)
    motion, begins, cell = proof_question(robot, scene, body)
    arm = cell.robot
    frames = Frames(chain, motion.start, body.frame)
    limits = MotionLimits(
        timings.limits(body.limits, arm.chain), timings.effort_loads(body, arm.chain)
    )
    wanted = constraint_set(constraints_in_root_frame(body.constraints, frames), cell.chain)
    tool_motions = tool_motions_in_root_frame(body.tool_motions, frames)
    certificate = certify(
        motion,
        arm,
        cell.scene,
        margin=body.margin,
        limits=limits,
        constraints=wanted,
        tool_motions=timed_tool_motions(tool_motions, arm.chain, motion, begins),
        deadline=current.deadline(),
    )
    if (late := overdue(certificate)) is not None:
        return late
    if body.path is not None:
        path = timings.joint_path(body.path, arm.chain)[1]
        certificate = with_path(certificate, motion, path, body.path.tolerance)
    answer = certificates.certificate_answer(certificate, begins, body.scene)
    if body.stops != "none":
        around = Surroundings(arm, cell.scene, body.margin, limits)
        stops = certify_stops(motion, certificate, around, body.stops, current.deadline())
        if stops.late:
            return timed_out("the work was done", "stops")
        answer |= certificates.stops_answer(stops, begins)
    if body.witness:
        found = witness(
            motion,
            arm,
            cell.scene,
            margin=body.margin,
            limits=limits,
            constraints=wanted,
            untold={
                "tool_motions": len(body.tool_motions.motions) if body.tool_motions else 0,
                "path": int(body.path is not None),
            },
            deadline=current.deadline(),
        )
        answer["witness"] = certificates.witness_answer(found)
    return to_json(answer | in_frame(chain) | notes_of(body, cell.notes), inf_nan_mode="null")


def proof_question(
    robot: Reference, scene: Reference | None, body: ValidateRequest
) -> tuple[Trajectory, float, RobotInScene]:
    """A request for a proof as a question: the motion, when it begins [s], and the cell.

    Args:
        robot: The robot.
        scene: The scene, where the request names a stored one.
        body: The request.

    Raises:
        ArmwrightError: The request is at fault.
    """
    motion, begins = trajectories.trajectory(body.trajectory, worker_cache.chain(robot))
    around = robot_in_scene(robot, scene, body, motion.start)
    return motion, begins, _collision_cell(around, body.collisions)


def _collision_cell(cell: RobotInScene, collisions: Collisions) -> RobotInScene:
    """The robot and the scene as far as collisions are looked at.

    Raises:
        InvalidRobotDescription: There are obstacles, and the robot has no collision geometry.
    """
    robot = cell.robot
    if collisions == "ignore":
        none = np.zeros(0, dtype=np.int64)
        bare = RobotGeometry(robot.chain, (), (), none, none, {})
        return dataclasses.replace(cell, robot=bare, scene=Scene())
    check_solids(robot, cell.scene, _SOLIDS_HINT)
    return cell


def check_solids(robot: RobotGeometry, scene: Scene, hint: str) -> None:
    """Check that a robot among obstacles has solids of which something can be proved.

    Raises:
        InvalidRobotDescription: It has none; with a hint.
    """
    if scene.obstacles and not robot.has_solids:
        raise InvalidRobotDescription(
            f"robot {robot.chain.name!r} has no collision geometry, so nothing could be proved of "
            f"the {len(scene.obstacles)} obstacle(s)",
            hint=hint,
            reason="no_collision_geometry",
        )


def refusal(failure: Failure, more: Mapping[str, Any] = MappingProxyType({})) -> TaskProblem:
    """Problem of a failure of planning, with more details."""
    details = {**problems.plain(failure.details), **more, "stage": failure.stage}
    return TaskProblem(failure.code, failure.message, failure.hint, details)


def _answer(planned: Plan, body: PlanRequest, cell: RobotInScene) -> dict[str, Any]:
    certificate = certificates.certificate_answer(planned.certificate, scene=body.scene)
    if planned.stops is not None:
        certificate |= certificates.stops_answer(planned.stops)
    cartesian = planned.fraction is not None
    return {
        "status": "success",
        **in_frame(cell.robot.chain),
        "planner": planned.planner,
        "stages": problems.stages_answer(planned.stages),
        "path": {"joints": planned.path.waypoints.tolist(), "length": planned.path.length},
        "trajectory": trajectories.trajectory_answer(
            planned.trajectory, body.timing.sample_period, count=body.timing.sample_count
        ),
        "certificate": certificate,
        "reproducibility": reproducibility(
            body, cell.robot, cell.scene, deterministic=planned.deterministic
        ),
        "fraction": planned.fraction,
        "tool_motions": tool_motions_answer(planned.tool_motions) if cartesian else None,
        "reference": reference_answer(cell.robot.chain, planned, body.seed) if cartesian else None,
        "stopped": None if planned.stopped is None else problems.plain(planned.stopped),
        "notes": list(planned.notes),
        "potential_field": None if planned.descent is None else _descent(planned.descent),
        "clearance": None
        if planned.clearance is None
        else problems.clearance_answer(planned.clearance),
        "configuration": planned.configuration and asdict(planned.configuration),
        "timing": timings.timing_answer(planned.timing, planned.trajectory),
        "progress": [asdict(step) for step in planned.progress],
    }


def _descent(found: Descent) -> dict[str, Any]:
    return {
        "joints": found.waypoints.tolist(),
        "potentials": found.potentials.tolist(),
        "iterations": found.iterations,
    }


def reproducibility(
    body: "PlanRequest | TaskRequest | TourRequest",
    robot: RobotGeometry,
    scene: Scene,
    *,
    deterministic: bool,
) -> dict[str, Any]:
    """Fields of an answer that say what it depends on.

    Args:
        body: The request; whether its answer is kept or has a witness does not change its hash, nor
            does its tool, which is a part of the robot.
        robot: The robot.
        scene: The scene.
        deterministic: Whether the same request has the same answer.
    """
    content = body.model_dump_json(exclude={"keep", "tool", "tcp", "witness"}).encode()
    stages = getattr(body, "stages", ())
    if stages and any(stage_tools(stages)):
        content = to_json(with_tool_names(from_json(content)))  # as kept requests have documents
    return {
        "seed": body.seed,
        "deterministic": deterministic,
        "robot_hash": robot.content_hash,
        "scene_hash": scene.content_hash,
        "request_hash": hashlib.sha256(content).hexdigest(),
        "versions": _versions(),
    }


@cache
def _versions() -> dict[str, str]:
    answer = {"armwright": VERSION, "python": platform.python_version()}
    for package in _PACKAGES:
        try:
            answer[package] = version(package)
        except PackageNotFoundError:
            answer[package] = "unknown"
    return answer
