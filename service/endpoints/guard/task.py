"""The gate in workers: of a single proposal, and of a session whose messages any worker may get."""

import pickle
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from pydantic import ValidationError
from pydantic_core import from_json, to_json

from armwright_wire.plans.guard import (
    GuardChange,
    GuardOpening,
    GuardRequest,
    GuardState,
    GuardStep,
    SceneChange,
)
from armwright_wire.plans.guard import Proposal as ProposalBody
from armwright_wire.scenes.scene import Scene as SceneBody
from kinematics.model.chain import Chain
from obstacles.scenes.scene import Scene
from planning.guard.gate import Guard, Running, Verdict
from planning.guard.proposals import (
    Proposal,
    SamplesProposal,
    TrajectoryProposal,
    TwistProposal,
    VelocityProposal,
)
from planning.proof.certificate import Certificate
from planning.proof.limits.limit_uses import Violation
from planning.timing.jerk.state_to_state import JointState
from planning.values.limits import MotionLimits
from service.endpoints.attached_objects import robot_in_scene
from service.endpoints.plan.task import check_solids
from service.fields import picked
from service.storage.caches.cache_key import Reference
from service.translate import certificates, poses, problems, timings, trajectories
from service.workers.result import SessionReply, SessionState, TaskProblem, validation_fault
from service.workers.task import GRACE, task

_HINT = "Give the robot solids, or leave the obstacles out."
#: Sessions that a worker keeps the gate of.
_MOST_SESSIONS = 32
#: Fields of faults on the wire, beside kind, time and message.
_TOLD = ("joint", "value", "limit", "pair", "depth")


class _Kept(NamedTuple):
    """The gate of a session, and the state that it is in."""

    state: SessionState
    gate: Guard


_SESSIONS: dict[str, _Kept] = {}


@task(grace=GRACE)
def guard(robot: Reference, scene: Reference | None, content: bytes) -> bytes | TaskProblem:
    """Answer a single proposal.

    Raises:
        ArmwrightError: The request is at fault.
    """
    body = GuardRequest.model_validate_json(content)
    gate = _gate(robot, scene, body)
    return to_json(_propose(gate, body, body.scene), inf_nan_mode="null")


@task(grace=GRACE)
def guard_message(
    robot: Reference, scene: Reference | None, opening: bytes, state: SessionState, content: bytes
) -> SessionReply | TaskProblem:
    """Answer a message of a session: its opening where there is no content, a step or a change.

    Args:
        robot: The robot.
        scene: The scene, where the opening names a stored one.
        opening: The opening.
        state: State of the session.
        content: The message.

    Raises:
        ArmwrightError: The message is at fault.
    """
    message: GuardStep | GuardChange | None = None
    try:
        if content:
            message = _message(content)
    except ValidationError as error:
        return validation_fault(error)
    body = GuardOpening.model_validate_json(opening)
    # Out of those kept until it is answered: a gate that failed is made anew.
    kept = _SESSIONS.pop(state.id, None)
    gate = _session_gate(robot, scene, body, state) if kept is None else kept.gate
    if kept is not None and kept.state != state:
        if kept.state.version != state.version:
            gate = _session_gate(robot, scene, body, state)
        else:
            gate.count, gate.running = state.count, _running(state)
    before, proof = gate.running, None
    if isinstance(message, GuardStep):
        answer = to_json(_propose(gate, message, body.scene), inf_nan_mode="null")
        after = replace(state, count=gate.count)
    elif isinstance(message, GuardChange):
        proof = _change(gate, message.change)
        answer, version = _ready(gate, proof), state.version + 1
        after = replace(state, version=version, scene=pickle.dumps(gate.scene))
    else:
        answer, after = _ready(gate, None), state
    if gate.running is not before:
        after = replace(after, running=pickle.dumps(gate.running))
    _SESSIONS[state.id] = _Kept(after, gate)
    while len(_SESSIONS) > _MOST_SESSIONS:
        del _SESSIONS[next(iter(_SESSIONS))]
    return SessionReply(answer, after)


def _message(content: bytes) -> GuardStep | GuardChange:
    """A message as a step, or as a change where it has that field.

    Raises:
        ValidationError: It is neither.
    """
    try:
        value = from_json(content)
    except ValueError:
        value = None
    if isinstance(value, dict) and "change" in value:
        return GuardChange.model_validate_json(content)
    return GuardStep.model_validate_json(content)


def _change(gate: Guard, change: SceneChange) -> Certificate | None:
    """Change the scene of a gate; the proof of what is left of its motion."""
    added = () if change.add is None else poses.scene(SceneBody(obstacles=change.add)).obstacles
    moved = {one.id: poses.transform(one.pose) for one in change.move or ()}
    return gate.change(add=added, move=moved, remove=change.remove or (), elapsed=change.elapsed)


def _session_gate(
    robot: Reference, scene: Reference | None, body: GuardOpening, state: SessionState
) -> Guard:
    """The gate of a session in its state."""
    gate = _gate(robot, scene, body, None if state.scene is None else pickle.loads(state.scene))
    gate.count, gate.running = state.count, _running(state)
    return gate


def _running(state: SessionState) -> Running | None:
    return None if state.running is None else pickle.loads(state.running)


def _gate(
    robot: Reference, scene: Reference | None, body: GuardOpening, changed: Scene | None = None
) -> Guard:
    cell = robot_in_scene(robot, scene, body)
    around = cell.scene if changed is None else changed
    check_solids(cell.robot, around, _HINT)
    limits = MotionLimits(timings.limits(body.limits, cell.robot.chain))
    return Guard(
        cell.robot,
        around,
        body.stop,
        margin=body.margin,
        limits=limits,
        tracking=body.tracking,
        chain=cell.chain,
    )


def _propose(gate: Guard, step: GuardStep, scene: object) -> dict[str, Any]:
    """The answer to a proposal."""
    chain = gate.around.robot.chain
    verdict = gate.propose(
        _state(step.state, chain),
        _proposal(step.proposal, chain),
        step.latency,
        elapsed=step.state.elapsed,
        scene_hash=step.scene_hash,
        exact=step.exact,
    )
    return _answer(gate, verdict, scene if isinstance(scene, str) else None)


def _state(body: GuardState, chain: Chain) -> JointState:
    position, *rates = (
        None if given is None else chain.configuration(given, f"state.{name}")
        for name, given in picked(body, "positions", "velocities", "accelerations").items()
    )
    assert position is not None
    return JointState(position, *rates)


def _proposal(body: ProposalBody, chain: Chain) -> Proposal:
    if body.trajectory is not None:
        return TrajectoryProposal(trajectories.trajectory(body.trajectory, chain)[0])
    if body.samples is not None:
        assert body.period is not None
        assert body.interpolation is not None
        rows = (
            problems.array_or_none(one)
            for one in (body.samples, body.velocities, body.accelerations)
        )
        positions, velocities, accelerations = rows
        assert positions is not None
        return SamplesProposal(
            positions, body.period, body.interpolation, velocities, accelerations
        )
    assert body.duration is not None
    if body.joint_velocities is not None:
        return VelocityProposal(np.array(body.joint_velocities), body.duration)
    return TwistProposal(np.array(body.twist), body.duration, body.link)


def _answer(gate: Guard, verdict: Verdict, scene: str | None) -> dict[str, Any]:
    stop, motion = verdict.stop, verdict.trajectory
    proof = certificates.certificate_answer(stop.certificate, scene=scene)
    proof |= certificates.stops_answer(stop.stops)
    return {
        "number": gate.count,
        "accepted_until": verdict.accepted_until,
        "scale": verdict.scale,
        "trajectory": None if motion is None else trajectories.trajectory_answer(motion, None),
        "stop": {
            "trajectory": trajectories.trajectory_answer(stop.trajectory, None),
            "certificate": proof,
            "number": stop.number,
        },
        "clearance": verdict.clearance,
        "pair": verdict.pair,
        "violations": [_violation(fault) for fault in verdict.violations],
        "notes": list(verdict.notes),
    }


def _violation(fault: Violation) -> dict[str, Any]:
    details: Mapping[str, Any] = fault.details
    told = {name: details[name] for name in _TOLD if name in details}
    if not told.get("pair"):
        told.pop("pair", None)
    return {"kind": fault.kind, "time": fault.time, "message": fault.message} | told


def _ready(gate: Guard, proof: Certificate | None) -> bytes:
    state = "none" if proof is None else ("proved" if proof.verified else "void")
    robot = gate.around.robot
    answer: dict[str, Any] = {
        "robot_hash": robot.content_hash,
        "scene_hash": gate.scene.content_hash,
        "joint_names": list(robot.chain.joint_names),
        "stop": state,
    }
    if proof is not None:
        answer["certificate"] = certificates.certificate_answer(proof)
    return to_json(answer, inf_nan_mode="null")
