"""Spans of a motion in which it comes nearer to something than is preferred."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinematics.arrays import Array
from kinematics.trajectory.trajectory import Trajectory
from obstacles.collision.checker import Checker
from planning.values.preferences import PreferredClearance

#: Where states are looked at about the nearest instant of a span, as shares of the time to the next
#: instants; then about the nearest of these.
_BESIDE = (np.array([-2.0, -1.0, 1.0, 2.0]) / 3.0, np.array([-1.0, 1.0]) / 6.0)


@dataclass(frozen=True, slots=True)
class CloseSpan:
    """A span of a motion that is nearer to something than preferred.

    Args:
        begins: When it begins [s].
        ends: When it ends [s].
        distance: The least distance in it, margins of obstacles taken off [m]; where obstacles and
            own links are near, that which lacks most of what is preferred. In a long span it is
            looked for at some instants, and at all about the nearest of these.
        pair: The bodies that come so near.
    """

    begins: float
    ends: float
    distance: float
    pair: tuple[str, str]


@dataclass(frozen=True, slots=True)
class ClearanceReport:
    """Preferred distances, and the spans of a motion that do not keep them.

    Args:
        preferred: From obstacles [m].
        own_links: Between the robot's own links [m].
        least: The margin that the certificate proves [m].
        spans: In order, looked at every ``period``.
        period: Between two instants that were checked [s].
    """

    preferred: float
    own_links: float
    least: float
    spans: tuple[CloseSpan, ...]
    period: float

    @property
    def time_below(self) -> float:
        """Time in which the motion is nearer than preferred [s]."""
        return sum(span.ends - span.begins for span in self.spans)


def clearance_report(
    checkers: Sequence[Checker],
    motion: Trajectory,
    preferred: PreferredClearance,
    margin: float,
    known: tuple[float, float] = (0.0, 0.0),
) -> ClearanceReport:
    """Look at a motion instant by instant for distances below the preferred ones.

    Args:
        checkers: Of the robot in its scene; before it, if any, of the robot in its solids' hulls,
            which are as far away at most: the robot itself is only packed where they are close.
        motion: The motion, of one second at least looked at every 25 ms.
        preferred: The distances.
        margin: The margin that is proved [m]; nothing below it is preferred.
        known: Distances that were proved, of obstacles, their own margins counted, and between the
            robot's own links [m]: where these are preferred, no instant needs a look.
    """
    distance, own = max(preferred.obstacles, margin), preferred.own_links
    # Instants are 25 ms apart at most, and 32 at least; of a long motion 512, farther apart.
    count = min(int(np.ceil(max(motion.duration / 0.025, 32))), 512)
    scene = checkers[-1].model.scene
    most = max((obstacle.margin for obstacle in scene.obstacles), default=0.0)
    if known[0] - most > distance and known[1] > own:
        return ClearanceReport(distance, own, margin, (), motion.duration / count)
    # The values of linspace, in a quarter of its time.
    times: Array = np.arange(count + 1, dtype=np.float64) * (motion.duration / count)
    times[-1] = motion.duration
    spacious = _with_distances(checkers[0], distance, own)
    states = motion.sample(times)
    close = ~spacious.each_valid(states)
    for checker in checkers[1:]:
        if not close.any():
            break
        spacious = _with_distances(checker, distance, own)
        close[close] = ~spacious.each_valid(states[close])
    spans = tuple(
        _span(spacious, motion, times, states, (first, last), (distance, own))
        for first, last in _runs(close)
    )
    return ClearanceReport(distance, own, margin, spans, motion.duration / count)


def _with_distances(checker: Checker, distance: float, own: float) -> Checker:
    return Checker(checker.model.with_margins(distance, own))


def _runs(close: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and last index of each run of true values."""
    marks, runs, last = close.tobytes(), list[tuple[int, int]](), 0
    while (first := marks.find(1, last)) >= 0:
        last = marks.find(0, first)
        last = len(marks) if last < 0 else last
        runs.append((first, last - 1))
    return runs


def _span(
    spacious: Checker,
    motion: Trajectory,
    times: Array,
    states: Array,
    run: tuple[int, int],
    preferred: tuple[float, float],
) -> CloseSpan:
    """The span of a run of instants, from the first to the last, out to the next not close."""
    first, last = run
    within, offset = states[first : last + 1], first
    # Where links are near each other all along each look takes a millisecond: few, in two rounds.
    step = math.isqrt(len(within) // 2)
    if step > 1:
        at = max(spacious.closest(within[::step], 0.0)[1], 0) * step
        offset += max(at - step + 1, 0)
        within = within[max(at - step + 1, 0) : at + step]
    lacking, at, pair = spacious.closest(within, 0.0)
    # A fast arm comes some millimetres nearer between two instants.
    middle, reach = times[offset + at], times[1] - times[0]
    for shares in _BESIDE:
        looked = np.clip(middle + reach * shares, 0.0, times[-1])
        nearer, at, other = spacious.closest(motion.sample(looked), lacking)
        if at >= 0:
            lacking, pair, middle = nearer, other, looked[at]
    is_own = pair is None or pair[1] not in spacious.model.scene.ids
    distance = max(lacking + preferred[is_own], 0.0)
    begins, ends = times[max(first - 1, 0)], times[min(last + 1, len(times) - 1)]
    return CloseSpan(float(begins), float(ends), distance, pair or ("", ""))
