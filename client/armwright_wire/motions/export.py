"""Exports of motions for robot controllers, on the wire."""

from typing import Annotated, Any, ClassVar, Literal

from pydantic import ConfigDict, Discriminator, Field, Tag

from armwright_wire.base import (
    Answer,
    Beside,
    Body,
    BodyWithRules,
    Label,
    Name,
    NonNegative,
    Number,
    Ratio,
    examples,
)
from armwright_wire.motions.certificate import CertificateAnswer, Premises
from armwright_wire.motions.trajectory import TrajectoryBody
from armwright_wire.scenes.check import SceneRequest, WithFingers

Format = Literal[
    "joint_trajectory_json",
    "joint_trajectory_yaml",
    "ros2_control",
    "csv",
    "urscript_servoj",
    "urscript_movej",
    "rapid",
    "krl",
    "egm",
    "rsi",
    "mcap",
]


class KeptMotion(Body):
    """A plan, task, tour or proof that was answered, as `GET /v1/plans/{id}` tells it."""

    operation: Literal["POST /v1/plan", "POST /v1/tasks", "POST /v1/tours", "POST /v1/validate"]
    """that was asked for"""
    request: dict[str, Any]
    """as it was sent"""
    answer: dict[str, Any]
    """all of it"""


def _by_form(value: object) -> str:
    return "id" if isinstance(value, str) else "inline"


PlanSource = Annotated[
    Annotated[Annotated[str, Field(max_length=64)], Tag("id")]
    | Annotated[KeptMotion, Tag("inline")],
    Discriminator(_by_form),
    Field(
        description="in place of a trajectory: id of a kept plan, task, tour or proof, or one as "
        "it was answered; robot, tools, scene and what is held are those of its request",
        examples=["0198f2a1b3c44d5e8f90a1b2c3d4e5f6"],
    ),
]


class ExportRequest(SceneRequest, WithFingers, BodyWithRules):
    """A motion to be written for a controller, and proved as the controller interpolates it."""

    model_config = ConfigDict(json_schema_extra={"examples": examples("ExportRequest")})

    one_of: ClassVar[tuple[str, ...]] = ("trajectory", "plan")
    needs: ClassVar[Beside] = {"trajectory": ("robot",)}
    only_beside: ClassVar[Beside] = {
        "robot": ("trajectory",),
        "scene": ("trajectory",),
        "tool": ("trajectory",),
        "tcp": ("trajectory",),
        "attached": ("trajectory",),
        "premises": ("trajectory",),
        "ports": ("plan",),
        "gripper": ("plan",),
    }

    robot: Name | None = Field(None, examples=["panda"])
    """name of a stored or built-in robot"""
    trajectory: TrajectoryBody | None = None
    plan: PlanSource | None = None
    format: Format = Field(examples=["ros2_control"])
    """the file to write"""
    sample_period: Annotated[Number, Field(ge=1e-4, le=60.0)] | None = None
    """time between points; quintic has points where pieces of the motion meet as well, cubic where
    the acceleration jumps; those of a path are chosen among such points. Left out, 0.01 s, or the
    cycle of the controller: 0.004 s of egm, 0.012 s of rsi [s]
    """
    sample_count: Annotated[int, Field(ge=2, le=100_000)] | None = None
    """of messages and tables, in place of a period: so many points, evenly spaced; none are added
    where pieces meet
    """
    least_spacing: NonNegative = 0.0
    """of messages and tables: points nearer in time to the one before, or to the end, are left out;
    the interpolation between the others is proved [s]
    """
    interpolation: Literal["quintic", "cubic", "linear"] | None = None
    """of messages and tables: by what each point gives. Left out, quintic where the acceleration is
    continuous, else cubic
    """
    path_tolerance: Annotated[Number, Field(ge=1e-6, le=1.0)] = 1e-3
    """largest distance of the points of the motion from the legs of urscript_movej, rapid and krl,
    Euclidean in joint space [rad]
    """
    blend: Annotated[NonNegative, Field(le=1.0)] = 0.0
    """of urscript_movej, rapid and krl: how far the flange may be from a point where the controller
    begins to cut the corner, at most; each is as large as is proved and as fits its legs. 0 stops
    at each point [m]
    """
    ports: Annotated[dict[Label, int | Label], Field(max_length=1000)] | None = Field(
        None, examples=[{"spindle": 2}]
    )
    """numbers or names in the controller of outputs and inputs, by those of stages"""
    gripper: Annotated[int, Field(ge=0)] | Label | None = None
    """digital output that closes the gripper; left out, the program calls gripper_to(positions,
    seconds), which the cell has
    """
    speed: Ratio = 0.1
    """of urscript_movej, rapid and krl: share of the axes' largest speeds"""
    name: Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]{0,23}$")] = "armwright"
    """of the program and of the file"""
    frame_id: Annotated[str, Field(max_length=256)] = ""
    """of the header of a ROS message"""
    premises: Premises | None = None
    """those of the certificate that the motion has; where robot, scene or what is held differ from
    them the export is refused
    """
    different_scene: bool = False
    """export all the same, proved for the robot and scene of this request"""


class ExportPart(Answer):
    """A part of a program, with its proof."""

    label: str
    """number and kind of a stage, or the ends of a leg"""
    kind: str
    """of the stage; leg, wait or plan of other motions"""
    certificate: CertificateAnswer
    """of the controller's motion, with what is held in it"""


class ExportAnswer(Answer):
    """A file for a controller, and what is proved of the motion that the controller makes of it."""

    format: Format
    """kind of file"""
    file_name: str = Field(examples=["armwright.yaml"])
    """under which to save it"""
    content: str
    """the text of the file; of mcap its bytes in base64"""
    point_count: int
    """points in the file"""
    interpolation: Literal["quintic", "cubic", "linear", "straight_legs"]
    """the rule between the points that the proof is about"""
    proved: bool
    """nothing collides where the controller keeps to the rule, which covers all of the file"""
    unproved: list[str]
    """parts that the proof does not cover, as the file says"""
    joint_deviation: list[float] | None
    """largest difference between the motion of the request and that of the controller, of each
    joint over all t [rad or m]; null for a path, which has other times
    """
    joint_tolerance: float | None
    """nothing collides while every joint is off by less than this [rad or m]; null where that is
    not proved, or nothing can collide
    """
    blends: list[float]
    """how far the flange is at most from each point where the controller begins to cut its corner;
    0 where it stops or follows the rule [m]
    """
    certificate: CertificateAnswer | None
    """of the controller's motion; of a path its positions and collisions alone; null of a program,
    whose parts have their own
    """
    parts: list[ExportPart] | None = None
    """of a program, in order; null of a trajectory"""
