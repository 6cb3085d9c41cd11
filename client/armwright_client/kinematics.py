"""Forward and inverse kinematics and Jacobians."""

from collections.abc import Mapping, Sequence
from typing import Annotated, Literal, TypedDict

from pydantic import Field

from armwright_client.base import (
    Answer,
    InFrame,
    Matrix,
    Request,
    Rows,
    Vector,
    Vector3,
    VectorLike,
)
from armwright_client.check import AttachedObjects
from armwright_client.constraint import Constraints, ConstraintUse
from armwright_client.pose import AnyPose, Pose
from armwright_client.scene import AllowedPair, AllowedPairs, SceneReference

JacobianKind = Literal["geometric", "analytic_zyz"]
IkMethod = Literal["auto", "analytic", "numeric", "gradient", "constrained"]
IkChoice = Literal["nearest", "limits", "manipulability"]
Orientation = Literal["quaternion_xyzw", "rotation_matrix", "euler_zyz", "rpy", "axis_angle"]
Axis = Literal["x", "y", "z", "rx", "ry", "rz"]


class FkOptions(TypedDict, total=False):
    """Options of forward kinematics.

    Args:
        link: Link whose pose is answered first; the tip if left out.
        orientation: Form of the orientations; quaternions if left out.
        frame: A link that stands still, or "tool"; the root frame if left out.
        fingers: Where joints of the gripper stand [rad or m], a list for one position with each
            configuration; the others where the robot holds them.
    """

    link: str | None
    orientation: Orientation | None
    frame: str | None
    fingers: Mapping[str, float | Sequence[float]] | None


class FkRequest(Request):
    """Configurations whose link poses are asked for, and the form of their orientations."""

    joints: Vector | Rows
    link: str | None = None
    orientation: Orientation | None = None
    frame: str | None = None
    fingers: dict[str, float | Vector] | None = None


class FkAnswer(InFrame):
    """Poses in a frame, the root frame if no other was asked for.

    Args:
        pose: Of the link asked for, or of the tip.
        links: Of every link.
    """

    pose: Pose
    links: dict[str, Pose]


class FkBatch(InFrame):
    """Poses of many configurations, in their order; see `FkAnswer`."""

    pose: list[Pose]
    links: dict[str, list[Pose]]


class JacobianOptions(TypedDict, total=False):
    """Options of a Jacobian.

    Args:
        link: The tip if left out.
        point: A point fixed to the link, in its frame [m]; its origin if left out.
        kind: "geometric" if left out.
        frame: A link that stands still, or "tool"; the root frame if left out.
    """

    link: str
    point: VectorLike
    kind: JacobianKind
    frame: str


class JacobianRequest(Request):
    """Configurations whose Jacobians are asked for."""

    joints: Vector | Rows
    link: str | None = None
    point: Vector3 | None = None
    kind: JacobianKind = "geometric"
    frame: str | None = None


class JacobianAnswer(InFrame):
    """A Jacobian.

    Args:
        jacobian: 6 x n, linear rows first.
        rank: Of the matrix.
        singular_values: Largest first.
        manipulability: Their product.
    """

    jacobian: Matrix
    rank: int
    singular_values: list[float]
    manipulability: float


class JacobianBatch(InFrame):
    """Jacobians of many configurations, in their order; see `JacobianAnswer`."""

    jacobian: list[Matrix]
    rank: list[int]
    singular_values: list[list[float]]
    manipulability: list[float]


class Gradient(Request):
    """Options of the method "gradient".

    Args:
        rule: "pseudo_inverse": J⁺ K e; "transpose": Jᵀ K e, the gradient of eᵀ K e / 2.
        form: "flow": q̇ by Runge-Kutta; "step": q ← q + …; if left out the flow of the
            pseudo-inverse and the step of the transpose.
        coordinates: Coordinates that orientation errors are counted in.
        gain: K [1/s], of the transpose γ: a number, or a matrix with a row for each axis that
            counts; 1 if left out, and for steps of the transpose the best of each.
        steps: At most; 400 or 20,000 if left out.
        trace: Also answer where it went.
        trace_points: Points of the trace at most; all of them if left out.
    """

    rule: Literal["pseudo_inverse", "transpose"] = "pseudo_inverse"
    form: Literal["flow", "step"] | None = None
    coordinates: Literal["rotation_vector", "zyz"] = "rotation_vector"
    gain: float | Rows | None = None
    steps: int | None = None
    trace: bool = False
    trace_points: int | None = None


class IkOptions(TypedDict, total=False):
    """Options of inverse kinematics.

    Args:
        link: The tip if left out.
        seed_joints: Where to look first; solutions near it are better.
        method: "auto" if left out.
        all_solutions: Also those that are outside limits or in collision, with the reason.
        all_turns: Also copies by whole turns of joints inside the limits.
        max_solutions: At most so many.
        choice: What is best; "nearest" to the seed if left out.
        parameters: Arm angles or values of the locked joint of a seven-joint arm's closed form.
        axes: Axes of the pose's own frame that count; all if left out.
        gradient: Of the method "gradient".
        frame: Of what names none: a link that stands still, or "tool" at the seed.
        scene: To be free of collisions in.
        attached: What is held meanwhile.
        allowed_collisions: More pairs that may touch.
        constraints: Beyond the pose, or in its place.
        posture: With constraints: what is nearest; the seed if left out.
        timeout: [s].
        seed: Of the random generator.
        keep: Whether request and answer are kept as a plan, see `Client.plans`.
    """

    link: str
    seed_joints: VectorLike
    method: IkMethod
    all_solutions: bool
    all_turns: bool
    max_solutions: int
    choice: IkChoice
    parameters: VectorLike
    axes: Sequence[Axis]
    gradient: Gradient
    frame: str
    scene: SceneReference
    attached: AttachedObjects
    allowed_collisions: AllowedPairs
    constraints: Constraints
    posture: VectorLike
    timeout: float
    seed: int
    keep: bool


class IkRequest(Request):
    """A pose to be reached, or many of them; see `IkOptions`."""

    pose: AnyPose | None = None
    poses: Sequence[AnyPose] | None = None
    link: str | None = None
    seed_joints: Vector | None = None
    method: IkMethod = "auto"
    all_solutions: bool = False
    all_turns: bool = False
    max_solutions: int | None = None
    choice: IkChoice = "nearest"
    parameters: Vector | None = None
    axes: Annotated[tuple[Axis, ...], Field(strict=False)] | None = None
    gradient: Gradient | None = None
    frame: str | None = None
    scene: SceneReference | None = None
    attached: AttachedObjects | None = None
    allowed_collisions: AllowedPairs | None = None
    constraints: Constraints | None = None
    posture: Vector | None = None
    timeout: float | None = None
    seed: int = 0
    keep: bool | None = None


class ArmSides(Answer):
    """Sides of an arm, told by its geometry; None where that part is singular or there is none.

    Args:
        shoulder: "right" where joint 2 raises the wrist centre along axis 1; of seven joints "no
            flip" where the sine of joint 2 is positive.
        elbow: "up" where the elbow is above the line from shoulder to wrist; of a planar arm "left"
            of it; of seven joints "no flip" where the sine of the bend about axis 4 is positive.
        wrist: "no flip" where the sine of its middle joint is positive.
    """

    shoulder: Literal["right", "left", "no flip", "flip"] | None = None
    elbow: Literal["up", "down", "left", "right", "no flip", "flip"] | None = None
    wrist: Literal["no flip", "flip"] | None = None


class IkSolution(Answer):
    """A configuration that reaches the pose, and how well.

    Args:
        joints: [rad or m].
        branch: Name of the closed form's branch.
        sides: Of arms with six joints, axes 2 and 3 parallel and a closed form.
        singular: Parts of these arms that are singular there.
        position_error: [m]; None where no pose was asked for.
        orientation_error: [rad].
        within_limits: Whether every joint is.
        collision_free: Whether nothing touches; without a scene of own links, with constraints
            alone; None where nothing was looked at.
        rejected_because: Why it can't be used, if so.
        clearance: With constraints: from the closest pair, margins taken off [m].
        constraints: How well each is held, the pose as the last one.
    """

    joints: list[float]
    branch: str | None = None
    sides: ArmSides | None = None
    singular: list[Literal["shoulder", "elbow", "wrist"]] = Field(default_factory=list)
    position_error: float | None
    orientation_error: float | None
    within_limits: bool
    collision_free: bool | None = None
    rejected_because: str | None = None
    clearance: float | None = None
    constraints: list[ConstraintUse] = Field(default_factory=list)


class GradientTrace(Answer):
    """Course of a gradient method from the start.

    Args:
        time: Of the flow [s]; of steps their number.
        joints: [rad or m].
        axes: Those that count, columns of the error.
        error: e(t) of these axes [m, rad].
        position_error: Norm of its positions [m].
        orientation_error: Norm of its rotation [rad].
    """

    time: list[float]
    joints: Matrix
    axes: list[Axis]
    error: Matrix
    position_error: list[float]
    orientation_error: list[float]


class Unsolved(Answer):
    """One of many poses that has no solution, and the problem it would be alone.

    Args:
        index: Which of the poses.
        code: Of the problem.
        detail: What is wrong.
        hint: What to do about it.
    """

    index: int
    code: str
    detail: str
    hint: str | None = None


class IkAnswer(InFrame):
    """Solutions, best first, and the trace of a gradient if it was asked for.

    Args:
        solutions: Best first.
        unsolved: Empty for one pose.
        deterministic: Whether the same request gives the same answer: no search was ended by time.
        trace: Of the gradient.
        allowed_collisions: Pairs that may touch.
        plan_id: Of the kept plan, if it was kept.
    """

    solutions: list[IkSolution]
    unsolved: list[Unsolved] = Field(default_factory=list)
    deterministic: bool = True
    trace: GradientTrace | None = None
    allowed_collisions: list[AllowedPair] = Field(default_factory=list)
    plan_id: str | None = None


class IkBatch(InFrame):
    """Solutions of many poses, in their order.

    Args:
        solutions: Of each pose, best first; empty where there is none.
        unsolved: The poses that have none, and why.
        deterministic: Whether the same request gives the same answer: no search was ended by time.
        allowed_collisions: Pairs that may touch.
        plan_id: Of the kept plan, if it was kept.
    """

    solutions: list[list[IkSolution]]
    unsolved: list[Unsolved] = Field(default_factory=list)
    deterministic: bool = True
    trace: GradientTrace | None = None
    allowed_collisions: list[AllowedPair] = Field(default_factory=list)
    plan_id: str | None = None
