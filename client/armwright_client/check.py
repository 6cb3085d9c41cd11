"""Collision checks."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, TypeAlias, TypedDict

from pydantic import Field

from armwright_client.base import PLAIN, Answer, Names, NonNegative, Request, Rows, Vector
from armwright_client.pose import Pose
from armwright_client.scene import SceneReference
from armwright_client.shape import Shape


class Attached(Request):
    """An object that moves with a link.

    Args:
        id: Of the object.
        shape: Of the object.
        pose: In the frame of the link.
        link: That carries it.
        touch_links: Links that may touch it.
    """

    id: str
    shape: Shape
    pose: Pose
    link: str
    touch_links: Names = Field(default_factory=list)


if TYPE_CHECKING:
    AttachedObjects: TypeAlias = Sequence[Attached]
else:
    AttachedObjects = Annotated[list[Attached], PLAIN]


class CheckOptions(TypedDict, total=False):
    """What a configuration is to be checked against beyond the robot itself.

    Args:
        scene: What it must not hit.
        attached: Objects that move with a link.
        margin: Distance to be kept [m].
        timeout: [s].
    """

    scene: SceneReference
    attached: AttachedObjects
    margin: float
    timeout: float


class CheckRequest(Request):
    """Configurations to be checked against limits, themselves and a scene."""

    robot: str
    joints: Vector | Rows
    scene: SceneReference | None = None
    attached: AttachedObjects | None = None
    margin: NonNegative | None = None
    timeout: float | None = None


class Collision(Answer):
    """Two bodies that penetrate each other by a depth [m]."""

    pair: tuple[str, str]
    depth: float


class LimitViolation(Answer):
    """A joint outside its limits [rad or m]."""

    joint: str
    value: float
    limit: float


class CheckAnswer(Answer):
    """The verdict about one configuration.

    Args:
        valid: Inside its limits, and every margin is kept.
        clearance: Smallest distance [m], negative in collision, None with nothing to hit.
        clearance_pair: Between whom that is.
        collisions: All pairs that penetrate each other.
        limit_violations: All joints outside their limits.
    """

    valid: bool
    clearance: float | None = None
    clearance_pair: tuple[str, str] | None = None
    collisions: list[Collision]
    limit_violations: list[LimitViolation] = Field(default_factory=list)


class CheckBatch(Answer):
    """The verdicts about many configurations, in their order; see `CheckAnswer`."""

    valid: list[bool]
    clearance: list[float | None]
    clearance_pair: list[tuple[str, str] | None] | None = None
    collisions: list[list[Collision]]
    limit_violations: list[list[LimitViolation]] = Field(default_factory=list)
