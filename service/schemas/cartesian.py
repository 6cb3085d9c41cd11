"""Straight and circular motions of the tool on the wire: options of the planner "cartesian"."""

from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError, model_validator

from service.schemas.base import Answer, Body, NonNegative, Point, Vector3
from service.schemas.pose import FramedPose

MAX_MOTIONS = 200

Deviation = Annotated[float, Field(ge=1e-7, le=1.0)]


class ToolMotion(Body):
    """A line, or an arc through a point or about a centre, from where the tool is."""

    type: Literal["lin", "circ"] = Field(examples=["lin"])
    pose: FramedPose = Field(description="of the tip where the motion ends")
    via: Point | None = Field(None, description="point on the arc")
    center: Point | None = Field(None, description="of the arc")
    normal: Vector3 | None = Field(
        None,
        description="with center: axis to turn about by the right hand, up to a whole turn; the "
        "shorter arc if left out",
    )

    @model_validator(mode="after")
    def _check_form(self) -> "ToolMotion":
        if self.type == "lin":
            if not (self.via is self.center is self.normal is None):
                raise ValueError("via, center and normal belong to motions of type circ")
        elif (self.via is None) == (self.center is None):
            raise ValueError("a motion of type circ needs exactly one of via, center")
        if self.normal is not None and self.center is None:
            raise ValueError("normal needs center")
        return self


class CartesianOptions(Body):
    """`planner_options` of the planner "cartesian"."""

    motions: Annotated[list[ToolMotion], Field(min_length=1, max_length=MAX_MOTIONS)] | None = (
        Field(None, description="one line to the goal if left out")
    )
    max_deviation: Deviation = Field(
        1e-4, description="of the tool's origin from its motion, for every instant [m]"
    )
    max_orientation_deviation: Deviation = Field(
        1e-3, description="of its orientation from that at the same place [rad]"
    )
    orientation: Literal["slerp", "free"] = Field(
        "slerp", description="about an axis that keeps still, or only the origin is led"
    )
    allow_partial: bool = Field(False, description="a motion that ends early is an answer too")


class TimedToolMotions(Body):
    """Motions of the tool that a trajectory is held to, in turn."""

    motions: Annotated[list[ToolMotion], Field(min_length=1, max_length=MAX_MOTIONS)]
    ends: Annotated[list[NonNegative], Field(min_length=1, max_length=MAX_MOTIONS)] | None = Field(
        None,
        description="when each motion ends [s], as tool_motions of a plan tell it; the end of the "
        "trajectory if left out, for one motion",
    )
    max_deviation: Deviation = Field(
        1e-4, description="of the tool's origin from its motion, for every instant [m]"
    )
    max_orientation_deviation: Deviation = Field(
        1e-3, description="of its orientation from that at the same place [rad]"
    )
    orientation: Literal["slerp", "free"] = Field(
        "slerp", description="about an axis that keeps still, or only the origin is led"
    )

    @model_validator(mode="after")
    def _check_ends(self) -> "TimedToolMotions":
        count = 1 if self.ends is None else len(self.ends)
        if count != len(self.motions):
            raise ValueError("ends needs as many times as there are motions")
        if self.ends is not None and sorted(self.ends) != self.ends:
            raise ValueError("ends must not descend")
        return self


def cartesian_options(given: dict[str, Any] | None) -> CartesianOptions:
    """The options, checked.

    Raises:
        ValueError: They have not the right form; the message says where.
    """
    try:
        return CartesianOptions.model_validate(given or {})
    except ValidationError as error:
        first = error.errors()[0]
        steps = (f"[{step}]" if isinstance(step, int) else f".{step}" for step in first["loc"])
        text = str(first["msg"]).removeprefix("Value error, ")
        raise ValueError(f"planner_options{''.join(steps)}: {text}") from None


class ToolMotionAnswer(Answer):
    """Result of one tool motion."""

    type: Literal["lin", "circ"]
    length: float = Field(description="of the whole of it [m]")
    angle: float = Field(description="how far the tool turns in the whole of it [rad]")
    fraction: float = Field(description="how far it was carried out")
    begins: float = Field(description="[s]")
    ends: float = Field(description="[s]")


class PathDeviationAnswer(Answer):
    """Largest deviation of the tool from its motions, proved for every instant."""

    position: float = Field(description="from the line or arc [m]")
    orientation: float | None = Field(description="[rad]; null where it is free")
    time: float = Field(description="where it is farthest off [s]")
    max_position: float = Field(description="what was allowed [m]")
    max_orientation: float | None = Field(description="what was allowed [rad]")
