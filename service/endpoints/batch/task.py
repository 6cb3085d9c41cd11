"""The problems of a batch, separated and planned in workers: a batch may be megabytes."""

import time
from typing import Any

from pydantic import ValidationError
from pydantic_core import from_json, to_json

from armwright_wire.plans.batch import BatchRequest, PlanRequests
from armwright_wire.scenes.scene import NamedScene
from kinematics.errors import ArmwrightError
from planning.values.deadline import Deadline
from service.endpoints.plan.task import plan_outcome
from service.endpoints.robots import task as robots
from service.storage.caches import prepared_files
from service.storage.caches.cache_key import Reference
from service.translate.frames import names_frame
from service.validation import body_problem
from service.workers import current
from service.workers.chunk_sizes import TURN, Pace, chunk_sizes
from service.workers.result import (
    BatchItem,
    BatchPart,
    PlannedPart,
    PlanOutcome,
    SplitBatch,
    TaskProblem,
)
from service.workers.task import GRACE, task


@task
def split(content: bytes, folder: str, name: str) -> SplitBatch:
    """The problems of a batch; a scene that it gives inline is built and kept for all workers.

    Args:
        content: The request, which was found valid when it came.
        folder: Folder in which the scene is kept.
        name: Name for the scene, different from that of any that is stored.

    Raises:
        InvalidScene: The scene can't be built.
    """
    head, problems = _parts(content)
    scene, shared = head.get("scene"), None
    if isinstance(scene, dict):
        del head["scene"]
        named = {**scene, "name": name, "frame": scene.get("frame") or head.get("frame")}
        document = NamedScene.model_validate_json(to_json(named)).model_dump_json(exclude_none=True)
        robots.prepare_scene(document.encode(), folder, name)
        shared = prepared_files.document_hash(document.encode())
    items = tuple(_item(head, problem, is_shared=shared is not None) for problem in problems)
    return SplitBatch(items, to_json(head)[1:-1] + b"," if head else b"", shared)


@task
def cut(content: bytes, pace: Pace) -> tuple[BatchPart, ...]:
    """The parts of a batch that agents answer apart, each with all that it needs.

    Args:
        content: The request, which was found valid when it came.
        pace: Speed of the agents.
    """
    head, problems = _parts(content)
    parts, first = [], 0
    for size in chunk_sizes(len(problems), pace):
        part = to_json({**head, "problems": problems[first : first + size]})
        parts.append(BatchPart(first, size, part))
        first += size
    return tuple(parts)


@task(grace=GRACE + TURN)
def plan_part(
    robot: Reference, scene: Reference | None, content: bytes, timeout: float
) -> PlannedPart:
    """Plan the problems of a part of a batch one after another, for `TURN` or a little longer.

    Args:
        robot: The robot of all of them.
        scene: The scene of all of them, where it is stored or shared.
        content: The part, as a batch of its own.
        timeout: Timeout of each problem [s].
    """
    began = time.monotonic()
    body = BatchRequest.model_validate_json(content)
    requests, framed = PlanRequests(body), names_frame(content)
    outcomes: list[PlanOutcome | TaskProblem] = []
    for index in range(len(body.problems)):
        current.begin_part(index, Deadline.after(timeout))
        outcomes.append(_outcome(robot, scene, requests, index, framed=framed))
        if time.monotonic() - began >= TURN:
            break
    return PlannedPart(tuple(outcomes), time.monotonic() - began)


def _outcome(
    robot: Reference, scene: Reference | None, requests: PlanRequests, index: int, *, framed: bool
) -> PlanOutcome | TaskProblem:
    """Plan or problem of one of a part: its faults are its own, and not those of the part."""
    try:
        return plan_outcome(robot, scene, requests[index], framed=framed)
    except ArmwrightError as error:
        return TaskProblem(error.code, error.message, error.hint, dict(error.details))
    except ValidationError as error:
        # What it says alone is valid; with what the batch says for all it is not.
        return TaskProblem.of(body_problem(error, {}))


def _parts(content: bytes) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """The fields of a batch that stand beside its problems, those that are null left out."""
    head: dict[str, Any] = from_json(content, cache_strings="keys")
    problems: list[dict[str, Any]] = head.pop("problems")
    return {name: value for name, value in head.items() if value is not None}, problems


def _item(head: dict[str, Any], problem: dict[str, Any], *, is_shared: bool) -> BatchItem:
    def field(name: str) -> Any:
        value = problem.get(name)
        return head.get(name) if value is None else value

    scene, tip = field("scene"), field("tcp")
    mounted = {"tool": field("tool"), "tcp": tip}
    if isinstance(tip, dict):
        mounted["attached"] = field("attached")
    return BatchItem(
        field("robot"),
        scene if isinstance(scene, str) else None,
        is_shared and problem.get("scene") is None,
        field("timeout"),
        to_json(problem),
        mounted if any(mounted.values()) else {},
    )
