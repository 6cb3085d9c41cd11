"""Timing of joint paths that lead the tool, from rest to rest along every motion."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Literal

import numpy as np

from kinematics.arrays import Array
from kinematics.jacobian import geometric
from kinematics.model.chain import Chain
from kinematics.trajectory.trajectory import Trajectory, concatenate, stay
from planning.result import SpeedLimit, ToolMotionReport
from planning.timing.jerk.jerk_limited import Pieces
from planning.timing.jerk.steady_speed import speed_caps, time_at_steady_speed
from planning.timing.parametrization import WORTH, TimeParametrization
from planning.timing.path.path import JointPath
from planning.timing.spline.quintic_fit import even_parts, fit_pieces
from planning.timing.time_scaling import ScaledTime
from planning.tool_motions.passing_times import passing_times
from planning.tool_motions.timed_tool_motions import SpeedBand, TimedToolMotions
from planning.tool_motions.tool_path import RunPart, Tolerances, ToolPath, ToolRun
from planning.tool_paths.tool_deviation import pieces_within
from planning.values.limits import MotionLimits

#: Spans for each second that are tried in turn [1/s], and spans at least.
_SPANS = ((12.0, 10), (16.0, 13), (24.0, 17))
_QUANTITIES: tuple[Literal["velocity", "acceleration", "jerk"], ...] = (
    "velocity", "acceleration", "jerk",
)  # fmt: skip
#: Places of a path that differ by less than this part of it are one.
_SAME_PLACE = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class TimedToolPath:
    """A tool path in time.

    Args:
        path: The joint paths with the motions of the tool.
        parts: One trajectory for each motion in which the joints move.
        reports: Times of each motion, and the share of it that is carried out.
        notes: Notes about the timing.
        transits: Free motions before some of the motions, by the index of the one that each leads
            to.
    """

    path: ToolPath
    parts: tuple[Trajectory, ...]
    reports: tuple[ToolMotionReport, ...]
    notes: tuple[str, ...] = ()
    transits: Mapping[int, Trajectory] = field(default_factory=lambda: MappingProxyType({}))

    @property
    def begins(self) -> float:
        """Time at which the first tool motion begins [s]."""
        return self.transits[0].duration if 0 in self.transits else 0.0

    @property
    def tool_motions(self) -> TimedToolMotions:
        """The motions with their times, as the proof asks for them."""
        times = [self.begins, *(report.ends for report in self.reports)]
        tolerances = self.path.tolerances
        parts = _begun_parts(self.path)
        return TimedToolMotions(
            tuple(part.motion for part in parts),
            np.array(times),
            tolerances.position,
            tolerances.orientation,
            tuple(part.tolerance for part in parts),
            self._speed_bands(),
            np.array([report.begins for report in self.reports]),
        )

    def _speed_bands(self) -> tuple[SpeedBand, ...]:
        """The speeds to be kept, and when."""
        width = self.path.speed_band
        if width is None:
            return ()
        spans = [
            (report.begins, report.ends, part.tool_speed)
            for report, part in zip(self.reports, _begun_parts(self.path), strict=True)
        ]
        return SpeedBand.of_spans(spans, width)

    def trajectory(self, chain: Chain) -> Trajectory:
        """The parts one after the other; a short stay where there are none."""
        remaining, parts = iter(self.parts), []
        for k, segment in enumerate(self.path.segments):
            parts += [self.transits[k]] if k in self.transits else []
            parts += [next(remaining)] if segment.path is not None else []
        if parts:
            return concatenate(parts)
        return stay(chain.joint_names, self.path.segments[0].start)

    def limits(self, parametrization: TimeParametrization) -> MotionLimits:
        """Limits that the trajectory keeps; splines one after the other can't keep a jerk limit."""
        limits = parametrization.motion_limits
        keeps_jerk = parametrization.method.follows_path or len(self.parts) < 2
        return limits if keeps_jerk else replace(limits, holds_jerk=False)


def time_tool_path(
    chain: Chain,
    path: ToolPath,
    parametrization: TimeParametrization,
    transits: Mapping[int, Trajectory] | None = None,
    *,
    near: bool = False,
) -> TimedToolPath:
    """Time every motion of a tool path, from rest to rest.

    Args:
        chain: The robot; its tip is the tool.
        path: The joint paths.
        parametrization: The method and the limits.
        transits: Free motions before some of the motions, at rest at both ends.
        near: Whether splines of few pieces are taken that keep near the path, not exactly to it.

    Raises:
        TimingFailed: No motion within the limits was found.
    """
    scaled = [_time_motion(chain, path, *pair, parametrization) for pair in path.moving]
    if near:
        scaled = [
            spline_near(chain, run, timed, path.tolerances, parametrization)
            for (run, _), timed in zip(path.moving, scaled, strict=True)
        ]
    parts = tuple(part.trajectory for part in scaled)
    free = transits or {}
    limits = [_speed_limits(chain, *pair, parametrization) for pair in path.moving]
    reports = _reports(chain, path, parts, limits, free)
    return TimedToolPath(path, parts, reports, parametrization.method.notes(scaled), free)


def _begun_parts(path: ToolPath) -> list[RunPart]:
    """Motions that were begun, in order."""
    pairs = zip(path.runs, path.segments, strict=True)
    return [part for run, segment in pairs for part in run.parts_until(segment.reached)]


def _reports(
    chain: Chain,
    path: ToolPath,
    trajectories: tuple[Trajectory, ...],
    limits: Sequence[Sequence[SpeedLimit | None]],
    transits: Mapping[int, Trajectory],
) -> tuple[ToolMotionReport, ...]:
    """Times of each motion of a tool path, with the free motions before some of them."""
    remaining = iter(zip(trajectories, limits, strict=True))
    reports: list[ToolMotionReport] = []
    now = 0.0
    for k, (run, segment) in enumerate(zip(path.runs, path.segments, strict=True)):
        now += transits[k].duration if k in transits else 0.0
        then = now
        parts = run.parts_until(segment.reached)
        ends = [0.0] * len(parts)
        slower: Sequence[SpeedLimit | None] = [None] * len(parts)
        if segment.path is not None:
            timed, slower = next(remaining)
            ends = passing_times(chain, segment.path, timed, parts)
        for part, end, limit in zip(parts, ends, slower, strict=True):
            motion = part.motion
            share = (segment.reached - part.begin) / (part.end - part.begin)
            reports.append(
                ToolMotionReport(
                    motion.kind, motion.length, motion.angle, min(share, 1.0), then,
                    now + end, motion, part.asked, part.blends, run.name, limit,
                )
            )  # fmt: skip
            then = now + end
        now = then
    return tuple(reports)


def _speed_limits(
    chain: Chain, run: ToolRun, path: JointPath, parametrization: TimeParametrization
) -> list[SpeedLimit | None]:
    """The limit of each part of a run that is farthest below the tool speed asked for.

    None where the joints allow the speed all along it, or the run has tolerances.
    """
    speed, parts = parametrization.tool_speed, run.parts_until(path.length)
    if speed is None or run.tolerances:
        return [None] * len(parts)
    jerk = parametrization.jerk
    rows = parametrization.velocity, parametrization.acceleration
    limits = np.stack([*rows, np.full(path.n, np.inf) if jerk is None else jerk])
    caps = speed_caps(path, limits, 1.0) if jerk is None else speed_caps(path, limits)
    caps, breaks, found = run.length * caps, path.breaks, list[SpeedLimit | None]()
    for part in parts:
        inside = (breaks[1:] > part.begin + _SAME_PLACE) & (breaks[:-1] < part.end - _SAME_PLACE)
        own = caps[inside]
        # A limit that allows this part of the speed asked for is none.
        if not len(own) or not own.min() < 0.99 * speed:
            found.append(None)
            continue
        _, quantity, joint = np.unravel_index(int(np.argmin(own)), own.shape)
        name = _QUANTITIES[int(quantity)]
        found.append(SpeedLimit(float(own.min()), chain.joint_names[int(joint)], name))
    return found


def _time_motion(
    chain: Chain,
    tool_path: ToolPath,
    run: ToolRun,
    path: JointPath,
    parametrization: TimeParametrization,
) -> ScaledTime:
    asked, band, speed = run, tool_path.speed_band, parametrization.tool_speed
    if not run.tool_speeds and speed is not None and len(run.motions) > 1:
        # Band of the speed of motions without a rest between them, as part of it.
        asked, band = replace(run, tool_speeds=(speed,) * len(run.motions)), 0.01
    if asked.tool_speeds:
        steady = _time_steadily(chain, asked, band, path, parametrization)
        if steady is not None:
            return steady
        parametrization = parametrization.at_tool_speed(chain, min(asked.tool_speeds))
    if parametrization.method.follows_path:
        return parametrization.time(path, chain.joint_names)
    knots = path.breaks
    # A tenth of the deviation allowed is left to what lies between samples.
    position, orientation = tool_path.tolerances.pair
    allowed = 0.9 * position, 0.9 * orientation
    # How often a spline of time is given twice as many waypoints to keep nearer to its motion.
    for _ in range(6):
        timed = parametrization.time_spline(path.sample(knots), None, "clamped", chain.joint_names)
        spline = timed.trajectory
        fine = pieces_within(chain, run, knots, spline.breaks, spline.coefficients, allowed)
        if fine.all():
            break
        knots = np.sort(np.concatenate([knots, 0.5 * (knots[1:] + knots[:-1])]))
    return timed


def _time_steadily(
    chain: Chain,
    run: ToolRun,
    band: float | None,
    path: JointPath,
    parametrization: TimeParametrization,
) -> ScaledTime | None:
    """The motion at steady speeds of the tool; None where another one keeps them as far."""
    if band is None or path.corners or not parametrization.smooth:
        return None
    path, speeds = _cut_where_speeds_change(chain, run, path)
    parametrization = parametrization.at_tool_speed(chain, max(run.tool_speeds))
    # Samples of the tool's speed on each piece of the path.
    places = path.breaks[:-1, None] + np.outer(path.lengths, np.linspace(0.0, 1.0, 5))
    at = np.minimum(places.ravel(), path.length)
    along = np.einsum("kij,kj->ki", geometric(chain, path.sample(at))[:, :3], path.sample(at, 1))
    rates = np.linalg.norm(along, axis=1).reshape(places.shape).max(axis=1)
    with np.errstate(divide="ignore"):
        wanted = speeds / rates
    # Part of the width of a band of speed by which a steady speed may vary with the path.
    steady = time_at_steady_speed(
        path, chain.joint_names, parametrization.jerk_bounds, wanted, 0.5 * band
    )
    if steady is None:
        return None
    timed = parametrization.slow_down_for_effort(steady.timed)
    # A steady motion that is slowed down for torques by more than this factor is held against
    # another.
    if len(steady.speeds) == 1 and timed.factor <= 1.02:
        return timed
    if len(set(run.tool_speeds)) > 1:
        # Another one keeps the least of the speeds everywhere.
        return timed
    other = parametrization.time(path, chain.joint_names)
    low = (1.0 - band) * run.tool_speeds[0]
    # A steady motion may take longer than another one by this factor.
    if timed.trajectory.duration > 1.05 * other.trajectory.duration:
        return other
    shares = [_share_in_band(chain, one.trajectory, low) for one in (timed, other)]
    return timed if shares[0] >= shares[1] else other


def _cut_where_speeds_change(
    chain: Chain, run: ToolRun, path: JointPath
) -> tuple[JointPath, Array]:
    """A path with a break where the tool passes from one speed to another, and those of pieces.

    Returns:
        The path, and the speed asked for on each of its p pieces, shape (p,) [m/s].
    """
    asked = np.array(run.tool_speeds)
    changes = np.flatnonzero(np.diff(asked))
    if not changes.size:
        return path, np.full(len(path.lengths), asked[0])
    # Times of a motion at ds/dt = 1 are places.
    motion = Trajectory(chain.joint_names, path.breaks, path.coefficients)
    cuts = np.array(passing_times(chain, path, motion, run.parts))[changes]
    for cut in cuts.tolist():
        if np.abs(motion.breaks - cut).min() > _SAME_PLACE * path.length:
            motion = concatenate(motion.split(cut))
    middles = 0.5 * (motion.breaks[1:] + motion.breaks[:-1])
    speeds = asked[np.append(changes, len(asked) - 1)][np.searchsorted(cuts, middles)]
    return JointPath(motion.coefficients, np.diff(motion.breaks)), speeds


def _share_in_band(chain: Chain, motion: Trajectory, low: float) -> float:
    """Part of the tool's way on which it is no slower than a speed [m/s], about."""
    # Samples of the tool's speed on the whole motion.
    times = np.linspace(0.0, motion.duration, 1001)
    J = geometric(chain, motion.sample(times))[:, :3]
    speeds = np.linalg.norm(np.einsum("kij,kj->ki", J, motion.sample(times, 1)), axis=1)
    total = float(speeds.sum())
    return float(speeds[speeds >= low].sum()) / total if total > 0.0 else 1.0


def spline_near(
    chain: Chain,
    run: ToolRun,
    timed: ScaledTime,
    tolerances: Tolerances,
    parametrization: TimeParametrization,
) -> ScaledTime:
    """The spline of fewest pieces near a motion along a run; the motion itself where none will do.

    Whether the tool keeps near enough is seen here for a run of one motion, and by the proof for
    all; whether the spline is free of collisions by the proof alone.

    Args:
        chain: The robot; its tip is the tool.
        run: Motions that the tool follows.
        timed: The motion, from rest to rest.
        tolerances: Deviations allowed.
        parametrization: The limits.
    """
    motion = timed.trajectory
    if parametrization.loads is not None or run.tolerances or run.tool_speeds:
        return timed
    # Of the deviation allowed, what a spline may use at samples: the rest is for what lies between
    # and for the proof's bounds.
    share = 0.5
    allowed = (share * tolerances.pair[0], share * tolerances.pair[1])
    best, pieces = timed, Pieces(motion.breaks, motion.coefficients)
    # A spline that takes longer than the motion by this factor is only taken if no other is faster.
    fast = 1.05
    for rate, least in _SPANS:
        count = max(least, math.ceil(rate * motion.duration))
        if count >= len(motion.breaks) - 1:
            break
        parts = even_parts(motion.duration, count, count / motion.duration)
        spline = fit_pieces(pieces, motion.joint_names, parametrization.jerk_bounds, parts)
        found = spline.trajectory
        longer = found.duration / motion.duration
        if longer > WORTH or (best is not timed and longer > fast):
            continue
        places = found.breaks / found.duration
        if (
            len(run.motions) == 1
            and not pieces_within(
                chain, run, places, found.breaks, found.coefficients, allowed
            ).all()
        ):
            continue
        if best is timed or found.duration < best.trajectory.duration:
            best = spline
        if longer <= fast:
            break
    return best
