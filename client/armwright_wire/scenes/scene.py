"""Shapes of obstacles [m], scenes, and projections onto them, on the wire."""

import base64
import binascii
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, ClassVar, Literal, Self

from pydantic import (
    AliasChoices,
    ConfigDict,
    Discriminator,
    Field,
    Tag,
    field_validator,
    model_validator,
)

from armwright_wire.base import (
    AS_LIST,
    Answer,
    Body,
    BodyWithRules,
    Coordinate,
    Frame,
    Label,
    Length,
    Name,
    NonNegative,
    Point,
    Vector3,
    any_given,
    distinct,
    examples,
)
from armwright_wire.pose import PoseInFrame

#: Caps on what one shape may consist of.
MAX_VERTICES = 200_000
MAX_FACES = 400_000
MAX_POINTS = 100_000

_Vertices = Annotated[list[Point], Field(max_length=MAX_VERTICES)]
_Face = Annotated[
    list[Annotated[int, Field(ge=0, lt=MAX_VERTICES)]], Field(min_length=3, max_length=3)
]
#: Shorter axes have no direction that could be trusted.
_LEAST_NORMAL = 1e-6


Edges = Annotated[Sequence[Length], AS_LIST, Field(min_length=3, max_length=3)]


class Box(Body):
    """A box centred in its frame, with its full edge lengths along x, y, z."""

    type: Literal["box"] = "box"
    size: Edges = Field(examples=[[0.2, 0.3, 0.5]])
    """edge lengths along x, y, z [m]"""


class Sphere(Body):
    """A sphere centred in its frame."""

    type: Literal["sphere"] = "sphere"
    radius: Length = Field(examples=[0.1])
    """[m]"""


class Cylinder(Body):
    """A cylinder centred in its frame, along z."""

    type: Literal["cylinder"] = "cylinder"
    radius: Length = Field(examples=[0.05])
    """about z [m]"""
    height: Length = Field(examples=[0.4])
    """along z [m]"""


class Capsule(Body):
    """A cylinder of the given height along z with a half sphere at each end, centred."""

    type: Literal["capsule"] = "capsule"
    radius: Length = Field(examples=[0.05])
    """of the cylinder and of its ends [m]"""
    height: Length = Field(examples=[0.4])
    """of the cylinder without its ends [m]"""


class Cone(Body):
    """A cone along z, centred at half its height, its tip at +z."""

    type: Literal["cone"] = "cone"
    radius: Length = Field(examples=[0.05])
    """of the base [m]"""
    height: Length = Field(examples=[0.4])
    """from the base to the tip [m]"""


class Halfspace(Body):
    """All points p with normal · p ≤ offset; both are divided by the length of the normal."""

    type: Literal["halfspace"] = "halfspace"
    normal: Vector3 = Field(examples=[[0.0, 0.0, 1.0]])
    """outward direction of the plane, of any length but 0"""
    offset: Coordinate = Field(examples=[0.0])
    """distance of the plane from the origin along the normal, times its length [m]"""

    @field_validator("normal")
    @classmethod
    def _check_normal(cls, value: list[float]) -> list[float]:
        if max(abs(number) for number in value) < _LEAST_NORMAL:
            raise ValueError("the normal has length 0, so it names no direction")
        return value


class Convex(Body):
    """The convex hull of its vertices."""

    type: Literal["convex"] = "convex"
    vertices: Annotated[_Vertices, Field(min_length=4)] = Field(
        examples=[[[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]]]
    )
    """points whose convex hull is meant [m]"""


class Mesh(Body):
    """A triangle mesh: vertices and faces, or an STL file in base64."""

    published_rules = (any_given(("vertices", "faces"), ("stl_base64",)),)
    at_most_one = (("vertices", "stl_base64"), ("faces", "stl_base64"))

    type: Literal["mesh"] = "mesh"
    vertices: Annotated[_Vertices, Field(min_length=3)] | None = None
    """corners of the triangles [m]"""
    faces: Annotated[list[_Face], Field(min_length=1, max_length=MAX_FACES)] | None = None
    """three vertex numbers each, counted from 0"""
    stl_base64: str | None = Field(None, min_length=1)
    """ASCII or binary STL"""

    @field_validator("stl_base64")
    @classmethod
    def _check_base64(cls, value: str | None) -> str | None:
        if value is not None:
            check_base64(value)
        return value

    @classmethod
    def from_stl(cls, path: Path | str) -> Self:
        """The mesh of an STL file.

        Raises:
            OSError: The file can't be read.
        """
        return cls(stl_base64=base64.b64encode(Path(path).read_bytes()).decode("ascii"))

    @model_validator(mode="after")
    def _check_form(self) -> "Mesh":
        if self.stl_base64 is not None:
            if self.vertices is not None or self.faces is not None:
                raise ValueError("give vertices and faces, or stl_base64, not both")
            return self
        if self.vertices is None or self.faces is None:
            raise ValueError("give vertices and faces, or stl_base64")
        count = len(self.vertices)
        for index, face in enumerate(self.faces):
            if max(face) >= count:
                raise ValueError(f"face {index} names vertex {max(face)}, but there are {count}")
        return self


class LeftOut(Body):
    """An object whose own points are left out of a cloud."""

    object: Label = Field(examples=["crate"])
    """name of an obstacle of the same scene"""
    margin: NonNegative = 0.0
    """points nearer to it than this are left out, and those inside of it [m]"""


class PointCloud(Body):
    """A sphere of one radius around every point."""

    # Stored scenes are read again as they were sent.
    model_config = ConfigDict(serialize_by_alias=True)

    type: Literal["point_cloud"] = "point_cloud"
    points: Annotated[list[Point], Field(min_length=1, max_length=MAX_POINTS)] = Field(
        examples=[[[0.5, 0.0, 0.2], [0.5, 0.01, 0.2]]]
    )
    """centres of the spheres [m]"""
    radius: Length = Field(examples=[0.01])
    """of each sphere [m]"""
    except_: Annotated[list[LeftOut], Field(max_length=1_000)] | None = Field(
        None, validation_alias=AliasChoices("except"), serialization_alias="except"
    )
    """objects of the scene about which points are left out"""


Shape = Annotated[
    Box | Sphere | Cylinder | Capsule | Cone | Halfspace | Convex | Mesh | PointCloud,
    Field(discriminator="type"),
]


def check_base64(text: str) -> None:
    """Check that a text is base64.

    Raises:
        ValueError: It is not.
    """
    try:
        base64.b64decode(text, validate=True)
    except (binascii.Error, ValueError):
        raise ValueError("not valid base64") from None


MAX_OBSTACLES = 10_000
_MAX_PAIRS = 100_000
_MAX_YAML = 16 * 1024 * 1024

Pair = Annotated[Sequence[Label], AS_LIST, Field(min_length=2, max_length=2)]


class LimitedPair(Body):
    """A pair that may touch, and how deep."""

    pair: Pair = Field(examples=[["gripper", "part"]])
    """names of the two bodies"""
    touch_depth: NonNegative | None = None
    """how deep they may overlap [m]; null for any depth"""


def _form_of_pair(value: object) -> str:
    return "limited" if isinstance(value, dict | LimitedPair) else "pair"


AllowedItem = Annotated[
    Annotated[Pair, Tag("pair")] | Annotated[LimitedPair, Tag("limited")],
    Discriminator(_form_of_pair),
]


class Obstacle(Body):
    """A shape at a pose, to be kept away from by its margin [m]."""

    id: Label = Field(examples=["table_top"])
    """name of the obstacle, unique in its scene"""
    shape: Shape
    """in the obstacle's own frame"""
    pose: PoseInFrame
    margin: Annotated[NonNegative, Field(le=10.0)] | None = None
    """distance to be kept from it [m]; 0 if left out"""


class Scene(BodyWithRules):
    """Obstacles, or the text of a MoveIt planning scene."""

    one_of: ClassVar[tuple[str, ...]] = ("obstacles", "moveit")

    model_config = ConfigDict(json_schema_extra={"examples": examples("Scene")})

    name: Name | None = None
    """under which it is stored, where it is"""
    frame: Frame | None = None
    obstacles: Annotated[list[Obstacle], Field(max_length=MAX_OBSTACLES)] | None = None
    """shapes to keep away from"""
    moveit: Annotated[str, Field(min_length=1, max_length=_MAX_YAML)] | None = None
    """planning scene of MoveIt: its YAML, or the text of its .scene file"""
    allowed_collisions: Annotated[list[AllowedItem], Field(max_length=_MAX_PAIRS)] | None = None
    """pairs of links or obstacles that may touch"""

    @classmethod
    def from_moveit(cls, path: Path | str, *, name: str | None = None) -> Self:
        """The scene of a MoveIt planning-scene file (YAML).

        Raises:
            OSError: The file can't be read.
        """
        return cls.of(name=name, moveit=Path(path).read_text(encoding="utf-8"))

    @field_validator("obstacles")
    @classmethod
    def _check_ids(cls, value: list[Obstacle] | None) -> list[Obstacle] | None:
        distinct([obstacle.id for obstacle in value or ()], "obstacle")
        return value


class NamedScene(Scene):
    """A scene to be stored."""

    name: Name = Field(examples=["table"])
    """under which it is stored"""


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

    name: str = Field(examples=["table"])
    """of the scene"""
    hash: str
    """SHA-256 of the stored document"""
    version: int = Field(examples=[1])
    """counts the replacements"""
    created: str = Field(examples=["2026-11-21T09:30:00+00:00"])
    """when it was stored first"""
    updated: str = Field(examples=["2026-11-21T09:30:00+00:00"])
    """when it was stored last"""


class SceneList(Answer):
    """Stored scenes by name; `next` continues the list, if there are more."""

    scenes: list[SceneSummary]
    """by name"""
    next: str | None = None
    """value of `after` for the next page"""


#: What projects points onto obstacles.
Engine = Literal["exact", "fcl"]


class ProjectRequest(Body):
    """Points to be projected onto every obstacle of a scene."""

    points: Annotated[list[Point], Field(min_length=1, max_length=MAX_POINTS)] = Field(
        examples=[[[0.5, 0.0, 0.4]]]
    )
    """to be projected [m]"""
    engine: Engine = Field("exact", examples=["fcl"])
    """what finds the nearest points: closed forms, or FCL's distance query (inside of obstacles the
    closed forms answer for both)
    """


class Projection(Answer):
    """The orthogonal projection of a point onto one obstacle."""

    obstacle: str = Field(examples=["table_top"])
    """its name"""
    projection: list[float] = Field(examples=[[0.5, 0.0, 0.22]])
    """the nearest point of the obstacle's surface [m]"""
    distance: float = Field(examples=[0.18])
    """[m], negative inside"""


class ProjectAnswer(Answer):
    """For each point its projection onto every obstacle."""

    projections: list[list[Projection]]
    """for each point one for each obstacle"""
    frame: str | None = None
    """of the scene, which points and projections are in; the root if null"""
