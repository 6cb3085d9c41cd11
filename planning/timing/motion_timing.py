"""Motions along a path that was found free: the fastest first, then ever safer ones.

What is timed is what is proved. Corners are rounded as far as their curves are proved free, a
motion with a stop at each corner comes last. A spline of time leaves the polyline between its
waypoints: with more waypoints on the legs it keeps nearer to them.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

import numpy as np

from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from kinematics.trajectory.trajectory import Trajectory, stay
from obstacles.collision.checker import Checker
from planning.timing.close_instants import (
    WHOLE,
    CloseInstants,
    close_instants,
    is_inside,
    not_beside,
    outside_instants,
    spans_beside,
    states_between,
)
from planning.timing.failure import TimingFailed
from planning.timing.jerk.even_corners import Pieces
from planning.timing.options import TimingOptions
from planning.timing.parametrization import (
    TimeParametrization,
    merge_repeated,
)
from planning.timing.path.blend import (
    certified_reaches,
    largest_reaches,
    merge,
    reach_for_deviation,
)
from planning.timing.spline.quintic_fit import SPAN_RATES, even_parts, finer_parts
from planning.timing.spline.spline import Ends
from planning.timing.time_scaling import ScaledTime
from planning.values.deadline import Deadline
from planning.values.limits import RATIO_TOLERANCE

# Instants of a piece of a spline at which its clearance is checked before it is proved.
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
    names = checker.model.chain.joint_names
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

    ``close`` are the instants at which it does not keep the first of the preferred clearances.
    """

    reaches: Array
    spline: ScaledTime
    close: CloseInstants


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
    _found_reaches: dict[bool, Array] = field(default_factory=dict, init=False)
    _found_widest: dict[bool, Array] = field(default_factory=dict, init=False)
    _found_close: dict[int, Array] = field(default_factory=dict, init=False)
    _on_path: ScaledTime | None = field(default=None, init=False)

    def time_on_path(self) -> ScaledTime:
        """The motion with rounded corners."""
        if self._on_path is None:
            names = self.checker.model.chain.joint_names
            polyline = self.points, self._reaches(), names
            self._on_path = self.parametrization.time_polyline(*polyline)
        return self._on_path

    def smooth(self) -> ScaledTime:
        """The spline near the motion where it is as far from everything, else the motion itself."""
        names = self.checker.model.chain.joint_names
        wide = self._spline_at_widest(names)
        if wide is not None and not len(wide.close.times):
            self.left_path = True
            return wide.spline
        reaches = self._reaches(even=True)
        rounded = self.parametrization.near_corners(self.points, reaches)
        if rounded is not None:
            is_wide = wide is not None and np.array_equal(reaches, wide.reaches)
            nearest = list[ScaledTime]()
            is_spacious = any(level is self.checker for level in self.preferred)
            for rate in SPAN_RATES:
                known = wide if is_wide and rate == SPAN_RATES[0] else None
                spline = self._spline_near(rounded, rate, names, nearest, known)
                if spline is not None:
                    self.left_path = True
                    return spline
            for spline in nearest if is_spacious else ():
                motion = spline.trajectory
                looked = motion.breaks, motion.coefficients
                # How much more finely a spline is checked where it has nothing to spare.
                if not len(close_instants(self.checker, *looked, finely=4).times):
                    self.left_path = True
                    return spline
        return self._within_loads(names) or self.time_on_path()

    def _within_loads(self, names: tuple[str, ...]) -> ScaledTime | None:
        """The spline near the motion on the path where loads bind that, and it keeps as clear."""
        if self.parametrization.loads is None:
            return None
        motion = self.time_on_path().trajectory
        rounded = Pieces(motion.breaks, motion.coefficients)
        self._found_close.clear()
        for spline in self.parametrization.splines_within_loads(motion, names):
            if self._near_instants(spline.trajectory, rounded, None) is None:
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
        reaches = self._widest_reaches(even=True)
        rounded = self.parametrization.near_corners(self.points, reaches)
        if rounded is None:
            return None
        parts = even_parts(float(rounded.breaks[-1]), len(self.points) - 1, SPAN_RATES[0])
        spline = self.parametrization.spline_near(rounded, names, parts)
        if spline is None:
            return None
        motion = spline.trajectory
        looked = motion.breaks, motion.coefficients
        if self.holds is not None and not self.holds(
            states_between(*looked, _INSTANTS * motion.pieces)
        ):
            return None
        if len(self._outside_limits(motion)):
            return None
        return _Wide(reaches, spline, close_instants(self.preferred[0], *looked))

    def _spline_near(
        self,
        rounded: Pieces,
        rate: float,
        names: tuple[str, ...],
        nearest: list[ScaledTime],
        known: _Wide | None,
    ) -> ScaledTime | None:
        """The spline near a motion that keeps as clear, with more spans where that is needed.

        Args:
            rounded: The motion.
            rate: Spans for each second of it at first [1/s].
            names: Names of the joints.
            nearest: The splines that come too near are added.
            known: The first of the splines, if it was checked before.
        """
        duration = float(rounded.breaks[-1])
        parts = even_parts(duration, len(self.points) - 1, rate)
        # Spans of a spline that comes too near are halved so often.
        for _ in range(4):
            if known is not None:
                spline: ScaledTime | None = known.spline
            else:
                spline = self.parametrization.spline_near(rounded, names, parts)
            if spline is None:
                return None
            motion = spline.trajectory
            near = self._near_instants(motion, rounded, None if known is None else known.close)
            known = None
            if near is None:
                return spline
            nearest.append(spline)
            if not len(near):
                return None
            parts = finer_parts(parts, motion, near)
            # Spans for each second at most [1/s], but so many are few in any case.
            if len(parts) - 1 > max(16.0 * duration, 20):
                return None
        return None

    def _reaches(self, *, even: bool = False) -> Array:
        """Reaches of the corners that are proved free, found once for each way to pass them."""
        even = even or self.parametrization.even_corners
        if even not in self._found_reaches:
            self._found_reaches[even] = self._find_reaches(even)
        return self._found_reaches[even]

    def _widest_reaches(self, *, even: bool) -> Array:
        """Reaches of the corners that are worth being proved free."""
        if even not in self._found_widest:
            tolerance, parametrization = self.timing.blend_tolerance, self.parametrization
            largest = largest_reaches(self.points)
            if tolerance is not None:
                largest = reach_for_deviation(self.points, tolerance, parametrization.smooth)
            widest = parametrization.widest_reaches(self.points, largest, even=even)
            self._found_widest[even] = widest
        return self._found_widest[even]

    def _find_reaches(self, even: bool) -> Array:
        return certified_reaches(
            self.checker,
            self.points,
            self.deadline,
            smooth=self.parametrization.smooth,
            most=self._widest_reaches(even=even),
            preferred=[level for level in self.preferred if level is not self.checker],
        )

    def _near_instants(
        self, motion: Trajectory, rounded: Pieces, close: CloseInstants | None
    ) -> Array | None:
        """Instants at which a motion is nearer than preferred and the rounded one is not, (k,) [s].

        None where there are none; k = 0 where it is refused for something else. ``close`` are those
        at which it does not keep the first level, where they are known.
        """
        looked = motion.breaks, motion.coefficients, _INSTANTS * motion.pieces
        states = None if self.holds is None else states_between(*looked)
        if self.holds is not None and states is not None and not self.holds(states):
            return np.empty(0)
        outside = self._outside_limits(motion)
        if len(outside):
            return outside
        for number, level in enumerate(self.preferred):
            if number > 0 or close is None:
                # What keeps the level above keeps this one, if it asks for no more.
                is_lower = number > 0 and _asks_no_more(level, self.preferred[number - 1])
                within = close.spans if is_lower and close is not None else WHOLE
                close = close_instants(level, motion.breaks, motion.coefficients, within=within)
            if not len(close.times):
                return None
            shares = close.times / motion.duration
            apart = not_beside(shares, self._close_on_path(number, rounded, shares))
            if len(apart):
                return apart * motion.duration
        states = states_between(*looked) if states is None else states
        return None if self.checker.all_valid(states) else np.empty(0)

    def _outside_limits(self, motion: Trajectory) -> Array:
        """Instants at which a spline is outside the joints' limits that its path comes to, (k,)."""
        limits = self.checker.model.chain.limits
        low, high = limits.lower, limits.upper
        # Splines swing over by milliradians. So near to a limit of a joint [rad or m] they are held
        # to it before they are proved, at so many instants of a piece.
        at_limit, limit_instants = 0.02, 8
        if is_inside(self.points, low, high, at_limit):
            return np.empty(0)
        count = limit_instants * motion.pieces
        return outside_instants(motion.breaks, motion.coefficients, count, low, high)

    def _close_on_path(self, number: int, rounded: Pieces, shares: Array) -> Array:
        """Shares at which the rounded motion is nearer than a level: beside some, or all, once."""
        known, level = self._found_close, self.preferred[number]
        duration = float(rounded.breaks[-1])
        if number in known:
            return known[number]
        # Instants beside which a motion is checked for them alone.
        if len(shares) <= 16:
            within = duration * spans_beside(shares)
            return close_instants(level, *rounded, within=within).times / duration
        return known.setdefault(number, close_instants(level, *rounded).times / duration)


def _asks_no_more(level: Checker, other: Checker) -> bool:
    """Whether each state that keeps what a checker asks for keeps what a level does."""
    margin, own = level.model.margin + level.slack, level.model.own_margin + level.slack
    most, most_own = other.model.margin + other.slack, other.model.own_margin + other.slack
    return margin <= most and own <= most_own


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
    if ends == "natural":
        _refuse_moving_ends(_spline(points, times, ends, parametrization, timing, names))
    # How often the legs of a path are halved to bring a spline nearer to them.
    for _ in range(6):
        yield partial(_spline, points, times, ends, parametrization, timing, names)
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


def _spline(
    points: Array,
    times: Array | None,
    ends: Ends,
    parametrization: TimeParametrization,
    timing: TimingOptions,
    names: tuple[str, ...],
) -> ScaledTime:
    timed = parametrization.time_spline(points, times, ends, names, timing.scale_times)
    checked = times is not None and not timing.scale_times
    factor = parametrization.needed_factor(timed.trajectory) if checked else 1.0
    if factor > 1.0 + RATIO_TOLERANCE:
        raise TimingFailed(
            f"the times given are too short: limits are kept by times {factor:.9g} times as long",
            hint="Give longer times, or ask for scale_times.",
            factor=factor,
        )
    return timed


def _halve(rows: Array) -> Array:
    """Insert the middle of each two neighbours between them."""
    answer = np.empty((2 * len(rows) - 1, rows.shape[1]))
    answer[::2], answer[1::2] = rows, 0.5 * (rows[1:] + rows[:-1])
    return answer
