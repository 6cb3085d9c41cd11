"""The witness of the motion of a kept plan, in a worker."""

import base64
import json
from typing import Any

from pydantic_core import to_json

from kinematics.errors import InvalidOption
from planning.witness.compact import unpacked
from service.endpoints.plan.task import plan_witness, question, validate
from service.storage.caches.cache_key import Reference
from service.translate import problems, trajectories
from service.workers import current
from service.workers.result import TaskProblem
from service.workers.task import GRACE, task

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
