"""Stops and the witness of the motion of a kept plan, in a worker."""

import base64
import json
from typing import Any

from pydantic_core import to_json

from armwright_wire.plans.plan import ValidateRequest
from kinematics.errors import InvalidOption
from kinematics.trajectory.trajectory import Trajectory
from planning.pipeline.moving_start import surroundings
from planning.stops.certificate import Surroundings, stop_motion
from planning.values.limits import MotionLimits
from planning.values.preferences import StopKind
from planning.witness.compact import unpacked
from service.endpoints.plan.task import plan_witness, proof_question, question, validate
from service.storage.caches.cache_key import Reference
from service.translate import certificates, problems, timings, trajectories
from service.workers import current
from service.workers.result import TaskProblem, overdue
from service.workers.task import GRACE, task


@task(grace=GRACE)
def stop(
    robot: Reference, scene: Reference | None, content: bytes, at: float, kind: StopKind
) -> bytes | TaskProblem:
    """The stop of a kept motion from an instant on, with its certificate.

    Args:
        robot: The robot.
        scene: The scene, where the request names a stored one.
        content: The kept plan as ``GET /v1/plans/{id}`` answers it.
        at: The instant [s].
        kind: "path" or "joints".

    Raises:
        InvalidOption: The plan has no single motion, or the instant is outside of it.
    """
    whole = json.loads(content)
    answer = whole.get("answer") or {}
    try:
        motion, begins, around = _motion(robot, scene, whole["operation"], whole["request"], answer)
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        raise InvalidOption(
            "the kept request and its answer do not belong together: there is no motion",
            hint="Replay the plan, and ask for a stop of the answer to that.",
        ) from error
    stopped = stop_motion(motion, around, at - begins, kind, current.deadline())
    if (late := overdue(stopped.certificate)) is not None:
        return late
    asked = whole["request"].get("scene")
    return to_json(
        {
            "kind": kind,
            "at": at,
            "trajectory": trajectories.trajectory_answer(stopped.trajectory, None),
            "certificate": certificates.certificate_answer(
                stopped.certificate, scene=asked if isinstance(asked, str) else None
            ),
        },
        inf_nan_mode="null",
    )


def _motion(
    robot: Reference,
    scene: Reference | None,
    operation: str,
    request: dict[str, Any],
    answer: dict[str, Any],
) -> tuple[Trajectory, float, Surroundings]:
    """The kept motion, when it begins [s], and what its stops are proved for."""
    if operation == "POST /v1/validate":
        body = ValidateRequest.model_validate(request)
        motion, begins, cell = proof_question(robot, scene, body)
        limits = MotionLimits(timings.limits(body.limits, cell.robot.chain))
        around = Surroundings(cell.robot, cell.scene, body.margin, limits)
    elif operation == "POST /v1/plan" and answer:
        asked, cell, problem = question(robot, scene, json.dumps(request).encode())
        chain = cell.robot.chain
        options = problems.options(asked, chain, current.deadline().remaining)
        motion, begins = trajectories.answered_trajectory(answer["trajectory"], chain)
        around = surroundings(problem, options)
    else:
        raise InvalidOption(
            f"{operation}: this kept plan has no single motion that could be stopped",
            hint="Ask for a plan or proof that was answered. Of a task or tour send the trajectory "
            'of a stage or leg to /v1/validate with "keep": true.',
        )
    kept = (answer.get("certificate") or answer).get("premises") or {}
    margin = max(around.margin, float(kept.get("margin") or 0.0))
    return motion, begins, around._replace(margin=margin)


#: Parts of answers that have a certificate each.
_PARTS = {"POST /v1/tasks": "stages", "POST /v1/tours": "legs"}


@task(grace=GRACE)
def witness(
    robot: Reference, scene: Reference | None, content: bytes, part: int, compact: bool
) -> bytes | TaskProblem:
    """Answer the witness of a kept plan or proof.

    Args:
        robot: The robot.
        scene: The scene, where the request names a stored one.
        content: The kept plan as ``GET /v1/plans/{id}`` answers it.
        part: Number of the stage of a task or the leg of a tour.
        compact: Whether the compact form is asked for, else JSON.

    Raises:
        InvalidOption: It has no motion, no such part, or is of an operation without witnesses.
    """
    whole = json.loads(content)
    found = _compact(robot, scene, whole, part)
    if isinstance(found, TaskProblem):
        return found
    return found if compact else to_json(unpacked(found))


def known_witnesses(
    robot: Reference, scene: Reference | None, whole: dict[str, Any]
) -> list[bytes]:
    """Compact forms of the witnesses of a kept motion: of a task or tour those that were answered.

    Args:
        robot: The robot.
        scene: The scene, where the request names a stored one.
        whole: The kept plan.
    """
    parts = (whole.get("answer") or {}).get(_PARTS.get(whole["operation"], ""), [{}])
    if whole["operation"] in _PARTS and not all("witness" in p["certificate"] for p in parts):
        return []
    found = [_compact(robot, scene, whole, part) for part in range(len(parts))]
    return [content for content in found if isinstance(content, bytes)]


def _compact(
    robot: Reference, scene: Reference | None, whole: dict[str, Any], part: int
) -> bytes | TaskProblem:
    request, answer, operation = whole["request"], whole.get("answer") or {}, whole["operation"]
    parts = answer.get(_PARTS[operation], []) if operation in _PARTS else [answer]
    if not part < len(parts):
        raise InvalidOption(
            f"this kept plan has no part {part}", hint=f"It has {len(parts)}, the first is 0."
        )
    known = parts[part].get("certificate", parts[part]).get("witness")
    if known is None and operation == "POST /v1/validate":
        proof = validate(robot, scene, to_json({**request, "witness": True}))
        if not isinstance(proof, bytes):
            return proof
        known = json.loads(proof)["witness"]
    if known is not None:
        return base64.b64decode(known["compact"])
    if operation != "POST /v1/plan" or not answer:
        raise InvalidOption(
            "this kept plan has no witness",
            hint="Ask for that of a plan or of a proof that was answered, or of a task or a tour "
            'that was asked for with "witness": true.',
        )
    return _of_plan(robot, scene, to_json(request), answer)


def _of_plan(
    robot: Reference, scene: Reference | None, request: bytes, answer: dict[str, Any]
) -> bytes:
    body, cell, problem = question(robot, scene, request)
    motion, _ = trajectories.answered_trajectory(answer["trajectory"], cell.robot.chain)
    options = problems.options(body, cell.robot.chain, current.deadline().remaining)
    return plan_witness(problem, options, motion).compact
