"""Shapes of obstacles on the wire [m], each in its own frame."""

import base64
import binascii
from typing import Annotated, Literal

from pydantic import ConfigDict, Field, field_validator, model_validator

from armwright_wire.base import Body, Coordinate, Length, Point, Vector3, any_given

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


class Box(Body):
    """A box centred in its frame, with its full edge lengths along x, y, z."""

    type: Literal["box"] = "box"
    size: Annotated[list[Length], Field(min_length=3, max_length=3)] = Field(
        examples=[[0.2, 0.3, 0.5]], description="edge lengths along x, y, z [m]"
    )


class Sphere(Body):
    """A sphere centred in its frame."""

    type: Literal["sphere"] = "sphere"
    radius: Length = Field(examples=[0.1], description="[m]")


class Cylinder(Body):
    """A cylinder centred in its frame, along z."""

    type: Literal["cylinder"] = "cylinder"
    radius: Length = Field(examples=[0.05], description="about z [m]")
    height: Length = Field(examples=[0.4], description="along z [m]")


class Capsule(Body):
    """A cylinder of the given height along z with a half sphere at each end, centred."""

    type: Literal["capsule"] = "capsule"
    radius: Length = Field(examples=[0.05], description="of the cylinder and of its ends [m]")
    height: Length = Field(examples=[0.4], description="of the cylinder without its ends [m]")


class Cone(Body):
    """A cone along z, centred at half its height, its tip at +z."""

    type: Literal["cone"] = "cone"
    radius: Length = Field(examples=[0.05], description="of the base [m]")
    height: Length = Field(examples=[0.4], description="from the base to the tip [m]")


class Halfspace(Body):
    """All points p with normal · p ≤ offset; both are divided by the length of the normal."""

    type: Literal["halfspace"] = "halfspace"
    normal: Vector3 = Field(
        examples=[[0.0, 0.0, 1.0]],
        description="outward direction of the plane, of any length but 0",
    )
    offset: Coordinate = Field(
        examples=[0.0],
        description="distance of the plane from the origin along the normal, times its length [m]",
    )

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
        examples=[[[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]]],
        description="points whose convex hull is meant [m]",
    )


class Mesh(Body):
    """A triangle mesh: vertices and faces, or an STL file in base64."""

    model_config = ConfigDict(json_schema_extra=any_given(("vertices", "faces"), ("stl_base64",)))

    type: Literal["mesh"] = "mesh"
    vertices: Annotated[_Vertices, Field(min_length=3)] | None = Field(
        None, description="corners of the triangles [m]"
    )
    faces: Annotated[list[_Face], Field(min_length=1, max_length=MAX_FACES)] | None = Field(
        None, description="three vertex numbers each, counted from 0"
    )
    stl_base64: str | None = Field(None, min_length=1, description="ASCII or binary STL")

    @field_validator("stl_base64")
    @classmethod
    def _check_base64(cls, value: str | None) -> str | None:
        if value is not None:
            check_base64(value)
        return value

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


class PointCloud(Body):
    """A sphere of one radius around every point."""

    type: Literal["point_cloud"] = "point_cloud"
    points: Annotated[list[Point], Field(min_length=1, max_length=MAX_POINTS)] = Field(
        examples=[[[0.5, 0.0, 0.2], [0.5, 0.01, 0.2]]], description="centres of the spheres [m]"
    )
    radius: Length = Field(examples=[0.01], description="of each sphere [m]")


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
