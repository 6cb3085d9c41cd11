"""Solutions and refusals of inverse kinematics as answers give them."""

from typing import Any

import numpy as np

from armwright_wire.robots.kinematics import IkRequest
from kinematics.ik.closed_form.arm_parts import arm_sides
from kinematics.ik.gradient import Trace
from kinematics.ik.numeric.numeric import AXES
from kinematics.ik.ranking import outside
from kinematics.ik.solution import IkResult, IkSolution
from kinematics.model.chain import Chain
from service.fields import picked
from service.workers.result import TaskProblem

#: Rejected configurations that a refusal carries.
_MAX_REJECTED = 32
#: Points of a trace in a refusal, where none was asked for.
_MAX_POINTS = 500


def solution_answer(chain: Chain, solution: IkSolution) -> dict[str, Any]:
    """A solution that was not compared with a scene."""
    why = outside(chain, solution.joints)
    return {
        "joints": solution.joints.tolist(),
        **picked(solution, "branch", "position_error", "orientation_error"),
        "within_limits": why is None,
        "collision_free": None,
        "rejected_because": why,
    }


def add_sides(chain: Chain, link: str | None, answers: list[dict[str, Any]]) -> None:
    """Add the sides of the arm to answers with solutions, and what of it is singular."""
    if not answers:
        return
    sides = arm_sides(chain, np.array([item["joints"] for item in answers]), link)
    if sides is None:
        return
    for item, side in zip(answers, sides, strict=True):
        item["sides"] = picked(side, "shoulder", "elbow", "wrist")
        item["singular"] = list(side.singular)


def completeness(result: IkResult, found: int, count: int) -> dict[str, Any]:
    """Whether solutions are all there are, with a note on those that are left out.

    Args:
        result: The solutions.
        found: Number of them that fit what the request asks for.
        count: Number of them that the answer has at most.
    """
    left = max(result.found, found) - count
    notes = [f"max_solutions leaves out {left} of the solutions found"] if left > 0 else []
    return {"complete": result.complete and left <= 0} | ({"notes": notes} if notes else {})


def trace_answer(trace: Trace, body: IkRequest) -> dict[str, Any]:
    """The course of a gradient method: all points, or as many as are asked for.

    Args:
        trace: The course.
        body: The request; where it asks for no trace, a refusal has at most 500 points.
    """
    given, count = body.gradient, len(trace.times)
    most = _MAX_POINTS
    if given is not None and given.trace:
        most = given.trace_points or count
    # The first and the last point stay.
    shown = np.unique(np.linspace(0, count - 1, min(count, most)).astype(np.int64))
    return {
        "time": trace.times[shown].tolist(),
        "joints": trace.joints[shown].tolist(),
        "axes": [axis for axis in AXES if body.axes is None or axis in body.axes],
        "error": trace.errors[shown].tolist(),
        "position_error": trace.position_error[shown].tolist(),
        "orientation_error": trace.orientation_error[shown].tolist(),
    }


def convergence_problem(link: str, trace: Trace, body: IkRequest) -> TaskProblem:
    """The refusal of a gradient that ended away from the pose."""
    last = trace.solution
    end = ", where it is stationary: Jᵀ K e = 0" if trace.stationary else ""
    return TaskProblem(
        "NO_IK_SOLUTION",
        f"after {last.iterations} steps the gradient has brought {link!r} to "
        f"{last.position_error:.4g} m and {last.orientation_error:.4g} rad from the pose{end}",
        "Start elsewhere (seed_joints), allow more steps, or take the method auto.",
        {
            "stage": "ik",
            **picked(last, "position_error", "orientation_error"),
            "nearest_joints": last.joints.tolist(),
            "stationary": trace.stationary,
            "trace": trace_answer(trace, body),
        },
    )


def unreachable(chain: Chain, link: str, result: IkResult) -> TaskProblem:
    """The refusal of a pose that no configuration reaches."""
    nearest, gap = result.nearest, result.out_of_reach
    details = {} if gap is None else {"out_of_reach_by": gap}
    beyond = "" if gap is None else f"the pose is out of reach by {gap:.4g} m: "
    return TaskProblem(
        "NO_IK_SOLUTION",
        f"{beyond}no configuration brings {link!r} to the pose: the nearest attempt stays "
        f"{nearest.position_error:.4g} m and {nearest.orientation_error:.4g} rad away",
        result.advice,
        {
            "stage": "ik",
            **picked(nearest, "position_error", "orientation_error"),
            "nearest_joints": nearest.joints.tolist(),
            "joint_names": list(chain.joint_names),
            "starts": result.starts,
            **details,
        },
    )


def all_in_collision(link: str, answers: list[dict[str, Any]]) -> TaskProblem:
    """The refusal of a pose that is reached in collision only."""
    return TaskProblem(
        "NO_IK_SOLUTION",
        f"each of the {len(answers)} configurations found that bring {link!r} to the pose is in "
        f"collision; of the nearest one {answers[0]['rejected_because']}",
        "Move the pose or the obstacle; with all_solutions the colliding ones are answered too.",
        {"stage": "collision", "rejected": answers[:_MAX_REJECTED]},
    )


def combined_answer(answers: list[dict[str, Any] | TaskProblem]) -> dict[str, Any]:
    """The answers to many poses as one, with the reason for each pose that has no solution."""
    combined: dict[str, Any] = {
        "solutions": [[] if isinstance(a, TaskProblem) else a["solutions"] for a in answers],
        "unsolved": [
            {"index": i, "code": answer.code, "detail": answer.message, "hint": answer.hint}
            for i, answer in enumerate(answers)
            if isinstance(answer, TaskProblem)
        ],
    }
    solved = [answer for answer in answers if isinstance(answer, dict)]
    if any("complete" in answer for answer in solved):
        combined["complete"] = all(answer.get("complete", False) for answer in solved)
    if notes := sorted({note for answer in solved for note in answer.get("notes", [])}):
        combined["notes"] = notes
    if not all(map(_is_deterministic, answers)):
        combined["deterministic"] = False
    for answer in answers:
        if isinstance(answer, dict) and "allowed_collisions" in answer:
            combined["allowed_collisions"] = answer["allowed_collisions"]
            break
    return combined


def _is_deterministic(answer: dict[str, Any] | TaskProblem) -> bool:
    told = answer.details if isinstance(answer, TaskProblem) else answer
    return bool(told.get("deterministic", True))
