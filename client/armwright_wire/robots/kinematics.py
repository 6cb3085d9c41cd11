"""Forward and inverse kinematics and Jacobians on the wire."""

from collections.abc import Sequence
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import ConfigDict, Field, model_validator
from pydantic.config import JsonDict

from armwright_wire.base import (
    JOINTS_EXAMPLE,
    MAX_BATCH,
    Answer,
    Beside,
    Body,
    BodyWithRules,
    Frame,
    InFrame,
    Joints,
    JointVector,
    Keepable,
    Label,
    Matrix,
    NonNegative,
    Number,
    PlanId,
    Point,
    Positive,
    Seed,
    Timeout,
    distinct,
    exactly_one,
    is_given,
)
from armwright_wire.goals.goal import Constraints, ConstraintUse
from armwright_wire.pose import Orientation, OrientedPoseAnswer, PoseInFrame
from armwright_wire.scenes.check import MAX_FINGERS, AllowedAnswers, AttachedObjects, WithScene
from armwright_wire.scenes.tool import WithTool

MAX_SOLUTIONS = 1_000
MAX_POSES = 1_000
MAX_PARAMETERS = 1_000
MAX_TWISTS = 10_000


#: Positions of one joint of a gripper, one for each configuration.
FingerTrack = Annotated[list[Number], Field(min_length=1, max_length=MAX_BATCH)]


class WithHeldFrames(WithTool):
    """A request of kinematics at configurations, which may name the frames of what is held."""

    joints: Joints = Field(examples=[JOINTS_EXAMPLE])
    link: Label | None = None
    """the tip if left out"""
    frame: Frame | None = None
    attached: AttachedObjects | None = None
    """whose ids are links, each with its frame at its `pose`; no shape is needed"""


class FkRequest(WithHeldFrames):
    """Configurations whose link poses are asked for."""

    orientation: Orientation = "quaternion_xyzw"
    """the form that orientations are answered in"""
    fingers: Annotated[dict[Label, Number | FingerTrack], Field(max_length=MAX_FINGERS)] | None = (
        None
    )
    """where joints of the gripper stand [rad or m], a list for one position with each
    configuration; the others where the robot holds them
    """


class FkAnswer(InFrame):
    """Poses in the frame that is told; with many configurations each pose is a list."""

    pose: OrientedPoseAnswer | list[OrientedPoseAnswer]
    links: dict[str, OrientedPoseAnswer | list[OrientedPoseAnswer]]
    """pose of each link by name"""


Axis = Literal["x", "y", "z", "rx", "ry", "rz"]
#: Rows of a Jacobian, each named once.
TaskAxes = Annotated[list[Axis], Field(min_length=1, max_length=6)]
TaskVector = Annotated[list[Number], Field(min_length=1, max_length=6)]


def check_task_vectors(vectors: Any, axes: Sequence[str] | None, name: str) -> None:
    """Check that vectors have a number for each axis that counts, or six, and names no twins.

    Raises:
        ValueError: They do not.
    """
    if axes is not None:
        distinct(axes, "axis")
    count = 6 if axes is None else len(axes)
    if vectors is not None:
        rows = vectors if isinstance(vectors[0], list) else [vectors]
        if any(len(row) not in (count, 6) for row in rows):
            raise ValueError(f"{name} needs {count} numbers, one for each axis that counts, or six")


class JacobianRequest(WithHeldFrames):
    """Configurations whose Jacobians are asked for."""

    point: Point | None = None
    """a point fixed to the link, in its frame [m]"""
    kind: Literal["geometric", "analytic_zyz"] = "geometric"
    """rows of the angular velocity, or of the rates of the ZYZ Euler angles"""
    axes: TaskAxes | None = Field(None, examples=[["x", "y", "z"]])
    """rows that count, of velocities along x, y, z and about rx, ry, rz of the frame; all six if
    left out. rank, singular values and manipulability are of these
    """

    @model_validator(mode="after")
    def _named_once(self) -> Self:
        check_task_vectors(None, self.axes, "axes")
        return self


class JacobianAnswer(InFrame):
    """6 x n, linear rows first; with many configurations each field is a list."""

    jacobian: Matrix | list[Matrix]
    """J, a row for each axis that counts, 6 x n for all: J q̇ = [v; ω]"""
    rank: int | list[int]
    """of J"""
    singular_values: list[float] | list[list[float]]
    """of J, largest first"""
    manipulability: float | list[float]
    """product of the singular values"""


#: A gain by rows, for as many axes as a pose has.
GainMatrix = Annotated[
    list[Annotated[list[Number], Field(min_length=1, max_length=6)]],
    Field(min_length=1, max_length=6),
]


class GradientOptions(Body):
    """Options of the method "gradient"."""

    rule: Literal["pseudo_inverse", "transpose"] = "pseudo_inverse"
    """J⁺ K e, or Jᵀ K e, the gradient of eᵀ K e / 2"""
    form: Literal["flow", "step"] | None = Field(None, examples=["flow"])
    """the flow q̇ by Runge-Kutta, or q ← q + …; flow of the pseudo-inverse and step of the
    transpose if left out
    """
    coordinates: Literal["rotation_vector", "zyz"] = "rotation_vector"
    """what orientation errors are counted in"""
    gain: Positive | GainMatrix | None = Field(
        None, examples=[[[2.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 0.5]]]
    )
    """K [1/s], of the transpose γ: a number, or a matrix with a row for each of the axes that
    count; 1 if left out, and for steps of the transpose the best of each
    """
    steps: Annotated[int, Field(ge=1, le=100_000)] | None = None
    """400 or 20,000 if left out"""
    duration: Annotated[Positive, Field(le=1e6)] | None = None
    """of a flow: answer where it is then, at the pose or not [s]; left out, it goes on to the pose
    """
    trace: bool = False
    """also answer where it went"""
    trace_points: Annotated[int, Field(ge=2, le=100_000)] | None = None
    """points of the trace at most; all of them if left out"""


#: The rule of a request for configurations: a pose, many poses, or constraints alone.
_POSES: JsonDict = {
    "oneOf": [
        is_given("pose"),
        is_given("poses"),
        {
            "required": ["constraints"],
            "properties": {
                "pose": {"type": "null"},
                "poses": {"type": "null"},
                "constraints": {"type": "array", "minItems": 1},
            },
        },
    ]
}


class IkRequest(WithScene, Keepable):
    """A pose to be reached, or many of them, each for itself."""

    model_config = ConfigDict(json_schema_extra={"allOf": [_POSES]})

    pose: PoseInFrame | None = None
    poses: Annotated[list[PoseInFrame], Field(min_length=1, max_length=MAX_POSES)] | None = None
    """many poses instead of one: solutions then holds a list for each"""
    link: Label | None = None
    """the tip if left out"""
    seed_joints: JointVector | None = Field(None, examples=[JOINTS_EXAMPLE])
    """where to search from; the middle of the ranges if left out"""
    method: Literal["auto", "analytic", "numeric", "gradient", "constrained"] = "auto"
    """auto: the closed form where the arm has one, else numeric"""
    all_solutions: bool = False
    """also those outside the limits or in collision, with the reason"""
    all_turns: bool = False
    """also copies by whole turns of joints inside the limits"""
    max_solutions: Annotated[int, Field(ge=1, le=MAX_SOLUTIONS)] | None = None
    """largest number of solutions to answer; if left out one, or all with all_solutions or
    all_turns
    """
    choice: Literal["nearest", "limits", "manipulability"] = "nearest"
    """what is best: nearest to the seed, farthest from limits, most manipulable"""
    parameters: Annotated[list[Number], Field(min_length=1, max_length=MAX_PARAMETERS)] | None = (
        None
    )
    """of a seven-joint arm's closed form: arm angles or locked joint's values"""
    axes: Annotated[list[Axis], Field(min_length=1, max_length=6)] | None = None
    """axes of the pose's own frame that count, all if left out: positions along x, y, z, turns
    about them rx, ry, rz
    """
    gradient: GradientOptions | None = None
    """of the method "gradient"
    """
    attached: AttachedObjects | None = None
    """what is held; solutions are then checked, with no scene too"""
    constraints: Constraints | None = None
    """with the methods constrained and auto; with them no pose is needed"""
    posture: JointVector | None = None
    """of the method constrained: what is nearest; the seed if left out"""
    timeout: Timeout | None = None
    seed: Seed = 0

    @model_validator(mode="after")
    def _pose_or_poses(self) -> Self:
        if not self.constraints or self.pose is not None or self.poses is not None:
            exactly_one(self, ("pose", "poses"))
        return self


class ArmSides(Answer):
    """Sides of an arm, told by its geometry; null where that part is singular or there is none."""

    shoulder: Literal["right", "left", "no flip", "flip"] | None
    """right where joint 2 raises the wrist centre along axis 1; of seven joints no flip where the
    sine of joint 2 is positive
    """
    elbow: Literal["up", "down", "left", "right", "no flip", "flip"] | None
    """up where the elbow is above the line from shoulder to wrist, along axis 1; of a planar arm
    left of it, seen against axis 1; of seven joints no flip where the sine of the bend about axis 4
    is positive
    """
    wrist: Literal["no flip", "flip"] | None
    """no flip where the sine of joint 5, from axis 4 to axis 6, is positive; of seven joints
    likewise of joint 6
    """


class IkSolution(Answer):
    """A configuration that reaches the pose, and how well."""

    joints: list[float] = Field(examples=[JOINTS_EXAMPLE])
    """the configuration, in the order of `joint_names` [rad or m]"""
    branch: str | None = None
    """name of the closed form's branch"""
    sides: ArmSides | None = None
    """of arms whose axes make a shoulder, an elbow or a wrist"""
    singular: list[Literal["shoulder", "elbow", "wrist"]] = Field(default_factory=list)
    """parts of these arms that are singular there"""
    position_error: float | None
    """[m]; null where no pose was asked for"""
    orientation_error: float | None
    """[rad]"""
    within_limits: bool
    """no joint is outside its limits"""
    collision_free: bool | None = None
    """nothing touches; where no scene was given own links alone, and only with constraints; null
    where nothing was looked at
    """
    rejected_because: str | None = None
    """why it is no solution; null where it is one"""
    clearance: float | None = None
    """with constraints: from the closest pair, margins taken off [m]"""
    constraints: list[ConstraintUse] = Field(default_factory=list)
    """how well each is held, the pose as the last one"""


class GradientTrace(Answer):
    """Course of a gradient method from the start."""

    time: list[float]
    """of the flow [s]; of steps their number"""
    joints: Matrix
    """configuration at each time"""
    axes: list[Axis]
    """those that count, columns of error"""
    error: Matrix
    """e(t) of these axes [m, rad]; where all three of position or rotation count in the root frame,
    else in the pose's own
    """
    position_error: list[float]
    """norm of its positions [m]"""
    orientation_error: list[float]
    """norm of its rotation [rad]"""


class Unsolved(Answer):
    """One of many poses that has no solution, and the problem it would be alone."""

    index: int
    """of the pose in the request, from 0"""
    code: str
    """of the problem"""
    detail: str
    """what is wrong, and where"""
    hint: str | None
    """what to do about it"""


class IkAnswer(InFrame):
    """Solutions, best first; with many poses a list for each, empty where there is none."""

    solutions: list[IkSolution] | list[list[IkSolution]]
    """configurations that reach the pose, best first"""
    complete: bool | None = None
    """where several are asked for: whether these are all inside the limits; false after a search,
    where a joint is free within the pose, or where max_solutions left some out; null where one is
    asked for
    """
    unsolved: list[Unsolved] = Field(default_factory=list)
    """with many poses: those without a solution, and why"""
    deterministic: bool = True
    """whether the same request gives the same answer; false where time ended a search under
    constraints
    """
    trace: GradientTrace | None = None
    allowed_collisions: AllowedAnswers = Field(default_factory=list)
    plan_id: PlanId = None


class VelocityRequest(WithHeldFrames, BodyWithRules):
    """Joint velocities, or the twist (linear, angular) that they are to cause."""

    one_of: ClassVar[tuple[str, ...]] = ("joint_velocities", "twist")
    only_beside: ClassVar[Beside] = {"nullspace": ("twist",), "damped_below": ("twist",)}

    joint_velocities: Joints | None = Field(None, examples=[[0.1] * 7])
    twist: (
        TaskVector | Annotated[list[TaskVector], Field(min_length=1, max_length=MAX_TWISTS)] | None
    ) = None
    """[v; w] in the frame, a number for each axis [m/s, rad/s]"""
    axes: TaskAxes | None = Field(None, examples=[["x", "y"]])
    """rows that count, of velocities along x, y, z and about rx, ry, rz of the frame, in the order
    of the twist's numbers; all six if left out
    """
    nullspace: Joints | None = None
    """b: (I − J⁺J) b is added, which leaves the axes that count at rest"""
    point: Point | None = None
    """a point fixed to the link, in its frame [m]"""
    damped_below: NonNegative | None = None
    """singular values below it are damped; 0 for the plain pseudo-inverse"""

    @model_validator(mode="after")
    def _one_of_two(self) -> Self:
        check_task_vectors(self.twist, self.axes, "twist")
        return self


class DampedDirection(Answer):
    """A direction in which the joints were kept from racing."""

    singular_value: float
    """of the Jacobian in this direction"""
    gain: float
    """what of the twist along it is still followed, 0 … 1"""
    twist: list[float]
    """the direction, of length 1"""
    joint_velocities: list[float]
    """the joints' part in it, of length 1"""


class VelocityAnswer(InFrame):
    """Twist and joint velocities; with many configurations each field is a list."""

    twist: list[float] | Matrix
    """[v; ω] of the link [m/s, rad/s]"""
    joint_velocities: list[float] | Matrix
    """of the joints [rad/s or m/s]"""
    residual: list[float] | Matrix
    """what of the twist is not followed"""
    rank: int | list[int]
    """of the Jacobian"""
    singular_values: list[float] | Matrix
    """of the Jacobian, largest first"""
    damped: list[DampedDirection] | list[list[DampedDirection]]
    """directions in which the joints were slowed down"""
