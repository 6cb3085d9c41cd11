"""Tolerance of the tool on its path: a box of position and orientation about the pose asked for.

With N the pose asked for at a place of the path and T the tool's, the deviation is

    e = A^T (p_T - p_N),   D = A^T R_T R_N^T A = Rx(rx) Ry(ry) Rz(rz)         (fixed axes A)
    e = R_N^T (p_T - p_N), D = R_N^T R_T = Rx(rx) Ry(ry) Rz(rz)               (the tool's own axes)

and its tilt is the angle between the axes z of D and of no deviation.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from kinematics.arrays import Array, frozen
from kinematics.errors import InvalidOption

#: Band of speed that is reported where none is asked for, as part of the speed.
SPEED_BAND = 0.1
Axis = Literal["x", "y", "z", "rx", "ry", "rz"]
AXES: tuple[Axis, ...] = get_args(Axis)
#: Angles that orientations have, of which rx and rz are not defined at a right angle of ry.
ROTATIONS: tuple[Axis, ...] = ("rx", "ry", "rz")
#: Largest deviation of position that can be asked for [m].
MAX_POSITION = 1.0
# Columns of deviations.
#: Angle about x [rad], behind deviations of position along three axes [m].
RX = 3
#: Angle about y [rad].
RY = 4
#: Angle about z [rad].
RZ = 5
SIZE = 6


@dataclass(frozen=True, slots=True, eq=False)
class ToolTolerance:
    """Ranges of the tool's deviation from the pose asked for.

    Args:
        lower: Least deviation along x, y, z [m] and about rx, ry, rz [rad], shape (6,); minus
            infinity where a rotation is free.
        upper: Largest deviation, likewise.
        tilt: Largest angle between the tool's axis z and that of the pose [rad]; infinite where the
            box alone counts.
        axes: Fixed axes in the base frame that deviations are along and about, shape (3, 3); None
            for the axes of the pose itself.

    Raises:
        InvalidOption: A range is empty, or one of ry beyond what can be asked for.
    """

    lower: Array
    upper: Array
    tilt: float = math.inf
    axes: Array | None = None

    def __post_init__(self) -> None:
        for name in ("lower", "upper"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
            if getattr(self, name).shape != (SIZE,):
                raise InvalidOption(
                    f"{name} has the shape {getattr(self, name).shape}, not ({SIZE},)",
                    hint=f"Give one number each for {', '.join(AXES)}.",
                )
        if self.axes is not None:
            object.__setattr__(self, "axes", frozen(self.axes))
        for axis, low, high in zip(AXES, self.lower, self.upper, strict=True):
            if not low <= high:
                raise InvalidOption(
                    f"tolerance of {axis}: {low:g} is above {high:g}",
                    hint="Give [least, largest] deviation.",
                )
        if not self.tilt > 0.0:
            raise InvalidOption("tilt must be positive", hint="Leave it out for no tilt at all.")
        angles = max(abs(self.lower[RY]), abs(self.upper[RY]))
        bounded = np.isfinite([self.lower[RX:], self.upper[RX:]]).any()
        # Largest bound of ry where not all rotations are free [rad].
        max_ry = 1.4
        if angles > max_ry and (bounded or self.tilt < math.pi):
            raise InvalidOption(
                f"tolerance of ry: beyond {max_ry:g} rad, where rx and rz are not defined",
                hint="Keep ry within it, or free all of rx, ry and rz.",
            )

    @classmethod
    def of(
        cls,
        ranges: Mapping[Axis, tuple[float, float]],
        free: tuple[Axis, ...] = (),
        tilt: float | None = None,
        axes: Array | None = None,
    ) -> "ToolTolerance":
        """A tolerance from what is named; axes that are not named are exact.

        Args:
            ranges: Least and largest deviation by axis [m], [rad].
            free: Rotations of which any angle will do.
            tilt: Largest angle between the tool's z and that of the pose, about any axis [rad].
            axes: Fixed axes, shape (3, 3); None for those of the pose.

        Raises:
            InvalidOption: As the constructor; a range of position is beyond what can be asked for,
                or a translation is called free.
        """
        lower, upper = np.zeros(SIZE), np.zeros(SIZE)
        if tilt is not None:
            lower[RX:RZ], upper[RX:RZ] = -tilt, tilt
        for axis, (low, high) in ranges.items():
            lower[AXES.index(axis)], upper[AXES.index(axis)] = low, high
        # Not of what a deviation is added to, see ``widened``.
        if np.abs([lower[:RX], upper[:RX]]).max() > MAX_POSITION:
            raise InvalidOption(f"a tolerance of position is at most {MAX_POSITION:g} m")
        for axis in free:
            if axis not in ROTATIONS:
                raise InvalidOption(
                    f"{axis!r} can't be free", hint="Give its range in metres, as [least, largest]."
                )
            lower[AXES.index(axis)], upper[AXES.index(axis)] = -np.inf, np.inf
        return cls(lower, upper, math.inf if tilt is None else tilt, axes)

    def widened(self, position: float, orientation: float) -> "ToolTolerance":
        """The tolerance with ranges and tilt wider by deviations [m], [rad] on either side."""
        more = np.array([position] * 3 + [orientation] * 3)
        return ToolTolerance(
            self.lower - more,
            self.upper + more,
            self.tilt + orientation,
            self.axes,
        )

    def poses(self, nominal: Array, deviations: Array) -> Array:
        """Poses (k, 4, 4) that deviate from those asked for (k, 4, 4) by deviations (k, 6)."""
        A = self._axes(nominal)
        T = np.tile(np.eye(4), (len(deviations), 1, 1))
        T[:, :3, 3] = nominal[:, :3, 3] + np.einsum("kij,kj->ki", A, deviations[:, :RX])
        D = rotations(deviations[:, RX:])
        turned = np.einsum("kij,kjl,kml->kim", A, D, A)
        T[:, :3, :3] = turned @ nominal[:, :3, :3]
        return T

    def _axes(self, nominal: Array) -> Array:
        if self.axes is None:
            return nominal[:, :3, :3]
        return np.broadcast_to(self.axes, (len(nominal), 3, 3))


def rotations(angles: Array) -> Array:
    """Rotations Rx(rx) Ry(ry) Rz(rz), shape (k, 3, 3), of angles (k, 3) [rad]."""
    (ca, cb, cc), (sa, sb, sc) = np.cos(angles).T, np.sin(angles).T
    rows = [
        [cb * cc, -cb * sc, sb],
        [ca * sc + sa * sb * cc, ca * cc - sa * sb * sc, -sa * cb],
        [sa * sc - ca * sb * cc, sa * cc + ca * sb * sc, ca * cb],
    ]
    return np.asarray(np.moveaxis(np.array(rows), 2, 0))


def tilts(deviations: Array) -> Array:
    """Angle of the axis z of deviations (k, 6) from no deviation, shape (k,) [rad]."""
    return np.asarray(
        np.arccos(np.clip(np.cos(deviations[:, RX]) * np.cos(deviations[:, RY]), -1, 1))
    )


@dataclass(frozen=True, slots=True, eq=False)
class SeamWaypoint:
    """A pose on a seam, and the way to it from the waypoint before.

    Args:
        T_base_tip: Pose of the tool without deviation, shape (4, 4).
        via: Point on the arc from the waypoint before, shape (3,) [m]; None for a line.
        tolerance: Tolerance on the way to it and there; None for that of the seam.
        blend: Distance from it at which the tool may leave the way [m]; None for that of all.
        tool_speed: Speed to be kept on the way to it [m/s]; None for that of the seam.
        axis_only: Whether of the orientation only the axis z is asked for; x and y are any two.
    """

    T_base_tip: Array
    via: Array | None = None
    tolerance: ToolTolerance | None = None
    blend: float | None = None
    tool_speed: float | None = None
    axis_only: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "T_base_tip", frozen(self.T_base_tip))
        if self.tool_speed is not None and not self.tool_speed > 0.0:
            raise InvalidOption("tool_speed must be positive [m/s]")


@dataclass(frozen=True, slots=True, eq=False)
class StraightOffset:
    """A straight motion towards a seam or away from it.

    Args:
        direction: Direction of the motion, of any length, shape (3,).
        distance: Length [m].
        frame: Frame whose axes the direction is along: that of the tool at the seam, or the base.
    """

    direction: Array
    distance: float
    frame: Literal["tool", "base"] = "tool"

    def __post_init__(self) -> None:
        object.__setattr__(self, "direction", frozen(self.direction))
        if not self.direction.any():
            raise InvalidOption("the direction of an approach or a retreat is zero")


@dataclass(frozen=True, slots=True, eq=False)
class SeamOptions:
    """A seam to be followed in one branch of inverse kinematics, or with rests where it changes.

    Args:
        waypoints: Waypoints in order, two at least.
        tolerance: Deviations that the tool may have from the path through them.
        tool_speed: Speed to be kept on ways to waypoints that have none of their own [m/s]; None
            for the largest that the limits allow, of all of them.
        speed_band: Largest difference from it, as part of it.
        approach: Motion that ends at the seam's start; None for none.
        retreat: Motion that begins at its end; None for none.
        branch_changes: Motion away from a waypoint after which the arm may come back in another
            branch; None where the whole seam is to be followed in one.
        through: Lines between waypoints, or arcs through the middles of a cubic spline.

    Raises:
        InvalidOption: There are too few waypoints, a speed is out of its range, or some ways have
            one and others have none.
    """

    waypoints: tuple[SeamWaypoint, ...]
    tolerance: ToolTolerance
    tool_speed: float | None = None
    speed_band: float = SPEED_BAND
    approach: StraightOffset | None = None
    retreat: StraightOffset | None = None
    branch_changes: StraightOffset | None = None
    through: Literal["polyline", "spline"] = "polyline"

    def __post_init__(self) -> None:
        if len(self.waypoints) < 2:
            raise InvalidOption("a seam needs two waypoints at least")
        if self.tool_speed is not None and not self.tool_speed > 0.0:
            raise InvalidOption("tool_speed must be positive [m/s]")
        if not 0.0 < self.speed_band <= 1.0:
            raise InvalidOption("speed_band must be above 0 and at most 1")
        speeds = self._asked_speeds()
        if None in speeds and any(speed is not None for speed in speeds):
            raise InvalidOption(
                f"waypoints[{speeds.index(None) + 1}] has no tool_speed, and others have",
                hint="Give tool_speed in the options too: it holds for those without.",
            )

    @property
    def speeds(self) -> tuple[float, ...]:
        """Speed to be kept on the way to each waypoint but the first [m/s]; empty for none."""
        return tuple(speed for speed in self._asked_speeds() if speed is not None)

    def _asked_speeds(self) -> list[float | None]:
        return [
            self.tool_speed if point.tool_speed is None else point.tool_speed
            for point in self.waypoints[1:]
        ]
