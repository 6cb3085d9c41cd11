"""Collision geometry of a robot as triangles, on the wire."""

from pydantic import Field

from service.schemas.base import Answer


class BodySurface(Answer):
    """The surface of one link as triangles, in the frame of a link."""

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
    simplified: bool = Field(description="hulls stand for the triangles of its meshes")


class GeometryAnswer(Answer):
    """The collision geometry of a robot."""

    robot: str = Field(description="name of the robot")
    hash: str = Field(description="of the model, as answers to plans give it")
    bodies: list[BodySurface] = Field(description="links that have geometry")
