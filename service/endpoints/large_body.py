"""Validation of large bodies in workers; the server receives an outline of them."""

import importlib
from typing import Any

from pydantic import BaseModel, TypeAdapter, ValidationError

from armwright_wire.scenes.tool import HeldTip, WithTool
from service.validation import ProblemError, body_problem, parse_json
from service.workers.result import TaskProblem
from service.workers.task import task

#: Lists of models whose items the server inspects.
_INSPECTED = ("problems", "stages")
#: What the server itself reads to mount a tool, the latter for the tip of an object.
_MOUNTED = ("tool", "attached")
#: Longer texts are cut; names and the like are far shorter.
_LONG = 4096
#: What is left of them.
_EXCERPT = 64


@task
def outline(model: str, content: bytes) -> BaseModel | TaskProblem:
    """Outline of a body that follows a model, or the reason why it does not.

    Args:
        model: Name of the model, as ``"armwright_wire.plans.plan:PlanRequest"``.
        content: JSON.

    Returns:
        An instance with the first object of each list of them and with long texts cut; lists of
        numbers stay, since they are counted.
    """
    module, _, name = model.partition(":")
    expected: type[BaseModel] = getattr(importlib.import_module(module), name)
    try:
        value = parse_json(content)
        try:
            # As the framework does it, down to the messages.
            body = TypeAdapter(expected).validate_python(value, from_attributes=True)
        except ValidationError as error:
            raise body_problem(error, value) from None
    except ProblemError as problem:
        return TaskProblem.of(problem)
    return _outline(body)


def _outline(body: BaseModel) -> BaseModel:
    # Fields that were left out are small, and a batch has thirty of them in each problem.
    parts = {name: getattr(body, name) for name in body.model_fields_set}
    whole = _MOUNTED[: isinstance(body, WithTool) + isinstance(parts.get("tcp"), HeldTip)]
    return body.model_copy(
        update={n: value if n in whole else _part(n, value) for n, value in parts.items()}
    )


def _part(name: str, value: Any) -> Any:
    if isinstance(value, BaseModel):
        return _outline(value)
    if isinstance(value, list) and value and isinstance(value[0], BaseModel):
        # The first stands for all: rules of a model ask whether there are any.
        return [_outline(item) for item in (value if name in _INSPECTED else value[:1])]
    if isinstance(value, dict):
        return {key: _part(key, item) for key, item in value.items()}
    # The beginning stands for the whole: a field that was given stays given.
    return value[:_EXCERPT] if isinstance(value, str) and len(value) > _LONG else value
