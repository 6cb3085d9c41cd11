"""Constraints of configurations and motions on the wire."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

from pydantic import ConfigDict, Field, model_validator

from armwright_wire.base import (
    MAX_JOINTS,
    Answer,
    Body,
    Frame,
    Label,
    Length,
    NonNegative,
    Number,
    Point,
    Positive,
    Vector3,
    any_given,
)
from armwright_wire.pose import Pose, Quaternion

MAX_CONSTRAINTS = 32
Angle = Annotated[float, Field(ge=0.0, le=3.141592653589793)]
#: One for all axes, or one for each.
Tolerances = NonNegative | Annotated[list[NonNegative], Field(min_length=3, max_length=3)]
Weight = Annotated[Positive, Field(description="makes it soft: what a squared unit of it costs")]


class _Weighed(Body):
    weight: Weight | None = None


class OfLink(_Weighed):
    """A constraint of a link, in a frame that stands still or seen from another link."""

    link: Label | None = Field(None, description="the tip if left out")
    reference_link: Label | None = Field(
        None, description="moving link whose frame it is seen from"
    )
    frame: Frame | None = None


class JointConstraint(_Weighed):
    """position − tolerance_below ≤ q ≤ position + tolerance_above [rad or m]."""

    type: Literal["joint"] = "joint"
    joint: Label = Field(examples=["panda_joint1"], description="name of the joint")
    position: Number = Field(examples=[0.0], description="value to stay near [rad or m]")
    tolerance_above: NonNegative = Field(
        0.0, examples=[0.3], description="how far above it may go [rad or m]"
    )
    tolerance_below: NonNegative = Field(
        0.0, examples=[0.3], description="how far below it may go [rad or m]"
    )


class BoxRegion(Body):
    """A box by the pose of its centre and its edge lengths [m]."""

    type: Literal["box"] = "box"
    pose: Pose
    size: Annotated[list[NonNegative], Field(min_length=3, max_length=3)] = Field(
        examples=[[0.1, 0.4, 0.2]], description="edge lengths along x, y, z [m]"
    )


class SphereRegion(Body):
    """All points within a radius of a centre [m]."""

    type: Literal["sphere"] = "sphere"
    center: Point = Field(examples=[[0.4, 0.0, 0.4]], description="of the sphere [m]")
    radius: NonNegative = Field(examples=[0.05], description="of the sphere [m]")


class PlaneRegion(Body):
    """All points within a tolerance of a plane [m]."""

    type: Literal["plane"] = "plane"
    point: Point = Field(examples=[[0.4, 0.0, 0.4]], description="on the plane [m]")
    normal: Vector3 = Field(
        examples=[[0.0, 0.0, 1.0]], description="of the plane, of any length but 0"
    )
    tolerance: NonNegative = Field(
        examples=[0.002], description="largest distance from the plane [m]"
    )


class LineRegion(Body):
    """All points within a tolerance of a line [m]."""

    type: Literal["line"] = "line"
    point: Point = Field(examples=[[0.4, 0.0, 0.4]], description="on the line [m]")
    direction: Vector3 = Field(
        examples=[[0.0, 1.0, 0.0]], description="of the line, of any length but 0"
    )
    tolerance: NonNegative = Field(
        examples=[0.002], description="largest distance from the line [m]"
    )
    length: Length | None = Field(None, description="within half of it of the point, along it")


Region = Annotated[BoxRegion | SphereRegion | PlaneRegion | LineRegion, Field(discriminator="type")]


class PositionConstraint(OfLink):
    """A point of a link stays in a region."""

    type: Literal["position"] = "position"
    point: Point = Field(default_factory=lambda: [0.0, 0.0, 0.0], description="in its frame [m]")
    region: Region = Field(description="where the point stays")


class OrientationConstraint(OfLink):
    """An axis of a link within a cone about a direction, or an orientation within tolerances."""

    model_config = ConfigDict(
        json_schema_extra=any_given(
            ("axis", "direction", "cone_angle"), ("quaternion_xyzw", "axis_tolerances")
        )
    )

    type: Literal["orientation"] = "orientation"
    axis: Vector3 | None = Field(None, examples=[[0.0, 0.0, 1.0]], description="of the link")
    direction: Vector3 | None = Field(
        None, examples=[[0.0, 0.0, -1.0]], description="of the cone's axis"
    )
    cone_angle: Angle | None = Field(
        None, examples=[0.1745], description="from the cone's axis to its side [rad]"
    )
    quaternion_xyzw: Quaternion | None = Field(None, description="orientation to stay near")
    axis_tolerances: Tolerances | None = Field(
        None, description="about its x, y, z [rad]; π or more leaves an axis free"
    )

    @model_validator(mode="after")
    def _check_form(self) -> "OrientationConstraint":
        cone = [self.axis, self.direction, self.cone_angle]
        near = [self.quaternion_xyzw, self.axis_tolerances]
        whole = all(x is not None for x in cone) and all(x is None for x in near)
        if not whole and not (all(x is not None for x in near) and all(x is None for x in cone)):
            raise ValueError(
                "give axis, direction and cone_angle, or quaternion_xyzw and axis_tolerances"
            )
        return self


class LookAtConstraint(OfLink):
    """An axis of a link, from a point on it, points at a target within an angle."""

    type: Literal["look_at"] = "look_at"
    axis: Vector3 = Field(examples=[[0.0, 0.0, 1.0]], description="of the link")
    target: Point = Field(examples=[[0.6, 0.0, 0.1]], description="to look at [m]")
    angle: Angle = Field(examples=[0.05], description="[rad]")
    point: Point = Field(default_factory=lambda: [0.0, 0.0, 0.0], description="in its frame [m]")


class ClearanceConstraint(Body):
    """Every obstacle stays at least so far away, beyond its own margin [m]."""

    type: Literal["clearance"] = "clearance"
    margin: NonNegative = Field(
        examples=[0.02], description="least distance from every obstacle [m]"
    )


class RelativePoseConstraint(OfLink):
    """A link stays near a pose, in a frame that stands still or as another link sees it."""

    type: Literal["relative_pose"] = "relative_pose"
    pose: Pose
    position_tolerance: Tolerances = Field(0.0, description="along the pose's x, y, z [m]")
    orientation_tolerance: Tolerances = Field(0.0, description="about the pose's x, y, z [rad]")


class ToolSpeedConstraint(Body):
    """The tip moves at most so fast [m/s]; of motions only."""

    type: Literal["tool_speed"] = "tool_speed"
    limit: Positive = Field(examples=[0.25], description="largest speed [m/s]")


class TorqueConstraint(Body):
    """Joint torques stay within limits [N m or N], the robot's if left out; of motions only."""

    type: Literal["torque"] = "torque"
    limits: Annotated[list[Positive], Field(min_length=1, max_length=MAX_JOINTS)] | None = Field(
        None, description="largest torque of each joint [N m or N]; the robot's if left out"
    )


Constraint = Annotated[
    JointConstraint
    | PositionConstraint
    | OrientationConstraint
    | LookAtConstraint
    | ClearanceConstraint
    | RelativePoseConstraint
    | ToolSpeedConstraint
    | TorqueConstraint,
    Field(discriminator="type"),
]
if TYPE_CHECKING:
    # Constraints, or what JSON has of them.
    Constraints: TypeAlias = Sequence[Any]
else:
    Constraints = Annotated[
        list[Constraint],
        Field(
            max_length=MAX_CONSTRAINTS,
            description="what holds during the whole motion, or of a configuration",
            examples=[
                [
                    {
                        "type": "orientation",
                        "axis": [0, 0, 1],
                        "direction": [0, 0, -1],
                        "cone_angle": 0.1745,
                    },
                    {"type": "clearance", "margin": 0.02},
                ]
            ],
        ),
    ]


class ConstraintUse(Answer):
    """Residual of a constraint, positive where it is violated."""

    constraint: int = Field(description="its number in the request")
    name: str = Field(description="kind of constraint")
    residual: float = Field(description="[unit]; negative by what is to spare")
    unit: str = Field(examples=["rad"], description="of the residual")
    hard: bool = Field(description="false for one with a weight")
    time: float | None = Field(None, description="about when it is worst [s], of a motion")
