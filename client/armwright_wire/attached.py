"""Attached objects and allowed collisions on the wire."""

from typing import Annotated, ClassVar

from pydantic import Field, model_validator

from armwright_wire.base import (
    Answer,
    Beside,
    Body,
    JointVector,
    Label,
    Matrix3,
    NonNegative,
    Number,
    Point,
    Positive,
    check_company,
    exactly_one,
)
from armwright_wire.pose import Pose
from armwright_wire.scene import AllowedItem
from armwright_wire.shape import Shape

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

    pair: list[str] = Field(
        examples=[["panda_hand", "table_top"]], description="names of the two bodies"
    )
    reason: str = Field(
        examples=["request"],
        description="who allows it: request, scene, touch_links, support or attached; of the robot "
        "itself srdf, adjacent, always, same body or suspected",
    )
    overlap: float | None = Field(
        examples=[0.0004],
        description="how deep they overlap at most [m], a bound for every t of a motion; null "
        "where it is not measured: of links that a joint joins, or that touch as they are built",
    )


AllowedAnswers = Annotated[
    list[AllowedAnswer],
    Field(description="all pairs that were not kept apart, whoever allows them"),
]


class Attached(Body):
    """An object that moves with a link; one that stands in the scene is out of it meanwhile."""

    one_of: ClassVar[tuple[str, ...]] = ("pose", "grasp_joints")
    only_beside: ClassVar[Beside] = {"center_of_mass": ("mass",), "inertia": ("mass",)}

    id: Label = Field(
        examples=["workpiece"],
        description="name of the object; that of an obstacle takes it out of the scene",
    )
    shape: Shape | None = Field(
        None, description="may be left out where the scene has an obstacle of this id"
    )
    pose: Pose | None = Field(None, description="in the frame of the link")
    grasp_joints: JointVector | None = Field(
        None,
        description="in place of pose: the configuration in which the link closed on the object "
        "where it stands in the scene",
    )
    link: Label = Field(examples=["panda_hand"], description="link that holds the object")
    touch_links: Annotated[list[Label], Field(max_length=100)] = Field(
        default_factory=list,
        description="what it may touch: links, obstacles, other attached objects",
    )
    touch_depth: TouchDepth = TOUCH_DEPTH
    mass: Positive | None = Field(
        None, description="for torques; without one the object weighs nothing [kg]"
    )
    center_of_mass: Point | None = Field(
        None, description="in the object's frame, its origin if left out [m]"
    )
    inertia: Matrix3 | None = Field(
        None, description="about it, in the object's axes; a point if left out [kg m^2]"
    )

    @model_validator(mode="after")
    def _check_form(self) -> "Attached":
        exactly_one(self, self.one_of)
        check_company(self)
        return self


FingerPositions = Annotated[dict[Label, Number], Field(max_length=MAX_FINGERS)]


class WithFingers(Body):
    """A request that may say where the gripper's fingers stand."""

    fingers: FingerPositions | None = Field(
        None,
        description="where joints of the gripper stand meanwhile [rad or m]; the others where the "
        "robot holds them",
    )


AttachedObjects = Annotated[
    list[Attached],
    Field(max_length=MAX_ATTACHED, description="objects that the robot holds"),
]
AllowedCollisions = Annotated[
    list[AllowedItem],
    Field(
        max_length=MAX_ALLOWED,
        description="more pairs of links, obstacles and attached objects that may touch, to any "
        "depth unless they give a `touch_depth`",
        examples=[[["panda_hand", "table_top"]]],
    ),
]
