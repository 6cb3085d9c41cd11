"""Limits that vary along a path: stretches of it that are run through within limits of their own.

The path is cut where stretches begin and end, and each part is timed within the tightest limits of
all stretches that it belongs to. The speeds between parts are the fastest ones of the whole path
without a limit of jerk; where a part leaves no room for the speeds at its ends they are lowered.
Under a jerk limit the speed along the path does not change where parts meet.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from kinematics.arrays import Array, Indices, frozen
from kinematics.errors import InvalidOption
from kinematics.model.chain import Chain
from kinematics.trajectory.trajectory import concatenate
from planning.timing.method import TimingMethod
from planning.timing.options import TimingFailed
from planning.timing.parametrization import TimeParametrization
from planning.timing.path.path import JointPath
from planning.timing.speed.constraints import cells
from planning.timing.speed.effort_limits import knot_limits
from planning.timing.speed.minimum_time import RESOLUTION, squared_speeds, with_end_speeds
from planning.timing.time_scaling import ScaledTime
from planning.values.limits import MotionLimits

# Places nearer than this part of the path's length are one [-].
_SAME_PLACE = 1e-9
# Part of the fastest speeds between parts that solvers are left for rounding [-].
_HAIR = 1e-8
# A speed between parts that leaves no room is multiplied by the first, and is 0 below the second
# part of the fastest [-].
_SLOWER, _LEAST = 0.8, 0.02


@dataclass(frozen=True, slots=True, eq=False)
class Stretch:
    """Limits along a stretch of a path, beside those of the whole motion.

    Args:
        begin: Waypoint at which it begins, counted from 0, between two where it has a fraction; or
            the length of straight lines through the waypoints up to there, Euclidean in joint
            space [rad or m].
        end: Where it ends, likewise.
        by_length: Whether it is given by length.
        velocity: Limits, shape (n,) [rad/s or m/s].
        acceleration: Limits, shape (n,) [rad/s^2 or m/s^2].
        tool_speed: Largest speed of the tip [m/s].

    Raises:
        InvalidOption: It has no length or no limit, or a limit is not positive.
    """

    begin: float
    end: float
    by_length: bool = False
    velocity: Array | None = None
    acceleration: Array | None = None
    tool_speed: float | None = None

    def __post_init__(self) -> None:
        if not 0.0 <= self.begin < self.end < np.inf:
            raise InvalidOption(
                f"limits_at: a stretch from {self.begin:.9g} to {self.end:.9g} has no length",
                hint="Begin at 0 or later, and end farther on.",
            )
        limits = (self.velocity, self.acceleration, self.tool_speed)
        if all(limit is None for limit in limits):
            raise InvalidOption(
                f"limits_at: the stretch from {self.begin:.9g} to {self.end:.9g} has no limit",
                hint="Give velocity, acceleration or tool_speed.",
            )
        for name in ("velocity", "acceleration"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, frozen(getattr(self, name)))
        if not all((np.asarray(limit) > 0.0).all() for limit in limits if limit is not None):
            raise InvalidOption("limits_at: a limit is not positive", hint="Give positive numbers.")


def check_stretches(
    stretches: Sequence[Stretch], points: Array, method: TimingMethod, chain: Chain | None
) -> None:
    """Refuse limits along stretches that are none of a path's.

    Args:
        stretches: The stretches.
        points: Waypoints of the path, shape (k, n).
        method: Method of timing.
        chain: The robot, if there is one.

    Raises:
        InvalidOption: The method leaves the path, a stretch ends beyond it or has no length, its
            limits are not n, or its tool has no robot.
    """
    if stretches and not method.follows_path:
        raise InvalidOption(
            "limits_at belongs to methods that follow a path, and a spline of time leaves it",
            hint="Ask for interpolation natural_spline with another method.",
        )
    for stretch in stretches:
        for name in ("velocity", "acceleration"):
            row = getattr(stretch, name)
            if row is not None and row.shape != (points.shape[1],):
                raise InvalidOption(
                    f"limits_at: {name} has {row.size} value(s) for {points.shape[1]} joint(s)",
                    hint="Give one for each joint.",
                )
        if stretch.tool_speed is not None and chain is None:
            raise InvalidOption(
                "limits_at: a limit of the tool's speed needs a robot",
                hint="Name one, or leave tool_speed out.",
            )
    _lengths(stretches, points)


def stretch_places(
    stretches: Sequence[Stretch], points: Array, numbers: Indices, places: Array
) -> Array:
    """Places on a path at which stretches begin and end, shape (m, 2).

    Args:
        stretches: m stretches.
        points: All waypoints, shape (k, n).
        numbers: Waypoints that the path leads through or rounds, shape (k',).
        places: Places of these on the path, shape (k',); between them the share of the length
            counts.
    """
    lengths = _lengths(stretches, points)
    return np.asarray(np.interp(lengths, path_lengths(points)[numbers], places))


def _lengths(stretches: Sequence[Stretch], points: Array) -> Array:
    """Lengths of the straight lines through waypoints at which stretches begin and end, (m, 2)."""
    lengths = path_lengths(points)
    found = np.empty((len(stretches), 2))
    for row, stretch in zip(found, stretches, strict=True):
        most = float(lengths[-1]) if stretch.by_length else len(points) - 1
        if stretch.end > most * (1.0 + _SAME_PLACE):
            raise InvalidOption(
                f"limits_at: a stretch ends at {stretch.end:g}, and the path at {most:.9g}",
                hint="Waypoints are counted from 0, lengths along straight lines through them.",
            )
        ends = np.minimum([stretch.begin, stretch.end], most)
        row[:] = ends if stretch.by_length else np.interp(ends, np.arange(len(points)), lengths)
        if row[1] - row[0] <= _SAME_PLACE * lengths[-1]:
            raise InvalidOption(
                f"limits_at: a stretch from {stretch.begin:.9g} to {stretch.end:.9g} has no length",
                hint="Its waypoints are the same: end it farther on.",
            )
    return found


def path_lengths(points: Array) -> Array:
    """Length of the straight lines through waypoints (k, n) up to each of them, shape (k,)."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def around_corners(path: JointPath, corners: Array, ends: Array) -> Array:
    """Stretches (m, 2) of a path that take in the curves of corners in which they begin or end.

    Args:
        path: Straight lines with rounded corners.
        corners: Places of the corners on it, shape (k,).
        ends: Places at which stretches begin and end, shape (m, 2).
    """
    breaks, curved = path.breaks, (path.coefficients[:, :, 2:] != 0.0).any(axis=(1, 2))
    found, hair = ends.copy(), _SAME_PLACE * path.length
    for column, place in np.ndindex(ends.shape):
        corner = corners[np.abs(corners - ends[column, place]).argmin()]
        before, after = np.searchsorted(breaks, [corner - hair, corner + hair]) - 1
        if before < 0 or after >= len(curved) or not (curved[before] and curved[after]):
            continue
        first, last = breaks[before], breaks[after + 1]
        if first < ends[column, place] < last:
            found[column, place] = last if place else first
    return found


@dataclass(slots=True)
class TimedInStretches:
    """Motion along a path whose limits vary.

    Args:
        path: The path.
        ends: Places on it at which stretches begin and end, shape (m, 2).
        stretches: The m stretches.
        parametrization: Method, and limits of the whole motion.
        joint_names: n names.
        chain: The robot, for limits of the tool's speed.
    """

    path: JointPath
    ends: Array
    stretches: Sequence[Stretch]
    parametrization: TimeParametrization
    joint_names: Sequence[str]
    chain: Chain | None = None

    def time(self) -> ScaledTime:
        """The motion, with the limits of each part.

        Raises:
            TimingFailed: There is none, or none was found.
        """
        parts = self.path.cut(self._places())
        starts = np.cumsum([0.0, *(part.length for part in parts)])
        within = [self._narrowed(0.5 * (a + b)) for a, b in pairwise(starts.tolist())]
        speeds = self._speeds(parts, within)
        timed = _time_parts(parts, within, speeds, self.joint_names)
        motion = concatenate([one.trajectory for one in timed])
        times = np.cumsum([0.0, *(one.trajectory.duration for one in timed)])
        firsts = np.searchsorted(motion.breaks, times).tolist()
        narrower = tuple(
            (i, k, MotionLimits(by.bounds, by.loads))
            for (i, k), by in zip(pairwise(firsts), within, strict=True)
            if i < k and by is not self.parametrization
        )
        return ScaledTime(motion, 1.0, narrower=narrower)

    def _places(self) -> Array:
        """Places within the path at which parts meet, on its breaks where these are near."""
        breaks, hair = self.path.breaks, _SAME_PLACE * self.path.length
        nearest = breaks[np.abs(breaks - self.ends.reshape(-1, 1)).argmin(axis=1)]
        places = self.ends.reshape(-1)
        places = np.unique(np.where(np.abs(places - nearest) <= hair, nearest, places))
        inner = places[(places > hair) & (places < breaks[-1] - hair)]
        return np.asarray(inner[np.diff(inner, prepend=-np.inf) > hair])

    def _narrowed(self, place: float) -> TimeParametrization:
        """Method and limits at a place."""
        found = self.parametrization
        for (begin, end), stretch in zip(self.ends, self.stretches, strict=True):
            if not begin <= place <= end:
                continue
            if stretch.velocity is not None:
                found = replace(found, velocity=np.minimum(found.velocity, stretch.velocity))
            if stretch.acceleration is not None:
                least = np.minimum(found.acceleration, stretch.acceleration)
                found = replace(found, acceleration=least)
            if stretch.tool_speed is not None:
                assert self.chain is not None
                found = found.at_tool_speed(self.chain, stretch.tool_speed)
        return found

    def _speeds(self, parts: Sequence[JointPath], within: Sequence[TimeParametrization]) -> Array:
        """Fastest speeds along the path at its start, between parts, and at its end, but for jerk.

        Raises:
            TimingFailed: No finite speed was found.
        """
        counts = [len(part.lengths) for part in parts]
        whole = JointPath(
            np.concatenate([part.coefficients for part in parts]),
            np.concatenate([part.lengths for part in parts]),
        )
        limits = np.array([[by.velocity, by.acceleration] for by in within])
        grid = cells(whole, RESOLUTION, np.repeat(limits, counts, axis=0))
        first, last = self.parametrization.end_speeds(self.path)
        grid = with_end_speeds(grid, (first, last))
        at = np.append(np.searchsorted(grid.pieces, np.cumsum([0, *counts[:-1]])), -1)
        for part, by, ends in zip(parts, within, pairwise(at), strict=True):
            if by.tool_speed is not None and by.loads is not None:
                q, q1, q2 = (part.sample([0.0, part.breaks[-1]], order) for order in range(3))
                most = knot_limits(replace(by.loads, effort=None), q, q1, q2).caps
                grid.caps[list(ends)] = np.minimum(grid.caps[list(ends)], most)
        between = np.sqrt(squared_speeds(grid)[at[1:-1]]) * (1.0 - _HAIR)
        return np.asarray([first, *between, last])


def _time_parts(
    parts: Sequence[JointPath],
    within: Sequence[TimeParametrization],
    speeds: Array,
    joint_names: Sequence[str],
) -> list[ScaledTime]:
    """The motions along the parts of a path, at speeds between them that they leave room for.

    Raises:
        TimingFailed: A part can't be timed though it begins and ends at rest, or as was asked.
    """
    fastest, timed = speeds.copy(), dict[int, ScaledTime]()
    while len(timed) < len(parts):
        i = next(i for i in range(len(parts)) if i not in timed)
        try:
            timed[i] = within[i].time(parts[i], joint_names, (speeds[i], speeds[i + 1]))
        except TimingFailed:
            lower = [k for k in (i, i + 1) if 0 < k < len(parts) and speeds[k] > 0.0]
            if not lower:
                raise
            k = max(lower, key=speeds.__getitem__)
            speeds[k] = _SLOWER * speeds[k] if speeds[k] > _LEAST * fastest[k] else 0.0
            timed.pop(k - 1, None)
            timed.pop(k, None)
    return [timed[i] for i in range(len(parts))]
