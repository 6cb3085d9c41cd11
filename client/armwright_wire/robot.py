"""Robots on the wire."""

from typing import Annotated, ClassVar, Literal

from pydantic import ConfigDict, Discriminator, Field, Tag, field_validator, model_validator
from pydantic.config import JsonDict

from armwright_wire.base import (
    Answer,
    Body,
    Label,
    Name,
    Number,
    Positive,
    any_given,
    exactly_one,
)
from armwright_wire.dh import DhAnswer, DhTable
from armwright_wire.motor import Motor
from armwright_wire.shape import check_base64

_MAX_XML = 16 * 1024 * 1024
#: Mesh files of one robot.
MAX_MESHES = 1_000
_MAX_URI = 1_024

#: Text of a joint_limits.yaml: a kilobyte a joint.
_MAX_LIMITS = 1_000_000

#: A number times another limit.
Rule = Annotated[str, Field(pattern=r"^[0-9eE+.\- ]+[x*×] *[a-z]+ *$", max_length=64)]
Xml = Annotated[str, Field(min_length=1, max_length=_MAX_XML)]
Uri = Annotated[str, Field(min_length=1, max_length=_MAX_URI)]


class JointLimits(Body):
    """Limits that a description leaves out or that are to be tightened."""

    lower: Number | None = Field(None, description="[rad] or [m]")
    upper: Number | None = Field(None, description="[rad] or [m]")
    velocity: Positive | None = Field(None, description="largest speed [rad/s or m/s]")
    acceleration: Positive | None = Field(None, description="largest acceleration [rad/s² or m/s²]")
    jerk: Positive | None = Field(None, description="largest jerk [rad/s³ or m/s³]")
    effort: Positive | None = Field(None, description="[N m] or [N]")


class DefaultLimits(Body):
    """Rules for limits that are known nowhere else: a number times another limit."""

    acceleration: Rule | None = Field(
        None, examples=["10 x velocity"], description="rule for accelerations"
    )
    jerk: Rule | None = Field(None, examples=["10 x acceleration"], description="rule for jerks")


def _by_form(value: object) -> str:
    return "text" if isinstance(value, str) else "object"


_LimitsByJoint = Annotated[dict[Label, JointLimits], Field(max_length=1_000)]
#: Limits by joint, or the text of a joint_limits.yaml.
LimitsOfJoints = Annotated[
    Annotated[_LimitsByJoint, Tag("object")]
    | Annotated[str, Field(min_length=1, max_length=_MAX_LIMITS), Tag("text")],
    Discriminator(_by_form),
    Field(
        description='by joint, where "*" is every joint of the chain; or the text of a '
        "joint_limits.yaml as MoveIt has it",
        examples=[{"*": {"acceleration": 5.0}}],
    ),
]


_EXAMPLE: JsonDict = {
    "name": "planar",
    "dh": {
        "convention": "standard",
        "rows": [
            {
                "type": "revolute",
                "a": 0.5,
                "alpha": 0.0,
                "d": 0.0,
                "theta": 0.0,
                "lower": -3.1,
                "upper": 3.1,
                "velocity": 2.0,
            }
        ],
        "geometry": {"capsules": 0.05},
    },
    "joint_limits": {"joint_1": {"acceleration": 10.0}},
}


class RobotFields(Body):
    """Fields of a robot beside its description."""

    name: Name = Field(description="under which the robot is stored")
    base_link: Label | None = Field(
        None,
        description="where the chain begins; poses are in the root frame all the same, unless this "
        "is work that a positioner moves beside the arm: then they are in its frame",
    )
    tip_link: Label | None = Field(
        None, description="where it ends; the likely tip if left out, told in lint"
    )
    joint_limits: LimitsOfJoints | None = None
    default_limits: DefaultLimits | None = Field(
        None, description="rules for limits that neither the description nor joint_limits gives"
    )
    allow_suspected: bool = Field(
        False,
        description="let pairs touch that the answer's suspected_collisions tells; only where no "
        "SRDF says which may",
    )
    visual_solids: bool = Field(
        False,
        description="of a URDF: links without collision geometry collide as they look",
    )
    held: Annotated[dict[Label, Number], Field(max_length=1_000)] | None = Field(
        None,
        description="positions of joints off the chain [rad or m]; 0, or the limit nearest to it, "
        "for those left out",
    )
    motors: Annotated[dict[Label, Motor], Field(max_length=1_000)] | None = Field(
        None,
        description='of a URDF by joint, "*" is every other joint of the chain: they give its '
        "joints their motor inertias, and frictions in place of its damping; all joints have one, "
        "or none has. Rows of a dh table have a `motor` each",
    )


class RobotChanges(Body):
    """Limits of a stored robot that change; those of other joints and quantities stay."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [{"joint_limits": {"*": {"acceleration": 4.0}}}],
            **any_given(("joint_limits",), ("default_limits",)),
        }
    )

    joint_limits: LimitsOfJoints | None = None
    default_limits: DefaultLimits | None = Field(
        None, description="rules in place of those of before"
    )

    @model_validator(mode="after")
    def _check_form(self) -> "RobotChanges":
        if self.joint_limits is None and self.default_limits is None:
            raise ValueError("give joint_limits or default_limits")
        return self


class ArchiveFields(RobotFields):
    """Fields of a robot that comes in an archive."""

    urdf_path: Uri | None = Field(
        None, description="which .urdf file is meant, by its path in the archive or the end of it"
    )
    srdf_path: Uri | None = Field(None, description="which .srdf file belongs to it, likewise")


class RobotBody(RobotFields):
    """A robot as URDF or as a Denavit-Hartenberg table."""

    one_of: ClassVar[tuple[str, ...]] = ("urdf", "dh")

    model_config = ConfigDict(json_schema_extra={"examples": [_EXAMPLE]})

    urdf: Xml | None = Field(None, description="text of the URDF")
    srdf: Xml | None = Field(None, description="text of the SRDF that belongs to it")
    dh: DhTable | None = None
    meshes: Annotated[dict[Uri, str], Field(max_length=MAX_MESHES)] | None = Field(
        None,
        description="package:// or relative URI of the URDF → file in base64: of what links "
        "collide with, and perhaps of what they look like",
    )

    @field_validator("meshes")
    @classmethod
    def _check_meshes(cls, value: dict[str, str] | None) -> dict[str, str] | None:
        for uri, content in (value or {}).items():
            try:
                check_base64(content)
            except ValueError as error:
                raise ValueError(f"mesh {uri!r}: {error}") from None
        return value

    @model_validator(mode="after")
    def _check_form(self) -> "RobotBody":
        exactly_one(self, self.one_of)
        if self.dh is not None:
            for name in ("srdf", "meshes", "held", "motors", "visual_solids"):
                if getattr(self, name) not in (None, False):
                    raise ValueError(f"{name} belongs to a URDF, not to a dh table")
        return self


class Limits(Answer):
    """Limits in the order of the joints; null where there is none."""

    lower: list[float | None] = Field(description="least position [rad or m]")
    upper: list[float | None] = Field(description="largest position [rad or m]")
    velocity: list[float | None] = Field(description="largest speed [rad/s or m/s]")
    acceleration: list[float | None] = Field(description="largest acceleration [rad/s² or m/s²]")
    jerk: list[float | None] = Field(description="largest jerk [rad/s³ or m/s³]")
    effort: list[float | None] = Field(description="largest torque or force [N m or N]")


class RobotSummary(Answer):
    """A robot in the list."""

    name: str = Field(examples=["panda"], description="of the robot")
    built_in: bool = Field(description="it is always there and can't be deleted")
    joints: int = Field(examples=[7], description="number of joints of its chain")


class RobotList(Answer):
    """All robots by name, built-in ones among them."""

    robots: list[RobotSummary] = Field(description="by name")
    next: str | None = Field(None, description="value of `after` for the next page")


class SuspectedPair(Answer):
    """Two links that touch where the robot surely may stand."""

    pair: list[str] = Field(description="names of the two links")
    reason: str = Field(examples=["zero pose"], description="where they touch")


class FingerJoint(Answer):
    """A joint of a gripper that others may follow."""

    position: float = Field(description="where the robot holds it [rad or m]")
    lower: float | None = Field(description="least position [rad or m]; null without a limit")
    upper: float | None = Field(description="largest position [rad or m]; null without a limit")


class RobotAnswer(Answer):
    """The model of a robot."""

    name: str = Field(examples=["panda"], description="under which it is stored")
    built_in: bool = Field(description="it is always there and can't be deleted")
    hash: str = Field(description="of the model with its solids, as answers to plans give it")
    joint_names: list[str] = Field(description="order of all joint vectors")
    joint_types: list[Literal["revolute", "prismatic"]] = Field(description="kind of each joint")
    limits: Limits
    links: list[str] = Field(description="from the root on")
    frame: str = Field(description="the root link, in whose frame all poses are")
    base_link: str = Field(description="where the chain begins")
    tip_link: str = Field(description="where the chain ends")
    states: dict[str, list[float]] = Field(
        default_factory=dict,
        description="named states of the SRDF for the joints of the chain [rad or m]",
    )
    default_limits: DefaultLimits | None = Field(None, description="of the request")
    held: dict[str, float] | None = Field(None, description="of the request")
    fingers: dict[str, FingerJoint] = Field(
        default_factory=dict,
        description="joints of the gripper that `fingers` of requests may move; those that follow "
        "others are left out",
    )
    motors: dict[str, Motor] | None = Field(
        None, description="by joint, of a table's rows or of the request; null where it has none"
    )
    dh: DhAnswer | None = None
    wrist: Literal["spherical", "three_parallel", "none"] = Field(
        description="kind of inverse kinematics in closed form"
    )
    allowed_collisions: list[list[str]] = Field(
        examples=[[["panda_link0", "panda_link1"]]], description="pairs of links that may touch"
    )
    allowed_collision_reasons: list[str] = Field(
        examples=[["adjacent"]],
        description="for each of these pairs: same body, adjacent, always, srdf or suspected",
    )
    suspected_collisions: list[SuspectedPair] = Field(
        default_factory=list,
        description="without an SRDF: pairs that touch in the zero pose, in a named state or "
        "often at random, and are checked unless the upload says allow_suspected",
    )
    lint: list[str] = Field(description="what is odd in the description")
