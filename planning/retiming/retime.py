"""Timing of any path: of its limits all is proved, of collisions nothing is known.

Motions near a path: along straight lines between few waypoints, or along a smooth curve.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cache, partial
from typing import NamedTuple

import numpy as np
import scipy

from kinematics.arrays import Array, Indices
from kinematics.errors import InvalidOption
from kinematics.model.chain import Chain, Limits
from kinematics.trajectory.trajectory import REST, Trajectory, stay
from planning.proof.certificate import Certificate, certify_limits, with_path
from planning.proof.limits.limit_uses import Violation
from planning.proof.path_nearness import CHORD_SHARE
from planning.retiming.limits_at import (
    TimedInStretches,
    around_corners,
    check_stretches,
    path_lengths,
    stretch_places,
)
from planning.retiming.passages import time_passages
from planning.retiming.retimed import PathToTime, Retimed
from planning.stops.certificate import certify_path_stops
from planning.timing.choice import chosen_parametrization, require_limits, required_limits
from planning.timing.method import JerkUse, timing_method
from planning.timing.options import Interpolation, TimingFailed, TimingOptions
from planning.timing.parametrization import TimeParametrization, timing_report
from planning.timing.path.blend import blend, merge
from planning.timing.path.path import JointPath
from planning.timing.path.simplification import Polyline, simplified_polyline
from planning.timing.spline.spline import Ends, chord_knots, led_by, smooth_curve, spline_path
from planning.timing.time_scaling import ScaledTime, with_duration
from planning.values.limits import MotionLimits
from planning.values.preferences import StopKinds


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
    attempts: Sequence[Attempt],
    chain: Chain | None,
    wanted: MotionLimits,
    near: PathToTime | None = None,
) -> tuple[ScaledTime, Certificate, tuple[str, ...]]:
    """The first motion that is proved, else the last one, its certificate, and notes on it.

    Args:
        attempts: The attempts.
        chain: The robot; None where there is none.
        wanted: Limits in place of its own.
        near: Path with a tolerance that the motion is to keep, where there is one.

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
        certificate = certify_limits(timed.trajectory, chain, timed.held_to(wanted))
        if near is not None and near.tolerance is not None:
            certificate = with_path(certificate, timed.trajectory, near.points, near.tolerance)
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
        chain: The robot, for limits of the tool's speed along stretches.
    """

    path: PathToTime
    points: Array
    timing: TimingOptions
    parametrization: TimeParametrization
    chain: Chain | None = None
    line: Polyline = field(init=False)

    def __post_init__(self) -> None:
        self.line = simplified_polyline(
            self.points,
            self._within or self.timing.blend_tolerance or 0.0,
            self.parametrization.smooth,
            moving=self._moving,
            norm=self._norm,
        )

    @property
    def _moving(self) -> bool:
        return self.timing.start_velocity is not None or self.timing.end_velocity is not None

    @property
    def _within(self) -> float | None:
        """The path's tolerance but for what the proof needs of it."""
        given = self.path.tolerance
        return None if given is None else (1.0 - 2.0 * CHORD_SHARE) * given

    @property
    def _norm(self) -> float:
        return 2.0 if self.path.tolerance is None else np.inf

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on waypoints that straight lines pass by, and on stops."""
        return _line_notes(self.line)

    def attempts(self) -> list[Attempt]:
        """Motions in the order of their durations: where there is one, the curve is the faster."""

        @cache
        def fastest() -> ScaledTime:
            return self._on_line(self.line.reaches)

        attempts = [Attempt(fastest, self.notes)]
        if self.line.reaches.any() and not self._moving:
            stopping = partial(self._on_line, np.zeros_like(self.line.reaches))
            attempts.append(Attempt(stopping, self.notes))
        curve = self._curve()
        if curve is None:
            return attempts
        path, note = curve
        return [Attempt(partial(self._faster_on, path, fastest), (note,)), *attempts]

    def fastest(self) -> ScaledTime:
        """The fastest motion that is found."""
        *others, last = self.attempts()
        for attempt in others:
            with suppress(TimingFailed):
                return attempt.motion()
        return last.motion()

    def _on_line(self, reaches: Array) -> ScaledTime:
        """The motion along straight lines with corners rounded by reaches."""
        corners, by, names = self.line.corners, self.parametrization, self.path.joint_names
        stretches = self.path.limits_at
        if not stretches:
            return by.time_polyline(corners, reaches, names)
        curve, places = blend(corners, reaches, smooth=by.smooth), path_lengths(corners)
        ends = stretch_places(stretches, self.points, self.line.numbers, places)
        ends = around_corners(curve, places, ends)
        return TimedInStretches(curve, ends, stretches, by, names, self.chain).time()

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
        within = self._within
        if within is None and self.line.left_out:
            within = self.timing.blend_tolerance or self.line.rounding
        if not within or self._moving or self.path.limits_at or len(self.line.corners) < 3:
            return None
        found = smooth_curve(self.points, within, self._norm)
        if found is None:
            return None
        note = f"A smooth curve stands for the path, at most {found[1]:.3g} from it"
        return found[0], f"{note}{_why(self.line)}"


def near_path(
    path: PathToTime, timing: TimingOptions, parametrization: TimeParametrization, chain: Chain
) -> Iterator[Callable[[], ScaledTime]]:
    """Motions within the tolerance of a path, to be tried in turn until one is proved free.

    Args:
        path: The path, with a tolerance.
        timing: Options of the timing.
        parametrization: Method and limits.
        chain: The robot.

    Raises:
        InvalidOption: The tolerance is none, or does not go with the timing.
    """
    _interpolation(path, timing)
    assert path.tolerance is not None
    if len(merge(path.points)) < 3:
        return
    # Shares of the tolerance: a motion that collides mostly does so for its deviation.
    for share in (1.0, 1.0 / 4.0, 1.0 / 16.0):
        nearer = replace(path, tolerance=share * path.tolerance)
        yield NearPath(nearer, path.points, timing, parametrization, chain).fastest


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


_STILL = "The path has no length: the robot stays"
_SIZES = "Look for limits or lengths of very different sizes."


def retime(
    path: PathToTime,
    timing: TimingOptions,
    overrides: Mapping[str, Array],
    chain: Chain | None = None,
) -> Retimed:
    """Time a path within limits.

    Args:
        path: Path to follow.
        timing: How.
        overrides: Limits (n,) by quantity, in place of the robot's.
        chain: The robot; without one the limits have to be given.

    Raises:
        MissingLimit: A limit that is needed is not known; the message names the joints.
        InvalidTrajectory: The path is malformed.
        InvalidOption: Options do not go together.
        TimingFailed: There is no such motion, or none was found.
    """
    if timing.times is not None and timing.method == "jerk_limited":
        return time_passages(path, timing, overrides, chain)
    names, n = path.joint_names, len(path.joint_names)
    if chain is None and "jerk" not in overrides and timing.method is timing.solver is None:
        # All limits are the caller's: what is not among them is not limited.
        timing = replace(timing, method="toppra")
    points, method = path.points, timing_method(timing.method, timing.solver)
    limits = Limits.unlimited(n) if chain is None else chain.limits
    times = _given_times(path, timing)
    if times is not None and not timing.scale_times:
        overrides = _known_limits(limits, overrides)
    elif chain is None:
        require_limits(required_limits(method), names, overrides)
    parametrization = chosen_parametrization(timing, names, limits, overrides, chain)
    begins = 0.0 if times is None else float(times[0])
    interpolation = _interpolation(path, timing)
    notes, numbers, near = _notes(points), np.arange(len(points)), None
    is_still = len(merge(points)) < 2
    check_stretches(path.limits_at, points, method, chain)
    if interpolation != "linear" and times is None and path.knots is None and not is_still:
        numbers = led_by(points)
        notes, points = notes + _led_notes(points, numbers), points[numbers]
    if interpolation == "linear" and not is_still:
        near = NearPath(path, points, timing, parametrization, chain)
        is_still = len(near.line.corners) < 2
    attempts: Sequence[Attempt]
    if is_still:
        notes = (*(near.notes if near else ()), f"{_STILL} where it is for {REST:g} s.")
        shape = stay(names, points[0])
        attempts = [Attempt(lambda: ScaledTime(shape, 1.0))]
    elif near is not None:
        attempts, shape = near.attempts(), _legs(names, points)
    elif not method.follows_path:
        ends = _ends(interpolation)
        shifted = None if times is None else times - times[0]
        timed = parametrization.time_spline(points, shifted, ends, names, timing.scale_times)
        notes += _spline_notes(timed.trajectory, ends, timing)
        attempts, shape = [Attempt(lambda: timed)], timed.trajectory
    else:
        curve = _curve(points, path.knots, interpolation)
        attempts = [Attempt(lambda: _along(curve, path, numbers, parametrization, chain))]
        shape = Trajectory(names, curve.breaks, curve.coefficients)
    lasting = [attempt.lasting(timing) for attempt in attempts]
    timed, certificate, told = first_verified(lasting, chain, parametrization.motion_limits, path)
    notes += told + method.notes((timed,))
    if times is None:
        if not certificate.verified:
            raise _failure(certificate.violation, shape, numbers, chain)
        # No times were asked for, so there is nothing to be longer than.
        timed = timed._replace(factor=1.0)
    if method.jerk is JerkUse.UNUSED and "jerk" in overrides:
        notes += ("The method toppra does not limit jerk: jerk_limited does.",)
    return _report(timed, certificate, parametrization, chain, notes, begins)


def with_path_stops(
    timed: Retimed, kind: StopKinds, chain: Chain | None, overrides: Mapping[str, Array]
) -> Retimed:
    """A timed path with the proof of its stops along the path, where these are asked for.

    Args:
        timed: The timed path.
        kind: Stops that it is to have.
        chain: The robot, if there is one.
        overrides: Limits (n,) by quantity, in place of the robot's.

    Raises:
        InvalidOption: Stops are asked for that leave the path.
        MissingLimit: The acceleration of a joint has no limit.
    """
    if kind == "none":
        return timed
    if timed.timing is not None and timed.timing.limits_at:
        raise InvalidOption(
            "stops are not proved within limits that vary along the path",
            hint="Leave stops or limits_at out.",
        )
    if kind != "path":
        raise InvalidOption(
            f"stops {kind!r} leave the path, and timing looks at no collisions",
            hint='Ask for stops "path" here; plan and validate prove those of single joints.',
        )
    motion = timed.trajectory
    limits = Limits.unlimited(motion.n) if chain is None else chain.limits
    names = ("velocity", "acceleration", "jerk")
    wanted = MotionLimits({name: row for name, row in overrides.items() if name in names})
    return replace(timed, stops=certify_path_stops(motion, timed.certificate, limits, wanted))


def _interpolation(path: PathToTime, timing: TimingOptions) -> Interpolation:
    """The interpolation asked for, or the usual one of the method.

    Raises:
        InvalidOption: The path's knots or tolerance do not go with it.
    """
    usual: Interpolation = "natural_spline" if timing.method == "spline" else "linear"
    interpolation = timing.interpolation or usual
    if interpolation == "linear" and path.knots is not None:
        raise InvalidOption(
            "knots belong to splines; straight lines have none",
            hint="Ask for interpolation natural_spline or clamped_spline, or leave knots out.",
        )
    _check_tolerance(path.tolerance, timing, interpolation)
    return interpolation


def _check_tolerance(
    tolerance: float | None, timing: TimingOptions, interpolation: Interpolation
) -> None:
    if tolerance is None:
        return
    if not 0.0 < tolerance < np.inf:
        raise InvalidOption(
            f"path.tolerance is {tolerance}", hint="Give a positive number, or leave it out."
        )
    if interpolation != "linear":
        raise InvalidOption(
            "path.tolerance belongs to straight lines; a spline leads through all its waypoints",
            hint="Ask for another method or interpolation linear, or simplify the path first.",
        )
    if timing.blend_tolerance is not None:
        raise InvalidOption(
            "both path.tolerance and timing.blend_tolerance are given",
            hint="Give the first for each joint, or the second for the Euclidean distance.",
        )


def _legs(names: tuple[str, ...], points: Array) -> Trajectory:
    """Straight lines through waypoints, one in each unit of time."""
    legs = np.stack([points[:-1], np.diff(points, axis=0)], axis=-1)
    return Trajectory(names, np.arange(float(len(points))), legs)


def _failure(
    violation: Violation | None, shape: Trajectory, numbers: Indices, chain: Chain | None
) -> TimingFailed:
    """Refusal of a motion that is not proved.

    Args:
        violation: The first of the motion.
        shape: The path, a piece from each waypoint to the next, at any times.
        numbers: Numbers of these waypoints.
        chain: The robot.
    """
    assert violation is not None
    if violation.kind != "position":
        is_far = violation.kind == "path_deviation"
        hint = "Give a larger path.tolerance: this one is within rounding." if is_far else _SIZES
        return TimingFailed(f"no motion was proved: {violation.message}", hint=hint)
    free = dict.fromkeys(("velocity", "acceleration", "jerk"), np.full(shape.n, np.inf))
    outside = certify_limits(shape, chain, MotionLimits(free)).violation or violation
    piece = int(np.searchsorted(shape.breaks[1:-1], outside.time, side="right"))
    between = numbers[[piece, min(piece + 1, len(numbers) - 1)]].tolist()
    hint = "Give waypoints within the joint's limits"
    if shape.coefficients.shape[-1] > 2:
        hint += "; a spline swings over them less where more lead it, and straight lines do not"
    return TimingFailed(
        f"{outside.message}, between waypoints {between[0]} and {between[1]}",
        hint=f"{hint}.",
        **outside.details,
        waypoints=between,
    )


def _curve(points: Array, knots: Array | None, interpolation: Interpolation) -> JointPath:
    values = chord_knots(points) if knots is None else knots
    return spline_path(points, values, _ends(interpolation))


def _along(
    curve: JointPath,
    path: PathToTime,
    numbers: Indices,
    by: TimeParametrization,
    chain: Chain | None,
) -> ScaledTime:
    """The motion along a spline through waypoints of a path, of given numbers."""
    if not path.limits_at:
        return by.time(curve, path.joint_names)
    ends = stretch_places(path.limits_at, path.points, numbers, curve.breaks)
    return TimedInStretches(curve, ends, path.limits_at, by, path.joint_names, chain).time()


def _ends(interpolation: Interpolation) -> Ends:
    return "natural" if interpolation == "natural_spline" else "clamped"


def _given_times(path: PathToTime, timing: TimingOptions) -> Array | None:
    """Times at the waypoints of a spline of time (k,) [s]; None where none are given."""
    if timing.method != "spline":
        return None
    if timing.times is not None and path.knots is not None:
        raise InvalidOption("both path.knots and timing.times are given", hint="Give one.")
    return path.knots if timing.times is None else np.array(timing.times, dtype=np.float64)


def _known_limits(limits: Limits, overrides: Mapping[str, Array]) -> dict[str, Array]:
    """Limits (n,) by quantity, infinite where none is known: given times need none."""
    known = {name: getattr(limits, name) for name in ("velocity", "acceleration")}
    unlimited = {name: np.where(np.isnan(row), np.inf, row) for name, row in known.items()}
    return unlimited | dict(overrides)


def _spline_notes(motion: Trajectory, ends: Ends, timing: TimingOptions) -> tuple[str, ...]:
    """Note on the velocities of a natural spline at its ends, where not both were asked for."""
    start, end = motion.sample([0.0, motion.duration], 1)
    are_given = timing.start_velocity is not None and timing.end_velocity is not None
    if ends == "clamped" or are_given or not (start.any() or end.any()):
        return ()
    begins, stops = (", ".join(f"{value:.6g}" for value in row) for row in (start, end))
    note = f"The natural spline begins with velocity [{begins}] and ends with [{stops}]: "
    note += "clamped_spline begins and ends at rest, or with start_velocity and end_velocity."
    return (note,)


def _report(
    timed: ScaledTime,
    certificate: Certificate,
    parametrization: TimeParametrization,
    chain: Chain | None,
    notes: tuple[str, ...],
    begins: float,
) -> Retimed:
    bounds = {} if parametrization.method.follows_path else parametrization.bounds
    unknown = [name for name, row in bounds.items() if np.isinf(row).all()]
    needed = 1.0 if certificate.violation is None else _needed(timed, parametrization, chain)
    if unknown:
        reason = f"no limits of {' and '.join(unknown)} are known: its peaks are only reported"
        notes += (f"{reason[0].upper()}{reason[1:]}.",)
    if unknown and len(unknown) == len(bounds):
        reasons = (*certificate.proved.reasons, reason)
        unproved = replace(certificate.proved, limits=False, reasons=reasons)
        certificate = replace(certificate, verified=False, proved=unproved)
    report = timing_report(parametrization, timed.solver)
    report = replace(report, limits_at=timed.held_to(MotionLimits()).between)
    return Retimed(timed.trajectory, certificate, timed.factor, needed, notes, begins, report)


def _needed(
    timed: ScaledTime, parametrization: TimeParametrization, chain: Chain | None
) -> float | None:
    """How many times as long a motion is proved; None where no slowing down is what it lacks."""
    try:
        factor = parametrization.needed_factor(timed.trajectory)
    except TimingFailed:
        return None
    slow = timed.trajectory.dilate(factor)
    slower = certify_limits(slow, chain, parametrization.motion_limits)
    return factor if slower.verified else None


def _notes(points: Array) -> tuple[str, ...]:
    """Notes on waypoints that repeat others, by their numbers."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    notes = [f"Waypoint {i + 1} repeats waypoint {i}." for i in np.flatnonzero(steps == 0.0)]
    # Legs shorter than this are reported: their direction has lost digits.
    tiny = 1e-9
    notes += [
        f"Waypoint {i + 1} is only {steps[i]:.3g} from waypoint {i}."
        for i in np.flatnonzero((steps > 0.0) & (steps < tiny))
    ]
    return tuple(notes)


def _led_notes(points: Array, numbers: Indices) -> tuple[str, ...]:
    """Note on waypoints that a spline leaves out, being nearly at others."""
    out = np.setdiff1d(np.arange(len(points)), numbers)
    if not len(out):
        return ()
    away = np.max(scipy.spatial.cKDTree(points[numbers]).query(points[out])[0])
    listed = ", ".join(map(str, out))
    return (f"The spline leaves out waypoint(s) {listed}, at most {away:.3g} from others.",)
