"""Kept plans: requests with their answers, to be looked at, replayed and taken elsewhere.

Kept plans as they are answered: summaries, documents and bundles.
"""

import asyncio
import json
import time
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from http import HTTPStatus
from typing import Annotated, Any, Literal

from fastapi import Query, Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.responses import HTMLResponse
from pydantic import BaseModel
from pydantic_core import to_json
from starlette.concurrency import run_in_threadpool

from armwright_wire.plans.kept_plan import (
    Bundle,
    DocumentName,
    KeptPlan,
    KeptPlanSummary,
    PlanList,
    ReplayAnswer,
    ReplayRequest,
    StopAnswer,
    StopRequest,
)
from armwright_wire.robots.robot import RobotBody
from armwright_wire.scenes.scene import NamedScene
from kinematics.errors import ArmwrightError
from service.access.authentication import caller_of
from service.endpoints.documents import page
from service.endpoints.plans.replay import pinned_references, replay_plan, replayed_body
from service.fields import picked
from service.http import answers
from service.http.json_route import json_router
from service.http.keeping import answer_digest, compared, named_robot, states_proof
from service.http.state import REPLAY, Replay, kept_plan, new_id, retention, settings_of, store_of
from service.storage.caches.cache_key import Reference
from service.storage.caches.prepared_files import document_hash
from service.storage.stores.plan_store import PlanContent, PlanRecord, PlanStore
from service.task_references import stop as stop_task
from service.task_references import swept as swept_task
from service.task_references import view as view_task
from service.task_references import witness as witness_task
from service.validation import ProblemError, parse_json, request_problem, validate_as
from service.viewer.page import content_security_policy
from service.workers.result import CacheMiss, TaskProblem
from service.workers.task import Job

#: What the documents of a bundle are, by their fields.
_DOCUMENTS: dict[str, type[BaseModel]] = {"robot_document": RobotBody, "scene_document": NamedScene}


def plan_summary(record: PlanRecord, lifetime: float) -> KeptPlanSummary:
    """A kept plan without its content; it is kept for a lifetime [s]."""
    return KeptPlanSummary(
        operation=f"{record.method} {record.path}",
        status="succeeded" if _succeeded(record) else "failed",
        robot=_name(record.robot, record.robot_hash),
        scene=_name(record.scene, record.scene_hash),
        **picked(record, "id", "code", "seed", "version", "digest", "job", "replay_of"),
        created=_moment(record.created),
        expires=_moment(record.created + lifetime),
        proved_here=record.proved_here,
    )


def plan_document(record: PlanRecord, content: PlanContent, lifetime: float) -> bytes:
    """The JSON of a kept plan; request and answer go in as they are."""
    head = plan_summary(record, lifetime).model_dump_json().encode()[:-1]
    answer, problem = (content.answer, b"null") if _succeeded(record) else (b"null", content.answer)
    parts = (head, b',"request":', content.request, b',"answer":', answer)
    return b"".join((*parts, b',"problem":', problem, b"}"))


async def bundle(plans: PlanStore, record: PlanRecord, content: PlanContent) -> Bundle:
    """A kept plan with its documents, for another installation."""
    robot = await _document(plans, record.robot_hash, record.tenant)
    scene = await _document(plans, record.scene_hash, record.tenant)
    return Bundle(
        armwright_bundle=1,
        operation=f"{record.method} {record.path}",
        status="succeeded" if _succeeded(record) else "failed",
        **picked(record, "version", "seed", "digest", "robot"),
        robot_document=robot,
        scene=record.scene,
        scene_document=scene,
        request=content.request.decode(),
        answer=content.answer.decode(),
    )


def checked_bundle(value: Any) -> Bundle:
    """A bundle from outside, each part of which has its form; what it claims is not looked at.

    Raises:
        ProblemError: VALIDATION_ERROR: a part has another form, or the digest is not that of the
            answer.
    """
    body = validate_as(Bundle, value)
    for field in ("request", "answer"):
        if not _is_object(getattr(body, field)):
            raise _broken(f"{field}: this is no JSON object")
    if (problem_code(body.answer) is None) is (body.status == "failed"):
        raise _broken("answer: a problem belongs to the status failed, and to no other")
    if answer_digest(body.answer.encode()) != body.digest:
        raise _broken("digest: it is not that of the answer")
    for field, model in _DOCUMENTS.items():
        document = getattr(body, field)
        try:
            if document is not None:
                validate_as(model, parse_json(document.encode()))
        except ProblemError as error:
            raise _broken(f"{field}: {error.detail}") from error
    return body


def problem_code(answer: str) -> str | None:
    """The code of a problem document, if it is one."""
    value = json.loads(answer)
    code = value.get("code") if isinstance(value, dict) else None
    return code if isinstance(code, str) else None


async def _document(plans: PlanStore, digest: str | None, tenant: str) -> str | None:
    if digest is None:
        return None
    content = await run_in_threadpool(plans.document, digest, tenant)
    return None if content is None else content.decode()


def _is_object(text: str) -> bool:
    try:
        return isinstance(parse_json(text.encode()), dict)
    except ProblemError:
        return False


def _broken(detail: str) -> ProblemError:
    return request_problem(
        "VALIDATION_ERROR",
        detail,
        hint="The bundle was changed. Fetch it again from GET /v1/plans/{id}/bundle.",
    )


def _succeeded(record: PlanRecord) -> bool:
    return record.status < HTTPStatus.BAD_REQUEST


def _name(name: str | None, digest: str | None) -> DocumentName | None:
    return None if name is None else DocumentName(name=name, hash=digest)


def _moment(seconds: float) -> datetime:
    return datetime.fromtimestamp(seconds, UTC)


router = json_router("kept plans", "/v1/plans")

#: Time for a page: clearances are measured at up to 151 instants [s].
_VIEW_TIMEOUT = 60.0
#: Time for answering the request of an imported plan; longer ones are not proved here [s].
_PROOF_TIMEOUT = 120.0
#: Of meshes and witnesses: generators of clients know none of theirs.
_BYTES = "application/octet-stream"
#: Status of a kept problem whose own is not known: an imported one.
_FAILED = 422
_SUCCEEDED = 200


@router.get("", summary="List kept plans")
async def list_plans(
    request: Request,
    robot: Annotated[
        str | None, Query(max_length=128, description="only those of this robot")
    ] = None,
    after: Annotated[str, Query(max_length=64, description="plans older than this one")] = "",
    limit: Annotated[int, Query(ge=1, le=1000)] = 100,
) -> PlanList:
    """Kept plans without their content, newest first, page by page."""
    tenant = caller_of(request.scope).tenant
    plans = store_of(request).plans
    stored = await run_in_threadpool(plans.list, after, limit + 1, tenant, robot=robot)
    records, following = page(stored, limit, lambda record: record.id)
    lifetime = settings_of(request).plan_lifetime
    return PlanList(plans=[plan_summary(item, lifetime) for item in records], next=following)


@router.post("", status_code=201, summary="Import a kept plan", response_model=KeptPlanSummary)
async def import_plan(body: Bundle, request: Request) -> Response:
    """Keeps the plan of a bundle, with its robot and scene, so that it can be replayed here.

    A bundle proves nothing by itself: its request is answered once more, with its robot and its
    scene. Where that gives the same answer, the plan is `proved_here`.
    """
    # The outline of a large body has its texts cut.
    whole = await run_in_threadpool(checked_bundle, parse_json(await request.body()))
    path = body.operation.removeprefix("POST ")
    documents = [whole.robot_document, whole.scene_document]
    contents = [None if text is None else text.encode() for text in documents]
    robot_hash, scene_hash = (None if c is None else document_hash(c) for c in contents)
    caller = caller_of(request.scope)
    record = PlanRecord(
        id=new_id(),
        method="POST",
        path=path,
        status=_SUCCEEDED if whole.status == "succeeded" else _FAILED,
        code=None if whole.status == "succeeded" else problem_code(whole.answer),
        robot=whole.robot,
        robot_hash=robot_hash,
        scene=whole.scene,
        scene_hash=scene_hash,
        seed=whole.seed,
        version=whole.version,
        digest=whole.digest,
        created=time.time(),
        tenant=caller.tenant,
        api_key=caller.api_key,
    )
    content = PlanContent(whole.request.encode(), whole.answer.encode())
    given = {document_hash(c): c for c in contents if c is not None}
    plans, settings = store_of(request).plans, settings_of(request)
    await run_in_threadpool(plans.add, record, content, given)
    own = await _same_answer(request, record, content)
    if own is not None:
        await run_in_threadpool(plans.note_proof, record.id, record.tenant, own)
        record = replace(record, proved_here=True)
    await run_in_threadpool(plans.purge, time.time(), retention(settings))
    summary = plan_summary(record, settings.plan_lifetime)
    headers = {"Location": f"/v1/plans/{record.id}"}
    return Response(summary.model_dump_json(), 201, headers, "application/json")


@router.get("/{id}", summary="Get a kept plan", response_model=KeptPlan)
async def get_plan(id: str, request: Request) -> Response:  # noqa: A002  (its name in the path)
    """The request, robot and scene by content hash, version, seed, and the answer or problem."""
    record, content = await kept_plan(request, id)
    document = plan_document(record, content, settings_of(request).plan_lifetime)
    return Response(document, media_type="application/json")


@router.delete("/{id}", status_code=204, summary="Forget a kept plan")
async def delete_plan(id: str, request: Request) -> Response:  # noqa: A002
    """Forgets the plan, and the robot and scene that were kept for it alone."""
    tenant = caller_of(request.scope).tenant
    await run_in_threadpool(store_of(request).plans.delete, id, tenant)
    return Response(status_code=204)


@router.get("/{id}/bundle", summary="Get a kept plan as a file", response_model=Bundle)
async def get_bundle(id: str, request: Request) -> Response:  # noqa: A002
    """One file with request, robot, scene and answer: POST it to /v1/plans of another service."""
    record, content = await kept_plan(request, id)
    whole = await bundle(store_of(request).plans, record, content)
    headers = {"Content-Disposition": f'attachment; filename="armwright-plan-{record.id}.json"'}
    return Response(whole.model_dump_json(), headers=headers, media_type="application/json")


@router.get(
    "/{id}/view",
    summary="See a kept plan",
    response_class=HTMLResponse,
    responses={
        200: {"description": "A page that needs nothing else", "content": {"text/html": {}}}
    },
)
async def view_plan(
    id: str,  # noqa: A002
    request: Request,
    tree: Annotated[
        bool,
        Query(description="plan once more, and draw the tree or roadmap of the last planner"),
    ] = False,
) -> Response:
    """One HTML file that shows robot, scene, motion, curves and proof, or why there is no motion.

    It opens from disk too, and asks no host for anything.
    """
    _, result = await _computed(
        id, request, lambda robot, scene, kept: view_task.job(robot, scene, kept, tree)
    )
    return HTMLResponse(result, headers={"Content-Security-Policy": content_security_policy()})


@router.get(
    "/{id}/swept",
    summary="Get the space that a kept motion takes up",
    response_class=Response,
    responses={
        200: {
            "description": "A mesh that holds all of it",
            "content": {_BYTES: {"schema": {"type": "string", "format": "binary"}}},
        }
    },
)
async def swept_plan(
    id: str,  # noqa: A002
    request: Request,
    format: Annotated[  # noqa: A002
        Literal["glb", "stl"], Query(description="of the file")
    ] = "glb",
    tolerance: Annotated[
        float, Query(ge=1e-4, le=1.0, description="what the hulls may be grown by [m]")
    ] = 0.005,
) -> Response:
    """A mesh that holds every point of the moving arm, and of what it holds, at every instant.

    For kept plans, proofs, tasks and tours. It is made of convex hulls that overlap.
    """
    record, result = await _computed(
        id,
        request,
        lambda robot, scene, kept: swept_task.job(robot, scene, kept, format, tolerance),
    )
    name = f'attachment; filename="armwright-swept-{record.id}.{format}"'
    return Response(result, media_type=_BYTES, headers={"Content-Disposition": name})


@router.post("/{id}/stop", summary="Stop the motion of a kept plan", response_model=StopAnswer)
async def stop_plan(id: str, body: StopRequest, request: Request) -> Response:  # noqa: A002
    """The stop of a kept motion from an instant on, as a trajectory with its own certificate.

    For kept plans and proofs. Where the stop meets something its certificate says what, and where.
    """
    _, result = await _computed(
        id,
        request,
        lambda robot, scene, kept: stop_task.job(robot, scene, kept, body.at, body.kind),
        body.timeout,
    )
    return Response(result, media_type="application/json")


@router.get(
    "/{id}/witness",
    summary="Get the witness of a kept plan",
    response_model=dict[str, Any],
    responses={200: {"description": "JSON or the compact form", "content": {_BYTES: {}}}},
)
async def plan_witness(
    id: str,  # noqa: A002
    request: Request,
    form: Annotated[
        Literal["json", "compact"], Query(description="of the document; both say the same")
    ] = "json",
    part: Annotated[int, Query(ge=0, description="stage of a task or leg of a tour")] = 0,
) -> Response:
    """A document from which anybody can check a kept plan or proof without this service.

    Its compact form is what both checkers read; JSON says the same.
    """
    compact = form == "compact"
    _, result = await _computed(
        id, request, lambda robot, scene, kept: witness_task.job(robot, scene, kept, part, compact)
    )
    return Response(result, media_type=_BYTES if compact else "application/json")


@router.post("/{id}/replay", summary="Replay a kept plan", response_model=ReplayAnswer)
async def replay(id: str, body: ReplayRequest, request: Request) -> Response:  # noqa: A002
    """The kept request answered once more, perhaps with changes, and compared with what was kept.

    Robot and scene are those that were kept unless the request says otherwise or changes name
    others. A problem is an answer too: the status is 200 where something was computed.
    """
    record, content = await kept_plan(request, id)
    pinned = pinned_references(request, record) if body.documents == "kept" else ()
    again = replayed_body(content, body.changes, body.keep_replay)
    result = await replay_plan(request, record, again, pinned)
    found = await run_in_threadpool(compared, content.answer, result.content)
    head = to_json(found._asdict() | {"plan_id": result.plan_id})
    field = b"answer" if result.succeeded else b"problem"
    answer = head[:-1] + b',"%s":' % field + result.content + b"}"
    return Response(answer, media_type="application/json")


async def _same_answer(request: Request, record: PlanRecord, content: PlanContent) -> bytes | None:
    """The answer of this service to a kept request, if it is the kept one and says proved."""
    asked = parse_json(content.request)
    scene = asked.get("scene") if isinstance(asked.get("scene"), str) else None
    # The page draws the robot and the scene of the record.
    if record.code or (named_robot(record.path, asked), scene) != (record.robot, record.scene):
        return None
    body, pinned = replayed_body(content, None, keep=False), pinned_references(request, record)
    try:
        async with asyncio.timeout(_PROOF_TIMEOUT):
            result = await replay_plan(request, record, body, pinned)
    except (TimeoutError, ProblemError, ArmwrightError, RequestValidationError):
        return None
    if not result.succeeded or not states_proof(record.path, result.content):
        return None
    digest = await run_in_threadpool(answer_digest, result.content)
    return result.content if digest == record.digest else None


async def _computed(
    plan_id: str,
    request: Request,
    make_job: Callable[[Reference, Reference | None, bytes], Job[bytes | TaskProblem | CacheMiss]],
    timeout: float | None = None,
) -> tuple[PlanRecord, bytes]:
    """A kept plan, and the result of a job about it: its robot with its tool, its scene, itself."""
    record, content = await kept_plan(request, plan_id)
    document = plan_document(record, content, settings_of(request).plan_lifetime)
    request.scope[REPLAY] = Replay(record.id, pinned_references(request, record))
    result = await answers.answer(
        request,
        lambda robot, scene: make_job(robot, scene, document),
        record.robot or "",
        record.scene,
        asked=parse_json(content.request),
        timeout=timeout or min(_VIEW_TIMEOUT, settings_of(request).max_timeout),
    )
    return record, result
