"""Straight and circular motions of the tool."""

from typing import Literal, Self

from armwright_client.base import NonNegative, Positive, Request, Vector, Vector3, VectorLike
from armwright_client.pose import AnyPose, Pose
from armwright_client.seam import ToolTolerance

Part = Literal["motion", "approach", "seam", "retreat"]


class _ToolCurve(Request):
    """A motion of the tool from where it is: what all kinds of them have.

    Args:
        type: "lin", "circ" or, of motions in time, "corner".
        pose: Of the tip where the motion ends.
        via: Point on the arc.
        center: Of the arc.
        normal: With the centre: axis to turn about by the right hand, up to a whole turn; the
            shorter arc if left out.
        blend: Distance from its end at which the tool may leave it for the next one [m]; that of
            the options if left out.
    """

    type: Literal["lin", "circ", "corner"]
    pose: AnyPose
    via: Vector3 | None = None
    center: Vector3 | None = None
    normal: Vector3 | None = None
    blend: NonNegative | None = None

    @classmethod
    def lin(cls, pose: Pose, *, blend: float | None = None) -> Self:
        """A line to a pose."""
        return cls(type="lin", pose=pose, blend=blend)

    @classmethod
    def circ(
        cls,
        pose: Pose,
        *,
        via: VectorLike | None = None,
        center: VectorLike | None = None,
        normal: VectorLike | None = None,
        blend: float | None = None,
    ) -> Self:
        """An arc to a pose, through a point or about a centre."""
        return cls.of(type="circ", pose=pose, via=via, center=center, normal=normal, blend=blend)


class ToolMotion(_ToolCurve):
    """A line, or an arc through a point or about a centre, from where the tool is.

    Args:
        type: "lin" or "circ".
    """

    type: Literal["lin", "circ"]


class CornerArc(Request):
    """The arc that leads to a rounded corner, or away from it.

    Args:
        center: Of the arc [m].
        normal: Axis to turn about by the right hand.
    """

    center: Vector3
    normal: Vector3


class RoundedCorner(Request):
    """The corner that a motion rounds: the end of one motion and the beginning of the next.

    Args:
        pose: Of the tip at the corner, which the tool passes by.
        slope: Rate at which the tool leaves the motion before, and joins the one after.
        before: Arc that leads to the corner; a line if left out.
        after: Arc that leads away from it; a line if left out.
    """

    pose: AnyPose
    slope: Positive
    before: CornerArc | None = None
    after: CornerArc | None = None


class TimedToolMotion(_ToolCurve):
    """A line, an arc or a corner that a trajectory is held to, a part of a seam perhaps.

    Args:
        rounds: The corner that a "corner" rounds.
        start: Of the tip where it begins; where the motion before ends if left out.
        begins: When it begins [s]; when the motion before ends if left out.
        part: Of a "seam" tolerance and tool speed hold.
        tolerance: By how much the tool may deviate in this motion.
        tool_speed: Of a "seam": to be kept in this motion [m/s]; that of all if left out.
    """

    rounds: RoundedCorner | None = None
    start: AnyPose | None = None
    begins: NonNegative | None = None
    part: Part | None = None
    tolerance: ToolTolerance | None = None
    tool_speed: Positive | None = None


class TimedToolMotions(Request):
    """Motions of the tool that a trajectory is held to, in turn.

    `CartesianOptions.seam_in_time` makes those of a seam from the plan along it.

    Args:
        motions: Each from where the one before ends.
        begins: When the first begins [s]; at the start of the trajectory if left out.
        ends: When each ends [s], as the tool motions of a plan tell it; may be left out for one.
        max_deviation: Of the tool's origin from its motion [m].
        max_orientation_deviation: Of its orientation from that at the same place [rad].
        orientation: "free" leads the origin only.
        tolerance: By how much the tool may deviate in motions of a seam without one of their own.
        tool_speed: To be kept in motions of a seam that have none of their own [m/s].
        speed_band: Largest difference from it, as part of it.
    """

    motions: list[ToolMotion | TimedToolMotion]
    begins: NonNegative | None = None
    ends: Vector | None = None
    max_deviation: Positive | None = None
    max_orientation_deviation: Positive | None = None
    orientation: Literal["slerp", "free"] | None = None
    tolerance: ToolTolerance | None = None
    tool_speed: Positive | None = None
    speed_band: Positive | None = None
