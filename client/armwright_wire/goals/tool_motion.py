"""Motions of the tool on the wire: lines, arcs and seams of the planner "cartesian"."""

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, ValidationError, model_validator
from pydantic.config import JsonDict

from armwright_wire.base import (
    AS_LIST,
    Answer,
    Beside,
    Body,
    BodyWithRules,
    Frame,
    FreeOrRange,
    NonNegative,
    Point,
    Rotation,
    Vector3,
    VectorLike,
    is_given,
    not_where,
    only_where,
)
from armwright_wire.goals.goal import given_fields
from armwright_wire.pose import AnyPose, PoseAnswer, PoseInFrame

MAX_WAYPOINTS = 2_000

Length = Annotated[float, Field(ge=-1.0, le=1.0)]
Angle = Annotated[float, Field(ge=-3.2, le=3.2)]
LengthRange = Annotated[list[Length], Field(min_length=2, max_length=2)]
AngleRange = Annotated[list[Angle], Field(min_length=2, max_length=2)]
Blend = Annotated[float, Field(ge=0.0, le=10.0)]
Axis = Literal["x", "y", "z", "rx", "ry", "rz"]
Turning = Literal["shorter", "longer"]
Speed = Annotated[float, Field(gt=0.0, le=100.0)]


class ToolTolerance(FreeOrRange):
    """Ranges of the tool's deviation [least, largest]; axes left out are exact.

    The tool's pose is T_pose Trans(x, y, z) Rx(rx) Ry(ry) Rz(rz) in its own frame.
    """

    x: LengthRange | None = Field(None, examples=[[-0.001, 0.001]])
    """[m]"""
    y: LengthRange | None = None
    """[m]"""
    z: LengthRange | None = None
    """[m]"""
    rx: AngleRange | None = None
    """[rad]"""
    ry: AngleRange | None = None
    """[rad], within 1.4 of 0"""
    rz: AngleRange | None = None
    """[rad]"""
    free: list[Rotation] = Field(default_factory=list, max_length=3, examples=[["rz"]])
    """rotations by any angle"""
    tilt: Annotated[float, Field(gt=0.0, le=1.4)] | None = None
    """largest angle between the tool's z and that of the pose [rad]"""
    frame: Frame | None = None
    """whose axes deviations are along: "tool", those of each pose, if left out; or a link that
    stands still
    """


class Waypoint(BodyWithRules):
    """A pose of the tool, or a point with the surface's normal that the tool's z is against."""

    one_of: ClassVar[tuple[str, ...]] = ("pose", "point")
    needs: ClassVar[Beside] = {"point": ("normal",), "normal": ("point",), "direction": ("point",)}

    pose: PoseInFrame | None = None
    """of the tip, without deviation"""
    point: Point | None = None
    """place of the tip [m]"""
    normal: Vector3 | None = None
    """with point: out of the surface; the tool's z axis points against it"""
    direction: Vector3 | None = None
    """with point: the tool's x axis, as far as it is across the normal; any angle about the normal
    if left out
    """
    frame: Frame | None = None
    """of point, normal, direction and via"""
    via: Point | None = None
    """on the arc from the waypoint before; a line if not"""
    tolerance: ToolTolerance | None = None
    """on the way to it and there; that of the options if left out"""
    free: list[Axis] = Field(default_factory=list, max_length=6, examples=[["rz"]])
    """axes that are free there and on the way to it, beside what tolerance says: rotations by any
    angle, x, y and z by up to 1 m
    """
    blend: Blend | None = None
    """distance from it at which the tool may leave the way [m]"""
    tool_speed: Speed | None = None
    """to be kept on the way to it [m/s]; that of the options if left out, which has to be there if
    others have their own
    """

    @model_validator(mode="after")
    def _check_form(self) -> "Waypoint":
        if self.normal is not None and not any(self.normal):
            raise ValueError("normal: has no length")
        for name in self.free:
            if self.tolerance is not None and getattr(self.tolerance, name) is not None:
                raise ValueError(f"{name} has a range and is free")
        return self

    @classmethod
    def at(cls, pose: AnyPose, *, tolerance: ToolTolerance | None = None) -> Self:
        """A waypoint at a pose."""
        return cls.of(pose=pose, tolerance=tolerance)

    @classmethod
    def on(
        cls, point: VectorLike, normal: VectorLike, *, direction: VectorLike | None = None
    ) -> Self:
        """A waypoint on a surface, with the normal out of it."""
        return cls.of(point=point, normal=normal, direction=direction)


class StraightOffset(Body):
    """A straight motion to the seam's start, or from its end."""

    direction: Vector3 = Field(examples=[[0.0, 0.0, 1.0]])
    """of the motion"""
    distance: Annotated[float, Field(gt=0.0, le=5.0)] = Field(examples=[0.05])
    """[m]"""
    frame: Literal["tool", "base"] = "tool"
    """direction is along the axes of the tool at the seam, or of the root"""

    @model_validator(mode="after")
    def _check_direction(self) -> "StraightOffset":
        if not any(self.direction):
            raise ValueError("direction: has no length")
        return self


MAX_MOTIONS = 200
#: Of a seam: one for each waypoint and two where it rounds a corner, and the ways there and back.
MAX_TIMED_MOTIONS = 3 * MAX_WAYPOINTS + 2

Deviation = Annotated[float, Field(ge=1e-7, le=1.0)]
Ends = Annotated[Sequence[NonNegative], AS_LIST, Field(min_length=1, max_length=MAX_TIMED_MOTIONS)]


#: The published rule of a motion that is no arc, or an arc.
_LINE_OR_ARC: JsonDict = {
    "oneOf": [
        {
            "properties": {"type": {"enum": ["lin", "corner"]}},
            "not": {"anyOf": [is_given("via"), is_given("center")]},
        },
        {
            "properties": {"type": {"const": "circ"}},
            "oneOf": [is_given("via"), is_given("center")],
        },
    ]
}


class ToolCurve(BodyWithRules):
    """A motion of the tool from where it is: what all kinds of them have."""

    goes_by_fields: ClassVar[bool] = True
    only_beside: ClassVar[Beside] = {"normal": ("center",)}
    published_rules: ClassVar[tuple[JsonDict, ...]] = (_LINE_OR_ARC,)

    type: Literal["lin", "circ", "corner"] = Field(examples=["lin"])
    """line, arc or rounded corner"""
    pose: PoseInFrame
    """of the tip where the motion ends"""
    via: Point | None = None
    """point on the arc"""
    center: Point | None = None
    """of the arc"""
    normal: Vector3 | None = None
    """with center: axis to turn about by the right hand, up to a whole turn; the shorter arc if
    left out
    """
    rotation: Turning = "shorter"
    """which way round the tool turns about the one axis of its rotation"""
    blend: Blend | None = None
    """distance from its end at which the tool may leave it for the next one, half of either motion
    at most; that of the options if left out [m]
    """

    @model_validator(mode="after")
    def _check_form(self) -> Self:
        if self.type != "circ":
            if not (self.via is self.center is None):
                raise ValueError("via, center and normal belong to motions of type circ")
        elif (self.via is None) == (self.center is None):
            raise ValueError("a motion of type circ needs exactly one of via, center")
        return self

    @classmethod
    def lin(cls, pose: AnyPose, *, blend: float | None = None) -> Self:
        """A line to a pose."""
        return cls.of(type="lin", pose=pose, blend=blend)

    @classmethod
    def circ(
        cls,
        pose: AnyPose,
        *,
        via: VectorLike | None = None,
        center: VectorLike | None = None,
        normal: VectorLike | None = None,
        blend: float | None = None,
    ) -> Self:
        """An arc to a pose, through a point or about a centre."""
        return cls.of(type="circ", pose=pose, via=via, center=center, normal=normal, blend=blend)


class ToolMotion(ToolCurve):
    """A line, or an arc through a point or about a centre, from where the tool is."""

    type: Literal["lin", "circ"] = Field(examples=["lin"])
    """line or arc"""


class CornerArc(Body):
    """The arc that leads to a rounded corner, or away from it."""

    center: Point
    """of the arc, in the frame of the motion's pose"""
    normal: Vector3
    """axis to turn about by the right hand"""


class RoundedCorner(Body):
    """The corner that a motion rounds: the end of one motion and the beginning of the next."""

    pose: PoseInFrame
    """of the tip at the corner, which the tool passes by"""
    slope: Annotated[float, Field(gt=0.0, le=2.5)]
    """rate at which the tool leaves the motion before, and joins the one after"""
    before: CornerArc | None = None
    """arc that leads to the corner; a line if left out"""
    after: CornerArc | None = None
    """arc that leads away from it; a line if left out"""


class ToolDeviations(Body):
    """How far the tool may be from its motion."""

    max_deviation: Deviation = 1e-4
    """of the tool's origin from its motion, for every instant [m]"""
    max_orientation_deviation: Deviation = 1e-3
    """of its orientation from that at the same place [rad]"""


class CartesianOptions(ToolDeviations, BodyWithRules):
    """`planner_options` of the planner "cartesian"."""

    only_beside: ClassVar[Beside] = {
        "tolerance": ("waypoints",),
        "through": ("waypoints",),
        "tool_speed": ("waypoints",),
        "approach": ("waypoints",),
        "retreat": ("waypoints",),
        "branch_changes": ("waypoints",),
    }
    at_most_one = (("motions", "waypoints"),)

    motions: Annotated[list[ToolMotion], Field(min_length=1, max_length=MAX_MOTIONS)] | None = None
    """one line to the goal if left out"""
    orientation: Literal["slerp", "free"] = "slerp"
    """about an axis that keeps still, or only the origin is led"""
    allow_partial: bool = False
    """a motion that ends early is an answer too"""
    blend: Blend = 0.0
    """corners are rounded by curves that begin and end at most so far from them, and the tool runs
    through; it rests at corners if 0 [m]
    """

    waypoints: Annotated[list[Waypoint], Field(min_length=2, max_length=MAX_WAYPOINTS)] | None = (
        None
    )
    """of a seam, in place of motions; the goal may be left out then"""
    tolerance: ToolTolerance | None = None
    """of all waypoints: by how much the tool may deviate; exact if left out"""
    through: Literal["polyline", "spline"] | None = None
    """lines between waypoints, also if left out; or arcs through the middles of a cubic spline,
    which a note measures against the lines: corners above 60 degrees stay
    """
    tool_speed: Speed | None = None
    """to be kept on the way to waypoints that have none of their own [m/s]"""
    speed_band: Annotated[float, Field(gt=0.0, le=1.0)] = 0.1
    """largest difference from tool_speed, as part of it"""
    approach: StraightOffset | None = None
    """to the first waypoint"""
    retreat: StraightOffset | None = None
    """from the last waypoint"""
    branch_changes: StraightOffset | None = None
    """retreat from a waypoint after which the arm may come back in another branch of its inverse
    kinematics; a seam that needs one is refused if left out
    """

    def as_options(self) -> dict[str, Any]:
        """The mapping that a plan's `planner_options` take."""
        return self.model_dump(mode="json", exclude_none=True)

    def seam_in_time(self, reports: Sequence["ToolMotionAnswer"]) -> "TimedToolMotions":
        """A seam as a trajectory is held to it, see `Client.validate`.

        Args:
            reports: `tool_motions` of the plan along this seam; of a motion that was recorded
                later, with the times of that one.
        """
        return TimedToolMotions.of(
            motions=[
                TimedToolMotion.of(
                    **given_fields(report.as_motion),
                    start=report.start,
                    begins=report.begins,
                    part=report.part,
                    tolerance=self._tolerance(report),
                    tool_speed=self._tool_speed(report),
                )
                for report in reports
            ],
            ends=[report.ends for report in reports],
            max_deviation=self.max_deviation,
            max_orientation_deviation=self.max_orientation_deviation,
            tolerance=self.tolerance,
            tool_speed=self.tool_speed,
            speed_band=self.speed_band,
        )

    def _tolerance(self, report: "ToolMotionAnswer") -> ToolTolerance | None:
        """Tolerance of the waypoint that a part of a seam leads to, where it has one of its own."""
        if self.waypoints is None or report.part != "seam":
            return None
        waypoint = self.waypoints[report.motion + 1]
        free = set(waypoint.free)
        if waypoint.point is not None and waypoint.direction is None:
            # Without a direction any angle about the normal will do.
            free.add("rz")
        if not free:
            return waypoint.tolerance
        given = waypoint.tolerance or self.tolerance or ToolTolerance()
        changes: dict[str, Any] = {axis: [-1.0, 1.0] for axis in free & {"x", "y", "z"}}
        turns = free - set(changes)
        changes |= dict.fromkeys(turns) | {"free": sorted({*given.free, *turns})}
        return given.model_copy(update=changes)

    def _tool_speed(self, report: "ToolMotionAnswer") -> float | None:
        """The speed to the waypoint that a part of a seam leads to, where it has its own."""
        if self.waypoints is None or report.part != "seam":
            return None
        return self.waypoints[report.motion + 1].tool_speed


class TimedToolMotion(ToolCurve):
    """A line, an arc or a corner that a trajectory is held to, a part of a seam perhaps."""

    published_rules: ClassVar[tuple[JsonDict, ...]] = (
        _LINE_OR_ARC,
        {
            "oneOf": [
                {"properties": {"type": {"const": "corner"}}, "allOf": [is_given("rounds")]},
                {
                    "properties": {"type": {"enum": ["lin", "circ"]}},
                    "not": is_given("rounds"),
                },
            ]
        },
        only_where("tool_speed", part="seam"),
        not_where("tolerance", type="corner"),
        not_where(type="corner", part="seam"),
    )

    rounds: RoundedCorner | None = None
    """the corner that a "corner" rounds"""
    start: PoseInFrame | None = None
    """of the tip where it begins; where the motion before ends if left out, of the first one where
    the tool is at the start of the trajectory
    """
    begins: NonNegative | None = None
    """when it begins [s]; when the motion before ends if left out, the tool is free in between if
    later
    """
    part: Literal["motion", "approach", "seam", "retreat"] = "motion"
    """of a "seam" tolerance and tool_speed hold"""
    tolerance: ToolTolerance | None = None
    """by how much the tool may deviate in this motion"""
    tool_speed: Speed | None = None
    """of a "seam": to be kept in this motion [m/s]; that of all if left out"""

    @model_validator(mode="after")
    def _check_speed(self) -> "TimedToolMotion":
        if self.tool_speed is not None and self.part != "seam":
            raise ValueError('tool_speed belongs to motions whose part is "seam"')
        if (self.type == "corner") != (self.rounds is not None):
            raise ValueError("rounds belongs to motions of type corner, which need it")
        if self.type == "corner" and (self.part == "seam" or self.tolerance is not None):
            raise ValueError("a motion of type corner has no tolerance, and is no part of a seam")
        return self


class TimedToolMotions(ToolDeviations):
    """Motions of the tool that a trajectory is held to, in turn."""

    motions: Annotated[list[TimedToolMotion], Field(min_length=1, max_length=MAX_TIMED_MOTIONS)]
    """lines, arcs and corners, in their order"""
    begins: NonNegative | None = None
    """when the first motion begins [s]; at the start of the trajectory if left out"""
    ends: Ends | None = None
    """when each motion ends [s], as tool_motions of a plan tell it; the end of the trajectory if
    left out, for one motion
    """
    tolerance: ToolTolerance | None = None
    """by how much the tool may deviate in motions that are parts of a seam and have no tolerance of
    their own; the deviations are added on all sides
    """
    tool_speed: Speed | None = None
    """to be kept in motions that are parts of a seam and have none of their own [m/s]"""
    speed_band: Annotated[float, Field(gt=0.0, le=1.0)] = 0.1
    """largest difference from tool_speed, as part of it"""
    orientation: Literal["slerp", "free"] = "slerp"
    """about an axis that keeps still, or only the origin is led"""

    @model_validator(mode="after")
    def _check_ends(self) -> "TimedToolMotions":
        count = 1 if self.ends is None else len(self.ends)
        if count != len(self.motions):
            raise ValueError("ends needs as many times as there are motions")
        if self.ends is not None and sorted(self.ends) != self.ends:
            raise ValueError("ends must not descend")
        if any(motion.blend for motion in self.motions):
            raise ValueError(
                "blend belongs to plans: give the corners that tool_motions of one tell"
            )
        if self.begins is not None and self.ends is not None and self.begins > self.ends[0]:
            raise ValueError("begins is after the end of the first motion")
        if not any(motion.part == "seam" for motion in self.motions):
            for name in ("tolerance", "tool_speed"):
                if getattr(self, name) is not None:
                    raise ValueError(f'{name} belongs to motions whose part is "seam"')
        return self


def cartesian_options(given: Mapping[str, Any] | None) -> CartesianOptions:
    """The options, checked.

    Raises:
        ValueError: They have not the right form; the message says where.
    """
    try:
        return CartesianOptions.model_validate(given or {})
    except ValidationError as error:
        first = error.errors()[0]
        steps = (f"[{step}]" if isinstance(step, int) else f".{step}" for step in first["loc"])
        text = str(first["msg"]).removeprefix("Value error, ")
        raise ValueError(f"planner_options{''.join(steps)}: {text}") from None


class CornerArcAnswer(Answer):
    """The arc that leads to a rounded corner, or away from it."""

    center: list[float]
    """[m]"""
    normal: list[float]
    """axis that it turns about"""


class RoundedCornerAnswer(Answer):
    """The corner that a motion rounds."""

    pose: PoseAnswer
    """of the tip at the corner, which the tool passes by"""
    slope: float
    """rate at which the tool leaves the motion before, and joins the one after"""
    before: CornerArcAnswer | None
    """arc that leads to the corner; null for a line"""
    after: CornerArcAnswer | None
    """arc that leads away from it; null for a line"""


class SpeedLimitAnswer(Answer):
    """Limit of a joint that keeps the tool below the speed asked for."""

    speed: float
    """largest constant speed of the tool that it allows [m/s]"""
    joint: str
    """name of the joint"""
    quantity: Literal["velocity", "acceleration", "jerk"]
    """which limit of it"""


class ToolMotionAnswer(Answer):
    """Result of one tool motion."""

    type: Literal["lin", "circ", "corner"]
    """line, arc or rounded corner"""
    length: float
    """of the whole of it [m]"""
    angle: float
    """how far the tool turns in the whole of it [rad]"""
    rotation: Turning = "shorter"
    """which way round it turns"""
    fraction: float
    """how far it was carried out"""
    begins: float
    """[s]"""
    ends: float
    """[s]"""
    motion: int
    """index of the motion of the request that it is a part of; of a seam, of the waypoint that it
    leaves
    """
    part: Literal["motion", "approach", "seam", "retreat"]
    """a motion of the request, or the way to, along or from a seam"""
    blend: bool
    """it rounds the corner at the end of that motion"""
    pose: PoseAnswer
    """of the tip where it ends, carried out in full"""
    start: PoseAnswer | None = None
    """of the tip where it begins; null where the motion before ends"""
    center: list[float] | None
    """of an arc [m]"""
    normal: list[float] | None
    """axis that an arc turns about"""
    rounds: RoundedCornerAnswer | None = None
    """the corner that a motion of type corner rounds"""
    speed_limit: SpeedLimitAnswer | None = None
    """what keeps the tool below timing.tool_speed in it; null where nothing does, or none is asked
    for. Before and after, the tool slows down and speeds up
    """

    @property
    def as_motion(self) -> ToolMotion | TimedToolMotion:
        """The motion as a request has it, to have a trajectory held to it."""
        if self.rounds is not None:
            corner = RoundedCorner.model_validate(self.rounds.model_dump(exclude_none=True))
            return TimedToolMotion(type="corner", pose=self.pose, rounds=corner)
        motion = ToolMotion.lin(self.pose)
        if self.center is not None:
            motion = ToolMotion.circ(self.pose, center=self.center, normal=self.normal)
        return motion.model_copy(update={"rotation": self.rotation})


class ReferencePoseAnswer(Answer):
    """The pose that the tool is held to at an instant: deviations are measured from it."""

    time: float
    """the instant, drawn by the seed of the request [s]"""
    motion: int
    """index of the tool motion that it is on"""
    pose: PoseAnswer
    """of the tip at the place of the motion nearest to it"""
