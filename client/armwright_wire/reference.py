"""References by name on the wire."""

from typing import Annotated, Literal

from pydantic import Field

from armwright_wire.base import MAX_BATCH, Body, JointVector, NonNegative, Number, Positive

Vector = Number | JointVector


class Hold(Body):
    """A reference that stands still."""

    type: Literal["hold"] = "hold"
    joints: JointVector = Field(description="[rad or m]")
    duration: Positive = Field(description="[s]")


class Step(Body):
    """A reference that jumps; the robot starts where it stands before, at rest."""

    type: Literal["step"] = "step"
    start: JointVector = Field(alias="from", description="where it stands before [rad or m]")
    end: JointVector = Field(alias="to", description="where it stands after [rad or m]")
    at: NonNegative = Field(0.0, description="when it jumps [s]")
    duration: Positive = Field(description="of the whole [s]")


class Sine(Body):
    """center + amplitude sin(2π frequency t + phase); one number holds for all joints."""

    type: Literal["sine"] = "sine"
    center: JointVector = Field(description="[rad or m]")
    amplitude: Vector = Field(description="[rad or m]")
    frequency: NonNegative | list[NonNegative] = Field(description="[Hz]")
    phase: Vector = Field(0.0, description="[rad]")
    duration: Positive = Field(description="[s]")


class Spline(Body):
    """A cubic spline through points; it lasts until the last time."""

    type: Literal["spline"] = "spline"
    points: Annotated[list[JointVector], Field(min_length=2, max_length=MAX_BATCH)] = Field(
        description="[rad or m]"
    )
    times: Annotated[list[NonNegative], Field(min_length=2, max_length=MAX_BATCH)] = Field(
        description="one for each point, ascending from 0 [s]"
    )
    interpolation: Literal["natural_spline", "clamped_spline"] = Field(
        "clamped_spline",
        description="clamped: at rest at both ends; natural: without acceleration there",
    )


NamedReference = Annotated[Hold | Step | Sine | Spline, Field(discriminator="type")]
