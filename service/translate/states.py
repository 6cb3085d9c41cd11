"""Named states of robots in requests, looked up."""

from collections.abc import Mapping
from typing import Any, TypeVar

import numpy as np

from armwright_wire.goals.goal import SingleGoal, Start
from armwright_wire.plans.plan import PlanRequest
from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from kinematics.model.chain import Chain
from kinematics.tree.srdf import state

_Part = TypeVar("_Part", Start, SingleGoal)


def with_states(body: PlanRequest, states: Mapping[str, Array]) -> PlanRequest:
    """A request for a plan with the joints of the states that it names.

    Args:
        body: The request.
        states: States of the robot, by name.

    Raises:
        InvalidRobotState: The robot has no such state.
        InvalidOption: It begins on another motion, which only planning itself looks up.
    """
    _refuse_plan(body.start)
    changes: dict[str, Any] = {}
    if body.start.state is not None:
        changes["start"] = _looked_up(body.start, states, "start.state")
    goal = body.goal
    if goal.state is not None:
        changes["goal"] = goal.model_copy(update=_joints(goal.state, states, "goal.state"))
    elif any(item.state is not None for item in goal.any_of or ()):
        items = [
            item if item.state is None else _looked_up(item, states, f"goal.any_of[{i}].state")
            for i, item in enumerate(goal.any_of or ())
        ]
        changes["goal"] = goal.model_copy(update={"any_of": items})
    return body.model_copy(update=changes) if changes else body


def _looked_up(part: _Part, states: Mapping[str, Array], where: str) -> _Part:
    assert part.state is not None
    return part.model_copy(update=_joints(part.state, states, where))


def _joints(name: str, states: Mapping[str, Array], where: str) -> dict[str, Any]:
    return {"joints": state(states, name, where).tolist(), "state": None}


def configuration(body: Start, chain: Chain, states: Mapping[str, Array], where: str) -> Array:
    """Configuration of a start or an end, shape (n,) [rad or m].

    Raises:
        InvalidRobotState: The robot has no such state, or the vector has the wrong length.
        InvalidOption: It is an instant of a plan.
    """
    _refuse_plan(body)
    if body.state is not None:
        return np.array(state(states, body.state, f"{where}.state"))
    return np.asarray(chain.state(body.joints or (), f"{where}.joints"))


def _refuse_plan(start: Start) -> None:
    """Refuse a start on the motion of a kept plan where nothing has looked that up."""
    if start.plan is not None:
        raise InvalidOption(
            f"an instant of plan {start.plan!r} is the start of a single new plan only",
            hint="Give joints, velocities and accelerations in its place.",
        )
