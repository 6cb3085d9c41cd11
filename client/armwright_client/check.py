"""Collision checks."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Self, TypeAlias, TypedDict

from pydantic import Field, model_validator

from armwright_client.base import (
    PLAIN,
    Answer,
    InFrame,
    Matrix3,
    Names,
    NonNegative,
    Positive,
    Request,
    Rows,
    Vector,
    Vector3,
)
from armwright_client.pose import Pose
from armwright_client.scene import AllowedPair, AllowedPairs, SceneReference, TouchDepth
from armwright_client.shape import Shape


class Attached(TouchDepth):
    """An object that moves with a link; one that stands in the scene is out of it meanwhile.

    Args:
        id: Of the object.
        shape: Of the object; may be left out where the scene has an obstacle of this id.
        pose: In the frame of the link.
        grasp_joints: In place of the pose: the configuration in which the link closed on the
            object where it stands in the scene.
        link: That carries it.
        touch_links: What it may touch: links, obstacles, other attached objects.
        touch_depth: How deep it may overlap these [m]; None for any depth.
        mass: For torques; without one it weighs nothing [kg].
        center_of_mass: In the object's frame, its origin if left out [m].
        inertia: About it, in the object's axes; a point if left out [kg m^2].
    """

    id: str
    shape: Shape | None = None
    pose: Pose | None = None
    grasp_joints: Vector | None = None
    link: str
    touch_links: Names = Field(default_factory=list)
    mass: Positive | None = None
    center_of_mass: Vector3 | None = None
    inertia: Matrix3 | None = None

    @model_validator(mode="after")
    def _check_form(self) -> Self:
        if (self.pose is None) == (self.grasp_joints is None):
            raise ValueError("give exactly one of pose, grasp_joints")
        if self.mass is None and (self.center_of_mass is not None or self.inertia is not None):
            raise ValueError("center_of_mass and inertia need mass")
        return self


if TYPE_CHECKING:
    AttachedObjects: TypeAlias = Sequence[Attached]
    FingerPositions: TypeAlias = Mapping[str, float]
else:
    AttachedObjects = Annotated[list[Attached], PLAIN]
    FingerPositions = Annotated[dict[str, float], PLAIN]


class CheckOptions(TypedDict, total=False):
    """Options of `check`: scene, margin and attached objects.

    Args:
        scene: What it must not hit.
        attached: Objects that move with a link.
        fingers: Where joints of the gripper stand meanwhile [rad or m].
        allowed_collisions: More pairs that may touch.
        margin: Distance to be kept [m].
        frame: Of an inline scene that names none: a link that stands still, or "tool".
        depth: False leaves depths and clearance out, and nearly all of the time.
        timeout: [s].
        keep: Whether request and answer are kept as a plan, see `Client.plans`.
    """

    scene: SceneReference
    frame: str
    depth: bool
    attached: AttachedObjects
    fingers: FingerPositions
    allowed_collisions: AllowedPairs
    margin: float
    timeout: float
    keep: bool


class CheckRequest(Request):
    """Configurations to be checked against limits, themselves and a scene."""

    robot: str
    joints: Vector | Rows
    scene: SceneReference | None = None
    attached: AttachedObjects | None = None
    fingers: FingerPositions | None = None
    allowed_collisions: AllowedPairs | None = None
    margin: NonNegative | None = None
    frame: str | None = None
    depth: bool | None = None
    timeout: float | None = None
    keep: bool | None = None


class Collision(Answer):
    """Two bodies that penetrate each other by a depth [m], None where it was not asked for."""

    pair: tuple[str, str]
    depth: float | None


class LimitViolation(Answer):
    """A joint outside its limits [rad or m]."""

    joint: str
    value: float
    limit: float


class CheckAnswer(InFrame):
    """The verdict about one configuration.

    Args:
        valid: Inside its limits, and every margin is kept.
        clearance: Smallest distance [m], negative in collision, None with nothing to hit.
        clearance_pair: Between whom that is.
        collisions: All pairs that penetrate each other; without depths one of them.
        limit_violations: All joints outside their limits.
        allowed_collisions: All pairs that were not kept apart, the deepest they are.
        plan_id: Of the kept plan, if it was kept.
    """

    valid: bool
    clearance: float | None = None
    clearance_pair: tuple[str, str] | None = None
    collisions: list[Collision]
    limit_violations: list[LimitViolation] = Field(default_factory=list)
    allowed_collisions: list[AllowedPair] = Field(default_factory=list)
    plan_id: str | None = None


class CheckBatch(InFrame):
    """The verdicts about many configurations, in their order; see `CheckAnswer`."""

    valid: list[bool]
    clearance: list[float | None]
    clearance_pair: list[tuple[str, str] | None] | None = None
    collisions: list[list[Collision]]
    limit_violations: list[list[LimitViolation]] = Field(default_factory=list)
    allowed_collisions: list[AllowedPair] = Field(default_factory=list)
    plan_id: str | None = None
