"""Constraints on configurations and motions."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

from pydantic import Field, JsonValue

from armwright_client.base import PLAIN, Answer, NonNegative, Positive, Request, Vector3, Vector4
from armwright_client.base import Vector as _Vector
from armwright_client.pose import Pose

if TYPE_CHECKING:
    Tolerances: TypeAlias = float | Sequence[float]
else:
    Tolerances = Annotated[float | Vector3, PLAIN]


class _Weighed(Request):
    weight: Positive | None = None


class _OfLink(_Weighed):
    link: str | None = None
    reference_link: str | None = None
    frame: str | None = None


class JointConstraint(_Weighed):
    """position - tolerance_below <= q <= position + tolerance_above [rad or m]."""

    type: Literal["joint"] = "joint"
    joint: str
    position: float
    tolerance_above: NonNegative = 0.0
    tolerance_below: NonNegative = 0.0


class BoxRegion(Request):
    """A box by the pose of its centre and its edge lengths [m]."""

    type: Literal["box"] = "box"
    pose: Pose
    size: Vector3


class SphereRegion(Request):
    """All points within a radius of a centre [m]."""

    type: Literal["sphere"] = "sphere"
    center: Vector3
    radius: NonNegative


class PlaneRegion(Request):
    """All points within a tolerance of a plane [m]."""

    type: Literal["plane"] = "plane"
    point: Vector3
    normal: Vector3
    tolerance: NonNegative


class LineRegion(Request):
    """All points within a tolerance of a line, within half a length of its point [m]."""

    type: Literal["line"] = "line"
    point: Vector3
    direction: Vector3
    tolerance: NonNegative
    length: Positive | None = None


Region: TypeAlias = Annotated[
    BoxRegion | SphereRegion | PlaneRegion | LineRegion, Field(discriminator="type")
]


class PositionConstraint(_OfLink):
    """A point of a link stays in a region."""

    type: Literal["position"] = "position"
    point: Vector3 = (0.0, 0.0, 0.0)
    region: Region


class OrientationConstraint(_OfLink):
    """A link's axis within a cone about a direction, or an orientation within tolerances.

    Args:
        axis: Of the link.
        direction: What it stays near.
        cone_angle: From the cone's axis to its side [rad].
        quaternion_xyzw: An orientation, in place of the three.
        axis_tolerances: About its x, y, z, or one for all [rad]; pi or more leaves an axis free.
    """

    type: Literal["orientation"] = "orientation"
    axis: Vector3 | None = None
    direction: Vector3 | None = None
    cone_angle: NonNegative | None = None
    quaternion_xyzw: Vector4 | None = None
    axis_tolerances: Tolerances | None = None


class LookAtConstraint(_OfLink):
    """An axis of a link, from a point on it, points at a target within an angle [rad]."""

    type: Literal["look_at"] = "look_at"
    axis: Vector3
    target: Vector3
    angle: NonNegative
    point: Vector3 = (0.0, 0.0, 0.0)


class ClearanceConstraint(Request):
    """Every obstacle stays at least so far away, beyond its own margin [m]."""

    type: Literal["clearance"] = "clearance"
    margin: NonNegative


class RelativePoseConstraint(_OfLink):
    """A link stays near a pose in the frame of another link, or of the base."""

    type: Literal["relative_pose"] = "relative_pose"
    pose: Pose
    position_tolerance: Tolerances = 0.0
    orientation_tolerance: Tolerances = 0.0


class ToolSpeedConstraint(Request):
    """The tip moves at most so fast [m/s]; of motions only."""

    type: Literal["tool_speed"] = "tool_speed"
    limit: Positive


class TorqueConstraint(Request):
    """Joint torques stay within limits [N m or N], the robot's if left out; of motions only."""

    type: Literal["torque"] = "torque"
    limits: _Vector | None = None


Constraint: TypeAlias = (
    JointConstraint
    | PositionConstraint
    | OrientationConstraint
    | LookAtConstraint
    | ClearanceConstraint
    | RelativePoseConstraint
    | ToolSpeedConstraint
    | TorqueConstraint
)
if TYPE_CHECKING:
    # What is read is a list, but a tuple may be given, and objects as the service takes them.
    Constraints: TypeAlias = Sequence[Constraint | Mapping[str, Any]]
else:
    Constraints = Annotated[list[Constraint | dict[str, JsonValue]], Field(strict=False)]


class ConstraintUse(Answer):
    """Residual of a constraint.

    Args:
        constraint: Its number in the request.
        name: What it is.
        residual: Positive by how much it is violated, negative by what is to spare [unit].
        unit: "m" or "rad".
        hard: Whether it has to hold.
        time: About when it is worst [s], of a motion.
    """

    constraint: int
    name: str
    residual: float
    unit: str
    hard: bool
    time: float | None = None
