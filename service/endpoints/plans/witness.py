"""The witness of the motion of a kept plan, in a worker."""

import json
from typing import Any

from pydantic_core import to_json

from kinematics.errors import InvalidOption
from service.endpoints.plan.task import plan_witness, question, validate
from service.storage.caches.cache_key import Reference
from service.translate import problems, trajectories
from service.workers import current
from service.workers.result import TaskProblem
from service.workers.task import GRACE, task


@task(grace=GRACE)
def witness(robot: Reference, scene: Reference | None, content: bytes) -> bytes | TaskProblem:
    """Answer the witness of a kept plan or proof.

    Args:
        robot: The robot.
        scene: The scene, where the request names a stored one.
        content: The kept plan as ``GET /v1/plans/{id}`` answers it.

    Raises:
        InvalidOption: It has no motion, or is of an operation without witnesses.
    """
    whole = json.loads(content)
    request, answer = whole["request"], whole.get("answer") or {}
    known = answer.get("certificate", answer).get("witness")
    if known is not None:
        return to_json(known)
    if whole["operation"] == "POST /v1/validate":
        proof = validate(robot, scene, to_json({**request, "witness": True}))
        return to_json(json.loads(proof)["witness"]) if isinstance(proof, bytes) else proof
    if whole["operation"] != "POST /v1/plan" or not answer:
        raise InvalidOption(
            "this kept plan has no witness",
            hint="Ask for that of a plan or of a proof that was answered.",
        )
    return to_json(_of_plan(robot, scene, to_json(request), answer))


def _of_plan(
    robot: Reference, scene: Reference | None, request: bytes, answer: dict[str, Any]
) -> dict[str, Any]:
    body, cell, problem = question(robot, scene, request)
    motion, _ = trajectories.answered_trajectory(answer["trajectory"], cell.robot.chain)
    options = problems.options(body, cell.robot.chain, current.deadline().remaining)
    return plan_witness(problem, options, motion)
