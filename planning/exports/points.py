"""Points of a motion as a file has them, digits that the file drops included."""

from typing import NamedTuple

import numpy as np

from kinematics.arrays import Array, Indices
from kinematics.errors import InvalidOption
from kinematics.trajectory.export import NANOSECONDS, nanoseconds, rows_at
from kinematics.trajectory.trajectory import Trajectory
from planning.exports.options import ExportFormat, ExportOptions, Rule
from planning.timing.path.simplification import fewest_waypoints
from planning.values.limits import JERK_JUMP


class ExportPoints(NamedTuple):
    """Points with what a file gives of them.

    Args:
        rule: The interpolation between them.
        ticks: Times, strictly increasing from 0, shape (p,) [ns].
        derivatives: Positions, and as the rule needs them velocities and accelerations, each of
            shape (p, n).
    """

    rule: Rule
    ticks: Indices
    derivatives: tuple[Array, ...]

    @property
    def times(self) -> Array:
        """Times of the points, shape (p,) [s]."""
        return self.ticks / NANOSECONDS

    @property
    def positions(self) -> Array:
        """Positions, shape (p, n) [rad or m]."""
        return self.derivatives[0]


def export_points(trajectory: Trajectory, options: ExportOptions) -> ExportPoints:
    """The points that a format gives of a motion.

    Args:
        trajectory: The motion.
        options: Format, period and tolerance.

    Raises:
        InvalidOption: The period gives too many points.
    """
    period = options.period
    if options.sample_count is not None:
        period = trajectory.duration / (options.sample_count - 1)
    # Points of one file: at half a kilobyte each, fifty megabytes.
    max_points = 100_000
    if trajectory.duration / period > max_points:
        raise InvalidOption(
            f"sample_period: {period:g} s over {trajectory.duration:g} s gives more than "
            f"{max_points} points",
            hint=f"Give at least {trajectory.duration / max_points:.3g} s.",
        )
    cycle = 1 if options.traits.cycles is None else round(period * NANOSECONDS)
    trajectory = _in_whole_cycles(trajectory, cycle)
    times, rule = trajectory.uniform_samples(period), _rule(trajectory, options)
    if rule == Rule.STRAIGHT_LEGS:
        positions = trajectory.sample(times)
        times = times[fewest_waypoints(positions, options.path_tolerance, 2.0)[0]]
    elif options.sample_count is not None:
        times = np.linspace(0.0, trajectory.duration, options.sample_count)
    elif rule in (Rule.QUINTIC, Rule.CUBIC):
        times = _with_breaks(trajectory, times, period, rule)
    if options.least_spacing:
        times = _spaced(times, options.least_spacing)
    ticks = nanoseconds(times)
    if rule != Rule.STRAIGHT_LEGS:
        # Where the motion is at the times that the file names: beside a near point, half a
        # nanosecond of difference would be felt in the acceleration.
        times = np.append(ticks[:-1] / NANOSECONDS, trajectory.duration)
    count = {Rule.QUINTIC: 3, Rule.CUBIC: 2}.get(rule, 1)
    rows = rows_at(trajectory, times, count)
    if options.format in (ExportFormat.RAPID, ExportFormat.KRL):
        rows = (np.deg2rad(single_degrees(rows[0]).astype(np.float64)),)
    if options.traits.decimals is not None:
        rows = (np.deg2rad(np.round(np.rad2deg(rows[0]), options.traits.decimals)),)
    return ExportPoints(rule, ticks, rows)


def _spaced(times: Array, least: float) -> Array:
    """The first time, those at least so long after the one before and before the end, the last."""
    kept = [float(times[0])]
    for time in times[1:-1].tolist():
        # Periods that are just as long count, whatever is rounded.
        if min(time - kept[-1], float(times[-1]) - time) >= least * (1.0 - 1e-9):
            kept.append(time)
    return np.array([*kept, times[-1]])


def _in_whole_cycles(trajectory: Trajectory, cycle: int) -> Trajectory:
    """The motion with a duration of whole cycles [ns], slower by less than one of them.

    Its last point is then where and as fast as the motion ends.
    """
    count = trajectory.duration * NANOSECONDS / cycle
    nearest = float(max(round(count), 1))
    # Durations that are off whole cycles by less are off by rounding [ns].
    whole = nearest if abs(count - nearest) * cycle <= 1e-5 else float(np.ceil(count))
    return trajectory if whole == count else trajectory.dilate(whole / count)


def single_degrees(positions: Array) -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
    """Angles [rad] in degrees as numbers of single precision, which RAPID and KRL compute with."""
    return np.rad2deg(positions).astype(np.float32)


def _with_breaks(trajectory: Trajectory, times: Array, period: float, rule: Rule) -> Array:
    """Times, and those at which pieces of the motion meet, as far as the rule needs them.

    Quintics between points of one piece of degree 5 at most are that piece, and keep its limits;
    across two pieces they exceed them by some percent. Any polynomial overshoots where it passes a
    jump of the acceleration.
    """
    breaks = trajectory.breaks[1:-1]
    # Degree of the polynomials that controllers interpolate by at most.
    if rule != Rule.QUINTIC or trajectory.coefficients[:, :, 6:].any():
        jumps = np.abs(trajectory.jumps(2)).max(axis=1, initial=0.0) > JERK_JUMP
        breaks = breaks[jumps]
    if not len(breaks):
        return times
    after = np.searchsorted(breaks, times[1:-1])
    padded = np.concatenate([[-np.inf], breaks, [np.inf]])
    gaps = np.minimum(times[1:-1] - padded[after], padded[after + 1] - times[1:-1])
    # A point this near to one where two pieces meet gives way to it, a share of the period.
    inner = times[1:-1][gaps > 0.1 * period]
    return np.unique(np.concatenate([times[:1], inner, breaks, times[-1:]]))


def _rule(trajectory: Trajectory, options: ExportOptions) -> Rule:
    if options.is_path:
        return Rule.STRAIGHT_LEGS
    if options.traits.kind == "stream":
        return Rule.LINEAR
    if options.interpolation is not None:
        return Rule(options.interpolation)
    smooth = trajectory.continuity().acceleration <= JERK_JUMP
    return Rule.QUINTIC if smooth else Rule.CUBIC
