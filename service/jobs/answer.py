"""Answers about jobs, and ``Prefer: respond-async``: 202 for a request that becomes one."""

from base64 import b64encode
from datetime import UTC, datetime

from fastapi import Request, Response
from pydantic_core import to_json

from armwright_wire.plans.job import JobSummary
from service.access.authentication import caller_of
from service.fields import picked
from service.http.idempotency import kept_answer, note_kept
from service.http.json_route import Handler, prefers_async
from service.http.state import DRY_RUN, DeferToJob
from service.jobs.runner import Jobs
from service.storage.stores.job_store import JobAnswer, JobRecord, StoredRequest


def job_summary(record: JobRecord, lifetime: float | None = None) -> JobSummary:
    """Status of a job; ended ones are kept for a lifetime [s]."""
    expires = None
    if record.ended is not None and lifetime is not None:
        expires = record.ended + lifetime
    return JobSummary(
        operation=f"{record.method} {record.path}",
        **picked(record, "id", "status", "progress", "stage", "location"),
        created=_moment(record.created) or "",
        started=_moment(record.started),
        ended=_moment(record.ended),
        expires=_moment(expires),
    )


def job_document(record: JobRecord, answer: JobAnswer | None, lifetime: float) -> bytes:
    """The JSON of a job; its answer, perhaps megabytes, goes in as it is, without being parsed."""
    result, error = b"null", b"null"
    if answer is not None and record.status == "succeeded":
        result = _embed(answer)
    elif answer is not None and record.status == "failed":
        error = _embed(answer)
    head = job_summary(record, lifetime).model_dump_json().encode()[:-1]
    return b"".join((head, b',"result":', result, b',"error":', error, b"}"))


def _embed(answer: JobAnswer) -> bytes:
    media_type = answer.content_type.split(";")[0]
    if media_type.endswith("json"):
        return answer.content or b"null"
    if media_type.startswith("text/") or media_type.endswith("xml"):
        return to_json(answer.content.decode("utf-8", "replace"))
    # A file, such as a mesh: as base64, which keeps every byte.
    return to_json(b64encode(answer.content).decode())


def _moment(seconds: float | None) -> datetime | None:
    return None if seconds is None else datetime.fromtimestamp(seconds, UTC)


async def defer(request: Request, handle: Handler) -> Response:
    """Check a request as far as that goes without work, and make a job of it.

    A request at fault is refused at once. One that needs no work is answered, and the job has
    succeeded.

    Raises:
        ProblemError: The request can't be answered, or no more jobs are accepted.
    """
    jobs: Jobs = request.app.state.jobs
    stored = StoredRequest(
        request.method,
        request.scope["path"],
        request.headers.get("content-type", ""),
        await request.body(),
    )
    caller = caller_of(request.scope)
    await jobs.check_room(len(stored.body), caller)
    preferred = prefers_async(request.headers.getlist("prefer"))

    def accepted(record: JobRecord) -> Response:
        headers = {"Location": f"/v1/jobs/{record.id}"}
        if preferred:
            headers["Preference-Applied"] = "respond-async"
        content = job_summary(record).model_dump_json().encode()
        return Response(content, 202, headers, "application/json")

    told = kept_answer(request, accepted)
    request.scope[DRY_RUN] = True
    try:
        response = await handle(request)
    except DeferToJob:
        record = await jobs.accept(stored, told, caller)
    else:
        answer = JobAnswer(response.headers.get("content-type", ""), bytes(response.body))
        location = response.headers.get("location")
        record = await jobs.keep(stored, answer, location, told, caller)
    note_kept(request)
    return accepted(record)
