"""Robots on the wire: motors, Denavit-Hartenberg tables, uploads, models and geometry."""

import base64
import struct
from typing import Annotated, ClassVar, Literal, TypeAlias

from pydantic import ConfigDict, Discriminator, Field, Tag, field_validator, model_validator

from armwright_wire.base import (
    MAX_JOINTS,
    Answer,
    Beside,
    Body,
    BodyWithRules,
    Coordinate,
    Label,
    Length,
    Matrix3,
    Name,
    NamePair,
    NonNegative,
    Number,
    Point,
    Positive,
    Vector3,
    any_given,
    examples,
    not_where,
)
from armwright_wire.pose import Pose, PoseAnswer
from armwright_wire.scenes.scene import Shape, check_base64
from armwright_wire.scenes.tool import NamedTool

GeometryKind: TypeAlias = Literal["collision", "visual"]


class Motor(Body):
    """A direct current motor behind a gear, seen from the joint as J q̈ + B q̇ = u − load."""

    inertia: NonNegative
    """J_m of the rotor [kg m²]"""
    friction: NonNegative = 0.0
    """B_m at the rotor [N m s/rad]"""
    torque_constant: Positive = 1.0
    """k_m [N m/A]"""
    back_emf: NonNegative = 0.0
    """k_b [V s/rad]"""
    resistance: Positive = 1.0
    """R [ohm]"""
    gear_ratio: Positive = 1.0
    """turns of the motor for one of the joint"""
    voltage_limit: Positive | None = None
    """largest |V| at its terminals [V]: with `saturate` torques are cut off there"""


class LinkInertia(Body):
    """Mass properties in place of a link's own."""

    mass: Positive
    """[kg]"""
    center_of_mass: Vector3
    """in the link's frame [m]"""
    inertia: Matrix3
    """about the centre of mass, in the link's axes [kg m²]"""


_Drive = Annotated[list[NonNegative], Field(max_length=MAX_JOINTS)]


class RobotInertias(Body):
    """Bodies and drives in place of a description's, as `identify` answers them."""

    origin: Annotated[str, Field(max_length=1_000)] = Field(examples=["identified from 2 logs"])
    """where they are from; told in lint"""
    links: Annotated[dict[Label, LinkInertia], Field(min_length=1, max_length=MAX_JOINTS)]
    """by a link of each joint's: the body of all that moves with that joint, in the frame of the
    link; other links there have none then
    """
    motor_inertia: _Drive | None = None
    """J, a number a joint [kg m² or kg]; as before if left out"""
    viscous_friction: _Drive | None = None
    """B, a number a joint [N m s/rad or N s/m]; likewise"""
    coulomb_friction: _Drive | None = None
    """dry friction F, a number a joint [N m or N]; likewise"""


_MAX_XML = 16 * 1024 * 1024
Xml = Annotated[str, Field(min_length=1, max_length=_MAX_XML)]


class RobotCalibration(Body):
    """Corrections of joints' frames, as `calibrate` answers them."""

    origin: Annotated[str, Field(max_length=1_000)] = Field(
        examples=["measured by a laser tracker"]
    )
    """where they are from; told in lint"""
    joints: Annotated[dict[Label, Pose], Field(min_length=1, max_length=MAX_JOINTS)]
    """each joint's frame, z along its axis, in the frame that the description has"""
    file: Xml | None = None
    """text of a maker's file that stands before them, of a URDF"""


#: Solids of one link.
_MAX_SOLIDS = 100


class LinkSolid(Body):
    """A shape that a link carries."""

    shape: Shape
    """of the solid"""
    pose: Pose | None = None
    """in the link's frame, which is frame i of row i; the frame itself if null"""


class LinkCapsules(Body):
    """Capsules about the segments a and d of every row."""

    capsules: Length = Field(examples=[0.06])
    """their radius [m]"""


class JointLimits(Body):
    """Limits of a joint: of an upload those that its description leaves out, or tighter ones."""

    lower: Number | None = None
    """[rad] or [m]"""
    upper: Number | None = None
    """[rad] or [m]"""
    velocity: Positive | None = None
    """largest speed [rad/s or m/s]"""
    acceleration: Positive | None = None
    """largest acceleration [rad/s² or m/s²]"""
    jerk: Positive | None = None
    """largest jerk [rad/s³ or m/s³]"""
    effort: Positive | None = None
    """largest torque or force [N m or N]"""


class DhRow(JointLimits, BodyWithRules):
    """One joint of a Denavit-Hartenberg table, with what is known of the link behind it.

    For a revolute joint `theta` is the offset of the joint variable, for a prismatic one `d` is.
    """

    published_rules = (
        not_where("lower", continuous=True),
        not_where("upper", continuous=True),
    )
    at_most_one = (("motor", "motor_inertia"), ("motor", "viscous_friction"))

    type: Literal["revolute", "prismatic"]
    """kind of joint"""
    a: Coordinate
    """[m]"""
    alpha: Number
    """[rad]"""
    d: Coordinate
    """[m]"""
    theta: Number
    """[rad]"""
    mass: NonNegative | None = None
    """[kg]"""
    center_of_mass: Point | None = None
    """in the link frame [m]"""
    inertia: Matrix3 | None = None
    """about the centre of mass in the link frame [kg m²]"""
    motor_inertia: NonNegative | None = None
    """reflected at the joint [kg m² or kg]"""
    viscous_friction: NonNegative | None = None
    """at the joint [N m s/rad or N s/m]"""
    coulomb_friction: NonNegative | None = None
    """dry friction [N m or N]"""
    motor: Motor | None = None
    """what drives the joint, in place of motor_inertia and viscous_friction; every row has one, or
    none has
    """
    beta: Number = 0.0
    """about y, behind alpha [rad]; 0 but for nearly parallel axes"""
    continuous: bool = False
    """without end: lower and upper are left out or null"""
    geometry: Annotated[list[LinkSolid], Field(max_length=_MAX_SOLIDS)] | None = None
    """solids of the link behind the joint"""

    @model_validator(mode="after")
    def _check_limits(self) -> "DhRow":
        if self.continuous and not (self.lower is None and self.upper is None):
            raise ValueError("a continuous joint has neither lower nor upper")
        if self.lower is not None and self.upper is not None and self.lower >= self.upper:
            raise ValueError(f"lower ({self.lower:g}) must be less than upper ({self.upper:g})")
        return self


class DhTable(Body):
    """A robot by its Denavit-Hartenberg parameters."""

    convention: Literal["standard", "modified"]
    """frame i at the end of link i (standard) or at its beginning (modified)"""
    rows: Annotated[list[DhRow], Field(min_length=1, max_length=MAX_JOINTS)]
    """one for each joint, from the base on"""
    base: Pose | None = None
    """frame 0 in the root frame; the root frame itself if left out"""
    tool: Pose | None = None
    """the tip in frame n; frame n itself if left out"""
    gravity: Vector3 | None = None
    """in the root frame [m/s²]"""
    geometry: LinkCapsules | None = None
    """solids of all links, beside those of the rows"""


class DhRowAnswer(Answer):
    """One row of the table that was given, or that is derived from the joint axes."""

    type: Literal["revolute", "prismatic"]
    """kind of joint"""
    a: float
    """link length [m]"""
    alpha: float
    """link twist [rad]"""
    d: float
    """link offset [m]"""
    theta: float
    """joint angle [rad]"""
    lower: float | None = None
    """[rad] or [m]; null where there is none"""
    upper: float | None = None
    """[rad] or [m]; null where there is none"""
    velocity: float | None = None
    """largest speed [rad/s or m/s]"""
    acceleration: float | None = None
    """largest acceleration [rad/s² or m/s²]"""
    jerk: float | None = None
    """largest jerk [rad/s³ or m/s³]"""
    effort: float | None = None
    """largest torque or force [N m or N]"""
    mass: float | None = None
    """of all that moves with the joint [kg]"""
    center_of_mass: list[float] | None = None
    """in frame i [m]"""
    inertia: list[list[float]] | None = None
    """about the centre of mass in the axes of frame i [kg m²]"""
    motor_inertia: float | None = None
    """null where there is a `motor`"""
    viscous_friction: float | None = None
    """null where there is a `motor`"""
    coulomb_friction: float | None = None
    """dry friction [N m or N]"""
    motor: Motor | None = None
    """what drives the joint, as it was given"""
    beta: float = 0.0
    """about y, behind alpha; 0 but for nearly parallel axes"""
    continuous: bool = False
    """without end: no lower and no upper limit"""
    geometry: list[LinkSolid] | None = None
    """as it was given"""


class DhAnswer(Answer):
    """The Denavit-Hartenberg table of a robot: the tool's pose is base H_1 … H_n tool."""

    convention: Literal["standard", "modified"]
    """frame i at the end of link i (standard) or at its beginning (modified)"""
    rows: list[DhRowAnswer]
    """one for each joint"""
    base: PoseAnswer
    """frame 0 in the root frame"""
    tool: PoseAnswer
    """the tip in frame n"""
    gravity: list[float] | None = None
    """in the root frame [m/s²]"""
    geometry: LinkCapsules | None = None
    """as it was given"""

    def table(self) -> DhTable:
        """The table to be sent, say to store the robot under another name."""
        return DhTable.model_validate(self.model_dump(exclude_none=True))


#: Mesh files of one robot.
MAX_MESHES = 1_000
_MAX_URI = 1_024

#: Text of a joint_limits.yaml: a kilobyte a joint.
_MAX_LIMITS = 1_000_000

#: A number times another limit.
Rule = Annotated[str, Field(pattern=r"^[0-9eE+.\- ]+[x*×] *[a-z]+ *$", max_length=64)]
Uri = Annotated[str, Field(min_length=1, max_length=_MAX_URI)]


class DefaultLimits(Body):
    """Rules for limits that are known nowhere else: a number times another limit."""

    acceleration: Rule | None = Field(None, examples=["10 x velocity"])
    """rule for accelerations"""
    jerk: Rule | None = Field(None, examples=["10 x acceleration"])
    """rule for jerks"""


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


#: Corrections by joint, or the text of a maker's file.
Calibrations = Annotated[
    Annotated[RobotCalibration, Tag("object")] | Annotated[Xml, Tag("text")],
    Discriminator(_by_form),
    Field(
        description="corrections of joints' frames; or of a URDF the text of a kinematics file as "
        "ur_calibration writes it"
    ),
]


class RobotFields(Body):
    """Fields of a robot beside its description."""

    name: Name
    """under which the robot is stored"""
    base_link: Label | None = None
    """where the chain begins; poses are in the root frame all the same, unless this is work that a
    positioner moves beside the arm: then they are in its frame
    """
    tip_link: Label | None = None
    """where it ends; the likely tip if left out, told in lint"""
    joint_limits: LimitsOfJoints | None = None
    default_limits: DefaultLimits | None = None
    """rules for limits that neither the description nor joint_limits gives"""
    inertias: RobotInertias | None = None
    """bodies and drives in place of the description's"""
    calibration: Calibrations | None = None
    allow_suspected: bool = False
    """let pairs touch that the answer's suspected_collisions tells; only where no SRDF says which
    may
    """
    visual_solids: bool = False
    """of a URDF: links without collision geometry collide as they look"""
    held: Annotated[dict[Label, Number], Field(max_length=1_000)] | None = None
    """positions of joints off the chain [rad or m]; 0, or the limit nearest to it, for those left
    out
    """
    tools: Annotated[list[NamedTool], Field(min_length=1, max_length=100)] | None = None
    """of this robot: requests name them in `tool`, as those of /v1/tools"""
    motors: Annotated[dict[Label, Motor], Field(max_length=1_000)] | None = None
    """of a URDF by joint, "*" is every other joint of the chain: they give its joints their motor
    inertias, and frictions in place of its damping; all joints have one, or none has. Rows of a dh
    table have a `motor` each
    """


class RobotChanges(Body):
    """Limits, inertias and frames of a stored robot that change; all else stays."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [{"joint_limits": {"*": {"acceleration": 4.0}}}],
            **any_given(("joint_limits",), ("default_limits",), ("inertias",), ("calibration",)),
        }
    )

    joint_limits: LimitsOfJoints | None = None
    default_limits: DefaultLimits | None = None
    """rules in place of those of before"""
    inertias: RobotInertias | None = None
    """bodies and drives in place of those of before"""
    calibration: Calibrations | None = None

    @model_validator(mode="after")
    def _check_form(self) -> "RobotChanges":
        if not any(getattr(self, name) is not None for name in type(self).model_fields):
            raise ValueError("give joint_limits, default_limits, inertias or calibration")
        return self


class ArchiveFields(RobotFields):
    """Fields of a robot that comes in an archive."""

    urdf_path: Uri | None = None
    """which .urdf file is meant, by its path in the archive or the end of it"""
    srdf_path: Uri | None = None
    """which .srdf file belongs to it, likewise"""


class RobotBody(RobotFields, BodyWithRules):
    """A robot as URDF or as a Denavit-Hartenberg table."""

    one_of: ClassVar[tuple[str, ...]] = ("urdf", "dh")
    needs: ClassVar[Beside] = dict.fromkeys(("srdf", "meshes", "held", "motors"), ("urdf",))
    published_rules = (not_where("dh", visual_solids=True),)

    model_config = ConfigDict(json_schema_extra={"examples": examples("RobotBody")})

    urdf: Xml | None = None
    """text of the URDF"""
    srdf: Xml | None = None
    """text of the SRDF that belongs to it"""
    dh: DhTable | None = None
    meshes: Annotated[dict[Uri, str], Field(max_length=MAX_MESHES)] | None = None
    """package:// or relative URI of the URDF → file in base64: of what links collide with, and
    perhaps of what they look like
    """

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
        if self.dh is not None:
            if isinstance(self.calibration, str) or getattr(self.calibration, "file", None):
                raise ValueError("a maker's calibration belongs to a URDF, not to a dh table")
            if self.visual_solids:
                raise ValueError("visual_solids belongs to a URDF, not to a dh table")
        return self


class Limits(Answer):
    """Limits in the order of the joints; null where there is none."""

    lower: list[float | None]
    """least position [rad or m]"""
    upper: list[float | None]
    """largest position [rad or m]"""
    velocity: list[float | None]
    """largest speed [rad/s or m/s]"""
    acceleration: list[float | None]
    """largest acceleration [rad/s² or m/s²]"""
    jerk: list[float | None]
    """largest jerk [rad/s³ or m/s³]"""
    effort: list[float | None]
    """largest torque or force [N m or N]"""


class RobotSummary(Answer):
    """A robot in the list."""

    name: str = Field(examples=["panda"])
    """of the robot"""
    built_in: bool
    """it is always there and can't be deleted"""
    joints: int = Field(examples=[7])
    """number of joints of its chain"""


class RobotList(Answer):
    """All robots by name, built-in ones among them."""

    robots: list[RobotSummary]
    """by name"""
    next: str | None = None
    """value of `after` for the next page"""


class SuspectedPair(Answer):
    """Two links that touch where the robot surely may stand."""

    pair: NamePair
    """names of the two links"""
    reason: str = Field(examples=["zero pose"])
    """where they touch"""


class FingerJoint(Answer):
    """A joint of a gripper that others may follow."""

    position: float
    """where the robot holds it [rad or m]"""
    lower: float | None
    """least position [rad or m]; null without a limit"""
    upper: float | None
    """largest position [rad or m]; null without a limit"""


class RobotAnswer(Answer):
    """The model of a robot."""

    name: str = Field(examples=["panda"])
    """under which it is stored"""
    built_in: bool
    """it is always there and can't be deleted"""
    hash: str
    """of the model with its solids, as answers to plans give it"""
    joint_names: list[str]
    """order of all joint vectors"""
    joint_types: list[Literal["revolute", "prismatic"]]
    """kind of each joint"""
    limits: Limits
    links: list[str]
    """from the root on"""
    frame: str
    """the root link, in whose frame all poses are"""
    base_link: str
    """where the chain begins"""
    tip_link: str
    """where the chain ends"""
    states: dict[str, list[float]] = Field(default_factory=dict)
    """named states of the SRDF for the joints of the chain [rad or m]"""
    default_limits: DefaultLimits | None = None
    """of the request"""
    held: dict[str, float] | None = None
    """of the request"""
    inertias: RobotInertias | None = None
    """of the request"""
    calibration: RobotCalibration | str | None = None
    """of the request"""
    tools: list[str] = Field(default_factory=list)
    """names of its own tools"""
    fingers: dict[str, FingerJoint] = Field(default_factory=dict)
    """joints of the gripper that `fingers` of requests may move; those that follow others are left
    out
    """
    motors: dict[str, Motor] | None = None
    """by joint, of a table's rows or of the request; null where it has none"""
    dh: DhAnswer | None = None
    wrist: Literal["spherical", "three_parallel", "none"]
    """kind of inverse kinematics in closed form"""
    allowed_collisions: list[list[str]] = Field(examples=[[["panda_link0", "panda_link1"]]])
    """pairs of links that may touch"""
    allowed_collision_reasons: list[str] = Field(examples=[["adjacent"]])
    """for each of these pairs: same body, adjacent, always, srdf or suspected"""
    suspected_collisions: list[SuspectedPair] = Field(default_factory=list)
    """without an SRDF: pairs that touch in the zero pose, in a named state or often at random, and
    are checked unless the upload says allow_suspected
    """
    lint: list[str]
    """what is odd in the description"""


class BodySurface(Answer):
    """The surface of one link, or its part of one colour, as triangles in the frame of a link."""

    link: str
    """the link that the surface belongs to"""
    frame: str
    """link whose frame the vertices are in; forward kinematics has it"""
    vertices: str = Field(examples=["AAAAAA=="])
    """corners x, y, z [m]: float32, little-endian, in base64"""
    faces: str = Field(examples=["AAAAAA=="])
    """three numbers of corners for each triangle, counter-clockwise from outside: uint32,
    little-endian, in base64
    """
    simplified: bool
    """hulls stand for the triangles of its meshes, or visual ones are thinned out"""
    color: list[float] | None = Field(None, examples=[[0.9, 0.9, 0.9, 1.0]])
    """red, green, blue, opacity from 0 to 1 of visual geometry, from the URDF's material or the
    file's; null where neither gives one
    """

    def corners(self) -> list[tuple[float, float, float]]:
        """The vertices [m]."""
        return list(struct.iter_unpack("<3f", base64.b64decode(self.vertices)))

    def triangles(self) -> list[tuple[int, int, int]]:
        """Numbers of the corners of each triangle, counter-clockwise from outside."""
        return list(struct.iter_unpack("<3I", base64.b64decode(self.faces)))


class GeometryAnswer(Answer):
    """The collision or visual geometry of a robot."""

    robot: str
    """name of the robot"""
    hash: str
    """of the model, as answers to plans give it"""
    kind: GeometryKind
    """what the bodies are, as asked for"""
    bodies: list[BodySurface]
    """links that have geometry; links without visual geometry have their collision geometry among
    visual bodies, and a robot that has none at all has no visual bodies
    """
