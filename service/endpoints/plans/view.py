"""The page of a kept plan, in a worker.

Kept plans, tasks and tours as the parts of one program.

Configurations of requests that failed: ends, candidates, and what was tried, with reasons.
"""

import base64
import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, cast, get_args

import numpy as np

from armwright_wire.goals.goal import SingleGoal
from armwright_wire.motions.export import KeptMotion
from armwright_wire.plans.plan import PlanRequest, ValidateRequest
from armwright_wire.plans.task import TaskRequest
from armwright_wire.plans.tour import TourRequest
from armwright_wire.robots.kinematics import IkRequest
from armwright_wire.scenes.check import CheckRequest
from kinematics.errors import ArmwrightError, InvalidOption
from kinematics.trajectory.trajectory import Trajectory, stay
from obstacles.convex.triangles import join
from obstacles.meshes.writer import glb, stl
from obstacles.robots.finger_geometry import swept_cover
from obstacles.robots.robot_geometry import RobotGeometry
from planning.exports.export import Place
from planning.exports.options import Event
from planning.exports.program import ProgramPart
from planning.exports.swept_volume import swept_volume
from planning.pipeline.pipeline import plan
from planning.proof.premises import Premises
from planning.values.finger_motion import FingerMotion
from planning.values.search_trees import Explored
from service.endpoints.attached_objects import RobotInScene, robot_in_scene
from service.endpoints.ik.task import ik
from service.endpoints.plan.task import question
from service.endpoints.plans.stop import known_witnesses
from service.endpoints.plans.view_stages import (
    Kept,
    Shown,
    task_cell,
    task_parts,
    task_shown,
    tour_parts,
    tour_shown,
)
from service.endpoints.tours.task import tour_cell
from service.storage.caches import worker_cache
from service.storage.caches.cache_key import Reference
from service.translate import trajectories
from service.translate.frames import first_configuration, with_states
from service.translate.problems import options
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
from service.viewer.timeline import Part
from service.viewer.words import (
    NOT_PROVED_HERE,
    PROVED_HERE,
    certificate_sentences,
    problem_sentences,
    unproved_sentences,
)
from service.workers import current
from service.workers.result import TaskProblem
from service.workers.task import task

#: Candidates of one goal, the best first, and of each goal of a tour.
_MAX_CANDIDATES, _MAX_TOUR_CANDIDATES = 24, 6
#: Reasons of tasks: in collision: hand and table.
_COLLISION = re.compile(r"in collision: (.+) and (.+)")


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


def of_task(kept: Kept, body: TaskRequest, start: Sequence[float]) -> Iterator[Configuration]:
    """The start, and one configuration of each alternative that was tried, with its reasons.

    Args:
        kept: The kept task.
        body: Request of the plan.
        start: Configuration that the task begins at [rad or m].
    """
    stage, detail = kept.problem.get("stage"), str(kept.problem["detail"])
    yield _end("start", start, detail if stage == "start" else None)
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


_OPERATIONS = get_args(KeptMotion.model_fields["operation"].annotation)


@task
def swept(
    robot: Reference, scene: Reference | None, content: bytes, form: str, tolerance: float
) -> bytes:
    """A mesh that holds every point of the moving arm, and of what it holds, at every instant.

    Args:
        robot: The robot.
        scene: The scene, where the request names a stored one.
        content: The kept plan as ``GET /v1/plans/{id}`` answers it.
        form: "glb" or "stl".
        tolerance: Largest growth of the hulls [m].

    Raises:
        InvalidOption: The plan has no motion, or the tolerance asks for too many hulls.
    """
    whole = json.loads(content)
    fields = {name: whole.get(name) or {} for name in ("operation", "request", "answer")}
    if not fields["answer"] or fields["operation"] not in _OPERATIONS:
        raise InvalidOption(
            "this kept plan has no motion, so that nothing is swept",
            hint="Ask for a plan, task, tour or proof that was answered.",
        )
    parts = program_parts(robot, scene, KeptMotion.model_validate(fields))
    moves = [_covered(part) for part in parts]
    volumes = [swept_volume(motion, arm, tolerance=tolerance) for motion, arm in moves]
    surface = join(volume.surface() for volume in volumes)
    return glb(surface, "swept volume") if form == "glb" else stl(surface)


def _covered(part: ProgramPart) -> tuple[Trajectory, RobotGeometry]:
    """The motion of a part, with fingers that hold all that they sweep in it."""
    arm, fingers = part.place.robot, part.fingers
    if fingers is not None:
        arm, _ = swept_cover(arm, fingers.first, fingers.last, (0.0, 1.0))
    return part.motion, arm


#: Shorter stays between legs are rounded off times [s].
_GAP = 1e-6


def program_parts(robot: Reference, scene: Reference | None, kept: KeptMotion) -> list[ProgramPart]:
    """The parts of a program that does what was planned.

    Args:
        robot: The robot.
        scene: The stored scene, where the kept request names one.
        kept: Request and answer.

    Raises:
        InvalidOption: Request and answer do not belong together.
        ArmwrightError: The kept request is at fault.
    """
    whole = Kept(kept.request, kept.answer, {}, robot, scene)
    try:
        if kept.operation == "POST /v1/tasks":
            pairs = zip(task_parts(whole), kept.answer["stages"], strict=True)
            return [_stage(*pair) for pair in pairs]
        if kept.operation == "POST /v1/tours":
            return [*_legs(tour_parts(whole), kept.answer["legs"])]
        return [_motion(whole, kept.operation)]
    except (AttributeError, LookupError, TypeError, ValueError) as error:
        raise InvalidOption(
            "plan: request and answer do not belong together: there is no motion",
            hint="Give both as GET /v1/plans/{id} answers them.",
        ) from error


def _stage(part: Part, stage: Mapping[str, Any]) -> ProgramPart:
    certificate, event = stage["certificate"], stage.get("event")
    fingers = None
    if part.fingers is not None:
        first, last = part.robot.fingers, part.last.fingers
        duration = part.fingers.duration
        fingers = FingerMotion(first, first.positions, last.positions, duration)
    item = "" if stage.get("item") is None else f", {stage['item']}"
    return ProgramPart(
        f"{part.label}{item}",
        stage["kind"],
        part.motion,
        Place(part.robot, part.scene, certificate["premises"]["margin"]),
        fingers,
        None if event is None else Event(stage["kind"], event["port"], event["value"]),
        Premises.of_fields(certificate["premises"]),
    )


def _legs(parts: Sequence[Part], legs: Sequence[Mapping[str, Any]]) -> Iterator[ProgramPart]:
    """Legs of a tour, and the stays at its goals between them."""
    time = 0.0
    for part, leg in zip(parts, legs, strict=True):
        told = leg["certificate"]["premises"]
        place = Place(part.robot, part.scene, told["margin"])
        if part.begins - time > _GAP:
            still = stay(part.motion.joint_names, part.motion.start, part.begins - time)
            yield ProgramPart(f"stay before {part.label}", "wait", still, place)
        yield ProgramPart(part.label, "leg", part.motion, place, premises=Premises.of_fields(told))
        time = part.begins + part.motion.duration


def _motion(kept: Kept, operation: str) -> ProgramPart:
    """The motion of a plan or proof."""
    if operation == "POST /v1/plan":
        _, cell = _plan_cell(kept)
        motion, _ = trajectories.answered_trajectory(kept.answer["trajectory"], cell.robot.chain)
        premises = Premises.of_fields(kept.answer["certificate"]["premises"])
    else:
        motion, cell = _proof_cell(kept)
        premises = Premises.of_fields(kept.answer["premises"])
    place = Place(cell.robot, cell.scene, premises.margin)
    return ProgramPart("motion", "plan", motion, place, premises=premises)


def _plan_cell(kept: Kept) -> tuple[PlanRequest, RobotInScene]:
    """A request for a plan with the joints of its states, and the robot in its scene."""
    geometry = worker_cache.robot(kept.robot).geometry
    body = with_states(PlanRequest.model_validate(kept.request), geometry.states)
    start = first_configuration(geometry.chain, body.start.joints)
    return body, robot_in_scene(kept.robot, kept.scene, body, start)


def _proof_cell(kept: Kept) -> tuple[Trajectory, RobotInScene]:
    """The motion of a request for a proof, and the robot in its scene."""
    body = ValidateRequest.model_validate(kept.request)
    motion, _ = trajectories.trajectory(body.trajectory, worker_cache.chain(kept.robot))
    return motion, robot_in_scene(kept.robot, kept.scene, body, motion.start)


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
    body, cell = _plan_cell(kept)
    if kept.answer:
        chain = cell.robot.chain
        motion, _ = trajectories.answered_trajectory(kept.answer["trajectory"], chain)
        sentences = [
            f"Planned by {kept.answer['planner']}: {motion.duration:.3f} s.",
            *certificate_sentences(kept.answer["certificate"]),
            *(f"Note: {note}" for note in kept.answer.get("notes") or ()),
        ]
        return Shown(cell, motion, [], sentences, {"path": kept.answer["path"]["joints"]})
    return Shown(cell, None, [*of_plan(kept, body)], [], {})


def _of_validate(kept: Kept) -> Shown:
    motion, cell = _proof_cell(kept)
    sentences = certificate_sentences(kept.answer) if kept.answer else []
    return Shown(cell, motion, [], sentences, {})


def _of_task(kept: Kept) -> Shown:
    if kept.answer:
        return task_shown(kept)
    body = TaskRequest.model_validate(kept.request)
    cell, start = task_cell(kept, body)
    shown = [*of_task(kept, body, start)]
    return Shown(cell, None, shown, untried(kept), {})


def _of_tour(kept: Kept) -> Shown:
    if kept.answer:
        return tour_shown(kept)
    body = TourRequest.model_validate(kept.request)
    cell, _ = tour_cell(kept.robot, kept.scene, body)
    return Shown(cell, None, [*of_tour(kept, body)], [], {})


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
