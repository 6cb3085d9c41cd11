"""Refusals of bodies: each field's path and what is wrong with it, never its value."""

from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from service.problem import ProblemError

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
        "tool",
        "tcp",
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
    "Poses are of the robot's tip_link. To lead the tip of a tool that is held, give the pose "
    "T_base_tip = T_base_tool T_tip_tool^-1, with T_tip_tool the tool's tip in the frame of "
    "tip_link; the tool itself is an attached object. Or create the robot with the tool's tip as "
    "a link of its URDF, on a fixed joint, and name it tip_link."
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
        found = [{**item, "loc": ("body", *item["loc"])} for item in fault_list(error)]
        raise validation_problem(found, value) from None


def fault_list(error: ValidationError) -> list[Any]:
    """The faults that pydantic found, without links, values and contexts: nobody is shown those."""
    return error.errors(include_url=False, include_input=False, include_context=False)


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
    return ProblemError(
        "VALIDATION_ERROR",
        sentence + (f"; and {more} more" if more > 0 else ""),
        stage="request",
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
        tagged = not tagged and isinstance(value, dict) and value.get("type") == step
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
