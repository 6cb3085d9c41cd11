"""Strict JSON: RFC 8259 in UTF-8, without NaN, Infinity or names that occur twice."""

import json
import math
from collections.abc import Iterable, Iterator
from typing import Any

from pydantic_core import from_json

from service.problem import ProblemError

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
    return ProblemError(
        "VALIDATION_ERROR",
        f"{what} has more than {limit} fields",
        stage="request",
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
    return ProblemError(
        "VALIDATION_ERROR",
        f"an object has the field {names[0]!r} twice",
        stage="request",
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
        return ProblemError(
            "VALIDATION_ERROR",
            f"{', '.join(paths)}: not a finite number; JSON has no NaN or Infinity",
            stage="request",
            errors=[{"path": path, "problem": "not a finite number"} for path in paths],
        )
    return ProblemError(
        "VALIDATION_ERROR",
        f"the body is not valid JSON: {message}",
        stage="request",
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
