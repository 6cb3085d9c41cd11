"""Requests whose path is the path of a route, word for word: they are given to it at once.

The framework compares a path with the pattern of one route after the other, and solves dependencies
that these routes don't have. Both cost more than all else that a server does for a request.
"""

from fastapi import FastAPI, Request, Response
from fastapi.exceptions import RequestValidationError
from starlette.routing import BaseRoute
from starlette.types import ASGIApp, Receive, Scope, Send

from kinematics.errors import ArmwrightError
from service.http.handlers import problem_of, problem_response
from service.http.json_route import JsonRoute
from service.problem import ProblemError


class RouteTable:
    """The routes that take a body and nothing else, by method and path.

    Args:
        application: Whose routes they are.
    """

    def __init__(self, application: FastAPI) -> None:
        self._application = application
        self._routes: dict[tuple[str, str], JsonRoute] | None = None

    def find(self, scope: Scope) -> JsonRoute | None:
        """The route of a request; None where it has none of these."""
        if self._routes is None:  # all are known by the time of the first request
            routes = _direct(self._application.router.routes)
            self._routes = {(method, r.path): r for r in routes for method in r.methods or ()}
        return self._routes.get((scope["method"], scope["path"]))


async def answer_directly(
    route: JsonRoute, request: Request, *, is_plain: bool = False
) -> Response:
    """The response of a direct route to a request with a body.

    Args:
        route: The route.
        request: The request.
        is_plain: Whether it is JSON by its type, and asks for nothing by its headers.
    """
    handle = route.handle_plain if is_plain else route.handle_directly
    assert handle is not None
    request.scope["route"] = route
    request.scope["path_params"] = {}
    try:
        return await handle(request)
    except (ProblemError, ArmwrightError, RequestValidationError) as error:
        return problem_response(problem_of(error), request.scope["path"])


class DirectRoutes:
    """Middleware that answers requests of routes that take a body and nothing else.

    All others go to the framework, and so do those without a body.

    Args:
        app: The application behind it.
        application: Whose routes they are.
    """

    def __init__(self, app: ASGIApp, application: FastAPI) -> None:
        self._app = app
        self._routes = RouteTable(application)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, to its route if it can be."""
        route = self._routes.find(scope) if scope["type"] == "http" else None
        if route is None or not _has_body(scope):
            await self._app(scope, receive, send)
            return
        response = await answer_directly(route, Request(scope, receive, send))
        await response(scope, receive, send)


def _has_body(scope: Scope) -> bool:
    lengths = [value for name, value in scope["headers"] if name == b"content-length"]
    return lengths not in ([], [b"0"])


def _direct(routes: list[BaseRoute]) -> list[JsonRoute]:
    """The routes that answer requests directly, of all routers."""
    found: list[JsonRoute] = []
    for route in routes:
        inner = getattr(route, "original_router", None)
        if inner is not None:
            found += _direct(inner.routes)
        elif isinstance(route, JsonRoute) and route.handle_directly is not None:
            found.append(route)
    return found
