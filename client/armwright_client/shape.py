"""Shapes of obstacles and attached objects [m], each in its own frame."""

import base64
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field

from armwright_client.base import Faces, Points, Positive, Request, Vector3


class Box(Request):
    """A box centred in its frame, with its full edge lengths along x, y, z."""

    type: Literal["box"] = "box"
    size: Vector3


class Sphere(Request):
    """A sphere centred in its frame."""

    type: Literal["sphere"] = "sphere"
    radius: Positive


class _Round(Request):
    radius: Positive
    height: Positive


class Cylinder(_Round):
    """A cylinder centred in its frame, along z."""

    type: Literal["cylinder"] = "cylinder"


class Capsule(_Round):
    """A cylinder of the given height along z with a half sphere at each end, centred."""

    type: Literal["capsule"] = "capsule"


class Cone(_Round):
    """A cone along z, centred at half its height, its tip at +z."""

    type: Literal["cone"] = "cone"


class Halfspace(Request):
    """All points p with normal · p ≤ offset; both are divided by the length of the normal."""

    type: Literal["halfspace"] = "halfspace"
    normal: Vector3
    offset: float


class Convex(Request):
    """The convex hull of its vertices."""

    type: Literal["convex"] = "convex"
    vertices: Points


class Mesh(Request):
    """A triangle mesh: vertices and faces, or an STL file in base64.

    Args:
        vertices: Points [m].
        faces: Three vertex numbers each, counted from 0.
        stl_base64: ASCII or binary STL instead of both.
    """

    type: Literal["mesh"] = "mesh"
    vertices: Points | None = None
    faces: Faces | None = None
    stl_base64: str | None = None

    @classmethod
    def from_stl(cls, path: Path | str) -> Self:
        """The mesh of an STL file.

        Raises:
            OSError: The file can't be read.
        """
        return cls(stl_base64=base64.b64encode(Path(path).read_bytes()).decode("ascii"))


class PointCloud(Request):
    """A sphere of one radius [m] around every point."""

    type: Literal["point_cloud"] = "point_cloud"
    points: Points
    radius: Positive


Shape = Annotated[
    Box | Sphere | Cylinder | Capsule | Cone | Halfspace | Convex | Mesh | PointCloud,
    Field(discriminator="type"),
]
