"""Kept plans as they are answered: summaries, documents and bundles."""

import json
from datetime import UTC, datetime
from http import HTTPStatus
from typing import Any

from pydantic import BaseModel
from starlette.concurrency import run_in_threadpool

from armwright_wire.plans.kept_plan import Bundle, DocumentName, KeptPlanSummary
from armwright_wire.robots.robot import RobotBody
from armwright_wire.scenes.scene import NamedScene
from service.fields import picked
from service.http.keeping import answer_digest
from service.problem import ProblemError, request_problem
from service.storage.stores.plan_store import PlanContent, PlanRecord, PlanStore
from service.validation import parse_json, validate_as

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
