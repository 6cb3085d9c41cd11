"""Refusals of bodies: each field's path and what is wrong with it, never its value.

Problems: what is wrong with a request or with the service, as values that any layer can raise.

`service.http.errors` turns them into problem documents (RFC 9457).
"""

import json
import logging
import math
import secrets
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError
from pydantic_core import from_json

_log = logging.getLogger(__name__)


class ProblemError(Exception):
    """A problem that ends a request.

    Args:
        code: The kind of problem, one of those that ``GET /v1/problems`` lists.
        detail: Fault of this one request, and its place.
        hint: Advice on how to mend it.
        stage: The step that failed.
        status: Another HTTP status than that of the kind.
        retry_after: Seconds after which a new attempt makes sense.
        headers: Headers of its answer beside the usual ones, by name.
        details: Values a program can use.
    """

    def __init__(
        self,
        code: str,
        detail: str,
        *,
        hint: str | None = None,
        stage: str | None = None,
        status: int | None = None,
        retry_after: int | None = None,
        headers: Mapping[str, str] | None = None,
        **details: Any,
    ) -> None:
        super().__init__(detail)
        self.code = code
        self.detail = detail
        self.hint = hint
        self.stage = stage
        self.status = status
        self.retry_after = retry_after
        self.headers = dict(headers or {})
        self.details = details


def request_problem(code: str, detail: str, **more: Any) -> ProblemError:
    """A fault of a request, found before anything was computed of it."""
    return ProblemError(code, detail, stage="request", **more)


def storage_problem(code: str, detail: str, **more: Any) -> ProblemError:
    """A fault about what is stored, or about the storage."""
    return ProblemError(code, detail, stage="storage", **more)


def from_fields(
    code: str, message: str, hint: str | None, details: Mapping[str, Any]
) -> ProblemError:
    """The problem of an error that came as values, for example from a worker.

    Args:
        code: The kind of problem.
        message: Fault and its place.
        hint: Advice on how to mend it.
        details: Values a program can use; those named ``stage`` and ``retry_after`` become the
            stage and the `retry_after` of the problem.
    """
    rest = {str(name): value for name, value in details.items()}
    stage, retry_after = rest.pop("stage", None), rest.pop("retry_after", None)
    problem = ProblemError(code, message, hint=hint, stage=None if stage is None else str(stage))
    problem.retry_after = None if retry_after is None else int(retry_after)
    problem.details = rest
    return problem


def unexpected_fault(what: str, trace: str | None = None, **details: Any) -> ProblemError:
    """Log a fault of the service under a new reference, and give the problem that names only that.

    Args:
        what: The request or task in which it happened.
        trace: The traceback, where it is not that of the exception being handled.
        details: More values for the problem.
    """
    reference = secrets.token_hex(8)
    if trace is None:
        _log.exception("unexpected error %s in %r", reference, what)
    else:
        _log.error("unexpected error %s in %r\n%s", reference, what, trace)
    return ProblemError(
        "CRASH",
        f"an unexpected error happened; it was logged as {reference}",
        hint="This is a fault of the service. Report the reference to whoever runs it.",
        reference=reference,
        **details,
    )


#: Numbers that are not finite which a problem lists.
_MAX_LISTED = 20
#: Fields of all objects together: a scene of ten thousand obstacles has eighty thousand.
MAX_FIELDS = 500_000
#: Fields of one object: a robot names its meshes in one, and has two thousand at most.
MAX_OBJECT_FIELDS = 4_096


def parse_json(content: bytes) -> Any:
    """Parse JSON by RFC 8259: UTF-8, no NaN or Infinity, no lone surrogates, no name twice.

    Raises:
        ProblemError: VALIDATION_ERROR with the position, with the path of each number that is not
            finite, or with the name that an object has twice; as `check_field_count`.
    """
    check_field_count(content)
    try:
        # Names of fields come again; names of robots and scenes would fill a cache for good.
        value = from_json(content, allow_inf_nan=False, cache_strings="keys")
    except ValueError as error:
        raise _syntax_problem(content, str(error)) from None
    if not _has_fields(value, _field_count(content)):
        raise _duplicate_problem(content)
    return value


def check_field_count(content: bytes) -> None:
    """Refuse JSON of more than `MAX_FIELDS` fields before it is parsed: that takes milliseconds.

    Raises:
        ProblemError: VALIDATION_ERROR.
    """
    # Exact but for strings that begin with a colon, and a hundred times as fast as counting.
    if content.count(b'":') <= MAX_FIELDS:
        return
    if b"\\" not in content or _field_count(content) > MAX_FIELDS:
        raise _too_many_fields("the body", MAX_FIELDS)


def _field_count(content: bytes) -> int:
    """The number of fields in valid JSON: that of the colons outside of its strings."""
    if b"\\" in content:
        # Of what is escaped only quotes matter, behind backslashes that are no escaped ones.
        content = content.replace(b"\\\\", b"").replace(b'\\"', b"")
    return b"".join(content.split(b'"')[::2]).count(b":")


def _has_fields(value: Any, count: int) -> bool:
    """Whether the objects in a value have so many fields; fewer where a name occurred twice.

    Raises:
        ProblemError: One object has more than `MAX_OBJECT_FIELDS` fields.
    """
    # Lists that begin with a number hold nothing but numbers, as a rule: they come last, and
    # nobody looks at them once all fields were found.
    waiting, unlikely = [value], list[Any]()
    while count > 0 and (waiting or unlikely):
        item = waiting.pop() if waiting else unlikely.pop()
        inner: Iterable[Any] = item if isinstance(item, list) else ()
        if isinstance(item, dict):
            if len(item) > MAX_OBJECT_FIELDS:
                raise _too_many_fields("an object", MAX_OBJECT_FIELDS)
            count -= len(item)
            inner = item.values()
        for child in inner:
            if type(child) is dict:
                waiting.append(child)
            elif type(child) is list and child:
                (unlikely if type(child[0]) in (float, int) else waiting).append(child)
    return count == 0


def _too_many_fields(what: str, limit: int) -> ProblemError:
    return request_problem(
        "VALIDATION_ERROR",
        f"{what} has more than {limit} fields",
        hint="No request needs as many; /docs shows what this endpoint takes.",
        max_fields=limit,
    )


def _duplicate_problem(content: bytes) -> ProblemError:
    names: list[str] = []

    def note(pairs: list[tuple[str, Any]]) -> None:
        seen: set[str] = set()
        for name, _ in pairs:
            if name in seen:
                names.append(name)
            seen.add(name)

    json.loads(content, object_pairs_hook=note)
    return request_problem(
        "VALIDATION_ERROR",
        f"an object has the field {names[0]!r} twice",
        hint="Give each field of an object once.",
        errors=[{"path": name, "problem": "given twice"} for name in names[:_MAX_LISTED]],
    )


def _syntax_problem(content: bytes, message: str) -> ProblemError:
    try:
        lenient = from_json(content, allow_inf_nan=True, cache_strings="keys")
    except ValueError:
        paths = []
    else:
        paths = [
            path for _, path in zip(range(_MAX_LISTED), _non_finite_paths(lenient), strict=False)
        ]
    if paths:
        return request_problem(
            "VALIDATION_ERROR",
            f"{', '.join(paths)}: not a finite number; JSON has no NaN or Infinity",
            errors=[{"path": path, "problem": "not a finite number"} for path in paths],
        )
    return request_problem(
        "VALIDATION_ERROR",
        f"the body is not valid JSON: {message}",
        hint="Send one JSON value in UTF-8.",
        errors=[{"path": "body", "problem": message}],
    )


def _non_finite_paths(value: Any, path: str = "") -> Iterator[str]:
    """The path of each number that is not finite."""
    if isinstance(value, dict):
        for name, item in value.items():
            yield from _non_finite_paths(item, f"{path}.{name}" if path else name)
    elif isinstance(value, list):
        for index, item in enumerate(value):
            yield from _non_finite_paths(item, f"{path}[{index}]")
    elif isinstance(value, float) and not math.isfinite(value):
        yield path or "body"


#: More would not be read.
_MAX_ERRORS = 50
_MAX_IN_SENTENCE = 3
_MAX_PATH = 200
_MAX_MESSAGE = 500

#: Errors that a value is of another kind than one that a field may have. Where it may have several
#: and the value is an object or a list with a fault inside, the others are not what was meant.
_OTHER_KINDS = frozenset(
    f"{kind}_type" for kind in ("bool", "int", "float", "string", "list", "dict", "model")
) | {"literal_error", "enum"}

#: Fields by which people ask for a tool on the tip, or for a point of what is held.
_TOOL_FIELDS = frozenset(
    {
        "tool_frame",
        "tool_offset",
        "tool_pose",
        "tip",
        "tip_link",
        "tip_offset",
        "offset",
    }
)
#: What to do instead.
_TOOL_HINT = (
    'Poses are of the tip. A tool with a tip of its own is "tool": a stored or built-in one '
    '(GET /v1/tools), or {"name", "tcp": {"tip": pose}}; "tcp" names its tip, or that of what is '
    'held: {"object": id, "pose": pose}.'
)

_Model = TypeVar("_Model", bound=BaseModel)


def validate_as(model: type[_Model], value: Any) -> _Model:
    """A parsed body as the model it must follow.

    Raises:
        ProblemError: VALIDATION_ERROR.
    """
    try:
        return model.model_validate(value)
    except ValidationError as error:
        raise body_problem(error, value) from None


def body_problem(error: ValidationError, body: Any) -> ProblemError:
    """The problem of a parsed body that does not follow its model."""
    # Without links, values and contexts: nobody is shown those.
    faults = error.errors(include_url=False, include_input=False, include_context=False)
    return validation_problem([{**one, "loc": ("body", *one["loc"])} for one in faults], body)


def validation_problem(errors: Sequence[Mapping[str, Any]], body: Any) -> ProblemError:
    """The problem of the errors pydantic found in a request with this parsed body."""
    listed = errors[:_MAX_ERRORS]
    paths = [field_path(e["loc"], body, missing=e["type"] == "missing") for e in listed]
    found = [
        {"path": path, "problem": _message(error)}
        for error, path in zip(listed, paths, strict=True)
        if not (error["type"] in _OTHER_KINDS and _has_fault_inside(path, paths))
    ]
    count = len(errors) - len(listed) + len(found)
    sentence = "; ".join(f"{item['path']}: {item['problem']}" for item in found[:_MAX_IN_SENTENCE])
    more = count - _MAX_IN_SENTENCE
    return request_problem(
        "VALIDATION_ERROR",
        sentence + (f"; and {more} more" if more > 0 else ""),
        hint=_TOOL_HINT
        if any(_asks_for_a_tool(error) for error in listed)
        else "details.errors lists every field; /docs shows what this endpoint takes.",
        errors=found,
        count=count,
    )


def _asks_for_a_tool(error: Mapping[str, Any]) -> bool:
    """Whether a field is unknown that would name a tool, or a point of it."""
    return error["type"] == "extra_forbidden" and error["loc"][-1] in _TOOL_FIELDS


def _has_fault_inside(path: str, paths: Sequence[str]) -> bool:
    """Whether one of the paths leads to a part of what another path leads to."""
    return any(other.startswith((f"{path}.", f"{path}[")) for other in paths)


def field_path(location: Sequence[str | int], body: Any, *, missing: bool = False) -> str:
    """A path such as ``obstacles[0].shape.size[1]`` of where pydantic found an error.

    Pydantic puts the tags of unions among the steps; those name nothing in the body and are left
    out: a step that leads nowhere, and the type of an object where its fields are still to come.

    Args:
        location: Steps of pydantic, the source ("body", "query", ...) first.
        body: The parsed body.
        missing: Whether the last step is a field that the body lacks.
    """
    source, *steps = location or ("body",)
    if source != "body":
        return ".".join(str(step) for step in location)[:_MAX_PATH]
    path, value, tagged = "", body, False
    for position, step in enumerate(steps):
        tags = (value.get("type"), value.get("kind")) if isinstance(value, dict) else ()
        tagged = not tagged and step in tags
        is_field = not tagged and _contains(value, step)
        if is_field:
            value = value[step]
        elif tagged or not (missing and position == len(steps) - 1):
            continue
        path += f"[{step}]" if isinstance(step, int) else f".{step}" if path else str(step)
    return path[:_MAX_PATH] or "body"


def _contains(value: Any, step: str | int) -> bool:
    if isinstance(value, dict):
        return step in value
    return isinstance(value, list) and isinstance(step, int) and 0 <= step < len(value)


def _message(error: Mapping[str, Any]) -> str:
    if error["type"] == "extra_forbidden":
        return "unknown field"
    if error["type"] == "missing":
        return "this field is required"
    return str(error["msg"]).removeprefix("Value error, ")[:_MAX_MESSAGE]
