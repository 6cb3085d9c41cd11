"""Measurements of an arm's tip on the wire, and the corrections that follow."""

from typing import Annotated, ClassVar, Literal

from pydantic import ConfigDict, Field

from armwright_wire.base import (
    Answer,
    Beside,
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

    point: Point
    """on the plane, in the frame of measurement [m]"""
    normal: Vector3
    """of any length but 0"""


class Accuracy(Body):
    """Standard deviations of positions and of rotations."""

    position: Length = Field(examples=[5e-5])
    """[m]"""
    rotation: Positive = Field(examples=[1e-4])
    """[rad]"""


class CalibrateRequest(WithTool, BodyWithRules):
    """Configurations of an arm and what was measured of a link there."""

    one_of: ClassVar[tuple[str, ...]] = ("poses", "positions", "distances", "plane")
    needs: ClassVar[Beside] = {"distances": ("anchor",), "anchor": ("distances",)}
    model_config = ConfigDict(json_schema_extra={"examples": examples("CalibrateRequest")})

    joints: Annotated[list[JointVector], _Measured]
    """configurations, in the order of `joint_names` [rad or m]"""
    poses: Annotated[list[Pose], _Measured] | None = None
    """of the link, one for each configuration"""
    positions: Annotated[list[Point], _Measured] | None = None
    """of the link's origin, likewise [m]"""
    distances: Annotated[list[NonNegative], _Measured] | None = None
    """of the link's origin from `anchor`, likewise [m]"""
    anchor: Point | None = None
    """of distances, in the frame of measurement [m]"""
    plane: Plane | None = None
    """that the link's origin touches everywhere"""
    link: Label | None = None
    """that is measured; the tip if left out"""
    unknown: list[Literal["frame", "tip"]] = Field([], max_length=2)
    """frame: how the root frame stands in that of measurement; tip: how what is measured is fixed
    to the link
    """
    noise: Accuracy | None = None
    """of measurements; found if left out"""
    tolerance: Accuracy | None = None
    """of the arm's making, of each joint's frame; 1 mm, 1 mrad if left out"""
    timeout: Timeout | None = None


class CorrectionAnswer(Answer):
    """A number of a correction."""

    joint: str
    """whose frame is corrected; tip or frame for those"""
    parameter: Literal["x", "y", "z", "rx", "ry", "rz"]
    """a coordinate [m], or of the rotation vector [rad], in that frame"""
    value: float
    """found [m or rad]"""
    standard_error: float
    """standard deviation [m or rad]"""
    determined: bool
    """measurements halve its tolerance at least"""


class LinkMargin(Answer):
    """Distance to keep for what is not known of where a joint's bodies are."""

    joint: str
    """whose bodies these are"""
    calibrated: float
    """of the calibrated robot: three standard deviations [m]"""
    described: float
    """of the robot as it is stored [m]"""


class CalibrateAnswer(InFrame):
    """Corrections with their errors, and the margins that follow."""

    corrections: list[CorrectionAnswer]
    """six of each frame"""
    identifiable: int
    """combinations that such measurements determine"""
    noise: Accuracy
    """of measurements, as given or found"""
    error_before: float
    """root mean square of a coordinate's error before [m]"""
    error_after: float
    """the same after [m]"""
    margins: list[LinkMargin]
    """by joint; the largest serves as `margin` of requests for motions"""
    calibration: RobotCalibration
    """as PATCH /v1/robots/{name} takes it"""
    tip: PoseAnswer
    """what is measured, in the frame of the link"""
    measurement_frame: PoseAnswer
    """the root frame in that of measurement"""
