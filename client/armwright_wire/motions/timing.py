"""Options of timing, and the account of it that answers give."""

from typing import Annotated, Literal

from pydantic import AliasChoices, Field

from armwright_wire.base import Answer, Body, NonNegative, Positive, Ratio
from armwright_wire.robots.payload import Payload

#: Waypoints with times of one request.
MAX_TIMES = 100_000

TimingMethod = Literal["toppra", "spline", "jerk_limited"]
TimingSolver = Literal["reachability", "toppra", "quintic_spline", "double_s", "interior_point"]


class Timing(Body):
    """Options of the timing."""

    method: TimingMethod | None = Field(None, examples=["jerk_limited"])
    """left out: jerk_limited, with the robot's jerk limits, and 25 x acceleration for joints that
    have none, which the answer tells; toppra for the least time. A path without a robot and without
    jerk limits is timed by toppra
    """
    solver: TimingSolver | None = None
    """of jerk_limited: quintic_spline (fewest pieces, near the path where that is proved) or
    interior_point (on the path; double_s is its older name); the first where method is left out,
    else the second. Of toppra: reachability (ours) if left out; toppra runs the package of that
    name, slows its answer down until all limits hold between its grid points too, and tells in the
    notes what that costs
    """
    velocity_scaling: Ratio | None = None
    """share of the velocity limits; 1 if left out"""
    acceleration_scaling: Ratio | None = None
    """share of the acceleration limits; 1 if left out"""
    jerk_scaling: Ratio | None = None
    """share of the jerk limits; 1 if left out"""
    times: Annotated[list[NonNegative], Field(min_length=2, max_length=MAX_TIMES)] | None = None
    """at the waypoints, for the method spline; from 0, increasing [s]"""
    scale_times: bool | None = None
    """stretch the times by the least factor that keeps all limits"""
    interpolation: Literal["linear", "natural_spline", "clamped_spline"] | None = None
    """between waypoints: straight lines, or a cubic spline kept exactly"""
    blend_tolerance: NonNegative | None = None
    """how far straight lines' corners may be cut, Euclidean in joint space"""
    torque_limits: bool | None = None
    """keep the robot's effort limits too"""
    payload: Payload | None = None
    """what the tip carries, for torques"""
    tool_speed: Positive | None = None
    """largest speed of the tip [m/s]"""
    duration: Positive | None = Field(None, examples=[2.0])
    """the motion is slowed down to this duration; refused where it takes longer. Of plan and
    retime, not of motions that lead the tool [s]
    """
    at_least: bool | None = None
    """a motion that takes longer than the duration stays as it is"""
    sample_period: Annotated[float, Field(ge=1e-4, le=60.0)] | None = None
    """samples are answered at this period [s], else none"""
    sample_count: Annotated[int, Field(ge=2, le=MAX_TIMES)] | None = None
    """so many samples are answered, evenly spaced, in place of a period. Of plan and retime"""


class RuledLimits(Answer):
    """Limits that are not known and follow a rule."""

    rule: str = Field(examples=["25 x acceleration"])
    """multiple of another limit"""
    joints: list[str]
    """that have no limit of their own"""


class HeldLimits(Answer):
    """Limits that a motion keeps between two instants, beside those of all of it."""

    begin: float = Field(validation_alias=AliasChoices("from"), serialization_alias="from")
    """the first instant [s]"""
    end: float = Field(validation_alias=AliasChoices("to"), serialization_alias="to")
    """the last instant [s]"""
    velocity: list[float | None]
    """of each joint; null for none"""
    acceleration: list[float | None]
    """of each joint; null for none"""
    tool_speed: float | None = None
    """of the tip [m/s]; null for none"""


class TimingAnswer(Answer):
    """Method and limits that a motion was timed by."""

    method: TimingMethod
    """that timed the motion"""
    solver: TimingSolver | None = None
    """that found the speeds; null where the method has one only"""
    limits: dict[str, list[float | None]]
    """velocity, acceleration and jerk of each joint, scaled; null for none"""
    ruled: dict[str, RuledLimits] = Field(default_factory=dict)
    """limits that the robot lacks, by quantity"""
    limits_at: list[HeldLimits] = Field(default_factory=list)
    """narrower limits, as the certificate judges them"""
    lower_bound: float | None = None
    """no motion along the same way takes less within these limits of velocity and acceleration [s];
    null where it is not worked out
    """
    gap: float | None = None
    """by how much the motion takes longer, as a part of the lower bound"""
