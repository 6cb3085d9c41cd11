"""Requests of the studio as Python and curl that ask the same of the service."""

import json
import shlex
from collections.abc import Sequence
from typing import Any

from pydantic import BaseModel

from armwright_client import IkRequest, PlanRequest, Pose, TaskRequest, TourRequest
from armwright_wire.base import Body as Request
from studio.requests import ik_request, path_request, plan_request, task_request, tour_request
from studio.state import StudioState


def plan_python(url: str, request: PlanRequest) -> str:
    """A Python program that plans the same motion with `armwright_client`.

    Args:
        url: Address of the service.
        request: The plan request.
    """
    fields = _changed_fields(request)
    robot, start, goal = (fields.pop(name) for name in ("robot", "start", "goal"))
    arguments = [repr(robot), _code(start.joints), _code(goal)]
    arguments += [f"{name}={_code(value)}" for name, value in fields.items()]
    names = sorted({"Client", *_models(goal), *(n for v in fields.values() for n in _models(v))})
    return "\n".join(
        [
            f"from armwright_client import {', '.join(names)}",
            "",
            f"with Client({url!r}) as client:",
            "    plan = client.plan(",
            *(f"        {argument}," for argument in arguments),
            "    )",
            "print(plan.planner, plan.trajectory.duration, plan.certificate.min_clearance)",
            "",
        ]
    )


def task_python(url: str, request: TaskRequest) -> str:
    """A Python program that plans the same task with `armwright_client`.

    Args:
        url: Address of the service.
        request: The task's request.
    """
    fields = _changed_fields(request)
    robot, start, stages = (fields.pop(name) for name in ("robot", "start", "stages"))
    arguments = [repr(robot), _code(start.joints)]
    listed = [f"            {_code(stage)}," for stage in stages]
    further = [f"        {name}={_code(value)}," for name, value in fields.items()]
    used = [n for value in (*stages, *fields.values()) for n in _models(value)]
    return "\n".join(
        [
            f"from armwright_client import {', '.join(sorted({'Client', *used}))}",
            "",
            f"with Client({url!r}) as client:",
            "    task = client.plan_task(",
            *(f"        {argument}," for argument in arguments),
            "        [",
            *listed,
            "        ],",
            *further,
            "    )",
            "for stage in task.stages:",
            "    print(stage.kind, stage.trajectory.duration, stage.certificate.verified)",
            "",
        ]
    )


def tour_python(url: str, request: TourRequest) -> str:
    """A Python program that plans the same tour with `armwright_client`.

    Args:
        url: Address of the service.
        request: The tour's request.
    """
    fields = _changed_fields(request)
    robot, goals = fields.pop("robot"), fields.pop("goals")
    used = [n for value in (*goals, *fields.values()) for n in _models(value)]
    return "\n".join(
        [
            f"from armwright_client import {', '.join(sorted({'Client', *used}))}",
            "",
            f"with Client({url!r}) as client:",
            "    tour = client.plan_tour(",
            f"        {robot!r},",
            "        [",
            *(f"            {_code(goal)}," for goal in goals),
            "        ],",
            *(f"        {name}={_code(value)}," for name, value in fields.items()),
            "    )",
            "for leg in tour.legs:",
            "    print(leg.origin, leg.target, leg.trajectory.duration, leg.certificate.verified)",
            "",
        ]
    )


def ik_python(url: str, robot: str, request: IkRequest) -> str:
    """A Python program that asks for the same inverse kinematics.

    Args:
        url: Address of the service.
        robot: Name of the robot.
        request: The request.
    """
    fields = _changed_fields(request)
    arguments = [repr(robot), _code(fields.pop("pose"))]
    arguments += [f"{name}={_code(value)}" for name, value in fields.items()]
    names = sorted({"Client", *_models(request)} - {"IkRequest"})
    return "\n".join(
        [
            f"from armwright_client import {', '.join(names)}",
            "",
            f"with Client({url!r}) as client:",
            "    answer = client.robots.ik(",
            *(f"        {argument}," for argument in arguments),
            "    )",
            "for solution in answer.solutions:",
            "    print(solution.rejected_because or 'valid', solution.joints)",
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


def plan_code(url: str, state: StudioState) -> tuple[str, str]:
    """The plan request as Python and as curl.

    Args:
        url: Address of the service.
        state: State of the studio.
    """
    request = plan_request(state, keep=False)
    return plan_python(url, request), curl(url, "/v1/plan", request)


def task_code(url: str, state: StudioState) -> tuple[str, str]:
    """The request of the task as Python and as curl.

    Args:
        url: Address of the service.
        state: State of the studio.
    """
    request = task_request(state, keep=False)
    return task_python(url, request), curl(url, "/v1/tasks", request)


def tour_code(url: str, state: StudioState) -> tuple[str, str]:
    """The request of the tour as Python and as curl.

    Args:
        url: Address of the service.
        state: State of the studio.

    Raises:
        ValueError: There are no two goals.
    """
    request = tour_request(state, keep=False)
    return tour_python(url, request), curl(url, "/v1/tours", request)


def path_code(url: str, state: StudioState) -> tuple[str, str]:
    """The request of the tool path as Python and as curl.

    Args:
        url: Address of the service.
        state: State of the studio.

    Raises:
        ValueError: There are no two waypoints.
    """
    request = path_request(state, keep=False)
    return plan_python(url, request), curl(url, "/v1/plan", request)


def ik_code(url: str, state: StudioState, tip: Pose) -> str:
    """The inverse kinematics of the goal as Python.

    Args:
        url: Address of the service.
        state: State of the studio.
        tip: Pose of the tip at the goal, in the root frame.
    """
    return ik_python(url, state.robot, ik_request(state, tip))


def all_code(url: str, state: StudioState, tip: Pose) -> str:
    """All that there is to ask, in Markdown; what is not valid yet says why.

    Args:
        url: Address of the service.
        state: State of the studio.
        tip: Pose of the tip at the goal, in the root frame.
    """
    parts = []
    for word, makes, entries in (
        ("task", task_code, state.stages),
        ("tour", tour_code, state.goals),
        ("tool path", path_code, state.waypoints),
    ):
        if entries:
            try:
                parts.append(f"The {word}:\n\n```python\n{makes(url, state)[0]}```")
            except ValueError as error:  # pydantic's, too
                parts.append(f"The {word} is not valid yet: {error}")
    try:
        python, shell = plan_code(url, state)
    except ValueError as error:  # a setting out of its range
        return f"The request is not valid: {error}"
    parts.append(f"The plan:\n\n```python\n{python}```\n\n```sh\n{shell}\n```")
    ik = ik_code(url, state, tip)
    parts.append(f"The configurations that reach the goal:\n\n```python\n{ik}```")
    return "\n\n".join(parts)
