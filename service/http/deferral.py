"""``Prefer: respond-async``: a request is looked at, stored as a job, and answered with 202."""

from collections.abc import Awaitable, Callable

from fastapi import Request, Response

from service.http.compute import DRY_RUN, ERRAND, DeferToJob
from service.jobs.answer import job_summary
from service.jobs.runner import Jobs
from service.jobs.store import JobAnswer, StoredRequest

#: What the preference is about; GET and DELETE compute nothing.
_METHODS = ("POST", "PUT")

Handler = Callable[[Request], Awaitable[Response]]


def is_postponed(request: Request, always: bool) -> bool:
    """Whether a request is to become a job: it asks for that, or what it asks for always is one."""
    if request.method not in _METHODS or ERRAND in request.scope:
        return False
    return always or prefers_async(request.headers.getlist("prefer"))


def prefers_async(values: list[str]) -> bool:
    """Whether headers Prefer (RFC 7240) name the preference respond-async."""
    preferences = ",".join(values).split(",")
    names = (preference.split(";")[0].split("=")[0] for preference in preferences)
    return any(name.strip().lower() == "respond-async" for name in names)


async def postponed(request: Request, handle: Handler) -> Response:
    """Look at a request as far as that goes without work, and make a job of it.

    What is wrong with it is told at once. What needs no work is done, and the job has succeeded.

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
    jobs.check_room(len(stored.body))
    request.scope[DRY_RUN] = True
    try:
        response = await handle(request)
    except DeferToJob:
        record = await jobs.accept(stored)
    else:
        answer = JobAnswer(response.headers.get("content-type", ""), bytes(response.body))
        record = await jobs.keep(stored, answer, response.headers.get("location"))
    headers = {"Location": f"/v1/jobs/{record.id}"}
    if prefers_async(request.headers.getlist("prefer")):
        headers["Preference-Applied"] = "respond-async"
    content = job_summary(record).model_dump_json().encode()
    return Response(content, 202, headers, "application/json")
