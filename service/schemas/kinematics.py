"""Forward and inverse kinematics and Jacobians on the wire."""

from typing import Annotated, Literal

from pydantic import Field

from service.schemas.base import (
    Answer,
    Body,
    FreeForm,
    Joints,
    JointVector,
    Label,
    Matrix,
    Point,
    Seed,
    Timeout,
)
from service.schemas.pose import Pose, PoseAnswer
from service.schemas.scene import SceneReference

MAX_SOLUTIONS = 1_000
MAX_CONSTRAINTS = 32

JOINTS_EXAMPLE = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]

Constraints = Annotated[list[FreeForm], Field(max_length=MAX_CONSTRAINTS)]


class FkRequest(Body):
    """Configurations whose link poses are asked for."""

    joints: Joints = Field(examples=[JOINTS_EXAMPLE])
    link: Label | None = Field(None, description="the tip if left out")


class FkAnswer(Answer):
    """Poses in the base frame; with many configurations each pose is a list."""

    pose: PoseAnswer | list[PoseAnswer]
    links: dict[str, PoseAnswer | list[PoseAnswer]]


class JacobianRequest(Body):
    """Configurations whose Jacobians are asked for."""

    joints: Joints = Field(examples=[JOINTS_EXAMPLE])
    link: Label | None = Field(None, description="the tip if left out")
    point: Point | None = Field(None, description="a point fixed to the link, in its frame [m]")
    kind: Literal["geometric", "analytic_zyz"] = "geometric"


class JacobianAnswer(Answer):
    """6 x n, linear rows first; with many configurations each field is a list."""

    jacobian: Matrix | list[Matrix]
    rank: int | list[int]
    singular_values: list[float] | list[list[float]]
    manipulability: float | list[float]


class IkRequest(Body):
    """A pose to be reached."""

    pose: Pose
    link: Label | None = Field(None, description="the tip if left out")
    seed_joints: JointVector | None = Field(None, examples=[JOINTS_EXAMPLE])
    method: Literal["auto", "analytic", "numeric", "gradient", "constrained"] = "auto"
    all_solutions: bool = False
    max_solutions: Annotated[int, Field(ge=1, le=MAX_SOLUTIONS)] | None = None
    scene: SceneReference | None = Field(None, examples=["table"])
    constraints: Constraints | None = None
    timeout: Timeout | None = None
    seed: Seed = 0


class IkSolution(Answer):
    """A configuration that reaches the pose, and how well."""

    joints: list[float] = Field(examples=[JOINTS_EXAMPLE])
    branch: str | None = None
    position_error: float = Field(description="[m]")
    orientation_error: float = Field(description="[rad]")
    within_limits: bool
    collision_free: bool | None = None
    rejected_because: str | None = None


class IkAnswer(Answer):
    """Solutions, best first."""

    solutions: list[IkSolution]
