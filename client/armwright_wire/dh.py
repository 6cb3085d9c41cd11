"""Denavit-Hartenberg tables on the wire, in requests and answers."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from armwright_wire.base import (
    MAX_JOINTS,
    Answer,
    Body,
    Coordinate,
    Length,
    Matrix3,
    NonNegative,
    Number,
    Point,
    Positive,
    Vector3,
)
from armwright_wire.motor import Motor
from armwright_wire.pose import Pose, PoseAnswer
from armwright_wire.shape import Shape

#: Solids of one link.
_MAX_SOLIDS = 100


class LinkSolid(Body):
    """A shape that a link carries."""

    shape: Shape = Field(description="of the solid")
    pose: Pose | None = Field(
        None, description="in the link's frame, which is frame i of row i; the frame itself if null"
    )


class LinkCapsules(Body):
    """Capsules about the segments a and d of every row."""

    capsules: Length = Field(description="their radius [m]", examples=[0.06])


class DhRow(Body):
    """One joint of a Denavit-Hartenberg table, with what is known of the link behind it.

    For a revolute joint `theta` is the offset of the joint variable, for a prismatic one `d` is.
    """

    type: Literal["revolute", "prismatic"] = Field(description="kind of joint")
    a: Coordinate = Field(description="[m]")
    alpha: Number = Field(description="[rad]")
    d: Coordinate = Field(description="[m]")
    theta: Number = Field(description="[rad]")
    lower: Number | None = Field(None, description="[rad] or [m]")
    upper: Number | None = Field(None, description="[rad] or [m]")
    velocity: Positive | None = Field(None, description="largest speed [rad/s or m/s]")
    acceleration: Positive | None = Field(None, description="largest acceleration [rad/s² or m/s²]")
    jerk: Positive | None = Field(None, description="largest jerk [rad/s³ or m/s³]")
    effort: Positive | None = Field(None, description="largest torque or force [N m or N]")
    mass: NonNegative | None = Field(None, description="[kg]")
    center_of_mass: Point | None = Field(None, description="in the link frame [m]")
    inertia: Matrix3 | None = Field(
        None, description="about the centre of mass in the link frame [kg m²]"
    )
    motor_inertia: NonNegative | None = Field(
        None, description="reflected at the joint [kg m² or kg]"
    )
    viscous_friction: NonNegative | None = Field(
        None, description="at the joint [N m s/rad or N s/m]"
    )
    coulomb_friction: NonNegative | None = Field(None, description="dry friction [N m or N]")
    motor: Motor | None = Field(
        None,
        description="what drives the joint, in place of motor_inertia and viscous_friction; every "
        "row has one, or none has",
    )
    beta: Number = Field(
        0.0, description="about y, behind alpha [rad]; 0 but for nearly parallel axes"
    )
    continuous: bool = Field(False, description="without end: lower and upper are left out or null")
    geometry: Annotated[list[LinkSolid], Field(max_length=_MAX_SOLIDS)] | None = Field(
        None, description="solids of the link behind the joint"
    )

    @model_validator(mode="after")
    def _check_limits(self) -> "DhRow":
        if self.continuous and not (self.lower is None and self.upper is None):
            raise ValueError("a continuous joint has neither lower nor upper")
        if self.lower is not None and self.upper is not None and self.lower >= self.upper:
            raise ValueError(f"lower ({self.lower:g}) must be less than upper ({self.upper:g})")
        drive = (self.motor_inertia, self.viscous_friction)
        if self.motor is not None and drive != (None, None):
            raise ValueError("motor has an inertia and a friction: leave out motor_inertia and "
                             "viscous_friction, or motor")  # fmt: skip
        return self


class DhTable(Body):
    """A robot by its Denavit-Hartenberg parameters."""

    convention: Literal["standard", "modified"] = Field(
        description="frame i at the end of link i (standard) or at its beginning (modified)"
    )
    rows: Annotated[list[DhRow], Field(min_length=1, max_length=MAX_JOINTS)] = Field(
        description="one for each joint, from the base on"
    )
    base: Pose | None = Field(
        None, description="frame 0 in the root frame; the root frame itself if left out"
    )
    tool: Pose | None = Field(None, description="the tip in frame n; frame n itself if left out")
    gravity: Vector3 | None = Field(None, description="in the root frame [m/s²]")
    geometry: LinkCapsules | None = Field(
        None, description="solids of all links, beside those of the rows"
    )


class DhRowAnswer(Answer):
    """One row of the table that was given, or that is derived from the joint axes."""

    type: Literal["revolute", "prismatic"] = Field(description="kind of joint")
    a: float = Field(description="link length [m]")
    alpha: float = Field(description="link twist [rad]")
    d: float = Field(description="link offset [m]")
    theta: float = Field(description="joint angle [rad]")
    lower: float | None = Field(None, description="[rad] or [m]; null where there is none")
    upper: float | None = Field(None, description="[rad] or [m]; null where there is none")
    velocity: float | None = Field(None, description="largest speed [rad/s or m/s]")
    acceleration: float | None = Field(None, description="largest acceleration [rad/s² or m/s²]")
    jerk: float | None = Field(None, description="largest jerk [rad/s³ or m/s³]")
    effort: float | None = Field(None, description="largest torque or force [N m or N]")
    mass: float | None = Field(None, description="of all that moves with the joint [kg]")
    center_of_mass: list[float] | None = Field(None, description="in frame i [m]")
    inertia: list[list[float]] | None = Field(
        None, description="about the centre of mass in the axes of frame i [kg m²]"
    )
    motor_inertia: float | None = Field(None, description="null where there is a `motor`")
    viscous_friction: float | None = Field(None, description="null where there is a `motor`")
    coulomb_friction: float | None = Field(None, description="dry friction [N m or N]")
    motor: Motor | None = Field(None, description="what drives the joint, as it was given")
    beta: float = Field(0.0, description="about y, behind alpha; 0 but for nearly parallel axes")
    continuous: bool = Field(False, description="without end: no lower and no upper limit")
    geometry: list[LinkSolid] | None = Field(None, description="as it was given")


class DhAnswer(Answer):
    """The Denavit-Hartenberg table of a robot: the tool's pose is base H_1 … H_n tool."""

    convention: Literal["standard", "modified"] = Field(
        description="frame i at the end of link i (standard) or at its beginning (modified)"
    )
    rows: list[DhRowAnswer] = Field(description="one for each joint")
    base: PoseAnswer = Field(description="frame 0 in the root frame")
    tool: PoseAnswer = Field(description="the tip in frame n")
    gravity: list[float] | None = Field(None, description="in the root frame [m/s²]")
    geometry: LinkCapsules | None = Field(None, description="as it was given")
