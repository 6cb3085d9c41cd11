"""Time parametrization: the method and all the limits that a path is timed by."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from kinematics.arrays import Array, frozen
from kinematics.errors import InvalidOption
from kinematics.model.chain import Chain
from kinematics.trajectory.trajectory import Trajectory
from planning.timing.estimate import estimate_limits
from planning.timing.jerk.double_s import MAX_PHASES
from planning.timing.jerk.jerk_limited import Pieces, rough_pieces, time_path_with_jerk
from planning.timing.method import JerkUse, TimingMethod
from planning.timing.options import Method, Solver, TimingFailed
from planning.timing.path.blend import blend, merge
from planning.timing.path.path import JointPath
from planning.timing.speed.effort_limits import slow_down
from planning.timing.speed.lower_bound import lower_bound
from planning.timing.speed.minimum_time import time_path
from planning.timing.spline.quintic_fit import even_parts, fit_pieces
from planning.timing.spline.span_loads import SpanLoads, span_loads
from planning.timing.spline.spline import (
    Ends,
    EndVelocities,
    chord_knots,
    spline_trajectory,
)
from planning.timing.time_scaling import ScaledTime, dilate, fit, fitting_factor
from planning.values.limits import EffortLimits, LimitsBetween, MotionLimits

#: A spline that takes longer than this part of the motion that it is near to is not worth it.
WORTH = 1.1


@dataclass(frozen=True, eq=False)
class TimeParametrization:
    """Method and limits that paths are timed by.

    Args:
        method: The method.
        velocity: Limits, shape (n,), inf where there is none [rad/s or m/s].
        acceleration: Limits, shape (n,) [rad/s^2 or m/s^2].
        jerk: Limits, shape (n,); None where jerk is not limited [rad/s^3 or m/s^3].
        loads: Limits of torque and tool speed.
        start_velocity: Velocity at the start, along the path, shape (n,); at rest where none is
            given.
        end_velocity: Velocity at the end, likewise.
        ruled: Names of joints whose jerk limit is not known but made by a rule.
        ignored_jerk: A jerk limit that was given, shape (n,), which the method does not keep.

    Also known: ``jerk_bounds``, limits of velocity, acceleration and jerk, shape (3, n), where
    jerk is limited; ``bounds``, the limits that a motion is held to, by quantity; ``near_path``,
    whether a spline near the path is tried where it is proved free.
    """

    method: TimingMethod
    velocity: Array
    acceleration: Array
    jerk: Array | None = None
    loads: EffortLimits | None = None
    start_velocity: Array | None = None
    end_velocity: Array | None = None
    ruled: tuple[str, ...] = ()
    ignored_jerk: Array | None = None
    jerk_bounds: Array = field(init=False, repr=False)
    bounds: Mapping[str, Array] = field(init=False, repr=False)
    near_path: bool = field(init=False, repr=False)

    def __post_init__(self) -> None:
        moving = any(v is not None and v.any() for v in (self.start_velocity, self.end_velocity))
        bounds = {"velocity": self.velocity, "acceleration": self.acceleration}
        if self.jerk is not None:
            bounds["jerk"] = self.jerk
            object.__setattr__(self, "jerk_bounds", frozen(np.stack([*bounds.values()])))
        object.__setattr__(self, "bounds", bounds)
        object.__setattr__(self, "near_path", self.method.near_path and not moving)

    @property
    def smooth(self) -> bool:
        """Whether corners have to be rounded by curves of continuous curvature."""
        return self.method.smooth

    @property
    def tool_speed(self) -> float | None:
        """Largest speed of the tool [m/s]; None where it is not limited."""
        return None if self.loads is None else self.loads.tool_speed

    def near_corners(self, waypoints: Array, reaches: Array) -> Pieces | None:
        """A motion that ``spline_near`` may be near to; it may exceed the limits.

        None where the method has no such splines, or no speed along the path is found.

        Args:
            waypoints: Shape (k, n), merged.
            reaches: Reaches for ``blend``, within the largest ones, shape (k - 2,).
        """
        if not (self.near_path and len(waypoints) > 2):
            return None
        try:
            return rough_pieces(blend(waypoints, reaches, smooth=True), self.jerk_bounds)
        except TimingFailed:
            return None

    def spline_near(
        self, motion: Pieces, joint_names: Sequence[str], legs: int, rate: float
    ) -> ScaledTime | None:
        """The spline of few pieces near a motion; None where it takes far longer than the motion.

        Args:
            motion: Motion of ``near_corners``.
            joint_names: n names.
            legs: Number of the straight legs of its path.
            rate: Spans for each second of the motion [1/s].
        """
        parts = even_parts(float(motion.breaks[-1]), legs, rate)
        fitted = fit_pieces(motion, joint_names, self.jerk_bounds, parts, self._span_loads)
        spline = fitted if self.loads is None else self._slow_down_a_little(self.loads, fitted)
        if spline is None or spline.trajectory.duration > WORTH * motion.breaks[-1]:
            return None
        return spline

    def splines_within_loads(
        self, motion: Trajectory, joint_names: Sequence[str]
    ) -> Iterator[ScaledTime]:
        """Splines of few pieces near a motion that keep the loads, as far as they are worth it.

        Args:
            motion: Motion from rest to rest, within all limits.
            joint_names: n names.
        """
        if self.loads is None or not self.near_path:
            return
        # Spans for each second of a motion within loads that are tried in turn [1/s]: 16 and 19
        # pieces in 1.6 s. Loads bind here and there, and more spans follow that more closely.
        span_rates_within_loads = (10.0, 12.0)
        # Spans that shorter motions are tried with then: 20, since this is rounded up.
        rates, few = [*span_rates_within_loads], 19.99 / motion.duration
        # The last rate [1/s]: more than few pieces, and mostly fewer than the motion has.
        rates += [rate for rate in (few, 20.0) if rate > rates[-1]]
        pieces = Pieces(motion.breaks, motion.coefficients)
        for rate in rates:
            parts = even_parts(motion.duration, None, rate)
            if len(parts) > motion.pieces:
                return
            fitted = fit_pieces(pieces, joint_names, self.jerk_bounds, parts, self._span_loads)
            try:
                # One that takes longer than this part of a motion within loads is not: that one is
                # there already.
                spline = slow_down(self.loads, fitted, 1.05 * motion.duration)
            except TimingFailed:
                continue
            yield spline._replace(solver=fitted.solver)

    @cached_property
    def _span_loads(self) -> SpanLoads | None:
        return None if self.loads is None else span_loads(self.loads)

    @staticmethod
    def _slow_down_a_little(loads: EffortLimits, scaled: ScaledTime) -> ScaledTime | None:
        """The motion slowed down for the loads; None where that takes far longer than without.

        Without the loads nothing is much faster: what keeps them by a little more time is worth its
        few pieces.
        """
        try:
            slowed = slow_down(loads, scaled, WORTH * scaled.trajectory.duration)
        except TimingFailed:
            return None
        return slowed._replace(solver=scaled.solver)

    @cached_property
    def estimate_limits(self) -> Array:
        """Limits of velocity, acceleration and jerk for estimates of times, shape (3, n)."""
        return frozen(estimate_limits(self.velocity, self.acceleration, self.jerk))

    @cached_property
    def motion_limits(self) -> MotionLimits:
        """Limits that a motion is proved within: its bounds, and the jerk that is ignored."""
        ignored = {} if self.ignored_jerk is None else {"jerk": self.ignored_jerk}
        holds_jerk = self.method.jerk is not JerkUse.UNUSED
        return MotionLimits({**self.bounds, **ignored}, self.loads, holds_jerk)

    def at_tool_speed(self, chain: Chain, speed: float) -> "TimeParametrization":
        """Parametrization with the tool no faster than a speed [m/s]."""
        loads = self.loads or EffortLimits(chain)
        slowest = speed if loads.tool_speed is None else min(speed, loads.tool_speed)
        return replace(self, loads=replace(loads, tool_speed=slowest))

    def time(
        self,
        path: JointPath,
        joint_names: Sequence[str],
        end_speeds: tuple[float, float] | None = None,
    ) -> ScaledTime:
        """The path run through as fast as the limits allow; not for splines of time.

        Args:
            path: Path to follow.
            joint_names: n names.
            end_speeds: ds/dt at the start and at the end; None for those of the boundary
                velocities.

        Raises:
            InvalidOption: A limit is malformed, a boundary velocity points off the path, or the
                method does not follow paths.
            TimingFailed: There is no such motion, or none was found.
        """
        method = self.method
        if not method.follows_path:
            raise InvalidOption(
                f"the timing method {method.name} does not follow paths",
                hint="Choose toppra or jerk_limited.",
            )
        speeds = end_speeds or self.end_speeds(path)
        if method.smooth:
            return time_path_with_jerk(
                path, joint_names, *self.jerk_bounds, end_speeds=speeds, loads=self.loads
            )
        return time_path(
            path,
            joint_names,
            self.velocity,
            self.acceleration,
            solver=method.solver or "reachability",
            end_speeds=speeds,
            loads=self.loads,
        )

    def time_polyline(
        self, waypoints: Array, reaches: Array, joint_names: Sequence[str]
    ) -> ScaledTime:
        """The polyline with its corners rounded, or with stops at them all where that is faster.

        Args:
            waypoints: Shape (k, n), merged, k >= 2.
            reaches: Reaches for ``blend``, shape (k - 2,).
            joint_names: n names.

        Raises:
            InvalidOption: As ``time``.
            TimingFailed: As ``time``.
        """
        found, failures = list[ScaledTime](), list[TimingFailed]()
        for tried in self._reaches_tried(waypoints, reaches):
            path = blend(waypoints, tried, smooth=self.smooth)
            try:
                found.append(self._time_on(path, joint_names))
            except TimingFailed as failure:
                failures.append(failure)
        if not found:
            raise failures[0]
        fastest = min(found, key=lambda timed: timed.trajectory.duration)
        if len(waypoints) == 2 and fastest.trajectory.pieces > MAX_PHASES:
            # Near a straight path is on it.
            return next(self.splines_within_loads(fastest.trajectory, joint_names), fastest)
        return fastest

    def _reaches_tried(self, waypoints: Array, reaches: Array) -> list[Array]:
        """Reaches, those with stops at sharp turns, and stops at all corners, each (k - 2,).

        Under low jerk limits a narrow curve may take longer than a stop.
        """
        if not (self.smooth and reaches.any()):
            return [reaches]
        legs = np.diff(waypoints, axis=0)
        legs /= np.linalg.norm(legs, axis=1)[:, None]
        # Cosine of the turn from which on a stop may be faster: that of 66 degrees.
        sharp = (legs[1:] * legs[:-1]).sum(axis=1) < 0.4
        some, none = np.where(sharp, 0.0, reaches), np.zeros_like(reaches)
        return [reaches, *(() if (some == reaches).all() or not some.any() else (some,)), none]

    def _time_on(self, path: JointPath, joint_names: Sequence[str]) -> ScaledTime:
        """The motion along a rounded polyline; legs in few pieces where loads hardly bind."""
        if self.near_path and self.loads and not path.coefficients[:, :, 2:].any():
            legs = time_path_with_jerk(path, joint_names, *self.jerk_bounds)
            slowed = self._slow_down_a_little(self.loads, legs)
            if slowed is not None:
                return slowed
        return self.time(path, joint_names)

    def time_spline(
        self,
        waypoints: ArrayLike,
        times: ArrayLike | None,
        ends: Ends,
        joint_names: Sequence[str],
        scale: bool = False,
    ) -> ScaledTime:
        """The cubic spline of time through the waypoints.

        Args:
            waypoints: Shape (k, n).
            times: Times at the waypoints, shape (k,) [s]. Where none are given they are
                proportional to the joint-space distance, and as small as the limits allow.
            ends: "natural", or "clamped": at rest. An end with a boundary velocity has that.
            joint_names: n names.
            scale: Whether given times are stretched by the least factor that keeps all limits.

        Returns:
            The motion, and the factor by which it is longer than the times say.

        Raises:
            InvalidTrajectory: Waypoints and times do not fit.
            InvalidOption: Boundary velocities were given without times that stay as given.
            TimingFailed: No slowing down keeps the loads.
        """
        velocities = self._spline_velocities(times is not None and not scale)
        if times is None:
            points = merge_repeated(waypoints)
            knots = chord_knots(points)
            motion = spline_trajectory(joint_names, points, knots, ends, velocities)
            fitted = fit(motion, **self.bounds)
            return self.slow_down_for_effort(fitted)
        motion = spline_trajectory(joint_names, waypoints, times, ends, velocities)
        if not scale:
            return ScaledTime(motion, 1.0)
        return self.slow_down_for_effort(dilate(motion, **self.bounds))

    def needed_factor(self, motion: Trajectory) -> float:
        """Least factor of a motion's duration for all limits to hold; 1 where they hold.

        Raises:
            TimingFailed: No slowing down keeps the loads.
        """
        factor = max(1.0, fitting_factor(motion, **self.bounds))
        if self.loads is None:
            return factor
        slower = motion.dilate(factor) if factor > 1.0 else motion
        return slow_down(self.loads, ScaledTime(slower, factor)).factor

    def slow_down_for_effort(self, scaled: ScaledTime) -> ScaledTime:
        """The motion slowed down until it keeps the limits of torque and tool speed.

        Raises:
            TimingFailed: No slowing down does.
        """
        return scaled if self.loads is None else slow_down(self.loads, scaled)

    def _spline_velocities(self, timed: bool) -> EndVelocities:
        given = (self.start_velocity, self.end_velocity)
        if not timed and any(value is not None for value in given):
            raise InvalidOption(
                "boundary velocities of a spline need times that stay as given",
                hint="Give times, without scaling, or leave the velocities out.",
            )
        return given

    def end_speeds(self, path: JointPath) -> tuple[float, float]:
        """Speeds along a path, ds/dt, that the velocities at the start and the end are.

        Raises:
            InvalidOption: A velocity points off the path.
        """
        length = float(path.breaks[-1])
        speeds = [
            _path_speed(path.sample([place], 1)[0], velocity, name)
            for place, velocity, name in (
                (0.0, self.start_velocity, "start_velocity"),
                (length, self.end_velocity, "end_velocity"),
            )
        ]
        return speeds[0], speeds[1]


def _path_speed(tangent: Array, velocity: Array | None, name: str) -> float:
    """The ds/dt of a velocity."""
    if velocity is None or not velocity.any():
        return 0.0
    if not np.isfinite(velocity).all() or velocity.shape != tangent.shape:
        raise InvalidOption(f"{name} must be {len(tangent)} finite numbers")
    square = float(tangent @ tangent)
    speed = float(velocity @ tangent) / square if square > 0.0 else 0.0
    off = float(np.linalg.norm(velocity - speed * tangent))
    # Boundary velocities may miss the path's direction by this part.
    if speed < 0.0 or off > 1e-6 * float(np.linalg.norm(velocity)):
        raise InvalidOption(
            f"{name} does not point along the path",
            hint="It must be a positive multiple of the path's direction there.",
            direction=tangent.tolist(),
        )
    return speed


def merge_repeated(waypoints: ArrayLike) -> Array:
    """The waypoints without those that repeat their predecessor; collinear ones stay.

    Raises:
        InvalidTrajectory: As in ``merge``.
    """
    points = np.array(waypoints, dtype=np.float64)
    merge(points)
    keep = np.append(True, (np.diff(points, axis=0) != 0.0).any(axis=1))
    return np.asarray(points[keep])


@dataclass(frozen=True, slots=True, eq=False)
class TimingReport:
    """Method and limits that a motion was timed by.

    Args:
        method: The method.
        solver: Solver of the speeds; None where there is no choice.
        limits: Limits that the motion is held to, scaled, by quantity ("velocity",
            "acceleration", "jerk"), each shape (n,).
        ruled_jerk: Names of the joints whose jerk limit follows ``choice.JERK_RULE``.
        limits_at: Limits that hold beside these between two instants.
    """

    method: Method
    solver: Solver | None
    limits: Mapping[str, Array]
    ruled_jerk: tuple[str, ...] = ()
    limits_at: tuple[LimitsBetween, ...] = ()

    def lower_bound(self, motion: Trajectory) -> float:
        """Time that no motion along the way of one undercuts within velocity and acceleration [s].

        Args:
            motion: The motion that was timed.
        """
        rows = np.array([self.limits["velocity"], self.limits["acceleration"]])
        limits = np.repeat(rows[:, None], motion.pieces, axis=1)
        middles = 0.5 * (motion.breaks[1:] + motion.breaks[:-1])
        for begin, end, there in self.limits_at:
            inside = (begin < middles) & (middles < end)
            for row, name in zip(limits, ("velocity", "acceleration"), strict=True):
                row[inside] = np.minimum(row[inside], there.bounds[name])
        return lower_bound(motion, *limits)


def timing_report(parametrization: TimeParametrization, solver: Solver | None) -> TimingReport:
    """The account of a motion's timing.

    Args:
        parametrization: Method and limits.
        solver: Name of the solver as the motion tells it; None for the usual one of the method.
    """
    method, solver = parametrization.method, solver or parametrization.method.solver
    return TimingReport(method.name, solver, parametrization.bounds, parametrization.ruled)
