"""Tools on the wire: what an arm works with, and how requests mount it."""

from typing import Annotated, ClassVar, Literal

from pydantic import ConfigDict, Discriminator, Field, Tag

from armwright_wire.base import (
    Answer,
    Beside,
    Body,
    BodyWithRules,
    Label,
    Length,
    Matrix3,
    Name,
    NonNegative,
    Number,
    Point,
    Positive,
    Vector3,
    examples,
)
from armwright_wire.pose import Pose
from armwright_wire.scenes.scene import Shape

MAX_SOLIDS = 1_000
MAX_PARTS = 32

Angle = Annotated[float, Field(ge=-1.5, le=1.5)]
#: Name of a part of a tool; the link of it is <tool>/<part>.
Part = Annotated[str, Field(pattern=r"^[^\x00-\x1f\x7f/]{1,64}$")]
_Mass = Annotated[NonNegative, Field(description="[kg]; 0 for none")]
_Speed = Annotated[Positive, Field(description="largest rate of the opening [m/s]")]


class ParallelJaw(Body):
    """Two opposing jaws along x; the tip is between their ends."""

    type: Literal["parallel_jaw"] = "parallel_jaw"
    opening: Length = 0.085
    """largest distance of the jaws [m]"""
    width: Length = 0.12
    """of the body, along x [m]"""
    depth: Length = 0.06
    """of the body, along y [m]"""
    height: Length = 0.1
    """of the body, along z [m]"""
    finger_length: Length = 0.05
    """beyond the body [m]"""
    finger_width: Length = 0.022
    """along y [m]"""
    finger_thickness: Length = 0.01
    """along x [m]"""
    speed: _Speed = 0.1
    mass: _Mass = 0.9


class ThreeJaw(Body):
    """Three jaws about z, 120 degrees apart; the tip is between their ends."""

    type: Literal["three_jaw"] = "three_jaw"
    opening: Length = 0.1
    """largest diameter between the jaws [m]"""
    radius: Length = 0.06
    """of the body [m]"""
    height: Length = 0.1
    """of the body [m]"""
    finger_length: Length = 0.06
    """beyond the body [m]"""
    finger_width: Length = 0.02
    """across [m]"""
    finger_thickness: Length = 0.012
    """along the way [m]"""
    speed: _Speed = 0.1
    mass: _Mass = 1.2


class SuctionCup(Body):
    """A cup on a stem; the tip is in the middle of its lip."""

    type: Literal["suction_cup"] = "suction_cup"
    radius: Length = 0.02
    """of the cup [m]"""
    height: Length = 0.03
    """of the cup [m]"""
    stem_radius: Length = 0.01
    """[m]"""
    stem_length: Length = 0.08
    """[m]"""
    mass: _Mass = 0.3


class Torch(Body):
    """A body and a bent neck; the tip is at the end of the wire."""

    type: Literal["torch"] = "torch"
    radius: Length = 0.025
    """of the body [m]"""
    length: Length = 0.2
    """of the body [m]"""
    neck_radius: Length = 0.01
    """[m]"""
    neck_length: Length = 0.12
    """[m]"""
    angle: Angle = 0.6
    """of the neck about y [rad]"""
    stick_out: Length = 0.015
    """of the wire beyond the neck [m]"""
    mass: _Mass = 1.0


class Spindle(Body):
    """A motor and a bit; the tip is at the end of the bit."""

    type: Literal["spindle"] = "spindle"
    radius: Length = 0.04
    """of the motor [m]"""
    length: Length = 0.18
    """of the motor [m]"""
    bit_radius: Length = 0.004
    """[m]"""
    bit_length: Length = 0.05
    """[m]"""
    mass: _Mass = 2.0


#: A built-in tool by its sizes.
Form = Annotated[
    ParallelJaw | ThreeJaw | SuctionCup | Torch | Spindle,
    Field(discriminator="type", description="a built-in tool, in place of all but name and link"),
]
#: Names of the built-in tools, which stand for those of the usual sizes.
BUILTIN_TOOLS = ("parallel_jaw", "three_jaw", "suction_cup", "torch", "spindle")


class Solid(Body):
    """A shape and where it is."""

    shape: Shape
    """in its own frame; no half-space"""
    pose: Pose
    """in the frame of the tool or finger"""


class ToolFinger(Body):
    """A finger that slides, or turns, with the opening of its tool."""

    type: Literal["prismatic", "revolute"] = "prismatic"
    """slides or turns"""
    pose: Pose
    """in the frame of the tool, at an opening of 0"""
    axis: Vector3 = Field(examples=[[1.0, 0.0, 0.0]])
    """in the finger's frame, of any length but 0"""
    travel: Number = 0.5
    """for an opening of one metre [m or rad]"""
    solids: Annotated[list[Solid], Field(max_length=MAX_SOLIDS)] = Field(default_factory=list)
    """in the finger's frame"""


class Tool(BodyWithRules):
    """A tool: tips, solids, mass and fingers in one frame, or a built-in one by its sizes."""

    one_of: ClassVar[tuple[str, ...]] = ("tcp", "form")
    only_beside: ClassVar[Beside] = {
        "center_of_mass": ("mass",),
        "inertia": ("mass",),
        "fingers": ("opening",),
        "opening": ("fingers",),
        "speed": ("opening",),
        "solids": ("tcp",),
        "mass": ("tcp",),
        "grip": ("tcp",),
    }

    model_config = ConfigDict(json_schema_extra={"examples": examples("Tool")})

    name: Name | None = None
    """of its link once it is mounted"""
    link: Label | None = Field(None, examples=["tool0"])
    """that it is mounted on, whose frame is its own; the robot's tip if left out"""
    form: Form | None = None
    tcp: Annotated[dict[Part, Pose], Field(min_length=1, max_length=MAX_PARTS)] | None = None
    """tips by name, in the frame of the tool"""
    solids: Annotated[list[Solid], Field(max_length=MAX_SOLIDS)] | None = None
    """in the frame of the tool"""
    mass: Positive | None = None
    """for torques; without one the tool weighs nothing [kg]"""
    center_of_mass: Point | None = None
    """in the frame of the tool, its origin if left out [m]"""
    inertia: Matrix3 | None = None
    """about it, in the tool's axes; a point if left out [kg m^2]"""
    fingers: Annotated[dict[Part, ToolFinger], Field(max_length=MAX_PARTS)] | None = None
    """by name; the joint <tool>/opening moves them"""
    grip: Literal["jaws", "suction", "none"] | None = None
    """how it holds things; jaws where it has fingers"""
    opening: Annotated[list[NonNegative], Field(min_length=2, max_length=2)] | None = Field(
        None, examples=[[0.0, 0.085]]
    )
    """least and largest distance of the fingers [m]"""
    speed: Positive | None = None
    """largest rate of the opening [m/s]"""


class NamedTool(Tool):
    """A tool with its name."""

    name: Name = Field(examples=["gripper_a"])
    """of its link once it is mounted"""


class HeldTip(Body):
    """The tip of an object that the robot holds."""

    object: Label = Field(examples=["peg"])
    """id of the object, in `attached`"""
    pose: Pose | None = None
    """in the object's frame; its origin if left out"""


def _by_name(value: object) -> str:
    return "name" if isinstance(value, str) else "inline"


#: A stored or built-in tool by its name, or a tool.
ToolReference = Annotated[
    Annotated[Name, Tag("name")] | Annotated[NamedTool, Tag("inline")],
    Discriminator(_by_name),
    Field(
        description="that is mounted meanwhile: name of a stored or built-in tool, or a tool; "
        "what speaks of the tip means its",
        examples=["parallel_jaw"],
    ),
]
#: A tip of the tool by its name, or one of what the robot holds.
TipReference = Annotated[
    Annotated[Part, Tag("name")] | Annotated[HeldTip, Tag("inline")],
    Discriminator(_by_name),
    Field(
        description="tip of the tool, which may be left out where it has one; or that of an "
        "object in `attached`",
        examples=["tip"],
    ),
]


class Margins(Body):
    """Distances that links and objects keep, beside the margin of all obstacles."""

    links: Annotated[dict[Label, NonNegative], Field(max_length=MAX_PARTS)] | None = Field(
        None, examples=[{"forearm_link": 0.02}]
    )
    """of a link from obstacles, by name, a tool's for all of its parts [m]"""
    objects: Annotated[dict[Label, NonNegative], Field(max_length=1000)] | None = Field(
        None, examples=[{"glass": 0.05}]
    )
    """of an obstacle, in place of its own [m]"""
    own: NonNegative = 0.0
    """of links from each other, that are kept apart [m]"""


class WithTool(Body):
    """A request that may mount a tool."""

    tool: ToolReference | None = None
    tcp: TipReference | None = None
    margins: Margins | None = None


class ToolSummary(Answer):
    """Summary of a tool."""

    name: str = Field(examples=["gripper_a"])
    """of the tool"""
    built_in: bool
    """whether it comes with the service"""
    hash: str | None = None
    """SHA-256 of the stored document; null of a built-in one"""
    version: int | None = Field(None, examples=[1])
    """counts the replacements"""
    updated: str | None = Field(None, examples=["2026-11-21T09:30:00+00:00"])
    """when it was stored last"""


class ToolList(Answer):
    """Tools by name; `next` continues the list, if there are more."""

    tools: list[ToolSummary]
    """by name"""
    next: str | None = None
    """value of `after` for the next page"""
