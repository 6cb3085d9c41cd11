"""Stops of the motion of a kept plan, in a worker."""

import json
from typing import Any

from pydantic_core import to_json

from armwright_wire.plans.plan import ValidateRequest
from kinematics.errors import InvalidOption
from kinematics.trajectory.trajectory import Trajectory
from planning.pipeline.stoppable import surroundings
from planning.stops.certificate import Surroundings, stop_motion
from planning.values.limits import MotionLimits
from planning.values.preferences import StopKind
from service.endpoints.plan.task import proof_question, question
from service.storage.caches.cache_key import Reference
from service.translate import certificates, problems, timings, trajectories
from service.workers import current
from service.workers.result import TaskProblem, timed_out
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
    violation = stopped.certificate.violation
    if violation is not None and violation.kind == "time":
        return timed_out("the work was done", "certificate")
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
            "this kept plan has no single motion that could be stopped",
            hint="Ask for a plan or proof that was answered.",
        )
    kept = (answer.get("certificate") or answer).get("premises") or {}
    margin = max(around.margin, float(kept.get("margin") or 0.0))
    return motion, begins, around._replace(margin=margin)
