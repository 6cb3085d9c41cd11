"""Starts and goals of planning problems."""

from collections.abc import Sequence
from typing import Any, Self, TypeAlias

from pydantic import model_validator

from armwright_client.base import (
    Positive,
    Request,
    Vector,
    VectorLike,
)
from armwright_client.pose import AnyPose, Pose


class Start(Request):
    """Start of a motion.

    Args:
        joints: The configuration [rad or m].
        state: A named state of the robot in its place.
        velocities: There, for a motion that is optimised; at rest if left out.
        accelerations: There, likewise; any that keep the limits if left out.
    """

    joints: Vector | None = None
    state: str | None = None
    velocities: Vector | None = None
    accelerations: Vector | None = None


class SingleGoal(Request):
    """A configuration, a named state, or a pose of the tip within tolerances [m, rad]."""

    joints: Vector | None = None
    state: str | None = None
    velocities: Vector | None = None
    accelerations: Vector | None = None
    pose: AnyPose | None = None
    frame: str | None = None
    position_tolerance: Positive | None = None
    orientation_tolerance: Positive | None = None

    @model_validator(mode="after")
    def _check_form(self) -> Self:
        given = [name for name in self._forms() if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError(f"give exactly one of {', '.join(self._forms())}")
        return self

    @classmethod
    def _forms(cls) -> tuple[str, ...]:
        return ("joints", "state", "pose")


class Goal(SingleGoal):
    """Goal of a motion: one, or any of several."""

    any_of: list[SingleGoal] | None = None

    @classmethod
    def _forms(cls) -> tuple[str, ...]:
        return ("joints", "state", "pose", "any_of")

    @classmethod
    def at_state(cls, state: str) -> Self:
        """A named state of the robot as the goal."""
        return cls(state=state)

    @classmethod
    def at_joints(
        cls,
        joints: VectorLike,
        *,
        velocities: VectorLike | None = None,
        accelerations: VectorLike | None = None,
    ) -> Self:
        """A configuration as the goal [rad or m], for an optimised motion passed at a velocity."""
        return cls.of(joints=joints, velocities=velocities, accelerations=accelerations)

    @classmethod
    def at_pose(
        cls,
        pose: Pose,
        *,
        position_tolerance: float | None = None,
        orientation_tolerance: float | None = None,
    ) -> Self:
        """A pose of the tip as the goal, within tolerances [m, rad]."""
        return cls(
            pose=pose,
            position_tolerance=position_tolerance,
            orientation_tolerance=orientation_tolerance,
        )

    @classmethod
    def among(cls, goals: Sequence["GoalLike"]) -> Self:
        """Goal that is any of several."""
        return cls(any_of=[SingleGoal(**_fields(as_goal(goal))) for goal in goals])


#: A goal, or a pose or configuration that is one.
GoalLike: TypeAlias = SingleGoal | Pose | VectorLike


def as_goal(goal: GoalLike) -> Goal:
    """The goal that is meant by a pose or a configuration."""
    if isinstance(goal, Goal):
        return goal
    if isinstance(goal, SingleGoal):
        return Goal(**_fields(goal))
    if isinstance(goal, Pose):
        return Goal.at_pose(goal)
    return Goal.at_joints(goal)


def _fields(goal: SingleGoal) -> dict[str, Any]:
    return {name: value for name, value in goal if value is not None}
