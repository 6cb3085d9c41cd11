"""Measurements of an arm's tip on the wire, and the corrections that follow."""

from typing import Annotated, ClassVar, Literal

from pydantic import ConfigDict, Field, model_validator

from armwright_wire.base import (
    Answer,
    Body,
    BodyWithRules,
    InFrame,
    JointVector,
    Label,
    Length,
    NonNegative,
    Point,
    Positive,
    Timeout,
    Vector3,
    examples,
)
from armwright_wire.pose import Pose, PoseAnswer
from armwright_wire.robots.robot import RobotCalibration
from armwright_wire.scenes.tool import WithTool

#: Configurations of one request.
MAX_MEASURED = 2_000
_Measured = Field(min_length=1, max_length=MAX_MEASURED)


class Plane(Body):
    """A plane that the tip touches."""

    point: Point = Field(description="on the plane, in the frame of measurement [m]")
    normal: Vector3 = Field(description="of any length but 0")


class Accuracy(Body):
    """Standard deviations of positions and of rotations."""

    position: Length = Field(description="[m]", examples=[5e-5])
    rotation: Positive = Field(description="[rad]", examples=[1e-4])


class CalibrateRequest(WithTool, BodyWithRules):
    """Configurations of an arm and what was measured of a link there."""

    one_of: ClassVar[tuple[str, ...]] = ("poses", "positions", "distances", "plane")
    model_config = ConfigDict(json_schema_extra={"examples": examples("CalibrateRequest")})

    joints: Annotated[list[JointVector], _Measured] = Field(
        description="configurations, in the order of `joint_names` [rad or m]"
    )
    poses: Annotated[list[Pose], _Measured] | None = Field(
        None, description="of the link, one for each configuration"
    )
    positions: Annotated[list[Point], _Measured] | None = Field(
        None, description="of the link's origin, likewise [m]"
    )
    distances: Annotated[list[NonNegative], _Measured] | None = Field(
        None, description="of the link's origin from `anchor`, likewise [m]"
    )
    anchor: Point | None = Field(None, description="of distances, in the frame of measurement [m]")
    plane: Plane | None = Field(None, description="that the link's origin touches everywhere")
    link: Label | None = Field(None, description="that is measured; the tip if left out")
    unknown: list[Literal["frame", "tip"]] = Field(
        [],
        max_length=2,
        description="frame: how the root frame stands in that of measurement; tip: how what is "
        "measured is fixed to the link",
    )
    noise: Accuracy | None = Field(None, description="of measurements; found if left out")
    tolerance: Accuracy | None = Field(
        None, description="of the arm's making, of each joint's frame; 1 mm, 1 mrad if left out"
    )
    timeout: Timeout | None = None

    @model_validator(mode="after")
    def _check_form(self) -> "CalibrateRequest":
        if (self.distances is None) != (self.anchor is None):
            raise ValueError("distances and anchor belong together: give both or neither")
        return self


class CorrectionAnswer(Answer):
    """A number of a correction."""

    joint: str = Field(description="whose frame is corrected; tip or frame for those")
    parameter: Literal["x", "y", "z", "rx", "ry", "rz"] = Field(
        description="a coordinate [m], or of the rotation vector [rad], in that frame"
    )
    value: float = Field(description="found [m or rad]")
    standard_error: float = Field(description="standard deviation [m or rad]")
    determined: bool = Field(description="measurements halve its tolerance at least")


class LinkMargin(Answer):
    """Distance to keep for what is not known of where a joint's bodies are."""

    joint: str = Field(description="whose bodies these are")
    calibrated: float = Field(description="of the calibrated robot: three standard deviations [m]")
    described: float = Field(description="of the robot as it is stored [m]")


class CalibrateAnswer(InFrame):
    """Corrections with their errors, and the margins that follow."""

    corrections: list[CorrectionAnswer] = Field(description="six of each frame")
    identifiable: int = Field(description="combinations that such measurements determine")
    noise: Accuracy = Field(description="of measurements, as given or found")
    error_before: float = Field(description="root mean square of a coordinate's error before [m]")
    error_after: float = Field(description="the same after [m]")
    margins: list[LinkMargin] = Field(
        description="by joint; the largest serves as `margin` of requests for motions"
    )
    calibration: RobotCalibration = Field(description="as PATCH /v1/robots/{name} takes it")
    tip: PoseAnswer = Field(description="what is measured, in the frame of the link")
    measurement_frame: PoseAnswer = Field(description="the root frame in that of measurement")
