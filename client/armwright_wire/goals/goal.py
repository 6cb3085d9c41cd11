"""Starts and goals of motions, costs of goals and preferred clearance, on the wire.

Constraints of configurations and motions on the wire.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self, TypeAlias

from pydantic import Field, model_validator
from pydantic.config import JsonDict

from armwright_wire.base import (
    JOINTS_EXAMPLE,
    MAX_JOINTS,
    Answer,
    Beside,
    Body,
    BodyWithRules,
    Frame,
    JointVector,
    Label,
    Length,
    NonNegative,
    Number,
    Point,
    Positive,
    Vector3,
    VectorLike,
    any_given,
    not_both,
)
from armwright_wire.pose import AnyPose, Pose, PoseInFrame, Quaternion
from armwright_wire.scenes.check import Margin

MAX_CONSTRAINTS = 32
Angle = Annotated[float, Field(ge=0.0, le=3.141592653589793)]
#: One for all axes, or one for each.
Tolerances = NonNegative | Annotated[list[NonNegative], Field(min_length=3, max_length=3)]
Weight = Annotated[Positive, Field(description="makes it soft: what a squared unit of it costs")]


class _Weighed(Body):
    weight: Weight | None = None


class OfLink(_Weighed):
    """A constraint of a link, in a frame that stands still or seen from another link."""

    link: Label | None = None
    """the tip if left out"""
    reference_link: Label | None = None
    """moving link whose frame it is seen from"""
    frame: Frame | None = None


class JointConstraint(_Weighed):
    """position − tolerance_below ≤ q ≤ position + tolerance_above [rad or m]."""

    type: Literal["joint"] = "joint"
    joint: Label = Field(examples=["panda_joint1"])
    """name of the joint"""
    position: Number = Field(examples=[0.0])
    """value to stay near [rad or m]"""
    tolerance_above: NonNegative = Field(0.0, examples=[0.3])
    """how far above it may go [rad or m]"""
    tolerance_below: NonNegative = Field(0.0, examples=[0.3])
    """how far below it may go [rad or m]"""


class BoxRegion(Body):
    """A box by the pose of its centre and its edge lengths [m]."""

    type: Literal["box"] = "box"
    pose: Pose
    size: Annotated[list[NonNegative], Field(min_length=3, max_length=3)] = Field(
        examples=[[0.1, 0.4, 0.2]]
    )
    """edge lengths along x, y, z [m]"""


class SphereRegion(Body):
    """All points within a radius of a centre [m]."""

    type: Literal["sphere"] = "sphere"
    center: Point = Field(examples=[[0.4, 0.0, 0.4]])
    """of the sphere [m]"""
    radius: NonNegative = Field(examples=[0.05])
    """of the sphere [m]"""


class PlaneRegion(Body):
    """All points within a tolerance of a plane [m]."""

    type: Literal["plane"] = "plane"
    point: Point = Field(examples=[[0.4, 0.0, 0.4]])
    """on the plane [m]"""
    normal: Vector3 = Field(examples=[[0.0, 0.0, 1.0]])
    """of the plane, of any length but 0"""
    tolerance: NonNegative = Field(examples=[0.002])
    """largest distance from the plane [m]"""


class LineRegion(Body):
    """All points within a tolerance of a line [m]."""

    type: Literal["line"] = "line"
    point: Point = Field(examples=[[0.4, 0.0, 0.4]])
    """on the line [m]"""
    direction: Vector3 = Field(examples=[[0.0, 1.0, 0.0]])
    """of the line, of any length but 0"""
    tolerance: NonNegative = Field(examples=[0.002])
    """largest distance from the line [m]"""
    length: Length | None = None
    """within half of it of the point, along it"""


Region = Annotated[BoxRegion | SphereRegion | PlaneRegion | LineRegion, Field(discriminator="type")]


class PositionConstraint(OfLink):
    """A point of a link stays in a region."""

    type: Literal["position"] = "position"
    point: Point = Field(default_factory=lambda: [0.0, 0.0, 0.0])
    """in its frame [m]"""
    region: Region
    """where the point stays"""


_CONE = ("axis", "direction", "cone_angle")
_NEAR = ("quaternion_xyzw", "axis_tolerances")


class OrientationConstraint(OfLink):
    """An axis of a link within a cone about a direction, or an orientation within tolerances."""

    published_rules: ClassVar[tuple[JsonDict, ...]] = (
        any_given(_CONE, _NEAR),
        *(rule for name in _CONE for rule in not_both(name, *_NEAR)),
    )

    type: Literal["orientation"] = "orientation"
    axis: Vector3 | None = Field(None, examples=[[0.0, 0.0, 1.0]])
    """of the link"""
    direction: Vector3 | None = Field(None, examples=[[0.0, 0.0, -1.0]])
    """of the cone's axis"""
    cone_angle: Angle | None = Field(None, examples=[0.1745])
    """from the cone's axis to its side [rad]"""
    quaternion_xyzw: Quaternion | None = None
    """orientation to stay near"""
    axis_tolerances: Tolerances | None = None
    """about its x, y, z [rad]; π or more leaves an axis free"""

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
    axis: Vector3 = Field(examples=[[0.0, 0.0, 1.0]])
    """of the link"""
    target: Point = Field(examples=[[0.6, 0.0, 0.1]])
    """to look at [m]"""
    angle: Angle = Field(examples=[0.05])
    """[rad]"""
    point: Point = Field(default_factory=lambda: [0.0, 0.0, 0.0])
    """in its frame [m]"""


class ClearanceConstraint(Body):
    """Every obstacle stays at least so far away, beyond its own margin [m]."""

    type: Literal["clearance"] = "clearance"
    margin: NonNegative = Field(examples=[0.02])
    """least distance from every obstacle [m]"""


class RelativePoseConstraint(OfLink):
    """A link stays near a pose, in a frame that stands still or as another link sees it."""

    type: Literal["relative_pose"] = "relative_pose"
    pose: Pose
    position_tolerance: Tolerances = 0.0
    """along the pose's x, y, z [m]"""
    orientation_tolerance: Tolerances = 0.0
    """about the pose's x, y, z [rad]"""


class ToolSpeedConstraint(Body):
    """The tip moves at most so fast [m/s]; of motions only."""

    type: Literal["tool_speed"] = "tool_speed"
    limit: Positive = Field(examples=[0.25])
    """largest speed [m/s]"""


class TorqueConstraint(Body):
    """Joint torques stay within limits [N m or N], the robot's if left out; of motions only."""

    type: Literal["torque"] = "torque"
    limits: Annotated[list[Positive], Field(min_length=1, max_length=MAX_JOINTS)] | None = None
    """largest torque of each joint [N m or N]; the robot's if left out"""


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

    constraint: int
    """its number in the request"""
    name: str
    """kind of constraint"""
    residual: float
    """[unit]; negative by what is to spare"""
    unit: str = Field(examples=["rad"])
    """of the residual"""
    hard: bool
    """false for one with a weight"""
    time: float | None = None
    """about when it is worst [s], of a motion"""


MAX_GOALS = 1_000

Tolerance = Annotated[Positive, Field(le=10.0)]


class Start(BodyWithRules):
    """Start of the motion."""

    one_of: ClassVar[tuple[str, ...]] = ("joints", "state", "plan")
    needs: ClassVar[Beside] = {"plan": ("at",)}
    only_beside: ClassVar[Beside] = {
        "at": ("plan",),
        "velocities": ("joints", "state"),
        "accelerations": ("joints", "state"),
    }

    joints: JointVector | None = Field(None, examples=[JOINTS_EXAMPLE])
    state: Label | None = Field(None, examples=["home"])
    """a named state of the robot"""
    velocities: JointVector | None = None
    """there; at rest if left out. Planners that optimise nothing brake to rest first"""
    accelerations: JointVector | None = None
    """there, likewise; any that keep the limits if left out"""

    plan: Label | None = None
    """of a plan: a kept one, whose motion is left at `at` in the same state; where no motion from
    there is proved, its stop is answered
    """
    at: NonNegative | None = None
    """instant of its trajectory [s]"""


class SingleGoal(BodyWithRules):
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
    state: Label | None = Field(None, examples=["home"])
    """a named state of the robot"""
    pose: PoseInFrame | None = None
    frame: Frame | None = None
    velocities: JointVector | None = None
    """at the joints, for a motion that is optimised; at rest if left out"""
    accelerations: JointVector | None = None
    """there, likewise; any that keep the limits if left out"""
    position_tolerance: Tolerance | None = None
    """how far off the tip may end if nothing is right there, 1e-4 if left out [m]"""
    orientation_tolerance: Tolerance | None = None
    """how far turned it may end if nothing is right there, 1e-3 if left out [rad]"""


class Goal(SingleGoal):
    """Goal of the motion: one, or any of several."""

    one_of: ClassVar[tuple[str, ...]] = ("joints", "state", "pose", "any_of")

    any_of: Annotated[list[SingleGoal], Field(min_length=1, max_length=MAX_GOALS)] | None = None
    """goals of which one is to be reached"""

    @classmethod
    def at_state(cls, state: str) -> Self:
        """A named state of the robot as the goal."""
        return cls(state=state)

    @classmethod
    def at_joints(
        cls,
        joints: VectorLike,
        *,
        velocities: VectorLike | None = None,
        accelerations: VectorLike | None = None,
    ) -> Self:
        """A configuration as the goal [rad or m], for an optimised motion passed at a velocity."""
        return cls.of(joints=joints, velocities=velocities, accelerations=accelerations)

    @classmethod
    def at_pose(
        cls,
        pose: AnyPose,
        *,
        position_tolerance: float | None = None,
        orientation_tolerance: float | None = None,
    ) -> Self:
        """A pose of the tip as the goal, within tolerances [m, rad]."""
        return cls.of(
            pose=pose,
            position_tolerance=position_tolerance,
            orientation_tolerance=orientation_tolerance,
        )

    @classmethod
    def among(cls, goals: Sequence["GoalLike"]) -> Self:
        """Goal that is any of several."""
        return cls(any_of=[SingleGoal(**given_fields(as_goal(goal))) for goal in goals])


#: A goal, or a pose or configuration that is one.
GoalLike: TypeAlias = SingleGoal | AnyPose | VectorLike


def as_goal(goal: GoalLike) -> Goal:
    """The goal that is meant by a pose or a configuration."""
    if isinstance(goal, Goal):
        return goal
    if isinstance(goal, SingleGoal):
        return Goal(**given_fields(goal))
    if isinstance(goal, AnyPose):
        return Goal.at_pose(goal)
    return Goal.at_joints(goal)


def given_fields(part: Body) -> dict[str, Any]:
    """The fields of a part of a request that are not None."""
    return {name: value for name, value in part if value is not None}


#: As planning has it; tests compare the two [m].
DEFAULT_PREFERRED = 0.02
MAX_PREFERRED = 1.0


class Clearance(Body):
    """Distances from obstacles: one to keep wherever there is room, one to keep always."""

    preferred: Annotated[NonNegative, Field(le=MAX_PREFERRED)] = DEFAULT_PREFERRED
    """kept wherever there is room [m]; a quarter of it, 5 mm at most, between the robot's own
    links; 0 prefers no distance
    """
    least: Margin | None = None
    """another name of margin [m]"""

    def check_margin(self, margin: float) -> None:
        """Refuse a margin that is given beside another least clearance.

        Raises:
            ValueError: They differ.
        """
        if self.least is not None and margin not in {0.0, self.least}:
            raise ValueError("margin and clearance.least are one distance: give one of them")


class CloseSpanAnswer(Answer):
    """A span of the motion that is nearer to something than preferred."""

    begins: float
    """[s]"""
    ends: float
    """[s]"""
    distance: float
    """the least in it, margins of obstacles taken off [m]"""
    pair: tuple[str, str]
    """the two bodies that come so near"""


class ClearanceAnswer(Answer):
    """Preferred distances, and where the motion does not keep them."""

    preferred: float
    """from obstacles [m]"""
    own_links: float
    """between the robot's own links [m]"""
    least: float
    """the margin that the certificate proves [m]"""
    time_below: float
    """time in which the motion is nearer than preferred [s]"""
    period: float
    """between two instants that were looked at [s]"""
    spans: list[CloseSpanAnswer]
    """spans of time nearer than preferred, in their order"""


class GoalCosts(Body):
    """Weights of what a goal configuration costs; those left out keep their default."""

    # Defaults are those of planning; tests compare the two.

    motion_time: NonNegative = 1.0
    """of the time of the straight joint motion from the start [1/s]"""
    joint_limits: NonNegative = 0.5
    """of the nearness to a joint limit: 1 at a limit, 0 from 15 % of the range"""
    manipulability: NonNegative = 0.2
    """of its lack: 1 at a singularity, 0 at the best configuration"""
    clearance: NonNegative = 0.2
    """of the nearness of obstacles: 1 in contact, 0 from 5 cm"""
    turns: NonNegative = 0.2
    """of each joint that turns by more than half a turn"""


class ConfigurationAnswer(Answer):
    """The configuration that was chosen for a pose, what it costs, and why it is not another."""

    branch: str | None = None
    """name of its branch; null where the arm has no closed form"""
    limit_share: float
    """distance of the joint nearest to its limit, as a share of the joint's range"""
    costs: dict[str, float] = Field(
        examples=[{"motion_time": 0.61, "joint_limits": 0.0, "turns": 0.0}]
    )
    """what it costs, weighted, by the names of `goal_costs`; `motion_time` is that of the straight
    joint motion to it
    """
    found: int
    """free configurations that were found"""
    cheaper: int
    """those of them that cost less, clearance left out"""
    at_limit: int
    """those of them within 2 % of a joint limit"""
    reason: str = Field(examples=["It costs the least of 8 free configurations."])
    """why it was chosen"""
