"""Requests of the studio as Python and curl that ask the same of the service."""

import json
import shlex
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from pydantic import BaseModel

from armwright_client import Pose, Start
from armwright_wire.base import Body as Request
from studio.requests import ik_request, path_request, plan_request, task_request, tour_request
from studio.state import StudioState

#: Methods of the client: the name of their answer, and lines of a program that print of it.
_PROGRAMS = {
    "plan": (
        "plan",
        ["print(plan.planner, plan.trajectory.duration, plan.certificate.min_clearance)"],
    ),
    "plan_task": (
        "task",
        [
            "for stage in task.stages:",
            "    print(stage.kind, stage.trajectory.duration, stage.certificate.verified)",
        ],
    ),
    "plan_tour": (
        "tour",
        [
            "for leg in tour.legs:",
            "    print(leg.origin, leg.target, leg.trajectory.duration, leg.certificate.verified)",
        ],
    ),
    "robots.ik": (
        "answer",
        [
            "for solution in answer.solutions:",
            "    print(solution.rejected_because or 'valid', solution.joints)",
        ],
    ),
}


def _program(url: str, robot: str, method: str, request: Request, places: Sequence[str]) -> str:
    """A Python program that asks the same with `armwright_client`.

    Args:
        url: Address of the service.
        robot: Name of the robot.
        method: Method of the client.
        request: The request.
        places: Fields that the method takes by position, after the robot.
    """
    fields = _changed_fields(request)
    fields.pop("robot", None)
    given = [fields.pop(name) for name in places]
    given = [value.joints if isinstance(value, Start) else value for value in given]
    arguments = [repr(robot)]
    for name, value in zip(places, given, strict=True):
        if name in ("stages", "goals"):
            items = "".join(f"            {_code(item)},\n" for item in value)
            arguments.append(f"[\n{items}        ]")
        else:
            arguments.append(_code(value))
    arguments += [f"{name}={_code(value)}" for name, value in fields.items()]
    answer, shows = _PROGRAMS[method]
    names = sorted({"Client"}.union(*(_models(value) for value in (*given, *fields.values()))))
    return "\n".join(
        [
            f"from armwright_client import {', '.join(names)}",
            "",
            f"with Client({url!r}) as client:",
            f"    {answer} = client.{method}(",
            *(f"        {argument}," for argument in arguments),
            "    )",
            *shows,
            "",
        ]
    )


def curl(url: str, path: str, request: Request) -> str:
    """A shell command that sends the same request.

    Args:
        url: Address of the service.
        path: Path of the endpoint, such as "/v1/plan".
        request: The body.
    """
    body = json.dumps(json.loads(request.to_json()))
    return (
        f"curl -sS {shlex.quote(url.rstrip('/') + path)} \\\n"
        "  -H 'Content-Type: application/json' \\\n"
        f"  --data {shlex.quote(body)}"
    )


def _changed_fields(model: BaseModel) -> dict[str, Any]:
    """Fields that are set to something else than their default, in their order."""
    return {
        name: getattr(model, name)
        for name, field in type(model).model_fields.items()
        if name in model.model_fields_set and getattr(model, name) != field.default
    }


def _code(value: Any) -> str:
    """An expression that makes the value."""
    if isinstance(value, BaseModel):
        fields = ", ".join(f"{name}={_code(item)}" for name, item in _changed_fields(value).items())
        return f"{type(value).__name__}({fields})"
    if isinstance(value, str | bytes) or not isinstance(value, Sequence):
        return repr(value)
    return f"[{', '.join(_code(item) for item in value)}]"


def _models(value: Any) -> set[str]:
    """Names of the models in a value."""
    if isinstance(value, BaseModel):
        inner = [_models(item) for item in _changed_fields(value).values()]
        return {type(value).__name__}.union(*inner)
    if isinstance(value, list | tuple):
        return set().union(*(_models(item) for item in value))
    return set()


class _Kind(NamedTuple):
    """Kind of plan: its request, and how the client and the service are asked for it.

    Args:
        request: Makes the request of a state.
        method: Method of the client.
        path: Path of the endpoint.
        places: Fields that the method takes by position, after the robot.
    """

    request: Callable[..., Request]
    method: str
    path: str
    places: tuple[str, ...]


_KINDS = {
    "plan": _Kind(plan_request, "plan", "/v1/plan", ("start", "goal")),
    "task": _Kind(task_request, "plan_task", "/v1/tasks", ("start", "stages")),
    "tour": _Kind(tour_request, "plan_tour", "/v1/tours", ("goals",)),
    "tool path": _Kind(path_request, "plan", "/v1/plan", ("start", "goal")),
}


def plan_code(url: str, state: StudioState, kind: str = "plan") -> tuple[str, str]:
    """The request of a plan as Python and as curl.

    Args:
        url: Address of the service.
        state: State of the studio.
        kind: "plan", "task", "tour" or "tool path".

    Raises:
        ValueError: There are no two goals of the tour, or waypoints of the tool path.
    """
    made = _KINDS[kind]
    request = made.request(state, keep=False)
    program = _program(url, state.robot, made.method, request, made.places)
    return program, curl(url, made.path, request)


def ik_code(url: str, state: StudioState, tip: Pose) -> str:
    """The inverse kinematics of the goal as Python.

    Args:
        url: Address of the service.
        state: State of the studio.
        tip: Pose of the tip at the goal, in the root frame.
    """
    return _program(url, state.robot, "robots.ik", ik_request(state, tip), ("pose",))


def all_code(url: str, state: StudioState, tip: Pose) -> str:
    """All that there is to ask, in Markdown; what is not valid yet says why.

    Args:
        url: Address of the service.
        state: State of the studio.
        tip: Pose of the tip at the goal, in the root frame.
    """
    parts = []
    lists = {"task": state.stages, "tour": state.goals, "tool path": state.waypoints}
    for kind in (kind for kind, entries in lists.items() if entries):
        try:
            parts.append(f"The {kind}:\n\n```python\n{plan_code(url, state, kind)[0]}```")
        except ValueError as error:  # pydantic's, too
            parts.append(f"The {kind} is not valid yet: {error}")
    try:
        python, shell = plan_code(url, state)
    except ValueError as error:  # a setting out of its range
        return f"The request is not valid: {error}"
    parts.append(f"The plan:\n\n```python\n{python}```\n\n```sh\n{shell}\n```")
    ik = ik_code(url, state, tip)
    parts.append(f"The configurations that reach the goal:\n\n```python\n{ik}```")
    return "\n\n".join(parts)
