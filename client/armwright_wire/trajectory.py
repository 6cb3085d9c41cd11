"""Timed motions and limits of joints, on the wire."""

from typing import Annotated

from pydantic import ConfigDict, Field, model_validator

from armwright_wire.base import (
    MAX_JOINTS,
    Answer,
    Body,
    JointVector,
    Label,
    NonNegative,
    Number,
    any_given,
)

MAX_SAMPLES = 100_000


#: Quintics are the highest that any timing here makes; other people's may be higher.
MAX_COEFFICIENTS = 16


Rows = Annotated[list[JointVector], Field(min_length=1, max_length=MAX_SAMPLES)]


JointRow = Annotated[list[Number], Field(max_length=MAX_JOINTS)]


class Segment(Body):
    """A polynomial piece: q_j(t) = Σ_k coefficients[j][k] (t − t0)^k for t0 ≤ t ≤ t1."""

    t0: Number = Field(description="when the piece begins [s]")
    t1: Number = Field(description="when the piece ends [s]")
    coefficients: Annotated[
        list[Annotated[list[Number], Field(min_length=1, max_length=MAX_COEFFICIENTS)]],
        Field(min_length=1, max_length=MAX_JOINTS),
    ] = Field(description="[joint][power of t − t0]")

    @model_validator(mode="after")
    def _check_times(self) -> "Segment":
        if self.t1 <= self.t0:
            raise ValueError(f"t1 ({self.t1:g}) must be after t0 ({self.t0:g})")
        return self


class Samples(Body):
    """Points of a motion, one row of joint values for each time."""

    time: Annotated[list[Number], Field(min_length=1, max_length=MAX_SAMPLES)] = Field(
        description="of each row, increasing [s]"
    )
    position: Rows = Field(description="of the joints [rad or m]")
    velocity: Rows | None = Field(None, description="of the joints [rad/s or m/s]")
    acceleration: Rows | None = Field(None, description="of the joints [rad/s² or m/s²]")

    @model_validator(mode="after")
    def _check_lengths(self) -> "Samples":
        for name in ("position", "velocity", "acceleration"):
            rows = getattr(self, name)
            if rows is not None and len(rows) != len(self.time):
                raise ValueError(f"{name} has {len(rows)} rows for {len(self.time)} times")
        return self


class TrajectoryBody(Body):
    """Anybody's motion: polynomial pieces, or samples and how to read between them."""

    model_config = ConfigDict(
        json_schema_extra=any_given(("segments",), ("samples", "interpolation"))
    )

    joint_names: Annotated[list[Label], Field(min_length=1, max_length=MAX_JOINTS)] | None = Field(
        None, description="order of the joints; the robot's if left out"
    )
    duration: NonNegative | None = Field(
        None, description="for people: the motion lasts as long as its segments or samples do [s]"
    )
    segments: Annotated[list[Segment], Field(min_length=1, max_length=MAX_SAMPLES)] | None = Field(
        None, description="polynomial pieces, in the order of time"
    )
    samples: Samples | None = None
    interpolation: Annotated[str, Field(pattern=r"^[a-z_]{1,32}$")] | None = Field(
        None, description="how to read between samples: linear, cubic, quintic, natural_spline, …"
    )

    @model_validator(mode="after")
    def _check_form(self) -> "TrajectoryBody":
        # What a plan answered can be sent as it is: it has both, and the pieces are the motion.
        if self.segments is None and self.samples is None:
            raise ValueError("give segments, or samples with interpolation")
        if self.segments is None and self.interpolation is None:
            raise ValueError("samples need interpolation: how to read between them")
        return self


class LimitsBody(Body):
    """Limits in the order of the joints, in place of the robot's."""

    velocity: JointRow | None = Field(
        None, description="largest speed of each joint [rad/s or m/s]"
    )
    acceleration: JointRow | None = Field(
        None, description="largest acceleration of each joint [rad/s² or m/s²]"
    )
    jerk: JointRow | None = Field(None, description="largest jerk of each joint [rad/s³ or m/s³]")
    effort: JointRow | None = Field(None, description="of torques, where these are limited")


class SegmentAnswer(Answer):
    """A polynomial piece, see `Segment`."""

    t0: float = Field(description="when the piece begins [s]")
    t1: float = Field(description="when the piece ends [s]")
    coefficients: list[list[float]] = Field(description="[joint][power of t − t0]")


class SamplesAnswer(Answer):
    """The motion at regular times."""

    time: list[float] = Field(description="of each row, increasing [s]")
    position: list[list[float]] = Field(description="of the joints [rad or m]")
    velocity: list[list[float]] = Field(description="of the joints [rad/s or m/s]")
    acceleration: list[list[float]] = Field(description="of the joints [rad/s² or m/s²]")


class TrajectoryAnswer(Answer):
    """A timed motion."""

    joint_names: list[str] = Field(description="order of the joints")
    duration: float = Field(description="of the motion [s]")
    segments: list[SegmentAnswer] = Field(description="polynomial pieces, which are the motion")
    samples: SamplesAnswer | None = None
