"""``Prefer: respond-async``: a request is checked, stored as a job, and answered with 202."""

from fastapi import Request, Response

from service.access.caller import caller_of
from service.http.idempotency import kept_answer, note_kept
from service.http.json_route import Handler, prefers_async
from service.http.state import DRY_RUN, DeferToJob
from service.jobs.answer import job_summary
from service.jobs.runner import Jobs
from service.storage.job_store import JobAnswer, JobRecord, StoredRequest


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
