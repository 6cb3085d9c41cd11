"""Results of tool motions."""

from armwright_client.base import Answer
from armwright_client.pose import Pose
from armwright_client.tool_motion import Part, RoundedCorner, TimedToolMotion, ToolMotion


class CornerArcReport(Answer):
    """The arc that leads to a rounded corner, or away from it.

    Args:
        center: Of the arc [m].
        normal: Axis that it turns about.
    """

    center: list[float]
    normal: list[float]


class RoundedCornerReport(Answer):
    """The corner that a motion rounds.

    Args:
        pose: Of the tip at the corner, which the tool passes by.
        slope: Rate at which the tool leaves the motion before, and joins the one after.
        before: Arc that leads to the corner; None for a line.
        after: Arc that leads away from it; None for a line.
    """

    pose: Pose
    slope: float
    before: CornerArcReport | None
    after: CornerArcReport | None


class SpeedLimit(Answer):
    """Limit of a joint that keeps the tool below the speed asked for.

    Args:
        speed: Largest constant speed of the tool that it allows [m/s].
        joint: Name of the joint.
        quantity: "velocity", "acceleration" or "jerk".
    """

    speed: float
    joint: str
    quantity: str


class ReferencePose(Answer):
    """The pose that the tool is held to at an instant.

    Args:
        time: The instant [s].
        motion: Index of the tool motion that it is on.
        pose: Of the tip at the place of the motion nearest to it.
    """

    time: float
    motion: int
    pose: Pose


class ToolMotionReport(Answer):
    """Result of one tool motion.

    Args:
        type: "lin", "circ" or "corner".
        length: Of the whole of it [m].
        angle: How far the tool turns in the whole of it [rad].
        fraction: How far it was carried out.
        begins: When [s].
        ends: When [s].
        motion: Index of the motion of the request that it is a part of; of a seam, of the waypoint
            that it leaves.
        part: "motion", or "approach", "seam" and "retreat" of waypoints.
        blend: Whether it rounds the corner at the end of that motion.
        pose: Of the tip where it ends, carried out in full.
        start: Of the tip where it begins; None where the motion before ends.
        center: Of an arc [m].
        normal: Axis that an arc turns about.
        rounds: The corner that a motion of type corner rounds.
        speed_limit: What keeps the tool below the speed asked for; None where nothing does.
    """

    type: str
    length: float
    angle: float
    fraction: float
    begins: float
    ends: float
    motion: int
    part: Part
    blend: bool
    pose: Pose
    start: Pose | None = None
    center: list[float] | None
    normal: list[float] | None
    rounds: RoundedCornerReport | None = None
    speed_limit: SpeedLimit | None = None

    @property
    def as_motion(self) -> ToolMotion | TimedToolMotion:
        """The motion as a request has it, to have a trajectory held to it."""
        if self.rounds is not None:
            corner = RoundedCorner.model_validate(self.rounds.model_dump(exclude_none=True))
            return TimedToolMotion(type="corner", pose=self.pose, rounds=corner)
        if self.center is None:
            return ToolMotion.lin(self.pose)
        return ToolMotion.circ(self.pose, center=self.center, normal=self.normal)
