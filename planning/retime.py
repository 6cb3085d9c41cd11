"""Timing of any path: of its limits all is proved, of collisions nothing is known."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from kinematics.arrays import Array
from kinematics.chain import Chain, Limits
from kinematics.errors import InvalidOption, InvalidTrajectory
from kinematics.trajectory import REST, Trajectory, stay
from planning.proof.certificate import Certificate, certify_limits
from planning.timing.blend import largest_reaches, merge, reach_for_deviation
from planning.timing.choice import chosen_parametrization, require_limits, required_limits
from planning.timing.method import JerkUse, timing_method
from planning.timing.options import Interpolation, TimingOptions
from planning.timing.parametrization import TimeParametrization
from planning.timing.path import JointPath
from planning.timing.report import TimingReport, timing_report
from planning.timing.spline import Ends, chord_knots, spline_path
from planning.timing.time_scaling import ScaledTime

#: Legs shorter than this are told of: their direction has lost digits.
TINY = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class PathToTime:
    """A path whose motion is wanted.

    Args:
        joint_names: n names.
        waypoints: Shape (k, n), k >= 1 [rad or m].
        knots: Of a spline through them, shape (k,); by distance in joint space where none are
            given. Times, for the method "spline" [s].
    """

    joint_names: tuple[str, ...]
    waypoints: Array
    knots: Array | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Retimed:
    """A timed path.

    Args:
        trajectory: The motion.
        certificate: What was proved of its limits; not verified where times given break them.
        factor: How many times as long as asked the motion is: times given were stretched by it.
        needed_factor: How many times as long the motion would have to be to keep all limits; 1
            where it does.
        notes: What is special about the path: waypoints left out, stops.
        begins: Time at which the motion begins, the first of given times [s].
        timing: Method and limits that it was timed by.
    """

    trajectory: Trajectory
    certificate: Certificate
    factor: float
    needed_factor: float
    notes: tuple[str, ...]
    begins: float = 0.0
    timing: TimingReport | None = None

    @property
    def peaks(self) -> dict[str, Array]:
        """Exact largest |velocity|, |acceleration| and |jerk| of each joint, each (n,)."""
        return {
            name: np.asarray(self.trajectory.peaks(order).value)
            for order, name in enumerate(("velocity", "acceleration", "jerk"), start=1)
        }


def retime(
    path: PathToTime,
    timing: TimingOptions,
    overrides: Mapping[str, Array],
    chain: Chain | None = None,
) -> Retimed:
    """Time a path within limits.

    Args:
        path: What to follow.
        timing: How.
        overrides: Limits (n,) by quantity, in place of the robot's.
        chain: The robot; without one the limits have to be given.

    Raises:
        MissingLimit: A limit that is needed is not known; the message names the joints.
        InvalidTrajectory: The path is malformed.
        InvalidOption: Options do not go together.
        TimingFailed: There is no such motion, or none was found.
    """
    names, n = path.joint_names, len(path.joint_names)
    if chain is None and "jerk" not in overrides:
        # All limits are the caller's: what is not among them is not limited.
        timing = _with_method(timing)
    points = _points(path)
    method = timing_method(timing.method, timing.solver)
    limits = Limits.unlimited(n) if chain is None else chain.limits
    times = _given_times(path, timing)
    if times is not None and not timing.scale_times:
        overrides = _known_limits(limits, overrides)
    elif chain is None:
        require_limits(required_limits(method), names, overrides)
    parametrization = chosen_parametrization(timing, names, limits, overrides, chain)
    begins = 0.0 if times is None else float(times[0])
    merged = merge(points)
    if len(merged) < 2:
        rest = ScaledTime(stay(names, points[0]), 1.0)
        note = f"The path has no length: the robot stays where it is for {REST:g} s."
        return _certify_retimed(rest, parametrization, chain, (note,), begins)
    interpolation = timing.interpolation or _usual(timing)
    notes = _notes(points, interpolation, timing)
    if not method.follows_path:
        ends = _ends(interpolation)
        timed = parametrization.time_spline(
            points, None if times is None else times - times[0], ends, names, timing.scale_times
        )
        notes += _spline_notes(timed.trajectory, ends)
        # Without times there is nothing to be longer than.
        timed = timed if times is not None else timed._replace(factor=1.0)
    else:
        if interpolation == "linear":
            timed = _linear(merged, path, parametrization, timing)
        else:
            curve = _curve(points, path.knots, interpolation)
            timed = parametrization.time(curve, names)
        notes += method.notes((timed,))
        # No times were asked for, so there is nothing to be longer than.
        timed = timed._replace(factor=1.0)
    if method.jerk is JerkUse.UNUSED and "jerk" in overrides:
        notes += ("The method toppra does not limit jerk: jerk_limited does.",)
    return _certify_retimed(timed, parametrization, chain, notes, begins)


def _with_method(timing: TimingOptions) -> TimingOptions:
    """The options with the least time as the method, where neither method nor solver is named."""
    if timing.method is None and timing.solver is None:
        return replace(timing, method="toppra")
    return timing


def _usual(timing: TimingOptions) -> Interpolation:
    return "natural_spline" if timing.method == "spline" else "linear"


def _points(path: PathToTime) -> Array:
    points = np.asarray(path.waypoints, dtype=np.float64)
    if points.ndim != 2 or len(points) < 1 or points.shape[1] != len(path.joint_names):
        raise InvalidTrajectory(
            f"a path of shape {points.shape} does not have {len(path.joint_names)} joint(s)",
            hint=f"The joints are: {', '.join(path.joint_names)}; give one value for each.",
        )
    return points


def _linear(
    merged: Array, path: PathToTime, parametrization: TimeParametrization, timing: TimingOptions
) -> ScaledTime:
    if path.knots is not None:
        raise InvalidOption(
            "knots belong to splines; straight lines have none",
            hint="Ask for interpolation natural_spline or clamped_spline, or leave knots out.",
        )
    reaches = reach_for_deviation(merged, timing.blend_tolerance or 0.0, parametrization.smooth)
    reaches = parametrization.widest_reaches(merged, reaches)
    return parametrization.time_polyline(merged, reaches, path.joint_names)


def _curve(points: Array, knots: Array | None, interpolation: Interpolation) -> JointPath:
    values = chord_knots(points) if knots is None else knots
    return spline_path(points, values, _ends(interpolation))


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


def _spline_notes(motion: Trajectory, ends: Ends) -> tuple[str, ...]:
    """Note on the velocities of a natural spline at its ends."""
    start, end = motion.sample([0.0, motion.duration], 1)
    if ends == "clamped" or not (start.any() or end.any()):
        return ()
    begins, stops = (", ".join(f"{value:.6g}" for value in row) for row in (start, end))
    note = f"The natural spline begins with velocity [{begins}] and ends with [{stops}]: "
    note += "clamped_spline begins and ends at rest, or with start_velocity and end_velocity."
    return (note,)


def _certify_retimed(
    timed: ScaledTime,
    parametrization: TimeParametrization,
    chain: Chain | None,
    notes: tuple[str, ...],
    begins: float = 0.0,
) -> Retimed:
    certificate = certify_limits(timed.trajectory, chain, parametrization.motion_limits)
    bounds = {} if parametrization.method.follows_path else parametrization.bounds
    unknown = [name for name, row in bounds.items() if np.isinf(row).all()]
    if unknown:
        reason = f"no limits of {' and '.join(unknown)} are known: its peaks are only reported"
        notes += (f"{reason[0].upper()}{reason[1:]}.",)
    if unknown and len(unknown) == len(bounds):
        reasons = (*certificate.proved.reasons, reason)
        unproved = replace(certificate.proved, limits=False, reasons=reasons)
        certificate = replace(certificate, verified=False, proved=unproved)
    needed = 1.0 if certificate.verified else parametrization.needed_factor(timed.trajectory)
    report = timing_report(parametrization, timed.solver)
    return Retimed(timed.trajectory, certificate, timed.factor, needed, notes, begins, report)


def _notes(points: Array, interpolation: Interpolation, timing: TimingOptions) -> tuple[str, ...]:
    """Notes on odd waypoints of a path, by their numbers."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    notes = [f"Waypoint {i + 1} repeats waypoint {i}." for i in np.flatnonzero(steps == 0.0)]
    notes += [
        f"Waypoint {i + 1} is only {steps[i]:.3g} from waypoint {i}."
        for i in np.flatnonzero((steps > 0.0) & (steps < TINY))
    ]
    if interpolation == "linear":
        merged = merge(points)
        sharp = largest_reaches(merged) == 0.0
        if not timing.blend_tolerance:
            sharp[:] = True
        places = [
            int(np.argmin(np.linalg.norm(points - stop, axis=1))) for stop in merged[1:-1][sharp]
        ]
        if places:
            notes.append(f"The motion stops at waypoint(s) {', '.join(map(str, places))}.")
    return tuple(notes)
