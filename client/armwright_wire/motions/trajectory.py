"""Timed motions and limits of joints, on the wire."""

from bisect import bisect_right
from collections.abc import Sequence
from math import ceil, perm
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import ConfigDict, Field, model_validator

from armwright_wire.base import (
    AS_LIST,
    MAX_JOINTS,
    MAX_NUMBER,
    Answer,
    Body,
    JointVector,
    Label,
    NonNegative,
    Number,
    VectorLike,
    any_given,
    as_json,
)
from armwright_wire.errors import InvalidArgument

MAX_SAMPLES = 100_000

#: Degree 9 is the highest that any timing here makes; other people's may be higher.
MAX_COEFFICIENTS = 16
#: Short pieces have large coefficients of high powers, of which little is left within them.
MAX_COEFFICIENT = 1e60


#: Times may miss the ends by so much of the duration, which is how sums of steps round.
_TIME_ROUNDING = 1e-9
#: A point this part of a period before the end would be the end twice over.
_SAME_SAMPLE = 1e-6
#: Ends slower than this share of the largest speed are at rest, as in the service's exports.
_REST = 1e-7
_NANOSECONDS = 1_000_000_000


Rows = Annotated[Sequence[JointVector], AS_LIST, Field(min_length=1, max_length=MAX_SAMPLES)]
JointRow = Annotated[Sequence[Number], AS_LIST, Field(max_length=MAX_JOINTS)]
_Coefficient = Annotated[float, Field(ge=-MAX_COEFFICIENT, le=MAX_COEFFICIENT)]
_Polynomial = Annotated[
    Sequence[_Coefficient], AS_LIST, Field(min_length=1, max_length=MAX_COEFFICIENTS)
]
Coefficients = Annotated[Sequence[_Polynomial], AS_LIST, Field(min_length=1, max_length=MAX_JOINTS)]


class Piece:
    """A polynomial piece that can be evaluated."""

    if TYPE_CHECKING:
        t0: float
        coefficients: Any

    def at(self, time: float, derivative: int = 0) -> list[float]:
        """The value of each joint, or of a derivative, at a time [s]."""
        elapsed = time - self.t0
        return [_value(row, elapsed, derivative) for row in self.coefficients]


class Pieces:
    """A motion of polynomial pieces that can be sampled."""

    if TYPE_CHECKING:
        joint_names: list[str] | None
        segments: Any

    def sample(self, times: VectorLike, derivative: int = 0) -> list[list[float]]:
        """Position of each joint, or a derivative of it, at given times.

        At a break the piece that begins there is meant, at the end the last piece.

        Args:
            times: Times from the beginning of the first piece to the end of the last [s].
            derivative: 0 position, 1 velocity, 2 acceleration, 3 jerk, ...

        Returns:
            A row for each time.

        Raises:
            InvalidArgument: There are no pieces, a time is outside of them, or the derivative is
                negative.
        """
        if not self.segments:
            raise InvalidArgument("the trajectory has samples only; nothing is known between them")
        if derivative < 0:
            raise InvalidArgument(f"there is no derivative of order {derivative}")
        starts = [segment.t0 for segment in self.segments]
        return [self._at(float(time), starts, derivative) for time in as_json(times)]

    def joint_trajectory(self, period: float, frame_id: str = "") -> dict[str, Any]:
        """The message trajectory_msgs/JointTrajectory of ROS 2 as a dictionary.

        Args:
            period: Period of the points, which end at the very end [s].
            frame_id: Frame id of the header.

        Raises:
            InvalidArgument: There are no pieces or no joint names, or the period is not positive.
        """
        times = self._times(period)
        ticks = [round((time - times[0]) * _NANOSECONDS) for time in times]
        rows = self._rows(times)
        points = [
            {
                "positions": q,
                "velocities": v,
                "accelerations": a,
                "effort": [],
                "time_from_start": {"sec": tick // _NANOSECONDS, "nanosec": tick % _NANOSECONDS},
            }
            for q, v, a, tick in zip(*rows, ticks, strict=True)
        ]
        header = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": frame_id}
        return {"header": header, "joint_names": list(self._names()), "points": points}

    def csv(self, period: float) -> str:
        """A table with a header: time, then position, velocity, acceleration of each joint.

        Args:
            period: Period of the rows, which end at the very end [s].

        Raises:
            InvalidArgument: As `joint_trajectory`.
        """
        times, names = self._times(period), self._names()
        kinds = ("position", "velocity", "acceleration")
        lines = [",".join(["time", *(f"{kind}.{name}" for kind in kinds for name in names)])]
        rows = self._rows(times)
        for time, q, v, a in zip(times, *rows, strict=True):
            lines.append(",".join(repr(value) for value in (time, *q, *v, *a)))
        return "\r\n".join([*lines, ""])

    def _rows(self, times: list[float]) -> list[list[list[float]]]:
        """Positions, velocities and accelerations; an end at rest to rounding is at rest."""
        rows = [self.sample(times, order) for order in range(3)]
        speeds = rows[1]
        rest = _REST * max(abs(speed) for row in speeds for speed in row)
        for end in (0, -1):
            speeds[end] = [0.0 if abs(speed) <= rest else speed for speed in speeds[end]]
        return rows

    def _names(self) -> list[str]:
        if not self.joint_names:
            raise InvalidArgument("the trajectory names no joints")
        return self.joint_names

    def _times(self, period: float) -> list[float]:
        """Each period from the beginning on, and the end."""
        if not self.segments or not period > 0.0:
            raise InvalidArgument("points need pieces and a positive period")
        first, last = self.segments[0].t0, self.segments[-1].t1
        count = max(1, ceil((last - first) / period - _SAME_SAMPLE))
        return [*(first + k * period for k in range(count)), last]

    def _at(self, time: float, starts: Sequence[float], derivative: int) -> list[float]:
        assert self.segments is not None
        first, last = starts[0], self.segments[-1].t1
        slack = _TIME_ROUNDING * (last - first)
        if not first - slack <= time <= last + slack:
            raise InvalidArgument(f"{time!r} s lies outside the motion, {first!r} to {last!r} s")
        inside = min(max(time, first), last)
        piece: Piece = self.segments[bisect_right(starts, inside) - 1]
        return piece.at(inside, derivative)


def _value(coefficients: Sequence[float], elapsed: float, derivative: int) -> float:
    """Horner's scheme for the derivative, whose coefficients are k!/(k−d)! c_k."""
    value = 0.0
    for power in range(len(coefficients) - 1, derivative - 1, -1):
        value = value * elapsed + perm(power, derivative) * coefficients[power]
    return value


class Segment(Body, Piece):
    """A polynomial piece: q_j(t) = Σ_k coefficients[j][k] (t − t0)^k for t0 ≤ t ≤ t1."""

    t0: Number
    """when the piece begins [s]"""
    t1: Number
    """when the piece ends [s]"""
    coefficients: Coefficients
    """[joint][power of t − t0]; beyond 1e12 only where that power of t1 − t0 brings it below"""

    @model_validator(mode="after")
    def _check_times(self) -> "Segment":
        if self.t1 <= self.t0:
            raise ValueError(f"t1 ({self.t1:g}) must be after t0 ({self.t0:g})")
        for row in self.coefficients:
            for power, value in enumerate(row):
                far = abs(value) > MAX_NUMBER
                if far and abs(value) * min(1.0, self.t1 - self.t0) ** power > MAX_NUMBER:
                    raise ValueError(
                        f"coefficients: {value:g} of power {power} is beyond {MAX_NUMBER:g} within "
                        "the piece"
                    )
        return self


class Samples(Body):
    """Points of a motion, one row of joint values for each time."""

    time: Annotated[list[Number], Field(min_length=1, max_length=MAX_SAMPLES)]
    """of each row, increasing [s]"""
    position: Rows
    """of the joints [rad or m]"""
    velocity: Rows | None = None
    """of the joints [rad/s or m/s]"""
    acceleration: Rows | None = None
    """of the joints [rad/s² or m/s²]"""

    @model_validator(mode="after")
    def _check_lengths(self) -> "Samples":
        for name in ("position", "velocity", "acceleration"):
            rows = getattr(self, name)
            if rows is not None and len(rows) != len(self.time):
                raise ValueError(f"{name} has {len(rows)} rows for {len(self.time)} times")
        return self


class TrajectoryBody(Body, Pieces):
    """Anybody's motion: polynomial pieces, or samples and how to read between them."""

    model_config = ConfigDict(
        json_schema_extra=any_given(("segments",), ("samples", "interpolation"))
    )

    joint_names: Annotated[list[Label], Field(min_length=1, max_length=MAX_JOINTS)] | None = None
    """order of the joints; the robot's if left out"""
    duration: NonNegative | None = None
    """for people: the motion lasts as long as its segments or samples do [s]"""
    segments: Annotated[list[Segment], Field(min_length=1, max_length=MAX_SAMPLES)] | None = None
    """polynomial pieces, in the order of time"""
    samples: Samples | None = None
    interpolation: Annotated[str, Field(pattern=r"^[a-z_]{1,32}$")] | None = None
    """how to read between samples: linear, cubic, quintic, natural_spline, …"""

    @model_validator(mode="after")
    def _check_form(self) -> "TrajectoryBody":
        # What a plan answered can be sent as it is: it has both, and the pieces are the motion.
        if self.segments is None and self.samples is None:
            raise ValueError("give segments, or samples with interpolation")
        if self.segments is None and self.interpolation is None:
            raise ValueError("samples need interpolation: how to read between them")
        return self


class LimitsBody(Body):
    """Limits in the order of the joints, in place of the robot's."""

    velocity: JointRow | None = None
    """largest speed of each joint [rad/s or m/s]"""
    acceleration: JointRow | None = None
    """largest acceleration of each joint [rad/s² or m/s²]"""
    jerk: JointRow | None = None
    """largest jerk of each joint [rad/s³ or m/s³]"""
    effort: JointRow | None = None
    """of torques, where these are limited"""


class SegmentAnswer(Answer, Piece):
    """A polynomial piece, see `Segment`."""

    t0: float
    """when the piece begins [s]"""
    t1: float
    """when the piece ends [s]"""
    coefficients: list[list[float]]
    """[joint][power of t − t0]"""


class SamplesAnswer(Answer):
    """The motion at regular times."""

    time: list[float]
    """of each row, increasing [s]"""
    position: list[list[float]]
    """of the joints [rad or m]"""
    velocity: list[list[float]]
    """of the joints [rad/s or m/s]"""
    acceleration: list[list[float]]
    """of the joints [rad/s² or m/s²]"""


class TrajectoryAnswer(Answer, Pieces):
    """A timed motion."""

    joint_names: list[str]
    """order of the joints"""
    duration: float
    """of the motion [s]"""
    segments: list[SegmentAnswer]
    """polynomial pieces, which are the motion"""
    samples: SamplesAnswer | None = None
