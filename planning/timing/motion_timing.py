"""Motions along a path that was found free: the fastest first, then ever safer ones.

What is timed is what is proved. Corners are rounded as far as their curves are proved free, a
motion with a stop at each corner comes last. A spline of time leaves the polyline between its
waypoints: with more waypoints on the legs it keeps nearer to them.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

import numpy as np

from compiled.kernel import directly, kernel
from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from kinematics.trajectory.polynomial import sample_kernel
from kinematics.trajectory.trajectory import Trajectory, stay
from obstacles.collision.checker import Checker
from obstacles.collision.lanes.check import mark_blocked
from obstacles.collision.model.model_arrays import ModelArrays
from planning.timing.jerk.jerk_limited import Pieces
from planning.timing.options import TimingFailed, TimingOptions
from planning.timing.parametrization import TimeParametrization, merge_repeated
from planning.timing.path.blend import (
    certified_reaches,
    largest_reaches,
    merge,
    reach_for_deviation,
)
from planning.timing.spline.quintic_fit import SPAN_RATES
from planning.timing.spline.spline import Ends
from planning.timing.time_scaling import ScaledTime
from planning.values.deadline import Deadline
from planning.values.limits import RATIO_TOLERANCE

#: Instants of a piece of a spline at which it is checked before it is proved.
_INSTANTS = 3


def motions(
    checker: Checker,
    waypoints: Array,
    parametrization: TimeParametrization,
    timing: TimingOptions,
    deadline: Deadline,
    preferred: Sequence[Checker] = (),
    *,
    keep_path: bool = False,
    holds: Callable[[Array], bool] | None = None,
) -> Iterator[Callable[[], ScaledTime]]:
    """Motions to be tried in turn, until one is proved.

    Args:
        checker: The robot in its scene.
        waypoints: A polyline proved free, shape (k, n).
        parametrization: The method and the limits.
        timing: Further options of the timing.
        deadline: Time after which corners are not checked any more.
        preferred: Checkers of falling clearance that corners are blended by where they keep it;
            ``checker`` itself among them where all of the motion can keep a preferred clearance.
        keep_path: Whether the motion keeps to the polyline but for its rounded corners.
        holds: Whether states (k, n) hold the path's constraints, where it has some: a spline that
            leaves the polyline is checked before it is proved.

    Raises:
        InvalidOption: Times were given that do not fit the waypoints, or an interpolation that
            would not follow the path that was found.
    """
    names = checker.model.robot.chain.joint_names
    points = merge(waypoints)
    if len(points) < 2:
        yield lambda: ScaledTime(stay(names, points[0]), 1.0)
        return
    if not parametrization.method.follows_path:
        yield from waypoint_splines(merge_repeated(waypoints), parametrization, timing, names)
        return
    if timing.interpolation not in {None, "linear"}:
        raise InvalidOption(
            f"a plan timed by {parametrization.method.name} follows straight lines with rounded "
            "corners",
            hint="Ask for the method spline, or leave interpolation out.",
        )
    if len(points) > 2:
        leaves = timing.blend_tolerance is None and not keep_path
        rounded = _RoundedMotion(
            checker, points, parametrization, timing, deadline, preferred, holds
        )
        if leaves:
            yield rounded.smooth
        if not leaves or rounded.left_path:
            yield rounded.time_on_path
    none = np.zeros(max(len(points) - 2, 0))
    yield lambda: parametrization.time_polyline(points, none, names)


class _Wide(NamedTuple):
    """The spline near a motion with corners as wide as is worth it, of which nothing is proved.

    ``is_clear`` says whether it keeps the first of the preferred clearances.
    """

    reaches: Array
    spline: ScaledTime
    is_clear: bool


@dataclass(slots=True)
class _RoundedMotion:
    """The motion with corners rounded as far as is free and asked for, and the spline near it.

    Args:
        checker: The robot in its scene.
        points: A polyline proved free, merged, shape (k, n), k >= 3.
        parametrization: The method and the limits.
        timing: Further options of the timing.
        deadline: Time after which corners are not checked any more.
        preferred: Checkers of falling clearance.
        holds: Same as in ``motions``.
    """

    checker: Checker
    points: Array
    parametrization: TimeParametrization
    timing: TimingOptions
    deadline: Deadline
    preferred: Sequence[Checker]
    holds: Callable[[Array], bool] | None = None
    left_path: bool = field(default=False, init=False)
    _found_reaches: Array | None = field(default=None, init=False)
    _kept_on_path: dict[int, bool] = field(default_factory=dict, init=False)
    _on_path: ScaledTime | None = field(default=None, init=False)

    def time_on_path(self) -> ScaledTime:
        """The motion with rounded corners."""
        if self._on_path is None:
            names = self.checker.model.robot.chain.joint_names
            polyline = self.points, self._reaches(), names
            self._on_path = self.parametrization.time_polyline(*polyline)
        return self._on_path

    def smooth(self) -> ScaledTime:
        """The spline near the motion where it is as far from everything, else the motion itself."""
        names = self.checker.model.robot.chain.joint_names
        wide = self._spline_at_widest(names)
        if wide is not None and wide.is_clear:
            self.left_path = True
            return wide.spline
        reaches = self._reaches()
        rounded = self.parametrization.near_corners(self.points, reaches)
        if rounded is not None:
            spline = self._spline_near(rounded, reaches, wide, names)
            if spline is not None:
                self.left_path = True
                return spline
        return self._within_loads(names) or self.time_on_path()

    def _spline_near(
        self, rounded: Pieces, reaches: Array, wide: _Wide | None, names: tuple[str, ...]
    ) -> ScaledTime | None:
        """The spline of fewest spans near a motion that keeps as clear as that.

        Args:
            rounded: The motion.
            reaches: Reaches of its corners.
            wide: The spline at the widest corners, which is the first where these are as wide.
            names: Names of the joints.
        """
        if wide is not None and not np.array_equal(reaches, wide.reaches):
            wide = None
        splines, legs = list[ScaledTime](), len(self.points) - 1
        for rate in SPAN_RATES:
            if wide is not None and not splines:
                spline: ScaledTime | None = wide.spline
            else:
                spline = self.parametrization.spline_near(rounded, names, legs, rate)
            if spline is None:
                continue
            if self._is_as_clear(spline.trajectory, rounded):
                return spline
            splines.append(spline)
        if any(level is self.checker for level in self.preferred):
            # A spline is checked so much more finely where it has nothing to spare.
            finely = 4
            for spline in splines:
                if _keeps(self.checker, spline.trajectory, finely):
                    return spline
        return None

    def _within_loads(self, names: tuple[str, ...]) -> ScaledTime | None:
        """The spline near the motion on the path where loads bind that, and it keeps as clear."""
        if self.parametrization.loads is None:
            return None
        motion = self.time_on_path().trajectory
        rounded = Pieces(motion.breaks, motion.coefficients)
        self._kept_on_path.clear()
        for spline in self.parametrization.splines_within_loads(motion, names):
            if self._is_as_clear(spline.trajectory, rounded):
                self.left_path = True
                return spline
        return None

    def _spline_at_widest(self, names: tuple[str, ...]) -> _Wide | None:
        """The spline near the widest corners, which are not proved free, if there is one.

        Where it keeps the first of the preferred clearances no corner has to be checked: the
        spline is what is proved.
        """
        if not self.preferred:
            return None
        reaches = self._widest_reaches()
        rounded = self.parametrization.near_corners(self.points, reaches)
        if rounded is None:
            return None
        legs = len(self.points) - 1
        spline = self.parametrization.spline_near(rounded, names, legs, SPAN_RATES[0])
        if spline is None or not self._is_allowed(spline.trajectory):
            return None
        return _Wide(reaches, spline, _keeps(self.preferred[0], spline.trajectory))

    def _reaches(self) -> Array:
        """Reaches of the corners that are proved free."""
        if self._found_reaches is None:
            self._found_reaches = certified_reaches(
                self.checker,
                self.points,
                self.deadline,
                smooth=self.parametrization.smooth,
                most=self._widest_reaches(),
                preferred=[level for level in self.preferred if level is not self.checker],
            )
        return self._found_reaches

    def _widest_reaches(self) -> Array:
        """Reaches of the corners that are asked for."""
        tolerance = self.timing.blend_tolerance
        if tolerance is None:
            return largest_reaches(self.points)
        return reach_for_deviation(self.points, tolerance, self.parametrization.smooth)

    def _is_as_clear(self, motion: Trajectory, rounded: Pieces) -> bool:
        """Whether a motion keeps the highest level that the rounded one keeps, or a higher one."""
        if not self._is_allowed(motion):
            return False
        for number, level in enumerate(self.preferred):
            if _keeps(level, motion):
                return True
            if number not in self._kept_on_path:
                self._kept_on_path[number] = _keeps(level, rounded)
            if self._kept_on_path[number]:
                return False
        return self.checker.all_valid(_states(motion, _INSTANTS))

    def _is_allowed(self, motion: Trajectory) -> bool:
        """Whether a motion that leaves the path holds constraints and the joints' limits."""
        if self.holds is not None and not self.holds(_states(motion, _INSTANTS)):
            return False
        limits = self.checker.model.robot.chain.limits
        low, high = limits.lower, limits.upper
        # Splines swing over by milliradians. So near to a limit of a joint [rad or m] they are held
        # to it before they are proved, at so many instants of a piece.
        at_limit, limit_instants = 0.02, 8
        if _is_inside(self.points, low + at_limit, high - at_limit):
            return True
        states = _states(motion, limit_instants)
        return _is_inside(states, low - RATIO_TOLERANCE, high + RATIO_TOLERANCE)


def _states(motion: Trajectory, each: int) -> Array:
    """States at so many instants of each piece of a motion, evenly spaced between its ends."""
    count = each * motion.pieces
    return motion.sample(np.arange(1, count + 1) * (motion.duration / (count + 1)))


def _is_inside(points: Array, lower: Array, upper: Array) -> bool:
    """Whether points (k, n) are inside limits (n,) of the joints."""
    return bool(((lower <= points) & (points <= upper)).all())


def _keeps(level: Checker, motion: Trajectory | Pieces, finely: int = 1) -> bool:
    """Whether a motion keeps what a checker asks for, as far as looks at its states tell.

    Args:
        level: The robot in its scene, with the distances to be kept.
        motion: The motion.
        finely: Factor of the number of states that are looked at.
    """
    # 1 rad for each metre of the distance that is to be kept: a link that goes straight past a
    # corner at a distance of 20 mm is 1 mm nearer there than 7 mm before.
    spacing = min(max(level.model.margin, 0.01), 0.04) / finely
    arrays, slack = level.model.arrays, float(level.slack)
    return directly(keeps_kernel, arrays, motion.breaks, motion.coefficients, spacing, slack)


@kernel
def keeps_kernel(
    model: ModelArrays, breaks: Array, coefficients: Array, spacing: float, slack: float
) -> bool:
    """Whether all states of a motion are free that are looked at after equal ways.

    Args:
        model: The packed robot and scene.
        breaks: Breaks of the motion, shape (m + 1,) [s].
        coefficients: Coefficients of the motion, shape (m, n, k).
        spacing: Way between two of them, Euclidean in joint space [rad or m].
        slack: Distance to keep beyond the margins [m].
    """
    # Instants by which the way of the motion is measured, and looks at most.
    parts, most, n = 32, 1024, coefficients.shape[1]
    times, way = np.empty(parts + 1), np.zeros(parts + 1)
    for k in range(parts + 1):
        times[k] = k * (breaks[-1] / parts)
    states = np.empty((parts + 1, n))
    sample_kernel(breaks, coefficients, times, 0, states)
    for k in range(parts):
        square = 0.0
        for j in range(n):
            square += (states[k + 1, j] - states[k, j]) ** 2
        way[k + 1] = way[k] + math.sqrt(square)
    count = min(max(2, math.ceil(way[-1] / spacing)), most)
    looked, at = np.empty(count + 1), 0
    for k in range(count + 1):
        gone = k * (way[-1] / count)
        while at < parts - 1 and way[at + 1] < gone:
            at += 1
        left, length = gone - way[at], way[at + 1] - way[at]
        share = min(left / length, 1.0) if length > 0.0 else 0.0
        looked[k] = times[at] + share * (times[at + 1] - times[at])
    states = np.empty((count + 1, n))
    sample_kernel(breaks, coefficients, looked, 0, states)
    return not mark_blocked(model, states, slack, np.empty(count + 1), True)


def waypoint_splines(
    points: Array,
    parametrization: TimeParametrization,
    timing: TimingOptions,
    names: tuple[str, ...],
) -> Iterator[Callable[[], ScaledTime]]:
    """Splines to be tried in turn, with ever more waypoints.

    Args:
        points: A polyline proved free, no two neighbours equal, shape (k, n).
        parametrization: The method and the limits.
        timing: Further options of the timing.
        names: Names of the joints.

    Raises:
        InvalidOption: Times that do not fit the waypoints, or a natural spline, whose ends move.
    """
    ends: Ends = "natural" if timing.interpolation == "natural_spline" else "clamped"
    times = None if timing.times is None else np.array(timing.times, dtype=np.float64)
    if times is not None and len(times) != len(points):
        raise InvalidOption(
            f"timing.times has {len(times)} values, the path that was found has {len(points)} "
            "waypoints",
            hint="Leave times out, or time a path of your own by POST /v1/retime.",
            waypoints=points.tolist(),
        )

    def spline(points: Array, times: Array | None) -> ScaledTime:
        timed = parametrization.time_spline(points, times, ends, names, timing.scale_times)
        checked = times is not None and not timing.scale_times
        factor = parametrization.needed_factor(timed.trajectory) if checked else 1.0
        if factor > 1.0 + RATIO_TOLERANCE:
            raise TimingFailed(
                "the times given are too short: limits are kept by times "
                f"{factor:.9g} times as long",
                hint="Give longer times, or ask for scale_times.",
                factor=factor,
            )
        return timed

    if ends == "natural":
        _refuse_moving_ends(spline(points, times))
    # How often the legs of a path are halved to bring a spline nearer to them.
    for _ in range(6):
        yield partial(spline, points, times)
        points = _halve(points)
        times = None if times is None else _halve(times[:, None])[:, 0]


def _refuse_moving_ends(timed: ScaledTime) -> None:
    """Refuse a natural spline, whose ends move: a plan begins and ends at rest."""
    motion = timed.trajectory
    start, end = motion.sample([0.0, motion.duration], 1)
    for label, velocity in (("begin", start), ("end", end)):
        j = int(np.argmax(np.abs(velocity)))
        # Velocity at an end that still counts as rest [rad/s or m/s].
        if abs(velocity[j]) > 1e-9:
            raise InvalidOption(
                f"a natural spline would {label} with {velocity[j]:.6g} in joint "
                f"{motion.joint_names[j]!r}, and a plan begins and ends at rest",
                hint="Ask for clamped_spline, or time the path by POST /v1/retime, which takes "
                "boundary velocities.",
                start_velocity=start.tolist(),
                end_velocity=end.tolist(),
            )


def _halve(rows: Array) -> Array:
    """Insert the middle of each two neighbours between them."""
    answer = np.empty((2 * len(rows) - 1, rows.shape[1]))
    answer[::2], answer[1::2] = rows, 0.5 * (rows[1:] + rows[:-1])
    return answer
