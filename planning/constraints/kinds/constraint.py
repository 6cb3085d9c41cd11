"""Constraints on configurations: a joint, a point, an axis or a pose held near what is wanted.

Of links in the frame of the base or of another link; regions of space are in ``region``.

Regions of space that a point may be held in: box, sphere, plane, line.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from kinematics.arrays import Array, frozen
from kinematics.errors import InvalidGoal
from kinematics.model.chain import Chain, JointType
from kinematics.pose import from_matrix, transform
from planning.constraints.kinds.frames import (
    Attachment,
    tolerance,
    tolerances,
    unit,
    vector,
    weight,
)
from planning.constraints.row import Row, RowKind, Unit

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


@dataclass(frozen=True, slots=True)
class ClearanceConstraint:
    """Every obstacle stays at least ``margin`` away, beyond its own margin.

    Args:
        margin: [m].

    Raises:
        InvalidGoal: It is negative.
    """

    margin: float
    weight: None = None
    name: ClassVar[str] = "clearance"

    def __post_init__(self) -> None:
        tolerance(self.margin, "margin", 1e6)

    def rows(self, chain: Chain) -> list[Row]:  # noqa: ARG002  distances need the scene
        """None: distances need the scene."""
        return []


@dataclass(frozen=True, slots=True)
class ToolSpeedConstraint:
    """The tip moves at ``limit`` at most.

    Args:
        limit: [m/s].

    Raises:
        InvalidGoal: It is not positive.
    """

    limit: float
    weight: None = None
    name: ClassVar[str] = "tool speed"

    def __post_init__(self) -> None:
        if not 0.0 < self.limit < np.inf:
            raise InvalidGoal(f"the tool speed limit is {self.limit}; it must be positive [m/s]")

    def rows(self, chain: Chain) -> list[Row]:  # noqa: ARG002  a speed needs time
        """None: a speed needs time."""
        return []


@dataclass(frozen=True, slots=True)
class TorqueConstraint:
    """Joint torques stay within limits.

    Args:
        limits: Limits in the order of the joints [N m or N]; the robot's own where None.

    Raises:
        InvalidGoal: A limit is not positive.
    """

    limits: Sequence[float] | None = None
    weight: None = None
    name: ClassVar[str] = "torque"

    def __post_init__(self) -> None:
        if self.limits is not None and not all(limit > 0.0 for limit in self.limits):
            raise InvalidGoal("torque limits must be positive [N m or N]")

    def rows(self, chain: Chain) -> list[Row]:
        """None: torques need the dynamics.

        Raises:
            InvalidGoal: There is not one limit for each joint.
        """
        if self.limits is not None and len(self.limits) != chain.n:
            raise InvalidGoal(
                f"the torque constraint has {len(self.limits)} limit(s), robot {chain.name!r} has "
                f"{chain.n} joints",
                hint=f"The order is: {', '.join(chain.joint_names)}.",
            )
        return []


@dataclass(frozen=True, slots=True)
class JointConstraint:
    """position - tolerance_below <= q_j <= position + tolerance_above.

    Args:
        joint: Name of the joint.
        position: [rad or m].
        tolerance_above: [rad or m].
        tolerance_below: [rad or m].
        weight: None where it must hold; else what a squared radian or metre of it costs.

    Raises:
        InvalidGoal: A tolerance is negative, or the position not finite.
    """

    joint: str
    position: float
    tolerance_above: float = 0.0
    tolerance_below: float = 0.0
    weight: float | None = None

    def __post_init__(self) -> None:
        if not np.isfinite(self.position):
            raise InvalidGoal(f"the position of joint {self.joint!r} is not finite")
        tolerance(self.tolerance_above, "tolerance_above")
        tolerance(self.tolerance_below, "tolerance_below")
        weight(self.weight)

    @property
    def name(self) -> str:
        """Name of the constraint."""
        return f"joint {self.joint!r}"

    def rows(self, chain: Chain) -> list[Row]:
        """Its rows on a chain.

        Raises:
            InvalidGoal: The chain has no such joint.
        """
        if self.joint not in chain.joint_names:
            raise InvalidGoal(
                f"robot {chain.name!r} has no joint {self.joint!r}",
                hint=f"Its joints are: {', '.join(chain.joint_names)}.",
                joint=self.joint,
                joints=list(chain.joint_names),
            )
        j = chain.joint_names.index(self.joint)
        low, high = self.position - self.tolerance_below, self.position + self.tolerance_above
        kind: Unit = "rad" if chain.joint_types[j] == JointType.REVOLUTE else "m"
        return [Row(RowKind.JOINT, j, -1, low, high, kind, label=f"joint {self.joint!r}")]


@dataclass(frozen=True, slots=True, eq=False)
class PositionConstraint:
    """A point of a link stays in a region.

    Args:
        region: Region in the frame of the reference.
        link: Link that carries the point; the tip where none is named.
        point: Point in the link's frame, shape (3,) [m].
        reference_link: The link whose frame the region is in; the base where none is named.
        weight: None where it must hold; else what a squared metre of it costs.

    Raises:
        InvalidGoal: The point is not finite, or the weight not positive.
    """

    region: Region
    link: str | None = None
    point: ArrayLike = (0.0, 0.0, 0.0)
    reference_link: str | None = None
    weight: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "point", vector(self.point, "point"))
        weight(self.weight)

    @property
    def name(self) -> str:
        """Name of the constraint."""
        return f"position of {'the tip' if self.link is None else repr(self.link)}"

    def rows(self, chain: Chain) -> list[Row]:
        """Its rows on a chain.

        Raises:
            InvalidLinkName: No such link.
            InvalidGoal: The link does not move against the reference.
        """
        at = Attachment.of(chain, self.link, self.reference_link)
        return self.region.rows(at, at.point(np.asarray(self.point)))


@dataclass(frozen=True, slots=True, eq=False)
class ConeConstraint:
    """An axis of a link stays within a cone: angle(R a, d) <= cone_angle.

    Args:
        axis: Axis of the link, in its frame, of any length, shape (3,).
        direction: Direction of the cone in the reference, of any length, shape (3,).
        cone_angle: Angle between the cone's axis and its surface [rad].
        link: The link; the tip where none is named.
        reference_link: The link whose frame the direction is in; the base where none is named.
        weight: None where it must hold; else what a squared radian of it costs.

    Raises:
        InvalidGoal: Axis or direction is 0, or the angle not in [0, pi].
    """

    axis: ArrayLike
    direction: ArrayLike
    cone_angle: float
    link: str | None = None
    reference_link: str | None = None
    weight: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "axis", unit(self.axis, "axis"))
        object.__setattr__(self, "direction", unit(self.direction, "direction"))
        tolerance(self.cone_angle, "cone_angle", math.pi)
        weight(self.weight)

    @property
    def name(self) -> str:
        """Name of the constraint."""
        return f"orientation cone of {'the tip' if self.link is None else repr(self.link)}"

    def rows(self, chain: Chain) -> list[Row]:
        """Its row on a chain.

        Raises:
            InvalidLinkName: No such link.
            InvalidGoal: The link does not move against the reference.
        """
        at = Attachment.of(chain, self.link, self.reference_link)
        axis, direction = at.axis(np.asarray(self.axis)), at.direction(np.asarray(self.direction))
        bounds = -np.inf, self.cone_angle
        return [at.row(RowKind.ANGLE, bounds, "the cone", "rad", axis=axis, direction=direction)]


@dataclass(frozen=True, slots=True, eq=False)
class OrientationConstraint:
    """A link's orientation stays near another: |log(R_target^T R)_i| <= axis_tolerances_i.

    Args:
        rotation: The target, in the reference, shape (3, 3).
        axis_tolerances: Tolerances about x, y and z of the target; one of pi or more leaves the
            axis free, shape (3,) or one number [rad].
        link: The link; the tip where none is named.
        reference_link: The link whose frame the target is in; the base where none is named.
        weight: None where it must hold; else what a squared radian of it costs.

    Raises:
        InvalidPose: The target is no rotation.
        InvalidGoal: A tolerance is negative.
    """

    rotation: Array
    axis_tolerances: ArrayLike
    link: str | None = None
    reference_link: str | None = None
    weight: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "rotation", frozen(from_matrix(self.rotation)))
        given = tolerances(np.asarray(self.axis_tolerances, dtype=np.float64), "axis_tolerances")
        object.__setattr__(self, "axis_tolerances", given)
        weight(self.weight)

    @property
    def name(self) -> str:
        """Name of the constraint."""
        return f"orientation of {'the tip' if self.link is None else repr(self.link)}"

    def rows(self, chain: Chain) -> list[Row]:
        """A row for each axis that is not free.

        Raises:
            InvalidLinkName: No such link.
            InvalidGoal: The link does not move against the reference.
        """
        at = Attachment.of(chain, self.link, self.reference_link)
        return rotation_rows(at, self.rotation, np.asarray(self.axis_tolerances))


def rotation_rows(at: Attachment, rotation: Array, limits: Array) -> list[Row]:
    """Rows that hold each component of the rotation left to a target within its limit."""
    K, M = at.turn(rotation)
    return [
        at.row(
            RowKind.ROTATION, (-float(limits[i]), float(limits[i])), f"the turn about {AXES[i]}",
            "rad", axis=M[:, i], turn=K,
        )
        for i in range(3) if limits[i] < math.pi
    ]  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class LookAtConstraint:
    """The ray from a point of a link along an axis passes a target: angle(R a, c - x) <= angle.

    Args:
        axis: Axis of the link, in its frame, of any length, shape (3,).
        target: Target in the reference, shape (3,) [m].
        angle: [rad].
        link: The link; the tip where none is named.
        point: The ray's origin in the link's frame, shape (3,) [m].
        reference_link: The link whose frame the target is in; the base where none is named.
        weight: None where it must hold; else what a squared radian of it costs.

    Raises:
        InvalidGoal: The axis is 0, the target not finite, or the angle not in [0, pi].
    """

    axis: ArrayLike
    target: ArrayLike
    angle: float
    link: str | None = None
    point: ArrayLike = (0.0, 0.0, 0.0)
    reference_link: str | None = None
    weight: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "axis", unit(self.axis, "axis"))
        object.__setattr__(self, "target", vector(self.target, "target"))
        object.__setattr__(self, "point", vector(self.point, "point"))
        tolerance(self.angle, "angle", math.pi)
        weight(self.weight)

    @property
    def name(self) -> str:
        """Name of the constraint."""
        return f"look-at of {'the tip' if self.link is None else repr(self.link)}"

    def rows(self, chain: Chain) -> list[Row]:
        """Its row on a chain.

        Raises:
            InvalidLinkName: No such link.
            InvalidGoal: The link does not move against the reference.
        """
        at = Attachment.of(chain, self.link, self.reference_link)
        vectors = {
            "axis": at.axis(np.asarray(self.axis)),
            "point": at.point(np.asarray(self.point)),
            "center": at.place(np.asarray(self.target)),
        }
        bounds = -np.inf, self.angle
        return [at.row(RowKind.LOOK, bounds, "the line of sight", "rad", **vectors)]


@dataclass(frozen=True, slots=True, eq=False)
class RelativePoseConstraint:
    """A link stays near a pose: its origin within a box, its rotation within axis tolerances.

    Args:
        T_reference_link: The pose in the frame of the reference, shape (4, 4).
        link: The link; the tip where none is named.
        reference_link: The link the pose is seen from; the base where none is named.
        position_tolerances: Position tolerances along x, y and z of the pose, inf where free; one
            number for all [m].
        orientation_tolerances: Tolerances about x, y and z of it, pi or more where free; or one
            number [rad].
        weight: None where it must hold; else what a squared metre or radian of it costs.

    Raises:
        InvalidPose: The pose's rotation is none.
        InvalidGoal: It is no finite transform, or a tolerance is negative.
    """

    T_reference_link: Array
    link: str | None = None
    reference_link: str | None = None
    position_tolerances: ArrayLike = 0.0
    orientation_tolerances: ArrayLike = 0.0
    weight: float | None = None

    def __post_init__(self) -> None:
        T = np.array(self.T_reference_link, dtype=np.float64)
        if T.shape != (4, 4) or not np.isfinite(T).all():
            raise InvalidGoal("a relative pose must be a finite 4x4 transform")
        T = transform(from_matrix(T[:3, :3]), T[:3, 3])
        object.__setattr__(self, "T_reference_link", frozen(T))
        for name in ("position_tolerances", "orientation_tolerances"):
            given = np.asarray(getattr(self, name), dtype=np.float64)
            object.__setattr__(self, name, tolerances(given, name))
        weight(self.weight)

    @property
    def name(self) -> str:
        """Name of the constraint."""
        seen_from = "the base" if self.reference_link is None else repr(self.reference_link)
        return (
            f"pose of {'the tip' if self.link is None else repr(self.link)} seen from {seen_from}"
        )

    def rows(self, chain: Chain) -> list[Row]:
        """A row for each axis that is not free.

        Raises:
            InvalidLinkName: No such link.
            InvalidGoal: Both links move with the same joint.
        """
        at = Attachment.of(chain, self.link, self.reference_link)
        box = BoxRegion(self.T_reference_link, 2.0 * np.asarray(self.position_tolerances))
        turns = np.minimum(np.asarray(self.orientation_tolerances), math.pi)
        rows = box.rows(at, at.point(np.zeros(3)))
        return rows + rotation_rows(at, self.T_reference_link[:3, :3], turns)


#: Constraints on where the robot is, which have rows.
Geometric = (
    JointConstraint
    | PositionConstraint
    | ConeConstraint
    | OrientationConstraint
    | LookAtConstraint
    | RelativePoseConstraint
)
Constraint = Geometric | ClearanceConstraint | ToolSpeedConstraint | TorqueConstraint
