"""Timed motions as polynomial pieces, to be sampled without NumPy."""

from bisect import bisect_right
from collections.abc import Sequence
from math import ceil, perm
from typing import Any, Self

from pydantic import model_validator

from armwright_client.base import NonNegative, Request, Rows, Vector, VectorLike, plain
from armwright_client.errors import InvalidArgument

#: Times may miss the ends by so much of the duration, which is how sums of steps round.
_TIME_ROUNDING = 1e-9
#: A point this part of a period before the end would be the end twice over.
_SAME_SAMPLE = 1e-6
#: Ends slower than this share of the largest speed are at rest, as in the service's exports.
_REST = 1e-7
_NANOSECONDS = 1_000_000_000


class Segment(Request):
    """A polynomial piece: q_j(t) = Σ_k coefficients[j][k] (t − t0)^k for t0 ≤ t ≤ t1.

    Args:
        t0: When it begins [s].
        t1: When it ends [s].
        coefficients: A row for each joint, lowest power first.
    """

    t0: float
    t1: float
    coefficients: Rows

    def at(self, time: float, derivative: int = 0) -> list[float]:
        """The value of each joint, or of a derivative, at a time [s]."""
        elapsed = time - self.t0
        return [_value(row, elapsed, derivative) for row in self.coefficients]


class Samples(Request):
    """Points of a motion, one row of joint values for each time [s]."""

    time: Vector
    position: Rows
    velocity: Rows | None = None
    acceleration: Rows | None = None


class Trajectory(Request):
    """A timed motion: polynomial pieces, or samples and how to read between them.

    A plan answers pieces, and samples where they were asked for. To have a motion of your own
    validated, give either.

    Args:
        joint_names: The order of the joints.
        duration: [s].
        segments: In order of time.
        samples: At some times.
        interpolation: How to read between samples where there are no segments: "linear",
            "natural_spline", ...
    """

    joint_names: list[str] | None = None
    duration: NonNegative | None = None
    segments: list[Segment] | None = None
    samples: Samples | None = None
    interpolation: str | None = None

    @model_validator(mode="after")
    def _check_form(self) -> Self:
        if not self.segments and self.samples is None:
            raise ValueError("give segments, or samples with interpolation")
        return self

    def sample(self, times: VectorLike, derivative: int = 0) -> list[list[float]]:
        """Position of each joint, or a derivative of it, at given times.

        At a break the piece that begins there is meant, at the end the last piece.

        Args:
            times: From the beginning of the first piece to the end of the last [s].
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
        return [self._at(float(time), starts, derivative) for time in plain(times)]

    def joint_trajectory(self, period: float, frame_id: str = "") -> dict[str, Any]:
        """The message trajectory_msgs/JointTrajectory of ROS 2 as a dictionary.

        Args:
            period: Of the points, which end at the very end [s].
            frame_id: Of the header.

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
            period: Of the rows, which end at the very end [s].

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
        return self.segments[bisect_right(starts, inside) - 1].at(inside, derivative)


class TimedTrajectory(Trajectory):
    """A motion as the service answers it: pieces from time 0 to `duration` [s]."""

    joint_names: list[str]
    duration: NonNegative
    segments: list[Segment]


def _value(coefficients: Sequence[float], elapsed: float, derivative: int) -> float:
    """Horner's scheme for the derivative, whose coefficients are k!/(k−d)! c_k."""
    value = 0.0
    for power in range(len(coefficients) - 1, derivative - 1, -1):
        value = value * elapsed + perm(power, derivative) * coefficients[power]
    return value
