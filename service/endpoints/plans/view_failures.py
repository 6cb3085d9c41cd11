"""Configurations of requests that failed: ends, candidates, and what was tried, with reasons."""

import json
import re
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple, cast

from armwright_wire.goals.goal import SingleGoal
from armwright_wire.plans.plan import PlanRequest
from armwright_wire.plans.task import TaskRequest
from armwright_wire.plans.tour import TourRequest
from kinematics.errors import ArmwrightError
from service.endpoints.ik.task import ik
from service.endpoints.plans.view_stages import task_start
from service.storage.caches.cache_key import Reference
from service.viewer.document import Configuration, rejected
from service.workers.result import TaskProblem

#: Candidates of one goal, the best first, and of each goal of a tour.
_MAX_CANDIDATES, _MAX_TOUR_CANDIDATES = 24, 6
#: Reasons of tasks: in collision: hand and table.
_COLLISION = re.compile(r"in collision: (.+) and (.+)")


class Kept(NamedTuple):
    """A kept plan whose page is made.

    Args:
        request: The body.
        answer: The answer; empty where there is a problem.
        problem: The problem document; empty where there is an answer.
        robot: Reference of the robot.
        scene: Reference of the stored scene, if the request names one.
    """

    request: dict[str, Any]
    answer: dict[str, Any]
    problem: dict[str, Any]
    robot: Reference
    scene: Reference | None


def of_plan(kept: Kept, body: PlanRequest) -> Iterator[Configuration]:
    """Start, goals, their IK candidates, and the configurations that the problem names.

    Args:
        kept: The kept plan.
        body: Request of the plan, with the joints of named states.
    """
    stage, details = kept.problem.get("stage"), kept.problem.get("details") or {}
    detail = str(kept.problem["detail"])
    if body.start.joints is not None:
        yield _end("start", body.start.joints, detail if stage == "start" else None)
    goals = body.goal.any_of or [body.goal]
    alone = len(goals) == 1
    for number, goal in enumerate(goals):
        name = "goal" if alone else f"goal {number}"
        if goal.joints is not None:
            yield _end(name, goal.joints, detail if stage == "goal" and alone else None)
        elif goal.pose is not None:
            yield from _candidates(kept, goal, body.start.joints, name)
    if details.get("nearest_joints"):
        yield rejected("nearest configuration", details["nearest_joints"], detail)
    nearest = details.get("nearest_valid")
    if nearest:
        words = f"moves the tip by {1000.0 * nearest['tip_distance']:.1f} mm"
        yield Configuration("nearest valid configuration", nearest["joints"], "valid", words)


def of_task(kept: Kept, body: TaskRequest) -> Iterator[Configuration]:
    """The start, and one configuration of each alternative that was tried, with its reasons.

    Args:
        kept: The kept task.
        body: Request of the plan.
    """
    stage, detail = kept.problem.get("stage"), str(kept.problem["detail"])
    yield _end("start", task_start(kept.robot, body), detail if stage == "start" else None)
    tried = _trials(kept)
    for trial in tried:
        if trial.get("joints"):
            yield rejected(_alternative(trial), trial["joints"], _reasons(trial))
    stages = {trial["stage"] for trial in tried}
    for number, item in enumerate(body.stages):
        goal = item.goal if item.kind == "move" else None
        if number not in stages and goal is not None and goal.joints is not None:
            yield _end(f"goal of stage {number}", goal.joints, None)


def untried(kept: Kept) -> list[str]:
    """Sentences about alternatives of a task that have no configuration to show.

    Args:
        kept: The kept task.
    """
    return [
        f"{_alternative(trial).capitalize()}: {_reasons(trial)}."
        for trial in _trials(kept)
        if not trial.get("joints") and trial["reasons"]
    ]


def of_tour(kept: Kept, body: TourRequest) -> Iterator[Configuration]:
    """The start, and the goals with their IK candidates.

    Args:
        kept: The kept tour.
        body: Request of the plan.
    """
    stage, detail = kept.problem.get("stage"), str(kept.problem["detail"])
    start = None if body.start is None else body.start.joints
    if start is not None:
        yield _end("start", start, detail if stage == "start" else None)
    for number, goal in enumerate(body.goals):
        name = f"goal {goal.id or number}"
        if goal.joints is not None:
            yield _end(name, goal.joints, None)
        elif goal.pose is not None:
            yield from _candidates(kept, goal, start, name, _MAX_TOUR_CANDIDATES)


def _end(label: str, joints: Sequence[float], reason: str | None) -> Configuration:
    """Start or goal of a problem, rejected where there is a reason."""
    if reason is None:
        return Configuration(label, joints, "asked")
    return rejected(label, joints, reason)


def _candidates(
    kept: Kept, goal: Any, seed: Sequence[float] | None, name: str, most: int = _MAX_CANDIDATES
) -> Iterator[Configuration]:
    """All inverse-kinematics solutions of a goal's pose, with the reasons of the rejected ones."""
    fields: dict[str, Any] = {
        name: kept.request[name]
        for name in ("attached", "allowed_collisions", "frame", "scene")
        if kept.request.get(name) is not None
    }
    fields |= {"pose": goal.pose.model_dump(exclude_none=True), "all_solutions": True}
    if isinstance(goal, SingleGoal) and goal.frame is not None:
        fields["frame"] = goal.frame
    if seed is not None:
        fields["seed_joints"] = list(seed)
    try:
        found = ik(kept.robot, kept.scene, json.dumps(fields).encode())
    except ArmwrightError:
        return
    given: list[dict[str, Any]] = []
    if isinstance(found, TaskProblem):
        given = cast(list[dict[str, Any]], found.details.get("rejected") or [])
    elif isinstance(found, bytes):
        given = json.loads(found)["solutions"]
    yield from solutions(given[:most], f"{name}, IK solution")


def _trials(kept: Kept) -> list[dict[str, Any]]:
    details = kept.problem.get("details") or {}
    return [trial for trial in details.get("trials") or () if trial["outcome"] != "solved"]


def _alternative(trial: dict[str, Any]) -> str:
    before = "".join(f", after {choice}" for choice in trial["choices"][:-1])
    return f"stage {trial['stage']}, choice {trial['choices'][-1]}{before}"


def _reasons(trial: dict[str, Any]) -> str:
    return "; ".join(_COLLISION.sub(r"'\1' and '\2' collide", text) for text in trial["reasons"])


def solutions(answers: list[dict[str, Any]], label: str) -> Iterator[Configuration]:
    """Inverse-kinematics solutions with the reasons of the rejected ones.

    Args:
        answers: Answers as the API answers them.
        label: Label of all of them; each gets its number, counted from 0.
    """
    for number, answer in enumerate(answers):
        why = answer.get("rejected_because")
        name = f"{label} {number}" + (f" ({answer['branch']})" if answer.get("branch") else "")
        if why is None:
            yield Configuration(name, answer["joints"], "valid")
        else:
            yield rejected(name, answer["joints"], why)
