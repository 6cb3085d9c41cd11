"""Regions of space that a point may be held in: box, sphere, plane, line."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from kinematics.arrays import Array, frozen
from kinematics.errors import InvalidGoal
from planning.constraints.kinds.frames import Attachment, tolerance, unit, vector
from planning.constraints.row import Row, RowKind

AXES = "xyz"


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
        center = at.place(self.T[:3, 3])
        return [
            at.row(
                RowKind.COORDINATE, (-0.5 * self.size[i], 0.5 * self.size[i]),
                f"the box along its {AXES[i]}", point=point, center=center,
                direction=at.direction(self.T[:3, i]),
            )
            for i in range(3) if np.isfinite(self.size[i])
        ]  # fmt: skip


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
        center, bounds = at.place(np.asarray(self.center)), (-np.inf, self.radius)
        return [at.row(RowKind.DISTANCE, bounds, "the sphere", point=point, center=center)]


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
        center, normal = at.place(np.asarray(self.point)), at.direction(np.asarray(self.normal))
        bounds, vectors = (-self.tolerance, self.tolerance), {"center": center, "direction": normal}
        return [at.row(RowKind.COORDINATE, bounds, "the plane", point=point, **vectors)]


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
        vectors = {"point": point, "center": center, "direction": along}
        rows = [at.row(RowKind.DISTANCE, (-np.inf, self.tolerance), "the line", **vectors)]
        if self.length is not None:
            ends = -0.5 * self.length, 0.5 * self.length
            rows.append(at.row(RowKind.COORDINATE, ends, "the line's length", **vectors))
        return rows


Region = BoxRegion | SphereRegion | PlaneRegion | LineRegion
