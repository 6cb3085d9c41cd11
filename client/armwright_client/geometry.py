"""Geometry of a robot as triangles."""

import base64
import struct
from typing import Literal

from armwright_client.base import Answer


class BodySurface(Answer):
    """The surface of one link, or its part of one colour, as triangles in the frame of a link.

    Args:
        link: The link that the surface belongs to.
        frame: Link whose frame the vertices are in; `fk` answers its pose.
        vertices: Corners x, y, z [m] as float32, little-endian, in base64.
        faces: Three numbers of corners for each triangle as uint32, little-endian, in base64.
        simplified: Whether hulls stand for the triangles of its meshes, or visual ones are thinned
            out.
        color: Red, green, blue, opacity from 0 to 1 of visual geometry; None where it is not known.
    """

    link: str
    frame: str
    vertices: str
    faces: str
    simplified: bool
    color: list[float] | None = None

    def corners(self) -> list[tuple[float, float, float]]:
        """The vertices [m]."""
        data = base64.b64decode(self.vertices)
        return list(struct.iter_unpack("<3f", data))

    def triangles(self) -> list[tuple[int, int, int]]:
        """Numbers of the corners of each triangle, counter-clockwise from outside."""
        data = base64.b64decode(self.faces)
        return list(struct.iter_unpack("<3I", data))


class GeometryAnswer(Answer):
    """The collision or visual geometry of a robot.

    Args:
        robot: Name of the robot.
        hash: Of the model, as answers to plans give it.
        bodies: Links that have geometry; no visual ones where the robot has none at all.
        kind: What the bodies are.
    """

    robot: str
    hash: str
    bodies: list[BodySurface]
    kind: Literal["collision", "visual"] = "collision"
