"""Collision checks on the wire."""

from typing import Annotated

from pydantic import Field

from armwright_wire.attached import AllowedAnswers, AllowedCollisions, AttachedObjects, WithFingers
from armwright_wire.base import (
    Answer,
    Frame,
    InFrame,
    Joints,
    Keepable,
    Name,
    NonNegative,
    PlanId,
    Timeout,
)
from armwright_wire.kinematics import JOINTS_EXAMPLE
from armwright_wire.scene import SceneReference

Margin = Annotated[
    NonNegative,
    Field(le=10.0, description="distance to be kept from obstacles, beyond their own margins [m]"),
]


class CheckRequest(WithFingers, Keepable):
    """Configurations to be checked against limits, themselves and a scene."""

    robot: Name = Field(examples=["panda"], description="name of a stored or built-in robot")
    scene: SceneReference | None = Field(None, examples=["table"])
    frame: Frame | None = None
    joints: Joints = Field(examples=[JOINTS_EXAMPLE])
    depth: bool = Field(
        True,
        description="false leaves depths and clearance out, and with them nearly all of the time",
    )
    attached: AttachedObjects | None = None
    allowed_collisions: AllowedCollisions | None = None
    margin: Margin = 0.0
    timeout: Timeout | None = None


class Collision(Answer):
    """Two bodies that penetrate each other."""

    pair: list[str] = Field(
        examples=[["panda_hand", "table_top"]], description="names of the two bodies"
    )
    depth: float | None = Field(
        examples=[0.012], description="[m]; null where depths were not asked for"
    )


class LimitViolation(Answer):
    """A joint outside its limits."""

    joint: str = Field(examples=["panda_joint4"], description="name of the joint")
    value: float = Field(examples=[0.1], description="[rad] or [m]")
    limit: float = Field(examples=[-0.0698], description="[rad] or [m]")


class CheckAnswer(InFrame):
    """The verdict; with many configurations each field is a list."""

    valid: bool | list[bool] = Field(
        description="within limits, nothing touches, and every margin is kept"
    )
    clearance: float | list[float | None] | None = Field(
        description="smallest distance [m], margins not taken off; negative by the depth in "
        "collision, null with nothing to hit"
    )
    clearance_pair: list[str] | list[list[str] | None] | None = Field(
        examples=[["panda_hand", "table_top"]], description="between whom that is"
    )
    collisions: list[Collision] | list[list[Collision]] = Field(
        description="pairs of bodies that touch"
    )
    limit_violations: list[LimitViolation] | list[list[LimitViolation]] = Field(
        description="joints outside their limits"
    )
    allowed_collisions: AllowedAnswers = Field(default_factory=list)
    plan_id: PlanId = None
