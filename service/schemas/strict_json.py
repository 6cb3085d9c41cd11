"""Strict JSON: RFC 8259 in UTF-8, without NaN or Infinity."""

import math
from collections.abc import Iterator
from typing import Any

from pydantic_core import from_json

from service.problem import ProblemError

#: Numbers that are not finite which a problem lists.
_MAX_LISTED = 20


def parse_json(content: bytes) -> Any:
    """Parse JSON by RFC 8259: UTF-8, no NaN or Infinity, no lone surrogates.

    Raises:
        ProblemError: VALIDATION_ERROR with the position, or with the path of each number that is
            not finite.
    """
    try:
        return from_json(content, allow_inf_nan=False)
    except ValueError as error:
        raise _syntax_problem(content, str(error)) from None


def _syntax_problem(content: bytes, message: str) -> ProblemError:
    try:
        lenient = from_json(content, allow_inf_nan=True)
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
