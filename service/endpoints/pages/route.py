"""Pages for people: the start page, and the documentation of the endpoints with all it loads."""

import gzip
import hashlib
import json
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Request, Response
from fastapi import Path as InPath
from fastapi.responses import FileResponse, HTMLResponse
from pydantic import Field
from starlette.concurrency import run_in_threadpool

from armwright_wire.base import Answer
from service.http.errors import KINDS
from service.http.json_route import json_router
from service.http.request_headers import accepts_gzip, names_tag
from service.validation import ProblemError
from service.version import VERSION

router = APIRouter(include_in_schema=False)


class Published:
    """The OpenAPI document as it is sent.

    Args:
        document: The document.
    """

    def __init__(self, document: dict[str, Any]) -> None:
        self.plain = json.dumps(document, ensure_ascii=False, separators=(",", ":")).encode()
        self.compressed = gzip.compress(self.plain, mtime=0)
        self.tag = f'"{hashlib.sha256(self.plain).hexdigest()[:32]}"'


_PLAIN = (
    "default-src 'none'; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'"
)
#: Swagger UI sets styles inside of its pages and draws its signs from data URLs.
_DOCS = (
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data:; connect-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'"
)
Asset = Literal["swagger-ui-bundle.js", "swagger-ui.css", "favicon.png"]

_PAGES = files("service.endpoints.pages")
_START = _PAGES.joinpath("start.html").read_text("utf-8").replace("VERSION", VERSION)
_DOCUMENTATION = _PAGES.joinpath("documentation.html").read_text("utf-8")
_SCRIPT = (
    'SwaggerUIBundle({url: "openapi.json", dom_id: "#endpoints", deepLinking: true, '
    "validatorUrl: null});\n"
)


@router.get("/")
async def start_page() -> Response:
    """The page that says what this is."""
    return HTMLResponse(_START, headers={"Content-Security-Policy": _PLAIN})


@router.get("/docs")
async def documentation() -> Response:
    """The endpoints, to read and to try out; nothing is loaded from elsewhere."""
    return HTMLResponse(_DOCUMENTATION, headers={"Content-Security-Policy": _DOCS})


@router.get("/openapi.json")
async def openapi_document(request: Request) -> Response:
    """The OpenAPI document, made once, with a tag by which clients ask whether it is another."""
    state = request.app.state
    if state.openapi is None:
        state.openapi = await run_in_threadpool(lambda: Published(request.app.openapi()))
    published: Published = state.openapi
    headers = {"ETag": published.tag, "Cache-Control": "no-cache"}
    if names_tag(request, published.tag):
        return Response(status_code=304, headers=headers)
    if accepts_gzip(request.scope):
        headers |= {"Content-Encoding": "gzip", "Vary": "Accept-Encoding"}
        return Response(published.compressed, headers=headers, media_type="application/json")
    return Response(published.plain, headers=headers, media_type="application/json")


@router.get("/docs/start.js")
async def documentation_script() -> Response:
    """The script that shows the OpenAPI document."""
    return Response(_SCRIPT, media_type="text/javascript")


@router.get("/docs/{asset}")
async def documentation_asset(asset: Annotated[Asset, InPath()], request: Request) -> Response:
    """A file of Swagger UI, as the package fastapi-offline brings it."""
    folder: Path = request.app.state.swagger
    return FileResponse(folder / asset, headers={"Cache-Control": "max-age=86400"})


def swagger_folder() -> Path:
    """Folder of Swagger UI's files; the package is found, not imported.

    Raises:
        LookupError: The package is not installed.
    """
    found = find_spec("fastapi_offline")
    if found is None or found.origin is None:
        raise LookupError("the package fastapi-offline is not installed")
    return Path(found.origin).parent / "static"


problem_router = json_router("problems", "/v1/problems")


class ProblemKind(Answer):
    """One kind of problem."""

    code: str = Field(examples=["GOAL_IN_COLLISION"], description="of the problem")
    status: int = Field(examples=[422], description="the usual HTTP status")
    title: str = Field(
        examples=["The goal configuration is in collision"],
        description="the kind of problem in words",
    )
    cure: str = Field(description="what can be done about it, beside the hint of the occurrence")


class ProblemKinds(Answer):
    """All kinds of problems."""

    problems: list[ProblemKind] = Field(description="all there are")


@problem_router.get("", summary="All kinds of problems")
async def list_problems() -> ProblemKinds:
    """Every code that an error can carry."""
    return ProblemKinds(problems=[_kind(code) for code in KINDS])


@problem_router.get("/{code}", summary="One kind of problem")
async def get_problem(code: str) -> ProblemKind:
    """Description of a problem's code."""
    if code not in KINDS:
        raise ProblemError(
            "NOT_FOUND",
            f"there is no kind of problem named {code!r}",
            hint="GET /v1/problems lists those there are.",
        )
    return _kind(code)


def _kind(code: str) -> ProblemKind:
    kind = KINDS[code]
    return ProblemKind(code=code, status=kind.status, title=kind.title, cure=kind.hint)
