"""Objects that the robot holds, pairs that may touch, and collision checks, on the wire."""

from collections.abc import Sequence
from typing import Annotated, ClassVar

from pydantic import Field

from armwright_wire.base import (
    AS_LIST,
    JOINTS_EXAMPLE,
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
    Matrix3,
    Name,
    NamePair,
    NonNegative,
    Number,
    PlanId,
    Point,
    Positive,
    Timeout,
)
from armwright_wire.pose import Pose
from armwright_wire.scenes.scene import AllowedItem, SceneReference, Shape
from armwright_wire.scenes.tool import WithTool

MAX_ATTACHED = 100
MAX_ALLOWED = 10_000
MAX_FINGERS = 100


#: As the library has it: tests compare the two [m].
TOUCH_DEPTH = 1e-3
TouchDepth = Annotated[
    NonNegative | None,
    Field(description="how deep they may overlap where they may touch [m]; null for any depth"),
]


class AllowedAnswer(Answer):
    """A pair that was not kept apart."""

    pair: NamePair = Field(examples=[["panda_hand", "table_top"]])
    """names of the two bodies"""
    reason: str = Field(examples=["request"])
    """who allows it: request, scene, touch_links, support or attached; of the robot itself srdf,
    adjacent, always, same body or suspected
    """
    overlap: float | None = Field(examples=[0.0004])
    """how deep they overlap at most [m], a bound for every t of a motion; null where it is not
    measured: of links that a joint joins, or that touch as they are built
    """


AllowedAnswers = Annotated[
    list[AllowedAnswer],
    Field(description="all pairs that were not kept apart, whoever allows them"),
]


class Carried(BodyWithRules):
    """What an object that is held may touch, and what it weighs."""

    only_beside: ClassVar[Beside] = {"center_of_mass": ("mass",), "inertia": ("mass",)}

    touch_links: Annotated[list[Label], Field(max_length=100)] = Field(default_factory=list)
    """what it may touch: links, obstacles, other attached objects"""
    touch_depth: TouchDepth = TOUCH_DEPTH
    mass: Positive | None = None
    """for torques; without one the object weighs nothing [kg]"""
    center_of_mass: Point | None = None
    """in the object's frame, its origin if left out [m]"""
    inertia: Matrix3 | None = None
    """about it, in the object's axes; a point if left out [kg m^2]"""


class Attached(Carried):
    """An object that moves with a link; one that stands in the scene is out of it meanwhile."""

    one_of: ClassVar[tuple[str, ...]] = ("pose", "grasp_joints")

    id: Label = Field(examples=["workpiece"])
    """name of the object; that of an obstacle takes it out of the scene"""
    shape: Shape | None = None
    """may be left out where the scene has an obstacle of this id"""
    pose: Pose | None = None
    """in the frame of the link"""
    grasp_joints: JointVector | None = None
    """in place of pose: the configuration in which the link closed on the object where it stands in
    the scene
    """
    link: Label = Field(examples=["panda_hand"])
    """link that holds the object"""


FingerPositions = Annotated[dict[Label, Number], Field(max_length=MAX_FINGERS)]


class WithFingers(Body):
    """A request that may say where the gripper's fingers stand."""

    fingers: FingerPositions | None = None
    """where joints of the gripper stand meanwhile [rad or m]; the others where the robot holds them
    """


AttachedObjects = Annotated[
    Sequence[Attached],
    AS_LIST,
    Field(max_length=MAX_ATTACHED, description="objects that the robot holds"),
]
AllowedCollisions = Annotated[
    Sequence[AllowedItem],
    AS_LIST,
    Field(
        max_length=MAX_ALLOWED,
        description="more pairs of links, obstacles and attached objects that may touch, to "
        "any depth unless they give a `touch_depth`; a group of the SRDF stands for its links, `*` "
        "for any letters",
        examples=[[["panda_hand", "table_top"]]],
    ),
]


Margin = Annotated[
    NonNegative,
    Field(le=10.0, description="distance to be kept from obstacles, beyond their own margins [m]"),
]


class WithScene(WithTool):
    """A request about a robot among obstacles, and what it holds."""

    scene: SceneReference | None = Field(None, examples=["table"])
    frame: Frame | None = None
    attached: AttachedObjects | None = None
    allowed_collisions: AllowedCollisions | None = None


class SceneRequest(WithScene):
    """A request about a robot that keeps a distance from obstacles."""

    margin: Margin = 0.0
    timeout: Timeout | None = None


class CheckRequest(SceneRequest, WithFingers, Keepable):
    """Configurations to be checked against limits, themselves and a scene."""

    robot: Name = Field(examples=["panda"])
    """name of a stored or built-in robot"""
    joints: Joints = Field(examples=[JOINTS_EXAMPLE])
    depth: bool = True
    """false leaves depths and clearance out, and with them nearly all of the time"""


class Collision(Answer):
    """Two bodies that penetrate each other."""

    pair: NamePair = Field(examples=[["panda_hand", "table_top"]])
    """names of the two bodies"""
    depth: float | None = Field(examples=[0.012])
    """[m]; null where depths were not asked for"""


class LimitViolation(Answer):
    """A joint outside its limits."""

    joint: str = Field(examples=["panda_joint4"])
    """name of the joint"""
    value: float = Field(examples=[0.1])
    """[rad] or [m]"""
    limit: float = Field(examples=[-0.0698])
    """[rad] or [m]"""


class CheckAnswer(InFrame):
    """The verdict; with many configurations each field is a list."""

    valid: bool | list[bool]
    """within limits, nothing touches, and every margin is kept"""
    clearance: float | list[float | None] | None
    """smallest distance [m], margins not taken off; negative by the depth in collision, null with
    nothing to hit
    """
    clearance_pair: NamePair | list[NamePair | None] | None = Field(
        examples=[["panda_hand", "table_top"]]
    )
    """between whom that is"""
    collisions: list[Collision] | list[list[Collision]]
    """pairs of bodies that touch"""
    limit_violations: list[LimitViolation] | list[list[LimitViolation]]
    """joints outside their limits"""
    allowed_collisions: AllowedAnswers = Field(default_factory=list)
    plan_id: PlanId = None
