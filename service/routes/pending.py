"""Endpoints of the interface that are not built yet: each says so, and what there is instead."""

from fastapi import APIRouter, Request

from service.body import JsonRoute
from service.errors import ProblemError
from service.openapi import RESPONSES

router = APIRouter(tags=["not built yet"], route_class=JsonRoute, responses=RESPONSES)

_PLAN = "There is POST /v1/plan, which answers one problem at once with a timed trajectory."
#: Method, path and what can be used instead.
_PENDING = (
    ("POST", "/v1/plan/batch", _PLAN),
    ("GET", "/v1/jobs/{id}", _PLAN),
    ("DELETE", "/v1/jobs/{id}", _PLAN),
    ("GET", "/v1/jobs/{id}/events", _PLAN),
    ("GET", "/metrics", "There are GET /healthz and GET /readyz."),
)


async def _not_built(request: Request) -> None:
    hint = next(hint for _, path, hint in _PENDING if path == request.scope["route"].path)
    raise ProblemError(
        "NOT_IMPLEMENTED",
        f"{request.method} {request.url.path} is not built yet",
        hint=hint,
    )


for _method, _path, _ in _PENDING:
    router.add_api_route(_path, _not_built, methods=[_method], summary="Answers 501")
