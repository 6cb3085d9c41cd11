"""Geometry of a robot as triangles, on the wire."""

from typing import Literal, TypeAlias

from pydantic import Field

from armwright_wire.base import Answer

GeometryKind: TypeAlias = Literal["collision", "visual"]


class BodySurface(Answer):
    """The surface of one link, or its part of one colour, as triangles in the frame of a link."""

    link: str = Field(description="the link that the surface belongs to")
    frame: str = Field(
        description="link whose frame the vertices are in; forward kinematics has it"
    )
    vertices: str = Field(
        description="corners x, y, z [m]: float32, little-endian, in base64", examples=["AAAAAA=="]
    )
    faces: str = Field(
        description="three numbers of corners for each triangle, counter-clockwise from outside: "
        "uint32, little-endian, in base64",
        examples=["AAAAAA=="],
    )
    simplified: bool = Field(
        description="hulls stand for the triangles of its meshes, or visual ones are thinned out"
    )
    color: list[float] | None = Field(
        None,
        description="red, green, blue, opacity from 0 to 1 of visual geometry, from the URDF's "
        "material or the file's; null where neither gives one",
        examples=[[0.9, 0.9, 0.9, 1.0]],
    )


class GeometryAnswer(Answer):
    """The collision or visual geometry of a robot."""

    robot: str = Field(description="name of the robot")
    hash: str = Field(description="of the model, as answers to plans give it")
    kind: GeometryKind = Field(description="what the bodies are, as asked for")
    bodies: list[BodySurface] = Field(
        description="links that have geometry; links without visual geometry have their collision "
        "geometry among visual bodies, and a robot that has none at all has no visual bodies"
    )
