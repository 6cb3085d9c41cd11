"""Seams on the wire: waypoints with tolerances, of the planner "cartesian"."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from armwright_wire.base import Answer, Body, Frame, Point, Vector3, exactly_one
from armwright_wire.pose import FramedPose

MAX_WAYPOINTS = 2_000

Length = Annotated[float, Field(ge=-1.0, le=1.0)]
Angle = Annotated[float, Field(ge=-3.2, le=3.2)]
LengthRange = Annotated[list[Length], Field(min_length=2, max_length=2)]
AngleRange = Annotated[list[Angle], Field(min_length=2, max_length=2)]
Blend = Annotated[float, Field(ge=0.0, le=10.0)]
Rotation = Literal["rx", "ry", "rz"]
Axis = Literal["x", "y", "z", "rx", "ry", "rz"]
Speed = Annotated[float, Field(gt=0.0, le=100.0)]


class ToolTolerance(Body):
    """Ranges of the tool's deviation [least, largest]; axes left out are exact.

    The tool's pose is T_pose Trans(x, y, z) Rx(rx) Ry(ry) Rz(rz) in its own frame.
    """

    x: LengthRange | None = Field(None, description="[m]", examples=[[-0.001, 0.001]])
    y: LengthRange | None = Field(None, description="[m]")
    z: LengthRange | None = Field(None, description="[m]")
    rx: AngleRange | None = Field(None, description="[rad]")
    ry: AngleRange | None = Field(None, description="[rad], within 1.4 of 0")
    rz: AngleRange | None = Field(None, description="[rad]")
    free: list[Rotation] = Field(
        default_factory=list, max_length=3, description="rotations by any angle", examples=[["rz"]]
    )
    tilt: Annotated[float, Field(gt=0.0, le=1.4)] | None = Field(
        None, description="largest angle between the tool's z and that of the pose [rad]"
    )
    frame: Frame | None = Field(
        None,
        description='whose axes deviations are along: "tool", those of each pose, if left out; or '
        "a link that stands still",
    )

    @model_validator(mode="after")
    def _check_ranges(self) -> "ToolTolerance":
        for name in ("x", "y", "z", "rx", "ry", "rz"):
            given = getattr(self, name)
            if given is not None and given[0] > given[1]:
                raise ValueError(f"{name}: {given[0]:g} is above {given[1]:g}")
            if given is not None and name in self.free:
                raise ValueError(f"{name} has a range and is free")
        return self


class Waypoint(Body):
    """A pose of the tool, or a point with the surface's normal that the tool's z is against."""

    pose: FramedPose | None = Field(None, description="of the tip, without deviation")
    point: Point | None = Field(None, description="place of the tip [m]")
    normal: Vector3 | None = Field(
        None, description="with point: out of the surface; the tool's z axis points against it"
    )
    direction: Vector3 | None = Field(
        None,
        description="with point: the tool's x axis, as far as it is across the normal; any angle "
        "about the normal if left out",
    )
    frame: Frame | None = Field(None, description="of point, normal, direction and via")
    via: Point | None = Field(
        None, description="on the arc from the waypoint before; a line if not"
    )
    tolerance: ToolTolerance | None = Field(
        None, description="on the way to it and there; that of the options if left out"
    )
    free: list[Axis] = Field(
        default_factory=list,
        max_length=6,
        description="axes that are free there and on the way to it, beside what tolerance says: "
        "rotations by any angle, x, y and z by up to 1 m",
        examples=[["rz"]],
    )
    blend: Blend | None = Field(
        None, description="distance from it at which the tool may leave the way [m]"
    )
    tool_speed: Speed | None = Field(
        None,
        description="to be kept on the way to it [m/s]; that of the options if left out, which has "
        "to be there if others have their own",
    )

    @model_validator(mode="after")
    def _check_form(self) -> "Waypoint":
        exactly_one(self, ("pose", "point"))
        if (self.point is None) != (self.normal is None):
            raise ValueError("point and normal belong together")
        if self.direction is not None and self.point is None:
            raise ValueError("direction belongs to point and normal")
        if self.normal is not None and not any(self.normal):
            raise ValueError("normal: has no length")
        for name in self.free:
            if self.tolerance is not None and getattr(self.tolerance, name) is not None:
                raise ValueError(f"{name} has a range and is free")
        return self


class StraightOffset(Body):
    """A straight motion to the seam's start, or from its end."""

    direction: Vector3 = Field(description="of the motion", examples=[[0.0, 0.0, 1.0]])
    distance: Annotated[float, Field(gt=0.0, le=5.0)] = Field(description="[m]", examples=[0.05])
    frame: Literal["tool", "base"] = Field(
        "tool", description="direction is along the axes of the tool at the seam, or of the root"
    )

    @model_validator(mode="after")
    def _check_direction(self) -> "StraightOffset":
        if not any(self.direction):
            raise ValueError("direction: has no length")
        return self


class ToolToleranceAnswer(Answer):
    """Use of the tolerances of a seam, proved for every instant."""

    share: float = Field(description="largest share of a range on either side of its middle")
    time: float = Field(description="when [s]")


class ToolSpeedBandAnswer(Answer):
    """Speed of the tool where one speed is asked for."""

    share: float = Field(
        description="of the seam's length, on which the speed is proved to be within the band"
    )
    least: float = Field(description="least speed found, starts and stops included [m/s]")
    most: float = Field(description="a bound of the largest speed over all t [m/s]")
    low: float = Field(description="least speed of the band [m/s]")
    high: float = Field(description="largest, which is a limit [m/s]")


class ToolSpeedAnswer(ToolSpeedBandAnswer):
    """Speed of the tool along a seam; of several speeds the least and the largest."""

    bands: list[ToolSpeedBandAnswer] | None = Field(
        None, description="the same for each of the speeds that are asked for, if they differ"
    )
