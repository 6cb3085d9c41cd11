"""Timing of joint paths that lead the tool, from rest to rest along every motion."""

from dataclasses import dataclass

import numpy as np

from kinematics.arrays import Array
from kinematics.chain import Chain
from kinematics.trajectory import Trajectory, concatenate, stay
from planning.passing_times import passing_times
from planning.result import ToolMotionReport
from planning.run_deviation import pieces_within
from planning.timing.parametrization import TimeParametrization
from planning.timing.path import JointPath
from planning.timing.time_scaling import ScaledTime
from planning.tool_motion import SpeedBand, TimedToolMotions, ToolMotion
from planning.tool_path import Tolerances, ToolPath
from planning.tool_run import RunPart, ToolRun, run_of
from planning.tool_spline import spline_near

#: How often a spline of time is given twice as many waypoints to keep nearer to its motion.
_MAX_DOUBLINGS = 6


@dataclass(frozen=True, slots=True, eq=False)
class TimedToolPath:
    """A tool path in time.

    Args:
        path: The joint paths with the motions of the tool.
        parts: One trajectory for each motion in which the joints move.
        reports: Times of each motion, and the share of it that is carried out.
        notes: About the timing.
        transit: The motion to the start of the tool path; None where it begins at once.
    """

    path: ToolPath
    parts: tuple[Trajectory, ...]
    reports: tuple[ToolMotionReport, ...]
    notes: tuple[str, ...] = ()
    transit: Trajectory | None = None

    @property
    def begins(self) -> float:
        """Time at which the first tool motion begins [s]."""
        return 0.0 if self.transit is None else self.transit.duration

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
            self._speed_band(),
        )

    def _speed_band(self) -> SpeedBand | None:
        """The speed to be kept, and when."""
        band = self.path.speed_band
        if band is None:
            return None
        parts = _begun_parts(self.path)
        spans = [
            (report.begins, report.ends)
            for report, part in zip(self.reports, parts, strict=True)
            if part.tolerance is not None
        ]
        return SpeedBand(*band, _joined(spans))

    def trajectory(self, chain: Chain) -> Trajectory:
        """The parts one after the other; a short stay where there are none."""
        parts = self.parts if self.transit is None else (self.transit, *self.parts)
        if parts:
            return concatenate(parts)
        return stay(chain.joint_names, self.path.segments[0].start)

    def bounds(self, parametrization: TimeParametrization) -> dict[str, Array]:
        """Limits that the trajectory keeps; splines one after the other can't keep a jerk limit."""
        bounds = parametrization.bounds
        if not parametrization.method.follows_path and len(self.parts) > 1:
            bounds.pop("jerk", None)
        return bounds


def time_tool_path(
    chain: Chain,
    path: ToolPath,
    parametrization: TimeParametrization,
    transit: Trajectory | None = None,
    *,
    near: bool = False,
) -> TimedToolPath:
    """Time every motion of a tool path, from rest to rest.

    Args:
        chain: The robot; its tip is the tool.
        path: The joint paths.
        parametrization: The method and the limits.
        transit: The motion to the start of the path, at rest at both ends.
        near: Whether splines of few pieces are taken that keep near the path, not exactly to it.

    Raises:
        TimingFailed: No motion within the limits was found.
    """
    scaled = [_time_motion(chain, *pair, path.tolerances, parametrization) for pair in path.moving]
    if near:
        runs = [run_of(motion) for motion, _ in path.moving]
        scaled = [
            spline_near(chain, *pair, path.tolerances, parametrization)
            for pair in zip(runs, scaled, strict=True)
        ]
    parts = tuple(part.trajectory for part in scaled)
    begins = 0.0 if transit is None else transit.duration
    reports = _reports(chain, path, parts, begins)
    return TimedToolPath(path, parts, reports, parametrization.method.notes(scaled), transit)


def _begun_parts(path: ToolPath) -> list[RunPart]:
    """Motions that were begun, in order."""
    return [
        part
        for run, segment in zip(path.runs, path.segments, strict=True)
        for part in run.parts_until(1.0 if segment.stop is None else segment.reached)
    ]


def _joined(spans: list[tuple[float, float]]) -> tuple[tuple[float, float], ...]:
    """Spans of time, those joined that follow each other at once."""
    joined: list[tuple[float, float]] = []
    for begins, ends in spans:
        follows = bool(joined) and joined[-1][1] == begins
        joined.append((joined.pop()[0] if follows else begins, ends))
    return tuple(joined)


def _reports(
    chain: Chain, path: ToolPath, trajectories: tuple[Trajectory, ...], begins: float
) -> tuple[ToolMotionReport, ...]:
    """Times of each motion of a tool path that begins at a time [s]."""
    remaining = iter(trajectories)
    reports: list[ToolMotionReport] = []
    now = then = begins
    for run, segment in zip(path.runs, path.segments, strict=True):
        reached = 1.0 if segment.stop is None else segment.reached
        parts = run.parts_until(reached)
        ends = [0.0] * len(parts)
        if segment.path is not None:
            ends = passing_times(chain, segment.path, next(remaining), parts)
        for part, end in zip(parts, ends, strict=True):
            motion, share = part.motion, (reached - part.begin) / (part.end - part.begin)
            reports.append(
                ToolMotionReport(
                    motion.kind, motion.length, motion.angle, min(share, 1.0), then,
                    now + end, motion, part.asked, part.blends, run.name,
                )
            )  # fmt: skip
            then = now + end
        now = then
    return tuple(reports)


def _time_motion(
    chain: Chain,
    motion: ToolMotion | ToolRun,
    path: JointPath,
    tolerances: Tolerances,
    parametrization: TimeParametrization,
) -> ScaledTime:
    run = run_of(motion)
    if run.tool_speed is not None:
        parametrization = parametrization.at_tool_speed(chain, run.tool_speed)
    if parametrization.method.follows_path:
        return parametrization.time(path, chain.joint_names)
    knots = path.breaks
    for _ in range(_MAX_DOUBLINGS):
        timed = parametrization.time_spline(path.sample(knots), None, "clamped", chain.joint_names)
        spline = timed.trajectory
        fine = pieces_within(chain, run, knots, spline.breaks, spline.coefficients, tolerances.pair)
        if fine.all():
            break
        knots = np.sort(np.concatenate([knots, 0.5 * (knots[1:] + knots[:-1])]))
    return timed
