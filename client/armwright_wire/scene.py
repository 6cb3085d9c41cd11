"""Scenes on the wire."""

from typing import Annotated, ClassVar, Literal

from pydantic import ConfigDict, Discriminator, Field, Tag, field_validator, model_validator
from pydantic.config import JsonDict

from armwright_wire.base import (
    Answer,
    Body,
    Frame,
    Label,
    Name,
    NonNegative,
    Point,
    distinct,
    exactly_one,
)
from armwright_wire.pose import FramedPose
from armwright_wire.shape import MAX_POINTS, Shape

MAX_OBSTACLES = 10_000
_MAX_PAIRS = 100_000
_MAX_YAML = 16 * 1024 * 1024

Pair = Annotated[list[Label], Field(min_length=2, max_length=2)]


class LimitedPair(Body):
    """A pair that may touch, and how deep."""

    pair: Pair = Field(examples=[["gripper", "part"]], description="names of the two bodies")
    touch_depth: NonNegative | None = Field(
        None, description="how deep they may overlap [m]; null for any depth"
    )


def _form_of_pair(value: object) -> str:
    return "limited" if isinstance(value, dict | LimitedPair) else "pair"


AllowedItem = Annotated[
    Annotated[Pair, Tag("pair")] | Annotated[LimitedPair, Tag("limited")],
    Discriminator(_form_of_pair),
]

_EXAMPLE: JsonDict = {
    "name": "table",
    "obstacles": [
        {
            "id": "table_top",
            "shape": {"type": "box", "size": [1.0, 0.8, 0.04]},
            "pose": {"position": [0.6, 0.0, 0.2]},
        },
        {
            "id": "post",
            "shape": {"type": "cylinder", "radius": 0.05, "height": 0.6},
            "pose": {"position": [0.5, 0.3, 0.5], "quaternion_xyzw": [0.0, 0.0, 0.0, 1.0]},
            "margin": 0.01,
        },
    ],
    "allowed_collisions": [["panda_link0", "table_top"]],
}


class Obstacle(Body):
    """A shape at a pose, to be kept away from by its margin [m]."""

    id: Label = Field(
        examples=["table_top"], description="name of the obstacle, unique in its scene"
    )
    shape: Shape = Field(description="in the obstacle's own frame")
    pose: FramedPose
    margin: Annotated[NonNegative, Field(le=10.0)] | None = Field(
        None, description="distance to be kept from it [m]; 0 if left out"
    )


class Scene(Body):
    """Obstacles, or the text of a MoveIt planning scene."""

    one_of: ClassVar[tuple[str, ...]] = ("obstacles", "moveit")

    model_config = ConfigDict(json_schema_extra={"examples": [_EXAMPLE]})

    name: Name | None = Field(None, description="under which it is stored, where it is")
    frame: Frame | None = None
    obstacles: Annotated[list[Obstacle], Field(max_length=MAX_OBSTACLES)] | None = Field(
        None, description="shapes to keep away from"
    )
    moveit: Annotated[str, Field(min_length=1, max_length=_MAX_YAML)] | None = Field(
        None, description="planning scene of MoveIt: its YAML, or the text of its .scene file"
    )
    allowed_collisions: Annotated[list[AllowedItem], Field(max_length=_MAX_PAIRS)] | None = Field(
        None, description="pairs of links or obstacles that may touch"
    )

    @field_validator("obstacles")
    @classmethod
    def _check_ids(cls, value: list[Obstacle] | None) -> list[Obstacle] | None:
        distinct([obstacle.id for obstacle in value or ()], "obstacle")
        return value

    @model_validator(mode="after")
    def _check_form(self) -> "Scene":
        exactly_one(self, self.one_of)
        return self


class NamedScene(Scene):
    """A scene to be stored."""

    name: Name = Field(examples=["table"], description="under which it is stored")


def _by_name(value: object) -> str:
    return "name" if isinstance(value, str) else "inline"


#: A stored scene by its name, or a scene.
SceneReference = Annotated[
    Annotated[Name, Tag("name")] | Annotated[Scene, Tag("inline")],
    Discriminator(_by_name),
    Field(description="name of a stored scene, or a scene; no obstacles if left out"),
]


class SceneSummary(Answer):
    """Summary of a stored scene, without its obstacles."""

    name: str = Field(examples=["table"], description="of the scene")
    hash: str = Field(description="SHA-256 of the stored document")
    version: int = Field(examples=[1], description="counts the replacements")
    created: str = Field(
        examples=["2026-11-21T09:30:00+00:00"], description="when it was stored first"
    )
    updated: str = Field(
        examples=["2026-11-21T09:30:00+00:00"], description="when it was stored last"
    )


class SceneList(Answer):
    """Stored scenes by name; `next` continues the list, if there are more."""

    scenes: list[SceneSummary] = Field(description="by name")
    next: str | None = Field(None, description="value of `after` for the next page")


#: What projects points onto obstacles.
Engine = Literal["exact", "fcl"]


class ProjectRequest(Body):
    """Points to be projected onto every obstacle of a scene."""

    points: Annotated[list[Point], Field(min_length=1, max_length=MAX_POINTS)] = Field(
        examples=[[[0.5, 0.0, 0.4]]], description="to be projected [m]"
    )
    engine: Engine = Field(
        "exact",
        description="what finds the nearest points: closed forms, or FCL's distance query (inside "
        "of obstacles the closed forms answer for both)",
        examples=["fcl"],
    )


class Projection(Answer):
    """The orthogonal projection of a point onto one obstacle."""

    obstacle: str = Field(examples=["table_top"], description="its name")
    projection: list[float] = Field(
        examples=[[0.5, 0.0, 0.22]], description="the nearest point of the obstacle's surface [m]"
    )
    distance: float = Field(examples=[0.18], description="[m], negative inside")


class ProjectAnswer(Answer):
    """For each point its projection onto every obstacle."""

    projections: list[list[Projection]] = Field(description="for each point one for each obstacle")
    frame: str | None = Field(
        None, description="of the scene, which points and projections are in; the root if null"
    )
