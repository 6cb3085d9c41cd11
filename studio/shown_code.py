"""Requests of the studio as Python and as curl."""

from armwright_client import Pose
from studio.code import curl, ik_python, plan_python, task_python, tour_python
from studio.requests import ik_request, path_request, plan_request, task_request, tour_request
from studio.state import StudioState


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
