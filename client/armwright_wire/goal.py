"""Starts and goals of motions on the wire."""

from typing import Annotated, ClassVar

from pydantic import Field, model_validator

from armwright_wire.base import (
    Beside,
    Body,
    Frame,
    JointVector,
    Label,
    Positive,
    check_company,
    exactly_one,
)
from armwright_wire.kinematics import JOINTS_EXAMPLE
from armwright_wire.pose import FramedPose

MAX_GOALS = 1_000

Tolerance = Annotated[Positive, Field(le=10.0)]


class Start(Body):
    """Start of the motion."""

    one_of: ClassVar[tuple[str, ...]] = ("joints", "state")

    joints: JointVector | None = Field(None, examples=[JOINTS_EXAMPLE])
    state: Label | None = Field(None, description="a named state of the robot", examples=["home"])
    velocities: JointVector | None = Field(
        None, description="there, for a motion that is optimised; at rest if left out"
    )
    accelerations: JointVector | None = Field(
        None, description="there, likewise; any that keep the limits if left out"
    )

    @model_validator(mode="after")
    def _check_form(self) -> "Start":
        exactly_one(self, self.one_of)
        return self


class SingleGoal(Body):
    """A configuration, or a pose of the tip within tolerances."""

    one_of: ClassVar[tuple[str, ...]] = ("joints", "state", "pose")
    only_beside: ClassVar[Beside] = {
        "position_tolerance": ("pose",),
        "orientation_tolerance": ("pose",),
        "frame": ("pose",),
        "velocities": ("joints", "state"),
        "accelerations": ("joints", "state"),
    }

    joints: JointVector | None = Field(None, examples=[[0.6, -0.3, 0.0, -2.0, 0.0, 1.8, 0.785]])
    state: Label | None = Field(None, description="a named state of the robot", examples=["home"])
    pose: FramedPose | None = None
    frame: Frame | None = None
    velocities: JointVector | None = Field(
        None, description="at the joints, for a motion that is optimised; at rest if left out"
    )
    accelerations: JointVector | None = Field(
        None, description="there, likewise; any that keep the limits if left out"
    )
    position_tolerance: Tolerance | None = Field(
        None,
        description="how far off the tip may end if nothing is right there, 1e-4 if left out [m]",
    )
    orientation_tolerance: Tolerance | None = Field(
        None,
        description="how far turned it may end if nothing is right there, 1e-3 if left out [rad]",
    )

    @model_validator(mode="after")
    def _check_form(self) -> "SingleGoal":
        exactly_one(self, self.one_of)
        check_company(self)
        return self


class Goal(SingleGoal):
    """Goal of the motion: one, or any of several."""

    one_of: ClassVar[tuple[str, ...]] = ("joints", "state", "pose", "any_of")

    any_of: Annotated[list[SingleGoal], Field(min_length=1, max_length=MAX_GOALS)] | None = Field(
        None, description="goals of which one is to be reached"
    )

    @model_validator(mode="after")
    def _check_form(self) -> "Goal":
        exactly_one(self, self.one_of)
        check_company(self)
        return self
