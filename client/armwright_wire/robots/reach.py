"""Reach of an arm on the wire."""

from collections.abc import Sequence
from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, field_validator, model_validator
from pydantic.config import JsonDict

from armwright_wire.base import (
    AS_LIST,
    Answer,
    Body,
    BodyWithRules,
    FreeOrRange,
    InFrame,
    Label,
    Number,
    Positive,
    Range,
    Seed,
    is_given,
)
from armwright_wire.pose import Pose, PoseAnswer, Quaternion, check_quaternion_norm
from armwright_wire.scenes.check import AllowedAnswers, SceneRequest

#: Poses that are listed one by one: at 100 bytes each, ten megabytes.
MAX_POSES = 100_000
MAX_ORIENTATIONS = 1_000
#: Candidates for the base.
MAX_BASES = 10_000
#: Poses whose configurations are answered where nothing is said about that.
JOINTS_UP_TO = 10_000

Quaternions = Annotated[
    Sequence[Quaternion], AS_LIST, Field(min_length=1, max_length=MAX_ORIENTATIONS)
]
Edge = Annotated[float, Field(ge=0.0, le=1e3)]


class ReachTolerance(FreeOrRange):
    """Deviation that is allowed from each pose, in its own frame: x, y, z, then Rx Ry Rz."""

    samples: Annotated[int, Field(ge=1, le=360)] = 12
    """values tried on each of these axes"""


class ReachBox(Body):
    """A box of the workspace with a grid of points, each with all orientations."""

    size: Annotated[list[Edge], Field(min_length=3, max_length=3)] = Field(
        examples=[[1.2, 1.2, 0.0]]
    )
    """lengths of its edges [m]; 0 for a plane or a line"""
    pose: Pose
    """of its centre"""
    spacing: Positive
    """largest distance of neighbouring points [m]"""
    orientations: Quaternions = Field(
        default_factory=lambda: [[0.0, 0.0, 0.0, 1.0]], examples=[[[1.0, 0.0, 0.0, 0.0]]]
    )
    """of the link at every point, x, y, z, w"""

    @field_validator("orientations")
    @classmethod
    def _check_quaternions(cls, value: list[list[float]]) -> list[list[float]]:
        for quaternion in value:
            check_quaternion_norm(quaternion)
        return value


class BaseRegion(Body):
    """Candidates for the base on a rectangle of the floor, turned about the vertical."""

    x: Range = Field(examples=[[-0.5, 0.5]])
    """[least, largest] [m]"""
    y: Range = Field(examples=[[-0.5, 0.5]])
    """[least, largest] [m]"""
    z: Number = 0.0
    """height of the base [m]"""
    spacing: Positive
    """largest distance of neighbouring candidates [m]"""
    yaws: Annotated[int, Field(ge=1, le=360)] = 8
    """angles about z, evenly over a turn"""


class ReachRequest(SceneRequest, BodyWithRules):
    """Task poses and what stands around; with candidates for the base also where to stand."""

    one_of: ClassVar[tuple[str, ...]] = ("poses", "box")
    at_most_one = (("bases", "base_region"), ("frame", "bases"), ("frame", "base_region"))
    published_rules: ClassVar[tuple[JsonDict, ...]] = (
        {"anyOf": [is_given("box"), {"properties": {"format": {"const": "json"}}}]},
    )

    poses: Annotated[list[Pose], Field(min_length=1, max_length=MAX_POSES)] | None = None
    """task poses of the link"""
    box: ReachBox | None = None
    """a grid of poses in place of a list"""
    link: Label | None = None
    """the tip if left out"""
    tolerance: ReachTolerance | None = None
    choice: Literal["manipulability", "clearance", "limits", "first"] = "manipulability"
    """what makes the best configuration of a pose; with `first` the first one that is found free
    will do, and `branches` and `samples` count no further
    """
    clearance: bool = True
    """measure the clearance of the best configurations"""
    joints: bool | None = Field(
        None, description=f"answer the best configurations; for up to {JOINTS_UP_TO} poses if left "
        "out",
    )  # fmt: skip
    bases: Annotated[list[Pose], Field(min_length=1, max_length=MAX_BASES)] | None = None
    """candidates for the base; poses and scene are then meant in their frame"""
    base_region: BaseRegion | None = None
    """candidates on the floor instead"""
    format: Literal["json", "svg", "glb"] = "json"
    """arrays, or with box and one orientation a picture of its slices, or a coloured mesh of what
    is reached (binary glTF)
    """
    seed: Seed = 0

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if self.format != "json" and self.box is None:
            raise ValueError("a picture needs box")
        return self


class ReachGrid(Answer):
    """Order of the arrays of a box: x changes slowest, then y, z and the orientation."""

    shape: list[int]
    """numbers along x, y, z and of orientations"""
    axes: list[list[float]]
    """coordinates along the box's axes [m]"""


class BaseAnswer(Answer):
    """One candidate for the base; figures are the worst of the poses that are reached."""

    index: int
    """number of the candidate"""
    pose: PoseAnswer
    reached: int
    """how many of the poses"""
    clearance: float | None
    """[m]; null where nothing can collide"""
    manipulability: float | None
    """product of the Jacobian's singular values; null where nothing is reached"""
    limit_distance: float | None
    """share of half its range left to the joint nearest to a limit; null likewise"""
    unreached: list[int]
    """numbers of the first poses that are not reached"""


class ReachAnswer(InFrame):
    """Reach of the poses in their order; with candidates for the base that from the best one."""

    count: int
    """number of poses"""
    reached: int
    """how many of them are reached"""
    statuses: list[str]
    """names of the numbers in status"""
    status: list[int]
    """of each pose: a place in `statuses`"""
    branches: list[int]
    """branches of inverse kinematics that are free of collision"""
    samples: list[int]
    """deviations within the tolerance that are reached"""
    manipulability: list[float | None]
    """product of the Jacobian's singular values at the best configuration"""
    clearance: list[float | None]
    """of the best configuration, margins taken off [m]; null where it was not asked for or nothing
    can collide
    """
    limit_distance: list[float | None]
    """share of half its range left to the joint nearest to a limit, 0 … 1"""
    joints: list[list[float] | None] | None
    """the best configurations"""
    joint_names: list[str]
    """order of the configurations"""
    grid: ReachGrid | None = None
    bases: list[BaseAnswer] | None = None
    """best first"""
    allowed_collisions: AllowedAnswers = Field(default_factory=list)
