"""Seams: waypoints with tolerances, of the planner "cartesian"."""

from typing import Literal, Self

from pydantic import Field

from armwright_client.base import Answer, NonNegative, Positive, Request, Vector3, VectorLike
from armwright_client.pose import AnyPose, Pose

Range = tuple[float, float]


class ToolTolerance(Request):
    """Ranges of the tool's deviation [least, largest]; axes left out are exact.

    Args:
        x: Along x [m].
        y: Along y [m].
        z: Along z [m].
        rx: About x [rad].
        ry: About y [rad].
        rz: About z [rad].
        free: Rotations by any angle.
        tilt: Largest angle between the tool's z and that of the pose [rad].
        frame: Whose axes deviations are along: those of each pose, or a link that stands still.
    """

    x: Range | None = None
    y: Range | None = None
    z: Range | None = None
    rx: Range | None = None
    ry: Range | None = None
    rz: Range | None = None
    free: list[Literal["rx", "ry", "rz"]] = Field(default_factory=list)
    tilt: Positive | None = None
    frame: str | None = None


class Waypoint(Request):
    """A pose of the tool, or a point with the surface's normal that the tool's z is against.

    Args:
        pose: Of the tip, without deviation.
        point: Place of the tip [m].
        normal: With point: out of the surface.
        direction: With point: the tool's x axis; any angle about the normal if left out.
        frame: Of point, normal, direction and via.
        via: Point on the arc from the waypoint before; a line if left out.
        tolerance: On the way to it and there; that of the options if left out.
        free: Axes that are free there and on the way to it, beside what the tolerance says:
            rotations by any angle, x, y and z by up to 1 m.
        blend: Distance from it at which the tool may leave the way [m].
        tool_speed: To be kept on the way to it [m/s]; that of the options if left out.
    """

    pose: AnyPose | None = None
    point: Vector3 | None = None
    normal: Vector3 | None = None
    direction: Vector3 | None = None
    frame: str | None = None
    via: Vector3 | None = None
    tolerance: ToolTolerance | None = None
    free: list[Literal["x", "y", "z", "rx", "ry", "rz"]] = Field(default_factory=list)
    blend: NonNegative | None = None
    tool_speed: Positive | None = None

    @classmethod
    def at(cls, pose: Pose, *, tolerance: ToolTolerance | None = None) -> Self:
        """A waypoint at a pose."""
        return cls(pose=pose, tolerance=tolerance)

    @classmethod
    def on(
        cls, point: VectorLike, normal: VectorLike, *, direction: VectorLike | None = None
    ) -> Self:
        """A waypoint on a surface, with the normal out of it."""
        return cls.of(point=point, normal=normal, direction=direction)


class StraightOffset(Request):
    """A straight motion to a seam's start, or from its end.

    Args:
        direction: Of the motion.
        distance: Its length [m].
        frame: Whose axes the direction is along: of the tool at the seam, or of the root.
    """

    direction: Vector3
    distance: Positive
    frame: Literal["tool", "base"] = "tool"


class ToolToleranceUse(Answer):
    """Use of the tolerances of a seam, proved for every instant.

    Args:
        share: Largest share of a range on either side of its middle.
        time: When [s].
    """

    share: float
    time: float


class ToolSpeedBand(Answer):
    """Speed of the tool where one speed is asked for.

    Args:
        share: Of the seam's length, on which the speed is proved to be within the band.
        least: Least speed found, starts and stops included [m/s].
        most: A bound of the largest speed over all t [m/s].
        low: Least speed of the band [m/s].
        high: Largest speed of the band, a limit [m/s].
    """

    share: float
    least: float
    most: float
    low: float
    high: float


class ToolSpeed(ToolSpeedBand):
    """Speed of the tool along a seam; of several speeds the least and the largest.

    Args:
        bands: The same for each of the speeds that are asked for, if they differ.
    """

    bands: list[ToolSpeedBand] | None = None
