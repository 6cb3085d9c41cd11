"""Jobs: requests that are answered later."""

from typing import Annotated

from fastapi import Header, Query, Request, Response
from starlette.responses import StreamingResponse

from armwright_wire.plans.job import JobAnswer, JobList, JobSummary
from service.access.authentication import caller_of
from service.endpoints.documents import page
from service.http.json_route import json_router
from service.http.state import settings_of
from service.jobs.answer import job_document, job_summary
from service.jobs.runner import Jobs
from service.storage.stores.job_store import JobAnswer as StoredAnswer
from service.storage.stores.job_store import JobRecord, Status, no_job

router = json_router("jobs", "/v1/jobs")

_STREAM = {
    200: {
        "description": "Server-sent events",
        "content": {
            "text/event-stream": {
                # A stream, not one value: OpenAPI 3.1 has no schema for that.
                "schema": {"description": "events as the HTML standard has them"},
                "example": "id: 4\nevent: stage\ndata: "
                '{"id":"0199…","status":"running","progress":0.2,"stage":"rrt_connect"}\n\n',
            }
        },
    },
    204: {"description": "The job has ended, and all its events were received"},
}


@router.get("", summary="List jobs")
async def list_jobs(
    request: Request,
    status: Annotated[Status | None, Query(description="only these")] = None,
    after: Annotated[str, Query(max_length=64, description="jobs older than this one")] = "",
    limit: Annotated[int, Query(ge=1, le=1000)] = 100,
) -> JobList:
    """Jobs without their answers, newest first, page by page."""
    tenant = caller_of(request.scope).tenant
    stored = await _jobs(request).list(status, after, limit + 1, tenant)
    records, following = page(stored, limit, lambda record: record.id)
    lifetime = settings_of(request).job_lifetime
    return JobList(jobs=[job_summary(record, lifetime) for record in records], next=following)


@router.get("/{id}", summary="Where a job stands", response_model=JobAnswer)
async def get_job(id: str, request: Request) -> Response:  # noqa: A002  (its name in the path)
    """Its status and progress, and once it has ended the result or the error."""
    record, answer = await _visible_job(id, request)
    content = job_document(record, answer, settings_of(request).job_lifetime)
    return Response(content, media_type="application/json")


@router.delete("/{id}", summary="Cancel a job")
async def cancel_job(id: str, request: Request) -> JobSummary:  # noqa: A002
    """Ends a job that waits or runs, at once; 409 if it has succeeded or failed already.

    Cancelling a cancelled job changes nothing.
    """
    await _visible_job(id, request)
    return job_summary(await _jobs(request).cancel(id), settings_of(request).job_lifetime)


@router.get(
    "/{id}/events",
    summary="Events of a job",
    response_class=StreamingResponse,
    responses=_STREAM,  # type: ignore[arg-type]
)
async def job_events(
    id: str,  # noqa: A002
    request: Request,
    last_event_id: Annotated[
        str, Header(max_length=32, description="events up to this one were received")
    ] = "",
) -> Response:
    """Server-sent events `status`, `stage`, `progress` and at last `end`, then the stream closes.

    Each carries where the job stands as JSON, so one that was missed is made up for by the next.
    """
    after = int(last_event_id) if last_event_id.isascii() and last_event_id.isdigit() else 0
    await _visible_job(id, request)
    stream = await _jobs(request).events(id, after)
    if stream is None:
        return Response(status_code=204)
    # Proxies must pass events on as they come.
    headers = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
    return StreamingResponse(stream, headers=headers, media_type="text/event-stream")


async def _visible_job(job_id: str, request: Request) -> tuple[JobRecord, StoredAnswer | None]:
    """A job of the caller's tenant; those of others are not there."""
    record, answer = await _jobs(request).get(job_id)
    if record.tenant != caller_of(request.scope).tenant:
        raise no_job(job_id)
    return record, answer


def _jobs(request: Request) -> Jobs:
    jobs: Jobs = request.app.state.jobs
    return jobs
