"""Kept answers: a request that says so is stored with its answer or problem.

Digests of answers, without the times that were measured, tell whether a replay answers the same.
"""

import hashlib
import json
import logging
import re
import time
from collections.abc import Awaitable, Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import islice
from typing import Any, NamedTuple

from fastapi import Request, Response
from pydantic import BaseModel
from pydantic_core import from_json, to_json
from starlette.concurrency import run_in_threadpool

from armwright_wire.base import Keepable
from armwright_wire.plans.kept_plan import MAX_DIFFERENCES
from kinematics.errors import ArmwrightError
from service.access.authentication import caller_of
from service.http.audit import check_answer
from service.http.errors import problem_content, problem_of, status_of
from service.http.state import (
    DRY_RUN,
    REPLAY,
    STORED_TOOL,
    USED_REFERENCES,
    Replay,
    job_context,
    new_id,
    retention,
    settings_of,
    store_of,
)
from service.storage.caches.cache_key import Reference
from service.storage.caches.mounts import with_tools
from service.storage.database import StorageUnavailable
from service.storage.stores.plan_store import PlanContent, PlanRecord
from service.validation import ProblemError
from service.version import VERSION

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
        status: Status of HTTP.
        code: Code of the problem, if it is one.
        content: JSON.
    """

    status: int
    code: str | None
    content: bytes


def answers_request(problem: ProblemError) -> bool:
    """Whether a problem is what was found out of a request, and not that nothing was computed."""
    return status_of(problem) in _ANSWERING and problem.code not in _MALFORMED


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
    begun = time.monotonic()
    try:
        response = await handle(request)
        await check_answer(request, bytes(response.body), time.monotonic() - begun)
    except (ProblemError, ArmwrightError) as error:
        problem = problem_of(error)
        if not answers_request(problem) and problem.code != "CERTIFICATE_DISPUTED":
            raise
        content = problem_content(problem, request.url.path)
        plan_id = await _keep(request, _Outcome(status_of(problem), problem.code, content))
        if plan_id is not None:
            problem.headers["Location"] = f"/v1/plans/{plan_id}"
            problem.details["plan_id"] = plan_id
        raise problem from None
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


def named_robot(path: str, body: Mapping[str, Any]) -> str | None:
    """The robot that a request names, in its path or its body."""
    named = _IK_ROBOT.match(path)
    return named[1] if named else body.get("robot")


def states_proof(path: str, content: bytes) -> bool:
    """Whether an answer says that all is proved: those of validate alone may say that it is not.

    Args:
        path: Path of the request.
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
    body = await request.body()
    if STORED_TOOL in request.scope:  # which may be another one when it is replayed
        body = to_json(with_tools(from_json(body), request.scope[STORED_TOOL]))
    content = PlanContent(body, outcome.content)
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
        id=new_id(),
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


#: Fields that hold measured times or names of this one answer: they differ from run to run.
_MEASURED = frozenset({"milliseconds", "plan_id", "instance"})


def answer_digest(content: bytes) -> str:
    """SHA-256 of an answer or problem without measured times, in hexadecimal digits.

    Args:
        content: JSON.
    """
    # Keys keep their order and floats their shortest form: equal digests are equal bytes.
    text = json.dumps(_reproducible(json.loads(content)), separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


class Comparison(NamedTuple):
    """Comparison of two answers, without measured times.

    Args:
        same: They are equal.
        differences: JSON pointers (RFC 6901) to the first values that they do not have in common.
        digest: SHA-256 of the second.
    """

    same: bool
    differences: list[str]
    digest: str


def compared(first: bytes, second: bytes) -> Comparison:
    """The comparison of two answers or problems, JSON."""
    digest = answer_digest(second)
    if digest == answer_digest(first):
        return Comparison(True, [], digest)
    values = _reproducible(json.loads(first)), _reproducible(json.loads(second))
    return Comparison(False, list(islice(_pointers(*values, ""), MAX_DIFFERENCES)), digest)


def _reproducible(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _reproducible(item) for name, item in value.items() if name not in _MEASURED}
    if isinstance(value, list):
        return [_reproducible(item) for item in value]
    return value


def _pointers(first: Any, second: Any, at: str) -> Iterator[str]:
    if isinstance(first, dict) and isinstance(second, dict):
        for name in [*first, *(name for name in second if name not in first)]:
            pointer = f"{at}/{name.replace('~', '~0').replace('/', '~1')}"
            if name in first and name in second:
                yield from _pointers(first[name], second[name], pointer)
            else:
                yield pointer
    elif isinstance(first, list) and isinstance(second, list) and len(first) == len(second):
        for index, pair in enumerate(zip(first, second, strict=True)):
            yield from _pointers(*pair, f"{at}/{index}")
    elif first != second:
        yield at


_log = logging.getLogger(__name__)
