"""Questions to the service that plan: motions, tasks, tours and tool paths."""

from armwright_client import Client, PlanRequest
from studio.requests import (
    path_request,
    plan_request,
    set_fields,
    task_request,
    tour_request,
)
from studio.result import Planned, TaskPlanned, TourPlanned
from studio.state import StudioState


def plan_motion(client: Client, state: StudioState) -> Planned:
    """A motion from start to goal.

    Args:
        client: Client that asks the service.
        state: State of the studio.

    Raises:
        ApiError: There is none.
    """
    return _planned(client, state, plan_request(state))


def plan_tool_path(client: Client, state: StudioState) -> Planned:
    """A motion of the tool along the waypoints.

    Args:
        client: Client that asks the service.
        state: State of the studio.

    Raises:
        ApiError: There is none.
        ValueError: There are no two waypoints.
    """
    return _planned(client, state, path_request(state))


def plan_task(client: Client, state: StudioState) -> TaskPlanned:
    """The stages of the task as one, from the start on.

    Args:
        client: Client that asks the service.
        state: State of the studio.

    Raises:
        ApiError: There is no way through them.
    """
    request = task_request(state)
    options = set_fields(request, without=("robot", "start", "stages"))
    return TaskPlanned(
        state, client.plan_task(request.robot, request.start, request.stages, **options)
    )


def plan_tour(client: Client, state: StudioState) -> TourPlanned:
    """The goals of the tour in the order that takes the least time, from the start on.

    Args:
        client: Client that asks the service.
        state: State of the studio.

    Raises:
        ApiError: There is no such tour.
        ValueError: There are no two goals.
    """
    request = tour_request(state)
    options = set_fields(request, without=("robot", "goals"))
    return TourPlanned(state, client.plan_tour(request.robot, request.goals, **options))


def _planned(client: Client, state: StudioState, request: PlanRequest) -> Planned:
    options = set_fields(request, without=("robot", "start", "goal"))
    return Planned(state, client.plan(request.robot, request.start, request.goal, **options))
