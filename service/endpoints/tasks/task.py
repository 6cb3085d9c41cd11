"""Tasks of several stages as requests ask for them, in workers."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from pydantic import TypeAdapter
from pydantic_core import to_json

from armwright_wire.plans import stages as stages_of
from armwright_wire.plans.stages import SingleStage
from armwright_wire.plans.task import TaskRequest
from kinematics.arrays import Array
from kinematics.errors import (
    ArmwrightError,
    InvalidLinkName,
    InvalidObjectName,
    InvalidOption,
)
from obstacles.robots.finger_geometry import with_fingers
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene
from planning.options import MAX_TIMEOUT
from planning.orders.blocks import Block, Each, Fallback, Flat, plan_blocks
from planning.sequence.result import (
    FoundOrder,
    SequenceFailure,
    SequencePlan,
    StagePlan,
    TaskOptions,
    Trial,
)
from planning.sequence.search import plan_task
from planning.sequence.stage import describe_stage
from planning.sequence.task import Task
from planning.sequence.world import Held, World
from service.endpoints.attached_objects import attachment, scene_notes
from service.endpoints.plan.task import check_solids, reproducibility
from service.endpoints.tasks import translation
from service.endpoints.tasks.regrasp import regrasp_stages
from service.endpoints.tasks.stage_cells import (
    moved,
    stage_cells,
    stage_robots,
    task_ground,
    task_objects,
)
from service.fields import picked
from service.storage.caches.cache_key import Reference
from service.translate import certificates, poses, problems, timings, trajectories
from service.translate.tool_motions import reference_answer
from service.workers import current
from service.workers.answer import in_frame
from service.workers.result import TaskProblem, timed_out
from service.workers.task import GRACE, task

Flats = Sequence[Flat[SingleStage]]
Blocks = Sequence[Block[SingleStage]]
_STAGES: TypeAdapter[list[stages_of.StageUnion]] = TypeAdapter(list[stages_of.StageUnion])

#: Trials that are answered: at 100 bytes each, two hundred kilobytes.
_MAX_TRIALS = 2_000
_SOLIDS_HINT = (
    'Give the robot solids: "visual_solids": true of a URDF, or "geometry": {"capsules": radius} '
    "of a DH table."
)


@task(grace=GRACE)
def plan_sequence(robot: Reference, scene: Reference | None, content: bytes) -> bytes | TaskProblem:
    """Answer a request for the motions of all stages of a task.

    Args:
        robot: The robot.
        scene: The scene, where the request names a stored one.
        content: The request.

    Raises:
        ArmwrightError: The request is at fault.
    """
    body = TaskRequest.model_validate_json(content)
    if body.start.velocities is not None or body.start.accelerations is not None:
        raise InvalidOption("a task begins at rest: start has no velocities or accelerations")
    alone, start, around = task_ground(robot, scene, body)
    geometry = with_fingers(alone, body.fingers or {})
    world = _world(body, geometry, moved(around, body))
    remaining = min(current.deadline().remaining, MAX_TIMEOUT)
    if not remaining > 0.0:
        return timed_out("the search began", "task")
    told = scene_notes(alone, around, [item.id for item in body.attached or ()])
    tried: list[tuple[SequencePlan | SequenceFailure, _Asked | ArmwrightError]] = []

    def attempt(flat: Flats, options: TaskOptions) -> SequencePlan | SequenceFailure:
        own = [one.stage for one in flat]
        robots = [*stage_robots(robot, own)]
        try:
            made = translation.stages(body, own, robots, world.scene, start, options.timeout)
        except ArmwrightError as error:
            k = error.details.get("index")
            unknown = isinstance(error, InvalidObjectName | InvalidLinkName)
            if unknown or k is None or flat[k].of is None:
                raise
            # What can't be gripped so may be in another order, or by another alternative.
            failure = SequenceFailure(error.code, error.message, error.hint or "", k,
                                      dict(error.details), (), reached=k)  # fmt: skip
            tried.append((failure, error))
            return failure
        asked = _Asked(Task(world, start, made, body.seed), flat, body)
        known = [one.duration for one, _ in tried if isinstance(one, SequencePlan) and one.complete]
        shortest = min(known, default=math.inf)

        def offer(found: SequencePlan) -> None:
            if found.duration < shortest:
                current.offer(partial(written, found, asked))

        tried.append((plan_task(asked.task, replace(options, offer=offer)), asked))
        return tried[-1][0]

    def written(found: SequencePlan, of: _Asked, orders: Sequence[FoundOrder] = ()) -> bytes:
        answer = _answer(found, of) | poses.notes_of(body, told)
        answer["orders"] = [asdict(one) | {"saved": one.saved} for one in orders]
        stages = answer["stages"]
        objects = task_objects(alone, around, body)
        cells = stage_cells(stages, robot, objects, geometry.fingers.positions)
        for plan, stage, cell in zip(found.stages, stages, cells, strict=True):
            premises = cell.premises(plan.certificate.premises.margin)
            proof = stage["certificate"]
            proof["premises"] = certificates.premises_answer(premises, body.scene)
            if body.witness:
                given = getattr(body.stages[plan.index], "limits", None) or body.limits
                proof["witness"] = certificates.part_witness(
                    plan.trajectory,
                    (cell.first.robot, cell.first.scene),
                    plan.certificate,
                    timings.given_limits(given, alone.chain.joint_names),
                    current.deadline(),
                    int(plan.fingers is not None),
                )
        return to_json(answer, inf_nan_mode="null")

    options = TaskOptions(
        remaining, body.improve, body.allow_partial, current.report,
        goal_costs=problems.goal_costs(body.goal_costs),
    )  # fmt: skip
    outcome, orders = plan_blocks(blocks(body.stages), options, attempt, body.seed)
    asked = next(asked for found, asked in tried if found is outcome)
    if isinstance(asked, ArmwrightError):
        raise asked
    if isinstance(outcome, SequenceFailure):
        return TaskProblem(
            outcome.code, outcome.message, outcome.hint, _failure_details(asked.task, outcome)
        )
    return written(outcome, asked, orders)


class _Asked(NamedTuple):
    """A flat list of stages that was planned.

    Args:
        task: The task.
        flat: Its stages as the request has them, with what each is for.
        body: The request.
    """

    task: Task
    flat: Flats
    body: TaskRequest


def _world(body: TaskRequest, robot: RobotGeometry, scene: Scene) -> World:
    """The world at the start.

    Raises:
        InvalidRobotDescription: There are obstacles, and the robot has no collision geometry.
    """
    check_solids(robot, scene, _SOLIDS_HINT)
    held = tuple(
        Held(attachment(robot, scene, item), translation.load(item)) for item in body.attached or ()
    )
    names = {item.name for item in held}
    if len(names) < len(held):
        raise InvalidOption("attached: an object is given twice", hint="Name each object once.")
    left = tuple(o for o in scene.obstacles if o.id not in names)
    return World(robot, replace(scene, obstacles=left), held)


# --------------------------------------------------------------------------------- the answer


def _answer(outcome: SequencePlan, whole: _Asked) -> dict[str, Any]:
    asked, flat, body = whole
    # Objects that the request moved are told even where no stage moves them again.
    elsewhere = {item.id for item in body.objects or ()}
    obstacles = asked.world.scene.obstacles
    before = {o.id: o.T_world_obstacle for o in obstacles if o.id not in elsewhere}
    begins, stages = 0.0, []
    for stage in outcome.stages:
        given, of = flat[stage.index]
        period = (given.timing or body.timing).sample_period
        reference = reference_answer(stage.after.robot.chain, stage.plan, body.seed)
        said = stage.event
        event = None if said is None else {"port": said.port, "value": said.value}
        led = asked.stages[stage.index].settings.tip
        tip = led and {
            "object": led.object,
            "pose": poses.pose_answer(led.T_object_tip).model_dump(),
        }
        more = {"reference": reference, "item": of, "event": event, "tip": tip}
        stages.append(_stage_answer(stage, begins, before, period) | more)
        begins += stage.trajectory.duration
    failure = outcome.failure
    return {
        "status": "success" if outcome.complete else "partial",
        **in_frame(asked.world.robot.chain),
        "duration": outcome.duration,
        "stages": stages,
        **_trials_answer(outcome.trials),
        "improvements": [picked(step, "milliseconds", "duration") for step in outcome.improvements],
        "exhausted": outcome.exhausted,
        "failure": None
        if failure is None
        else picked(failure, "code", "message", "hint") | {"index": failure.stage},
        "reproducibility": reproducibility(
            body, asked.world.robot, asked.world.scene, deterministic=outcome.deterministic
        ),
    }


def _stage_answer(
    stage: StagePlan, begins: float, before: Mapping[str, Array], period: float | None
) -> dict[str, Any]:
    plan = stage.plan
    certificate = certificates.certificate_answer(stage.certificate)
    if stage.plan is not None and stage.plan.trajectory == stage.trajectory:
        certificate |= certificates.stops_answer(stage.plan.stops)
    return {
        "index": stage.index,
        "kind": stage.kind,
        "name": stage.name or None,
        "begins": begins,
        "choice": stage.target,
        "configuration": stage.configuration and asdict(stage.configuration),
        "planner": None if plan is None else plan.planner,
        "stages": [] if plan is None else problems.stages_answer(plan.stages),
        "path": None
        if plan is None
        else {"joints": plan.path.waypoints.tolist(), "length": plan.path.length},
        "trajectory": trajectories.trajectory_answer(stage.trajectory, period),
        "fingers": None
        if stage.fingers is None
        else trajectories.trajectory_answer(stage.fingers.trajectory, period),
        "certificate": certificate,
        "passes": stage.passes,
        "after": _world_answer(stage.after, before),
        "notes": [] if plan is None else list(plan.notes),
    }


def _world_answer(world: World, before: Mapping[str, Array]) -> dict[str, Any]:
    moved = [
        {"id": o.id, "pose": poses.pose_answer(o.T_world_obstacle).model_dump()}
        for o in world.scene.obstacles
        if o.id not in before or not np.array_equal(o.T_world_obstacle, before[o.id])
    ]
    return {
        "objects": moved,
        "attached": [_held_answer(item) for item in world.held],
        "fingers": dict(world.robot.fingers.positions),
    }


def _held_answer(item: Held) -> dict[str, Any]:
    held, load = item.attachment, item.load
    answer: dict[str, Any] = {
        "id": item.name,
        "link": held.link,
        "pose": poses.pose_answer(held.held.T_world_obstacle).model_dump(),
        "touch_links": list(held.touches),
        "touch_depth": held.touch_depth if math.isfinite(held.touch_depth) else None,
    }
    if load is not None:
        answer["mass"] = load.mass
        answer["center_of_mass"] = list(load.center_of_mass)
        answer["inertia"] = None if load.tensor is None else load.tensor.tolist()
    return answer


def _failure_details(asked: Task, failure: SequenceFailure) -> dict[str, Any]:
    stage = asked.stages[failure.stage]
    return {
        **failure.details,
        "stage": describe_stage(asked.stages, failure.stage),
        "name": stage.settings.name or None,
        **_trials_answer(failure.trials),
    }


def _trials_answer(trials: tuple[Trial, ...]) -> dict[str, Any]:
    return {
        "trials": [
            picked(trial, "choices", "stage", "outcome", "reasons")
            | {"joints": None if trial.joints is None else trial.joints.tolist()}
            for trial in trials[:_MAX_TRIALS]
        ],
        "trials_omitted": max(len(trials) - _MAX_TRIALS, 0),
    }


# --------------------------------------------------------------------------------- the blocks


def blocks(stages: Sequence[stages_of.StageUnion]) -> Blocks:
    """The stages of a request, those inside of ``for_each`` and ``fallback`` as blocks.

    Args:
        stages: Stages of the request, in order.
    """
    made: list[Block[SingleStage]] = []
    for k, stage in enumerate(stages):
        if isinstance(stage, stages_of.RegraspStage):
            again = regrasp_stages(stage, stages[:k])
            made.append(Fallback([again * count for count in range(stage.most + 1)]))
            continue
        if isinstance(stage, stages_of.MoveStage) and stage.via is not None:
            made += stage.through()
        made.append(_block(stage))
    return made


def _block(
    stage: SingleStage | stages_of.ForEachStage | stages_of.FallbackStage,
) -> Block[SingleStage]:
    match stage:
        case stages_of.ForEachStage():
            items = next(iter(stage.for_each.values()))
            by_place = any(
                isinstance(one, stages_of.PlaceStage)
                and any(grid is not None and grid.fill == "next" for grid in (one.grid, one.stack))
                for one in stage.stages
            )
            return Each(items, _maker(stage), stage.order, by_place)
        case stages_of.FallbackStage():
            return Fallback([blocks(alternative) for alternative in stage.fallback])
        case _:
            return stage


def _maker(stage: stages_of.ForEachStage) -> Callable[[Sequence[int]], Blocks]:
    """Maker of the stages for one item, after those that were before it."""
    body = [one.model_dump(mode="json", by_alias=True, exclude_unset=True) for one in stage.stages]
    objects = stage.for_each.get("object", next(iter(stage.for_each.values())))
    named = {one["name"] for one in body if one.get("name")}

    def stages(order: Sequence[int]) -> Blocks:
        item, number = order[-1], len(order) - 1
        values = {f"{{{name}}}": values[item] for name, values in stage.for_each.items()}
        below = objects[order[-2]] if number else None

        def made(part: Any, field: str = "") -> Any:
            if isinstance(part, dict):
                return {name: made(value, name) for name, value in part.items()}
            if isinstance(part, list):
                return [made(value, field) for value in part]
            if not isinstance(part, str):
                return part
            if field in ("name", "end_of") and part in named and "{" not in part:
                return f"{part} {objects[item]}"
            for name, value in values.items():
                part = part.replace(name, value)
            return part

        filled = [_filled(made(one), number, below) for one in body]
        return blocks(_STAGES.validate_python(filled))

    return stages


def _filled(stage: Mapping[str, Any], number: int, below: str | None) -> dict[str, Any]:
    """A stage whose places on a grid or stack are the next ones after some were taken."""
    filled = dict(stage)
    for name in ("grid", "stack"):
        if filled.get(name):
            first = filled[name].get("first", 0)
            filled[name] = {**filled[name], "first": first + number}
    if filled.get("stack") and below is not None:
        support = filled.get("support") or []
        filled["support"] = [*([support] if isinstance(support, str) else support), below]
    return filled
