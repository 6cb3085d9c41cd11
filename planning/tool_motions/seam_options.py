"""Seams: paths of the tool through waypoints, with tolerances and a speed."""

from dataclasses import dataclass
from typing import Literal

from kinematics.arrays import Array, frozen
from kinematics.errors import InvalidOption
from planning.tool_motions.tool_tolerance import ToolTolerance

#: Band of speed that is reported where none is asked for, as part of the speed.
SPEED_BAND = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class SeamWaypoint:
    """A pose on a seam, and the way to it from the waypoint before.

    Args:
        T_base_tip: Pose of the tool without deviation, shape (4, 4).
        via: Point on the arc from the waypoint before, shape (3,) [m]; None for a line.
        tolerance: On the way to it and there; None for that of the seam.
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
        direction: Of the motion, of any length, shape (3,).
        distance: Its length [m].
        frame: Whose axes the direction is along: those of the tool at the seam, or the base.
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
        waypoints: In order, two at least.
        tolerance: By how much the tool may deviate from the path through them.
        tool_speed: Speed to be kept on ways to waypoints that have none of their own [m/s]; None
            for the largest that the limits allow, of all of them.
        speed_band: Largest difference from it, as part of it.
        approach: Motion that ends at the seam's start; None for none.
        retreat: Motion that begins at its end; None for none.
        branch_changes: Motion away from a waypoint after which the arm may come back in another
            branch; None where the whole seam is to be followed in one.

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
