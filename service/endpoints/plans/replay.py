"""Replays of kept plans: the request once more, perhaps changed, through the same endpoint."""

import json
from collections.abc import Mapping
from contextlib import AsyncExitStack
from dataclasses import dataclass
from typing import Any

from fastapi import Request

from kinematics.errors import ArmwrightError
from service.http.errors import problem_content, problem_of
from service.http.keeping import KEPT_PLAN, answers_request
from service.http.state import REPLAY, STORED_TOOL, USED_REFERENCES, Replay, prepared_folder
from service.jobs.replay import send_again
from service.storage.caches.cache_key import Reference
from service.storage.stores.plan_store import PlanContent, PlanRecord
from service.validation import ProblemError

#: Keys of a scope that belong to the request around the replay.
_OUTER = ("route", "endpoint", "path_params", "starlette.exception_handlers", "router", KEPT_PLAN,
          STORED_TOOL)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Replayed:
    """Result of a replay.

    Args:
        content: The answer or problem, JSON.
        succeeded: Whether the content is an answer, not a problem.
        plan_id: The kept plan that it became, if it was kept.
    """

    content: bytes
    succeeded: bool
    plan_id: str | None


def merge(value: Any, patch: Any) -> Any:
    """A JSON value with a merge patch (RFC 7396) applied."""
    if not isinstance(patch, dict):
        return patch
    merged = dict(value) if isinstance(value, dict) else {}
    for name, change in patch.items():
        if change is None:
            merged.pop(name, None)
        else:
            merged[name] = merge(merged.get(name), change)
    return merged


def replayed_body(
    content: PlanContent, changes: Mapping[str, Any] | None, keep: bool | None
) -> bytes:
    """The body of a kept request for its replay; without changes, its own bytes as far as can be.

    Args:
        content: Content of the kept plan.
        changes: A merge patch.
        keep: Whether the replay is to be kept; None to leave that to the endpoint.
    """
    body = {**json.loads(content.request)}
    body.pop("keep", None)
    body = merge(body, changes or {})
    if keep is not None:
        body["keep"] = keep
    return json.dumps(body, ensure_ascii=False, separators=(",", ":")).encode()


def pinned_references(request: Request, record: PlanRecord) -> tuple[Reference, ...]:
    """Robot and scene of a kept plan, by the hashes that they had."""
    folder = prepared_folder(request)
    references = []
    if record.robot is not None and record.robot_hash is not None:
        references.append(Reference("robot", record.robot, record.robot_hash, folder))
    if record.scene is not None and record.scene_hash is not None:
        references.append(Reference("scene", record.scene, record.scene_hash, folder))
    return tuple(references)


async def replay_plan(
    request: Request, record: PlanRecord, body: bytes, pinned: tuple[Reference, ...]
) -> Replayed:
    """Answer a kept request once more.

    Args:
        request: Request that asks for the replay: its client, job and caller are those of the
            replay.
        record: The kept plan.
        body: The request, JSON.
        pinned: Robot and scene that stay as they were.

    Raises:
        ProblemError: Nothing was computed: a name is unknown, a change malformed, the service busy.
        fastapi.exceptions.RequestValidationError: A change does not follow the schema.
    """
    scope = {name: value for name, value in request.scope.items() if name not in _OUTER}
    scope[REPLAY] = Replay(record.id, pinned)
    scope[USED_REFERENCES] = {}
    scope |= {"path": record.path, "raw_path": record.path.encode(), "query_string": b""}
    scope["headers"] = [
        (b"content-type", b"application/json"),
        (b"content-length", str(len(body)).encode()),
    ]
    try:
        async with AsyncExitStack() as stack:
            # A request that its route got directly has not passed the framework's own layer.
            scope.setdefault("fastapi_middleware_astack", stack)
            sent = await send_again(request.app.router, scope, body, request.receive)
    except (ProblemError, ArmwrightError) as error:
        content = answering_problem(error, record.path)
        return Replayed(content, succeeded=False, plan_id=scope.get(KEPT_PLAN))
    return Replayed(bytes(sent.body), succeeded=True, plan_id=scope.get(KEPT_PLAN))


def answering_problem(error: ProblemError | ArmwrightError, path: str) -> bytes:
    """The problem document that answers a request.

    Args:
        error: Reason for which there is no other answer.
        path: Path of the request.

    Raises:
        ProblemError: Nothing was computed.
        ArmwrightError: Nothing was computed.
    """
    problem = problem_of(error)
    if not answers_request(problem):
        raise error
    return problem_content(problem, path)
