"""Motions near a path: along straight lines between few waypoints, or along a smooth curve."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, partial
from typing import NamedTuple

import numpy as np

from kinematics.arrays import Array
from kinematics.model.chain import Chain
from planning.proof.certificate import Certificate, certify_limits
from planning.timing.failure import TimingFailed
from planning.timing.method import JerkLimited
from planning.timing.options import TimingOptions
from planning.timing.parametrization import TimeParametrization
from planning.timing.path.path import JointPath
from planning.timing.path.simplification import Polyline, simplified_polyline
from planning.timing.spline.spline import smooth_curve
from planning.timing.time_scaling import ScaledTime, with_duration
from planning.values.limits import MotionLimits


@dataclass(frozen=True, slots=True, eq=False)
class PathToTime:
    """A path whose motion is wanted.

    Args:
        joint_names: n names.
        waypoints: Shape (k, n), k >= 1 [rad or m].
        knots: Knots of a spline through them, shape (k,); by distance in joint space where none are
            given. Times, for the method "spline" [s].
        tolerance: How far any joint may be from straight lines through them, at every place, for
            the motion to have the fewest corners [rad or m]; None for none.
    """

    joint_names: tuple[str, ...]
    waypoints: Array
    knots: Array | None = None
    tolerance: float | None = None


class Attempt(NamedTuple):
    """A motion to be tried, and notes that hold where it is taken.

    Args:
        motion: Makes the motion; raises TimingFailed where there is none.
        notes: The notes.
    """

    motion: Callable[[], ScaledTime]
    notes: tuple[str, ...] = ()

    def lasting(self, timing: TimingOptions) -> "Attempt":
        """The attempt with the duration that is asked for."""
        if timing.duration is None:
            return self
        return self._replace(
            motion=lambda: with_duration(self.motion(), timing.duration, timing.at_least)
        )


def first_verified(
    attempts: Sequence[Attempt], chain: Chain | None, wanted: MotionLimits
) -> tuple[ScaledTime, Certificate, tuple[str, ...]]:
    """The first motion that is proved, else the last one, its certificate, and notes on it.

    Raises:
        TimingFailed: The last attempt finds none.
    """
    for number, attempt in enumerate(attempts, start=1):
        try:
            timed = attempt.motion()
        except TimingFailed:
            if number == len(attempts):
                raise
            continue
        certificate = certify_limits(timed.trajectory, chain, wanted)
        if certificate.verified:
            break
    return timed, certificate, attempt.notes


@dataclass(slots=True)
class NearPath:
    """What stands for a path: few of its waypoints, and a smooth curve where there is one.

    Args:
        path: The path as it was asked for.
        points: Its waypoints, shape (k, n).
        timing: Options of the timing.
        parametrization: Method and limits.
    """

    path: PathToTime
    points: Array
    timing: TimingOptions
    parametrization: TimeParametrization
    line: Polyline = field(init=False)

    def __post_init__(self) -> None:
        self.line = simplified_polyline(
            self.points,
            self.path.tolerance or self.timing.blend_tolerance or 0.0,
            self.parametrization.smooth,
            moving=self._moving,
            norm=self._norm,
        )

    @property
    def _moving(self) -> bool:
        return self.timing.start_velocity is not None or self.timing.end_velocity is not None

    @property
    def _norm(self) -> float:
        return 2.0 if self.path.tolerance is None else np.inf

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on waypoints that straight lines pass by, and on stops."""
        return _line_notes(self.line)

    def attempts(self) -> list[Attempt]:
        """Motions by the solver asked for, then by another one, in the order of their durations.

        With many corners the optimum on a grid can be slower than closed forms, which are found in
        a moment: the faster of the two is taken. A curve is taken where that is faster still.
        """
        solvers = [self.parametrization]
        if isinstance(self.parametrization.method, JerkLimited):
            other = self.parametrization.method.other
            solvers.append(replace(self.parametrization, method=other))

        @cache
        def fastest() -> ScaledTime:
            closed = [self._on_line(by) for by in solvers[1:] if by.even_corners]
            found = [self._on_line(self.parametrization), *closed]
            return min(found, key=lambda timed: timed.trajectory.duration)

        motions: list[Callable[[], ScaledTime]] = [fastest]
        motions += [partial(self._on_line, by) for by in solvers[1:]]
        attempts = [Attempt(motion, self.notes) for motion in motions]
        curve = self._curve()
        if curve is None:
            return attempts
        path, note = curve
        return [Attempt(partial(self._faster_on, path, fastest), (note,)), *attempts]

    def _on_line(self, by: TimeParametrization) -> ScaledTime:
        """The motion along straight lines with rounded corners."""
        corners, reaches = self.line.corners, self.line.reaches
        reaches = by.widest_reaches(corners, reaches)
        return by.time_polyline(corners, reaches, self.path.joint_names)

    def _faster_on(self, curve: JointPath, on_line: Callable[[], ScaledTime]) -> ScaledTime:
        """The motion along a curve.

        Raises:
            TimingFailed: There is none, or the one along straight lines is faster.
        """
        timed = self.parametrization.time(curve, self.path.joint_names)
        try:
            other = on_line()
        except TimingFailed:
            return timed
        if other.trajectory.duration <= timed.trajectory.duration:
            raise TimingFailed("the motion along straight lines is faster")
        return timed

    def _curve(self) -> tuple[JointPath, str] | None:
        """A smooth curve near the path and a note on it; None where lines are to be straight."""
        within = self.path.tolerance
        if within is None and self.line.left_out:
            within = self.timing.blend_tolerance or self.line.rounding
        if not within or self._moving or len(self.line.corners) < 3:
            return None
        found = smooth_curve(self.points, within, self._norm)
        if found is None:
            return None
        note = f"A smooth curve stands for the path, at most {found[1]:.3g} from it"
        return found[0], f"{note}{_why(self.line)}"


def _why(line: Polyline) -> str:
    return " for the rounding of the waypoints' last decimal." if line.rounding else "."


def _line_notes(line: Polyline) -> tuple[str, ...]:
    """Notes on waypoints that straight lines pass by, and on stops."""
    notes = []
    why = _why(line)
    if line.left_out:
        notes.append(
            f"{line.left_out} waypoint(s) are left out, at most {line.deviation:.3g} from straight "
            f"lines between the others{why}"
        )
    is_rounded = line.reaches > 0.0
    if line.rounding and is_rounded.any():
        notes.append(f"{is_rounded.sum()} corner(s) are cut by at most {line.rounding:.3g}{why}")
    if not is_rounded.all():
        stops = line.numbers[1:-1][~is_rounded]
        # Stops that a note lists.
        most = 20
        places = ", ".join(map(str, stops[:most]))
        if len(stops) > most:
            places += f" and {len(stops) - most} more: path.tolerance spares most of them"
        notes.append(f"The motion stops at waypoint(s) {places}.")
    return tuple(notes)
