"""A layer that lets requests for health and metrics through, for processes that serve no others."""

from starlette.types import ASGIApp, Receive, Scope, Send

from service.http.handlers import problem_response
from service.problem import ProblemError

#: Paths that an agent answers.
PATHS = ("/healthz", "/readyz", "/metrics")


class HealthOnly:
    """An application of which others reach the paths in `PATHS` only.

    Args:
        app: The whole application.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or answer it with 404."""
        if scope["type"] != "http" or scope["path"] in PATHS:
            await self._app(scope, receive, send)
            return
        problem = ProblemError(
            "NOT_FOUND",
            "an agent answers for its health and metrics only",
            stage="request",
            hint=f"GET {', '.join(PATHS)}; ask a server for everything else.",
        )
        await problem_response(problem, scope["path"])(scope, receive, send)
