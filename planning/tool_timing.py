"""Timing of joint paths that lead the tool, from rest to rest along every motion."""

from dataclasses import dataclass

import numpy as np

from kinematics.arrays import Array
from kinematics.chain import Chain
from kinematics.trajectory import Trajectory, concatenate, stay
from planning.result import ToolMotionReport
from planning.timing.parametrization import TimeParametrization
from planning.timing.path import JointPath
from planning.timing.time_scaling import ScaledTime
from planning.tool_deviation import piece_deviations
from planning.tool_motion import TimedToolMotions, ToolMotion
from planning.tool_path import Tolerances, ToolPath

#: How often a spline of time is given twice as many waypoints to keep nearer to its motion.
_MAX_DOUBLINGS = 6


@dataclass(frozen=True, slots=True, eq=False)
class TimedToolPath:
    """A tool path in time.

    Args:
        path: The joint paths with the motions of the tool.
        parts: One trajectory for each motion in which the joints move.
        notes: About the timing.
    """

    path: ToolPath
    parts: tuple[Trajectory, ...]
    notes: tuple[str, ...] = ()

    @property
    def reports(self) -> tuple[ToolMotionReport, ...]:
        """Times of each motion, and the share of it that is carried out."""
        parts = iter(self.parts)
        reports, now = [], 0.0
        for motion, segment in zip(self.path.motions, self.path.segments, strict=True):
            then = now + (0.0 if segment.path is None else next(parts).duration)
            fraction = 1.0 if segment.stop is None else segment.reached
            reports.append(
                ToolMotionReport(motion.kind, motion.length, motion.angle, fraction, now, then)
            )
            now = then
        return tuple(reports)

    @property
    def tool_motions(self) -> TimedToolMotions:
        """The motions with their times, as the proof asks for them."""
        times = [0.0, *(report.ends for report in self.reports)]
        tolerances = self.path.tolerances
        return TimedToolMotions(
            self.path.motions, np.array(times), tolerances.position, tolerances.orientation
        )

    def trajectory(self, chain: Chain) -> Trajectory:
        """The parts one after the other; a short stay where there are none."""
        if self.parts:
            return concatenate(self.parts)
        return stay(chain.joint_names, self.path.segments[0].start)

    def bounds(self, parametrization: TimeParametrization) -> dict[str, Array]:
        """Limits that the trajectory keeps; splines one after the other can't keep a jerk limit."""
        bounds = parametrization.bounds
        if not parametrization.method.follows_path and len(self.parts) > 1:
            bounds.pop("jerk", None)
        return bounds


def time_tool_path(
    chain: Chain, path: ToolPath, parametrization: TimeParametrization
) -> TimedToolPath:
    """Time every motion of a tool path, from rest to rest.

    Args:
        chain: The robot; its tip is the tool.
        path: The joint paths.
        parametrization: The method and the limits.

    Raises:
        TimingFailed: No motion within the limits was found.
    """
    scaled = [_time_motion(chain, *pair, path.tolerances, parametrization) for pair in path.moving]
    parts = tuple(part.trajectory for part in scaled)
    return TimedToolPath(path, parts, parametrization.method.notes(scaled))


def _time_motion(
    chain: Chain,
    motion: ToolMotion,
    path: JointPath,
    tolerances: Tolerances,
    parametrization: TimeParametrization,
) -> ScaledTime:
    if parametrization.method.follows_path:
        return parametrization.time(path, chain.joint_names)
    knots = path.breaks
    for _ in range(_MAX_DOUBLINGS):
        timed = parametrization.time_spline(path.sample(knots), None, "clamped", chain.joint_names)
        spline = timed.trajectory
        _, fine, _ = piece_deviations(
            chain, spline.breaks, spline.coefficients, motion, tolerances.pair
        )
        if fine.all():
            break
        knots = np.sort(np.concatenate([knots, 0.5 * (knots[1:] + knots[:-1])]))
    return timed
