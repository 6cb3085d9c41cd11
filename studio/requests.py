"""Requests of the studio's state: a plan, and the inverse kinematics of its goal."""

from typing import Any

from armwright_client import (
    Attached,
    Clearance,
    Goal,
    IkRequest,
    PlanRequest,
    Pose,
    Scene,
    Start,
    Timing,
)
from studio.state import StudioState

#: Inverse kinematics while a goal is dragged may take this long [s].
_LIVE_TIMEOUT = 2.0
#: Solutions that are drawn at once; more would hide each other.
MAX_BRANCHES = 8
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
        state: Of the studio.
        keep: Whether the service keeps request and answer, for the page that shows them.

    Raises:
        pydantic.ValidationError: A setting is out of its range.
    """
    return PlanRequest(
        robot=state.robot,
        start=Start(joints=state.start),
        goal=goal_of(state),
        scene=scene_of(state),
        attached=_attached(state),
        keep=keep or None,
        **_nested(state.settings),
    )


def ik_request(state: StudioState, pose: Pose) -> IkRequest:
    """The request for all configurations that reach a pose, valid or not.

    Args:
        state: Of the studio.
        pose: Of the tip, in the root frame.
    """
    return IkRequest(
        pose=pose,
        seed_joints=state.goal_joints,
        all_solutions=True,
        max_solutions=MAX_BRANCHES,
        scene=scene_of(state),
        attached=_attached(state),
        timeout=_LIVE_TIMEOUT,
    )


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
