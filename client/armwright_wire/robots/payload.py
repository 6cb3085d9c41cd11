"""A load that a link carries, on the wire."""

from typing import Annotated

from pydantic import Field

from armwright_wire.base import Body, Label, Point, Positive, Vector3

Tensor = Annotated[list[Vector3], Field(min_length=3, max_length=3)]


class Payload(Body):
    """A rigid load fixed to a link, in addition to what the robot's description has."""

    mass: Positive = Field(examples=[1.5])
    """[kg]"""
    center_of_mass: Point = Field([0.0, 0.0, 0.0])
    """in the link's frame [m]"""
    inertia: Tensor | None = None
    """about the centre of mass [kg m²]; a point mass if left out"""
    link: Label | None = None
    """the tip if left out"""
