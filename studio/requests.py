"""Requests of the studio's state, and the questions to the service that plan by them."""

import json
from collections.abc import Callable, Sequence
from typing import Any

from pydantic import ValidationError

from armwright_client import (
    ApiError,
    ArmwrightError,
    Attached,
    Clearance,
    Client,
    Goal,
    IkRequest,
    PlanRequest,
    Pose,
    Scene,
    Start,
    TaskRequest,
    Timing,
    TourRequest,
)
from studio.result import Failure, Outcome, Planned, TaskPlanned, TourPlanned, failure
from studio.state import StudioState

#: Inverse kinematics while a goal is dragged may take this long [s].
_LIVE_TIMEOUT = 2.0
#: Solutions that are drawn at once; more would hide each other.
MAX_BRANCHES = 8
#: Settings of a plan that a task takes as well.
_OF_TASKS = ("margin", "seed", "timeout", "timing")
#: And a tour.
_OF_TOURS = (*_OF_TASKS, "clearance")
#: Goals of a tour and waypoints of a tool path at least.
_FEWEST = 2
#: Models of the settings that are objects.
_MODELS = {"timing": Timing, "clearance": Clearance}


def scene_of(state: StudioState) -> Scene | None:
    """The scene of a state; None where there are no obstacles."""
    return Scene(obstacles=list(state.obstacles)) if state.obstacles else None


def goal_of(state: StudioState) -> Goal:
    """The goal of a state: a pose, or a configuration."""
    if state.goal_pose is not None:
        return Goal(pose=state.goal_pose)
    return Goal(joints=state.goal_joints)


def plan_request(state: StudioState, *, keep: bool = True) -> PlanRequest:
    """The request that plans from start to goal.

    Args:
        state: State of the studio.
        keep: Whether the service keeps request and answer, for the page that shows them.

    Raises:
        pydantic.ValidationError: A setting is out of its range.
    """
    return PlanRequest(
        **_common(state, keep),
        robot=state.robot,
        goal=goal_of(state),
        fingers=dict(state.fingers) or None,
        constraints=[dict(entry) for entry in state.constraints] or None,
    )


def task_request(state: StudioState, *, keep: bool = True) -> TaskRequest:
    """The request that plans the stages of the task as one, from the start on.

    Args:
        state: State of the studio.
        keep: Whether the service keeps request and answer, for the page that shows them.

    Raises:
        pydantic.ValidationError: A stage or a setting is not as the API has it.
    """
    # Read from JSON: of what kind a stage is, and that its fields are right, the model finds out.
    stages = [dict(entry) for entry in state.stages]
    read = TaskRequest.model_validate_json(
        json.dumps({"robot": state.robot, "start": {"joints": [*state.start]}, "stages": stages})
    )
    return TaskRequest(
        **_common(state, keep, _OF_TASKS),
        robot=state.robot,
        stages=read.stages,
        fingers=dict(state.fingers) or None,
    )


def tour_request(state: StudioState, *, keep: bool = True) -> TourRequest:
    """The request for the goals of the tour in the best order, from the start on.

    Args:
        state: State of the studio.
        keep: Whether the service keeps request and answer, for the page that shows them.

    Raises:
        pydantic.ValidationError: A goal or a setting is not as the API has it.
        ValueError: There are no two goals.
    """
    if len(state.goals) < _FEWEST:
        raise ValueError("a tour has two goals or more: add them first")
    body = {"robot": state.robot, "goals": [dict(entry) for entry in state.goals]}
    read = TourRequest.model_validate_json(json.dumps({**body, **state.tour_options}))
    return TourRequest(**set_fields(read), **_common(state, keep, _OF_TOURS))


def path_request(state: StudioState, *, keep: bool = True) -> PlanRequest:
    """The request for a motion of the tool along the waypoints, from the start on.

    Args:
        state: State of the studio.
        keep: Whether the service keeps request and answer, for the page that shows them.

    Raises:
        pydantic.ValidationError: A waypoint or a setting is not as the API has it.
        ValueError: There are no two waypoints.
    """
    if len(state.waypoints) < _FEWEST:
        raise ValueError("a tool path has two waypoints or more: add them first")
    last = state.waypoints[-1]
    pose = last.get("pose") or {"position": last.get("point")}
    goal = Goal.model_validate_json(json.dumps({"pose": pose}))
    request = plan_request(state, keep=keep)
    options = {"waypoints": [dict(entry) for entry in state.waypoints], **state.path_options}
    changes = {"goal": goal, "planner": "cartesian", "planner_options": options}
    return request.model_copy(update=changes)


def set_fields(request: Any, without: Sequence[str] = ()) -> dict[str, Any]:
    """Fields of a request that are set, as the client's methods take them.

    Args:
        request: A model of the client.
        without: Fields that the method takes by position.
    """
    return {
        name: getattr(request, name)
        for name in type(request).model_fields
        if name in request.model_fields_set
        and name not in without
        and getattr(request, name) is not None
    }


def ik_request(state: StudioState, pose: Pose) -> IkRequest:
    """The request for all configurations that reach a pose, valid or not.

    Args:
        state: State of the studio.
        pose: Pose of the tip, in the root frame.
    """
    return IkRequest(
        pose=pose,
        tool=state.tool,
        seed_joints=state.goal_joints,
        all_solutions=True,
        max_solutions=MAX_BRANCHES,
        scene=scene_of(state),
        attached=_attached(state),
        timeout=_LIVE_TIMEOUT,
    )


def _common(
    state: StudioState, keep: bool, settings: Sequence[str] | None = None
) -> dict[str, Any]:
    """Fields that all requests for motions have: tool, start, surroundings and settings.

    Args:
        state: State of the studio.
        keep: Whether the service keeps request and answer.
        settings: Settings that the request takes, by the first word of their path; None for all.
    """
    taken = {
        path: value
        for path, value in state.settings.items()
        if settings is None or path.partition(".")[0] in settings
    }
    return {
        "tool": state.tool,
        "start": Start(joints=state.start),
        "scene": scene_of(state),
        "attached": _attached(state),
        "keep": keep or None,
        **_nested(taken),
    }


def _attached(state: StudioState) -> list[Attached] | None:
    """Obstacles that are carried from the start, where the link has closed on them."""
    carried = [
        Attached(id=name, link=link, grasp_joints=state.start, touch_links=[link])
        for name, link in state.attached.items()
    ]
    return carried or None


def _nested(settings: Any) -> dict[str, Any]:
    """Settings by path as fields, objects as models."""
    fields: dict[str, Any] = {}
    groups: dict[str, dict[str, Any]] = {}
    for path, value in settings.items():
        group, _, name = path.partition(".")
        if name:
            groups.setdefault(group, {})[name] = value
        else:
            fields[path] = value
    return fields | {group: _MODELS[group](**values) for group, values in groups.items()}


def attempt(state: StudioState, action: Callable[[], Outcome]) -> Outcome:
    """The result of a question, or why there is none.

    Args:
        state: State that is asked about.
        action: Asks.
    """
    try:
        return action()
    except ApiError as error:
        return failure(state, error.problem)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(str(step) for step in first["loc"])
        return Failure(state, "A setting is out of its range", f"{where}: {first['msg']}")
    except ValueError as error:
        return Failure(state, "Something is missing", str(error))
    except ArmwrightError as error:
        return Failure(state, "The service did not answer", str(error))


def plan(client: Client, state: StudioState, kind: str) -> Outcome:
    """What was asked for, planned by the service.

    Args:
        client: Client that asks the service.
        state: State of the studio.
        kind: "motion", "task", "tour" or "tool path".

    Raises:
        ApiError: There is no such motion.
        ValueError: There are no two goals of the tour, or waypoints of the tool path.
    """
    if kind == "task":
        task = task_request(state)
        options = set_fields(task, without=("robot", "start", "stages"))
        return TaskPlanned(state, client.plan_task(task.robot, task.start, task.stages, **options))
    if kind == "tour":
        tour = tour_request(state)
        options = set_fields(tour, without=("robot", "goals"))
        return TourPlanned(state, client.plan_tour(tour.robot, tour.goals, **options))
    motion = path_request(state) if kind == "tool path" else plan_request(state)
    options = set_fields(motion, without=("robot", "start", "goal"))
    return Planned(state, client.plan(motion.robot, motion.start, motion.goal, **options))
