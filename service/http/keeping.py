"""Kept answers: a request that says so is stored with its answer or problem."""

import json
import logging
import re
import secrets
import time
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass
from typing import Any

from fastapi import Request, Response
from pydantic import BaseModel
from starlette.concurrency import run_in_threadpool

from armwright_wire.base import Keepable
from kinematics.errors import ArmwrightError
from service.access.caller import caller_of
from service.http.answer_digest import answer_digest
from service.http.errors import document, from_domain, status_of, with_headers
from service.http.job_context import DRY_RUN, job_context
from service.http.state import (
    REPLAY,
    USED_REFERENCES,
    Replay,
    retention,
    settings_of,
    store_of,
)
from service.problem import ProblemError
from service.storage.cache_key import Reference
from service.storage.database import StorageUnavailable
from service.storage.plan_store import PlanContent, PlanRecord
from service.version import VERSION

_log = logging.getLogger(__name__)
#: Key in the scope of a request, with the id of the plan that it was kept as.
KEPT_PLAN = "armwright.kept_plan"
#: Statuses of problems that answer the request: no motion, or the deadline passed.
_ANSWERING = (422, 504)
#: Codes of problems with these statuses that only say that the request is malformed.
_MALFORMED = frozenset({"VALIDATION_ERROR", "OUT_OF_MEMORY", "IDEMPOTENCY_KEY_REUSED"})
_IK_ROBOT = re.compile(r"/v1/robots/([^/]+)/")


@dataclass(frozen=True, slots=True)
class _Outcome:
    """Answer or problem of a request.

    Args:
        status: Of HTTP.
        code: Of the problem, if it is one.
        content: JSON.
    """

    status: int
    code: str | None
    content: bytes


def takes_keep(model: type[BaseModel] | None) -> bool:
    """Whether requests that follow a model can be kept."""
    return model is not None and issubclass(model, Keepable)


async def answer_and_keep(
    request: Request, handle: Callable[[Request], Awaitable[Response]]
) -> Response:
    """Handle a request that can be kept, and keep it with its answer or problem if it says so.

    Raises:
        ProblemError: That of the request; a kept one has a header Location and a `plan_id`.
    """
    if request.scope.get(DRY_RUN) or not await _is_wanted(request):
        return await handle(request)
    try:
        response = await handle(request)
    except (ProblemError, ArmwrightError) as error:
        problem = from_domain(error) if isinstance(error, ArmwrightError) else error
        if status_of(problem) not in _ANSWERING or problem.code in _MALFORMED:
            raise
        content = json.dumps(document(problem, request.url.path), ensure_ascii=False)
        failure = _Outcome(status_of(problem), problem.code, content.encode())
        plan_id = await _keep(request, failure)
        if plan_id is None:
            raise problem from None
        place = {"Location": f"/v1/plans/{plan_id}"}
        raise with_headers(problem, place, plan_id=plan_id) from None
    outcome = _Outcome(response.status_code, None, bytes(response.body))
    plan_id = await _keep(request, outcome)
    if plan_id is None:
        return response
    return Response(
        b'{"plan_id":"%s",' % plan_id.encode() + outcome.content[1:],
        response.status_code,
        {"Location": f"/v1/plans/{plan_id}"},
        response.headers["content-type"],
    )


def new_plan_id() -> str:
    """The id of a new kept plan: later ones sort after earlier ones, and none can be guessed."""
    return f"{int(1000 * time.time()):012x}{secrets.token_hex(10)}"


def named_robot(path: str, body: Mapping[str, Any]) -> str | None:
    """The robot that a request names, in its path or its body."""
    named = _IK_ROBOT.match(path)
    return named[1] if named else body.get("robot")


def states_proof(path: str, content: bytes) -> bool:
    """Whether an answer says that all is proved: those of validate alone may say that it is not.

    Args:
        path: Of the request.
        content: The answer, JSON.
    """
    return path != "/v1/validate" or json.loads(content)["verified"] is True


async def _is_wanted(request: Request) -> bool:
    body = await request.json()
    wanted = body.get("keep") if isinstance(body, dict) else getattr(body, "keep", None)
    return job_context(request) is not None if wanted is None else wanted is True


async def _keep(request: Request, outcome: _Outcome) -> str | None:
    """Keep an outcome; the id of the plan, or None if the storage can't be used now.

    An answer is worth more than its record: it is given either way.
    """
    content = PlanContent(await request.body(), outcome.content)
    record = await run_in_threadpool(_record, request, content, outcome)
    plans = store_of(request).plans
    try:
        await run_in_threadpool(plans.add, record, content)
        await run_in_threadpool(plans.purge, time.time(), retention(settings_of(request)))
    except StorageUnavailable as problem:
        _log.warning("an answer could not be kept: %s", problem.detail)
        return None
    request.scope[KEPT_PLAN] = record.id
    return record.id


def _record(request: Request, content: PlanContent, outcome: _Outcome) -> PlanRecord:
    caller = caller_of(request.scope)
    context = job_context(request)
    replay: Replay | None = request.scope.get(REPLAY)
    used: dict[str, Reference] = request.scope.get(USED_REFERENCES, {})
    robot, scene = used.get("robot"), used.get("scene")
    body: dict[str, Any] = json.loads(content.request)
    robot_name = named_robot(request.url.path, body)
    return PlanRecord(
        id=new_plan_id(),
        method=request.method,
        path=request.url.path,
        status=outcome.status,
        code=outcome.code,
        robot=robot_name if robot is None else robot.name,
        robot_hash=None if robot is None or robot.built_in else robot.hash,
        scene=None if scene is None else scene.name,
        scene_hash=None if scene is None else scene.hash,
        seed=body.get("seed"),
        version=VERSION,
        digest=answer_digest(outcome.content),
        created=time.time(),
        job=None if context is None else context.id,
        replay_of=None if replay is None else replay.plan_id,
        tenant=caller.tenant,
        api_key=caller.api_key,
        proved_here=outcome.code is None and states_proof(request.url.path, outcome.content),
    )
