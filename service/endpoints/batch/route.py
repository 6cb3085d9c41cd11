"""Many problems at once, always as a job."""

from fastapi import Request, Response

from armwright_wire.plans.batch import BatchAnswer, BatchRequest
from armwright_wire.plans.job import JobSummary
from service.http import answers
from service.http.compute import allowed_time
from service.http.json_route import Handler, JobRoute, json_router
from service.http.state import DeferToJob, job_context, settings_of
from service.jobs.batch import Batch
from service.validation import request_problem

_RESULT = {200: {"description": "The result of the job", "model": BatchAnswer}}


class BatchRoute(JobRoute):
    """A route whose jobs are batches: what was checked when it came is not validated again."""

    def get_route_handler(self) -> Handler:
        """The handler of the framework, which is not asked again for what runs as a job."""
        check = super().get_route_handler()

        async def plan_or_check(request: Request) -> Response:
            context = job_context(request)
            if context is None:
                return await check(request)
            return Response(await Batch(request, context).run(), media_type="application/json")

        return plan_or_check


router = json_router("planning", route_class=BatchRoute)


@router.post(
    "/plan/batch",
    status_code=202,
    summary="Plan many motions",
    response_model=JobSummary,
    responses=_RESULT,  # type: ignore[arg-type]
)
async def plan_batch(body: BatchRequest, request: Request) -> Response:
    """A job whose result lists, in order, the plan of each problem or why there is none.

    One that fails, or that brings a worker down, costs the others nothing.
    """
    await _check(body, request)
    raise DeferToJob


async def _check(body: BatchRequest, request: Request) -> None:
    """Refuse a batch at fault as a whole; the fault of one problem is answered in its place."""
    settings = settings_of(request)
    if len(body.problems) > settings.batch_limit:
        raise request_problem(
            "PAYLOAD_TOO_LARGE",
            f"problems: {len(body.problems)} are more than the {settings.batch_limit} allowed here",
            hint="Send them in several batches.",
            batch_limit=settings.batch_limit,
        )
    parts = (body, *body.problems)
    for seconds in {part.timeout for part in parts}:
        allowed_time(settings, seconds)
    for robot in {part.robot for part in parts if part.robot is not None}:
        await answers.robot(request, robot)
    for scene in {part.scene for part in parts if isinstance(part.scene, str)}:
        await answers.scene(request, scene)
