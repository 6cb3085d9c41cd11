"""Regions of space that a point may be held in: box, sphere, plane, line."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from kinematics.arrays import Array, frozen
from kinematics.errors import InvalidGoal
from planning.constraints.kinds.frames import Attachment, tolerance, unit, vector
from planning.constraints.row import Row, RowKind

_AXES = "xyz"


@dataclass(frozen=True, slots=True, eq=False)
class BoxRegion:
    """A box: |R^T (x - p)| <= size / 2 in each of its axes.

    Args:
        T: Pose of its centre, shape (4, 4).
        size: Edge lengths, inf where it has no end, shape (3,) [m].

    Raises:
        InvalidGoal: An edge is negative, or the pose not finite.
    """

    T: Array
    size: Array

    def __post_init__(self) -> None:
        size, T = frozen(self.size), frozen(self.T)
        if T.shape != (4, 4) or not np.isfinite(T).all():
            raise InvalidGoal("a box region's pose must be a finite 4x4 transform")
        if size.shape != (3,) or not (size >= 0.0).all():
            raise InvalidGoal("a box region's size must be three numbers, 0 or more")
        object.__setattr__(self, "T", T)
        object.__setattr__(self, "size", size)

    def rows(self, at: Attachment, point: Array) -> list[Row]:
        """A row for each pair of faces."""
        return [
            Row(
                RowKind.COORDINATE,
                at.carrier,
                at.reference,
                -0.5 * self.size[i],
                0.5 * self.size[i],
                "m",
                point=point,
                center=at.place(self.T[:3, 3]),
                direction=at.direction(self.T[:3, i]),
                label=f"the box along its {_AXES[i]}",
            )
            for i in range(3)
            if np.isfinite(self.size[i])
        ]


@dataclass(frozen=True, slots=True, eq=False)
class SphereRegion:
    """A ball: |x - c| <= radius.

    Args:
        center: Shape (3,) [m].
        radius: [m].

    Raises:
        InvalidGoal: The radius is negative, or the centre not finite.
    """

    center: ArrayLike
    radius: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "center", vector(self.center, "center"))
        tolerance(self.radius, "radius")

    def rows(self, at: Attachment, point: Array) -> list[Row]:
        """One row."""
        center = at.place(np.asarray(self.center))
        return [
            Row(
                RowKind.DISTANCE,
                at.carrier,
                at.reference,
                -np.inf,
                self.radius,
                "m",
                point=point,
                center=center,
                label="the sphere",
            )
        ]


@dataclass(frozen=True, slots=True, eq=False)
class PlaneRegion:
    """A slab about a plane: |n . (x - p)| <= tolerance.

    Args:
        point: Point of the plane, shape (3,) [m].
        normal: Normal of any length, shape (3,).
        tolerance: [m].

    Raises:
        InvalidGoal: The tolerance is negative, or the normal 0.
    """

    point: ArrayLike
    normal: ArrayLike
    tolerance: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "point", vector(self.point, "point"))
        object.__setattr__(self, "normal", unit(self.normal, "normal"))
        tolerance(self.tolerance, "tolerance")

    def rows(self, at: Attachment, point: Array) -> list[Row]:
        """One row."""
        return [
            Row(
                RowKind.COORDINATE,
                at.carrier,
                at.reference,
                -self.tolerance,
                self.tolerance,
                "m",
                point=point,
                center=at.place(np.asarray(self.point)),
                direction=at.direction(np.asarray(self.normal)),
                label="the plane",
            )
        ]


@dataclass(frozen=True, slots=True, eq=False)
class LineRegion:
    """A cylinder about a line: the distance of x from it is at most ``tolerance``.

    Args:
        point: Point of the line, shape (3,) [m].
        direction: Direction of any length, shape (3,).
        tolerance: [m].
        length: Length that, where given, holds x within half of it of the point, along the line
            [m].

    Raises:
        InvalidGoal: The tolerance or the length is negative, or the direction 0.
    """

    point: ArrayLike
    direction: ArrayLike
    tolerance: float
    length: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "point", vector(self.point, "point"))
        object.__setattr__(self, "direction", unit(self.direction, "direction"))
        tolerance(self.tolerance, "tolerance")
        if self.length is not None:
            tolerance(self.length, "length")

    def rows(self, at: Attachment, point: Array) -> list[Row]:
        """One row, or two where the line has a length."""
        center, along = at.place(np.asarray(self.point)), at.direction(np.asarray(self.direction))
        rows = [
            Row(
                RowKind.DISTANCE,
                at.carrier,
                at.reference,
                -np.inf,
                self.tolerance,
                "m",
                point=point,
                center=center,
                direction=along,
                label="the line",
            )
        ]
        if self.length is not None:
            half = 0.5 * self.length
            rows.append(
                Row(
                    RowKind.COORDINATE,
                    at.carrier,
                    at.reference,
                    -half,
                    half,
                    "m",
                    point=point,
                    center=center,
                    direction=along,
                    label="the line's length",
                )
            )
        return rows


Region = BoxRegion | SphereRegion | PlaneRegion | LineRegion
