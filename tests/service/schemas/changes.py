"""Changes of bodies, and what is wrong with one."""

import copy
from collections.abc import Iterator
from typing import Any

from pydantic import BaseModel

from service.validation import ProblemError, validate_as

#: Steps from a body to a value in it.
Path = tuple[str | int, ...]


def written(path: Path) -> str:
    """A path as problem documents write it."""
    text = ""
    for step in path:
        text += f"[{step}]" if isinstance(step, int) else f".{step}" if text else step
    return text


def changed(body: Any, path: Path, value: Any) -> dict[str, Any]:
    """A copy of a body in which one value is another."""
    twin: dict[str, Any] = copy.deepcopy(body)
    place: Any = twin
    for step in path[:-1]:
        place = place[step]
    place[path[-1]] = value
    return twin


def without(body: Any, path: Path) -> dict[str, Any]:
    """A copy of a body in which one field is missing."""
    twin: dict[str, Any] = copy.deepcopy(body)
    place: Any = twin
    for step in path[:-1]:
        place = place[step]
    del place[path[-1]]
    return twin


def values(body: Any, path: Path = ()) -> Iterator[tuple[Path, Any]]:
    """Every value below the body itself, objects and lists included, with the path to it."""
    if path:
        yield path, body
    if isinstance(body, dict | list):
        for step, item in body.items() if isinstance(body, dict) else enumerate(body):
            yield from values(item, (*path, step))


def refusals(model: type[BaseModel], body: Any) -> dict[str, str]:
    """What is wrong with a body, by the paths of its faults; empty where nothing is."""
    try:
        validate_as(model, body)
    except ProblemError as problem:
        if (problem.code, problem.stage) != ("VALIDATION_ERROR", "request"):
            raise
        return {item["path"]: item["problem"] for item in problem.details["errors"]}
    return {}
