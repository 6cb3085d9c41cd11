"""The page of a kept plan, in a worker."""

import base64
import json
import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from armwright_wire.plans.plan import PlanRequest, ValidateRequest
from armwright_wire.plans.task import TaskRequest
from armwright_wire.plans.tour import TourRequest
from armwright_wire.robots.kinematics import IkRequest
from armwright_wire.scenes.check import CheckRequest
from kinematics.errors import ArmwrightError, InvalidOption
from planning.pipeline.pipeline import plan
from planning.values.search_trees import Explored
from service.endpoints.attached_objects import robot_in_scene
from service.endpoints.plan.task import question
from service.endpoints.plans import view_failures
from service.endpoints.plans.view_failures import Kept, solutions
from service.endpoints.plans.view_stages import (
    Shown,
    task_cell,
    task_shown,
    tour_cell,
    tour_shown,
)
from service.endpoints.plans.witness import known_witnesses
from service.storage.caches import worker_cache
from service.storage.caches.cache_key import Reference
from service.translate import trajectories
from service.translate.frames import first_configuration
from service.translate.problems import options
from service.translate.states import with_states
from service.viewer.document import (
    Configuration,
    configuration_documents,
    motion_document,
    rejected,
    robot_document,
    tree_document,
    tree_sentence,
)
from service.viewer.page import checker, page
from service.viewer.words import (
    NOT_PROVED_HERE,
    PROVED_HERE,
    certificate_sentences,
    problem_sentences,
    unproved_sentences,
)
from service.workers import current
from service.workers.task import task

#: Configurations that one page shows.
_MAX_CONFIGURATIONS = 64
#: Solids up to which the page has a witness: points of a cloud are solids too.
_MAX_SOLIDS = 2000
#: Share of the time that is left which planning once more may take; the page needs the rest.
_TREE_SHARE = 0.7
_IK = re.compile(r"POST /v1/robots/[^/]+/ik")


@task
def view(robot: Reference, scene: Reference | None, content: bytes, tree: bool = False) -> bytes:
    """The HTML page of a kept plan.

    Args:
        robot: The robot.
        scene: The scene, where the request names a stored one.
        content: The kept plan as ``GET /v1/plans/{id}`` answers it.
        tree: Whether to plan once more, and to draw the tree or roadmap of the last planner.

    Raises:
        ArmwrightError: The request is at fault, so that nothing of it can be drawn.
    """
    whole = json.loads(content)
    kept = Kept(
        whole["request"], whole.get("answer") or {}, whole.get("problem") or {}, robot, scene
    )
    operation, proved_here = whole["operation"], whole.get("proved_here") is True
    try:
        shown = _parts(operation)(kept)
        if proved_here:
            shown = shown._replace(sentences=[*shown.sentences, PROVED_HERE])
        else:
            shown = _unproved(shown, kept)
        explored = _explored(kept, operation) if tree else None
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        # Bundles may hold anything; what was kept here was an answer of this service.
        raise InvalidOption(
            "the kept request and its answer do not belong together: nothing can be drawn",
            hint="Replay the plan, and see the answer to that.",
        ) from error
    arm, place = shown.cell.robot, shown.cell.scene
    limit = kept.request.get("tool_speed") or (kept.request.get("timing") or {}).get("tool_speed")
    said = [] if explored is None else [tree_sentence(explored)]
    motion = None
    if shown.motion is not None:
        motion = motion_document(shown.motion, arm, place, limit, shown.curves)
    # An imported answer might bring the witness of another motion.
    solids = len(arm.pieces) + len(place.pieces()[1])
    shows = motion is not None and proved_here and solids <= _MAX_SOLIDS
    witnesses = _witnesses(kept, whole) if shows else []
    return page(
        {
            "title": f"{operation} · {arm.chain.name}",
            "id": whole.get("id"),
            "operation": operation,
            "failed": bool(kept.problem),
            **{name: whole.get(name) for name in ("created", "version", "seed", "digest")},
            **robot_document(arm, place, shown.moved, worker_cache.visuals(robot)),
            "motion": motion,
            "configurations": configuration_documents(
                arm, place, shown.configurations[:_MAX_CONFIGURATIONS]
            ),
            "proved_here": proved_here,
            "sentences": [
                *(problem_sentences(kept.problem) if kept.problem else ()),
                *shown.sentences,
                *said,
            ],
            "tree": None if explored is None else tree_document(arm.chain, explored),
            "request": kept.request,
            "witnesses": [base64.b64encode(content).decode() for content in witnesses],
            "checker": checker() if witnesses else "",
            **shown.extra,
        }
    )


def _witnesses(kept: Kept, whole: dict[str, Any]) -> list[bytes]:
    """Witnesses of the motion, for the browser to check; none where there can't be any."""
    try:
        return known_witnesses(kept.robot, kept.scene, whole)
    except ArmwrightError:
        return []


def _unproved(shown: Shown, kept: Kept) -> Shown:
    """The parts of a page without what its answer says was proved or found valid."""
    if kept.problem:
        return shown._replace(sentences=[*shown.sentences, NOT_PROVED_HERE])
    told = [item._replace(verdict="asked", reason="") for item in shown.configurations]
    certificate = kept.answer.get("certificate") or kept.answer
    sentences = [NOT_PROVED_HERE, *unproved_sentences(certificate)]
    return shown._replace(configurations=told, sentences=sentences)


def _parts(operation: str) -> Callable[[Kept], Shown]:
    if _IK.fullmatch(operation):
        return _of_ik
    makers = {
        "POST /v1/check": _of_check,
        "POST /v1/validate": _of_validate,
        "POST /v1/plan": _of_plan,
        "POST /v1/tasks": _of_task,
        "POST /v1/tours": _of_tour,
    }
    if operation not in makers:
        raise InvalidOption(
            f"answers of {operation} have no page",
            hint='Prove its motion with POST /v1/validate and "keep": true to see it.',
        )
    return makers[operation]


def _explored(kept: Kept, operation: str) -> Explored:
    """The tree or roadmap of a plan's last planner, planned once more.

    Raises:
        InvalidOption: It is no plan.
    """
    if operation != "POST /v1/plan":
        raise InvalidOption(
            f"answers of {operation} have no tree",
            hint="Leave tree out, or ask for the page of a plan.",
        )
    content = json.dumps(kept.request).encode()
    body, cell, problem = question(kept.robot, kept.scene, content)
    explored = Explored()
    left = _TREE_SHARE * current.deadline().remaining
    seconds = min(body.timeout or left, left)
    plan(problem, replace(options(body, cell.robot.chain, seconds), explored=explored))
    return explored


def _of_plan(kept: Kept) -> Shown:
    geometry = worker_cache.robot(kept.robot).geometry
    body = with_states(PlanRequest.model_validate(kept.request), geometry.states)
    chain = geometry.chain
    start = first_configuration(chain, body.start.joints)
    cell = robot_in_scene(kept.robot, kept.scene, body, start)
    if kept.answer:
        motion, _ = trajectories.answered_trajectory(kept.answer["trajectory"], chain)
        sentences = [
            f"Planned by {kept.answer['planner']}: {motion.duration:.3f} s.",
            *certificate_sentences(kept.answer["certificate"]),
            *(f"Note: {note}" for note in kept.answer.get("notes") or ()),
        ]
        return Shown(cell, motion, [], sentences, {"path": kept.answer["path"]["joints"]})
    return Shown(cell, None, [*view_failures.of_plan(kept, body)], [], {})


def _of_validate(kept: Kept) -> Shown:
    body = ValidateRequest.model_validate(kept.request)
    chain = worker_cache.chain(kept.robot)
    motion, _ = trajectories.trajectory(body.trajectory, chain)
    cell = robot_in_scene(kept.robot, kept.scene, body, motion.start)
    sentences = certificate_sentences(kept.answer) if kept.answer else []
    return Shown(cell, motion, [], sentences, {})


def _of_task(kept: Kept) -> Shown:
    if kept.answer:
        return task_shown(kept.robot, kept.scene, kept.request, kept.answer)
    body = TaskRequest.model_validate(kept.request)
    cell = task_cell(kept.robot, kept.scene, body)
    shown = [*view_failures.of_task(kept, body)]
    return Shown(cell, None, shown, view_failures.untried(kept), {})


def _of_tour(kept: Kept) -> Shown:
    if kept.answer:
        return tour_shown(kept.robot, kept.scene, kept.request, kept.answer)
    body = TourRequest.model_validate(kept.request)
    shown = [*view_failures.of_tour(kept, body)]
    return Shown(tour_cell(kept.robot, kept.scene, body), None, shown, [], {})


def _of_check(kept: Kept) -> Shown:
    body = CheckRequest.model_validate(kept.request)
    chain = worker_cache.chain(kept.robot)
    cell = robot_in_scene(kept.robot, kept.scene, body, first_configuration(chain, body.joints))
    rows = np.atleast_2d(np.array(body.joints)).tolist()
    shown = [
        _configuration_of(f"configuration {i}", row, _verdict(kept.answer, i))
        for i, row in enumerate(rows)
    ]
    count = sum(item.verdict == "valid" for item in shown)
    return Shown(cell, None, shown, [f"{count} of {len(shown)} configurations are valid."], {})


def _verdict(answer: Mapping[str, Any], i: int) -> Mapping[str, Any]:
    """The verdict on configuration i of an answer about one or many."""
    if not isinstance(answer["valid"], list):
        return answer
    names = ("valid", "clearance", "clearance_pair", "collisions", "limit_violations")
    return {name: answer[name][i] for name in names}


def _configuration_of(label: str, joints: list[float], verdict: Mapping[str, Any]) -> Configuration:
    pair = verdict["clearance_pair"]
    if verdict["valid"]:
        clearance = verdict["clearance"]
        words = "" if clearance is None else f"clearance {1000.0 * clearance:.1f} mm"
        return Configuration(label, joints, "valid", words, pair)
    hits = verdict["collisions"]
    reasons = [f"'{hit['pair'][0]}' and '{hit['pair'][1]}' collide" for hit in hits]
    reasons += [f"{item['joint']} is outside its limit" for item in verdict["limit_violations"]]
    if not reasons and pair is not None:
        reasons = [f"'{pair[0]}' and '{pair[1]}' are nearer than the margin"]
    return rejected(label, joints, "; ".join(reasons))


def _of_ik(kept: Kept) -> Shown:
    body = IkRequest.model_validate(kept.request)
    chain = worker_cache.chain(kept.robot)
    seed = None if body.seed_joints is None else first_configuration(chain, body.seed_joints)
    cell = robot_in_scene(kept.robot, kept.scene, body, seed)
    details = kept.problem.get("details") or {}
    given = kept.answer.get("solutions") or details.get("rejected") or []
    flat = [item for row in given for item in (row if isinstance(row, list) else [row])]
    shown = [*solutions(flat, "solution")]
    if details.get("nearest_joints"):
        shown.append(rejected("nearest", details["nearest_joints"], kept.problem["detail"]))
    count = sum(item.verdict == "valid" for item in shown)
    return Shown(cell, None, shown, [f"{count} of {len(shown)} solutions are valid."], {})
