"""Distance of a motion from straight lines through waypoints, bounded for every instant.

Motion and lines are run through together, in the same order and never back: the Frechet distance,
joint by joint. The motion is cut into parts so short that each is within a small share of the
tolerance of its chord, by the largest second derivative that its coefficients allow. Two straight
lines that are run through evenly are nowhere farther apart than at their ends; so it is decided
exactly whether chords and lines are within what is left of the tolerance, by the places that can be
reached on the edges of each pair of them ("Computing the Frechet distance between two polygonal
curves", 1995). Timing measures such distances by ``planning.timing``, and a fault there must not be
believed here.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from compiled.kernel import kernel
from kinematics.arrays import Array, numbers
from kinematics.errors import InvalidOption, InvalidTrajectory
from kinematics.trajectory.trajectory import Trajectory
from planning.proof.limits.limit_uses import Violation

#: Least share of the tolerance by which a part of the motion may be off its chord.
CHORD_SHARE = 1.0 / 512.0
# Shares that are tried in turn.
_SHARES = (1.0 / 32.0, CHORD_SHARE)
# Parts of a motion, and pairs of a part and a line, that are looked at.
_MOST_PARTS, _MOST_PAIRS = 1_000_000, 30_000_000
# Halvings of what is not known of the distance.
_HALVINGS = 5


@dataclass(frozen=True, slots=True)
class PathNearness:
    """How near a motion is to straight lines through waypoints.

    Args:
        tolerance: The distance asked for, in every joint [rad or m].
        deviation: Bound of the distance of any joint at every instant, about sharp; None where it
            is not proved to be within the tolerance.
    """

    tolerance: float
    deviation: float | None


def path_nearness(
    motion: Trajectory, waypoints: ArrayLike, tolerance: float
) -> tuple[PathNearness, Violation | None]:
    """The nearness of a motion to a path, and where it leaves that.

    Args:
        motion: The motion.
        waypoints: Those of the path, shape (k, n), k >= 1 [rad or m].
        tolerance: Largest distance of any joint from the straight lines through them, at every
            instant, both being run through in the same order [rad or m].

    Raises:
        InvalidTrajectory: The waypoints are not finite or not of the joints of the motion.
        InvalidOption: The tolerance is not positive.
    """
    points = numbers(waypoints, "waypoints")
    if points.ndim != 2 or points.shape[1] != motion.n:
        raise InvalidTrajectory(
            f"a path of shape {points.shape} is none of {motion.n} joint(s)",
            hint=f"Give one value for each of {', '.join(motion.joint_names)} in every row.",
        )
    if not 0.0 < tolerance < np.inf:
        raise InvalidOption(f"path.tolerance is {tolerance}", hint="Give a positive number.")
    line = np.ascontiguousarray(points if len(points) > 1 else np.repeat(points, 2, axis=0))
    deviation, wrong = _bound(motion, line, tolerance)
    return PathNearness(tolerance, deviation), wrong


def _bound(
    motion: Trajectory, line: Array, tolerance: float
) -> tuple[float | None, Violation | None]:
    """The bound of the distance, or where the motion leaves the path."""
    details = {"tolerance": tolerance}
    for share in _SHARES:
        chord = share * tolerance
        parts = chord_counts(motion, chord)
        if not parts.sum() <= _MOST_PARTS:
            message = f"the motion was not compared with the path: {tolerance:g} is too fine for it"
            return None, Violation("unproved", 0.0, message, details)
        times = times_of_parts(motion, parts)
        chords = motion.sample(times)
        near = near_parts_kernel(chords, line, tolerance - chord)
        if near < 0:
            message = "the motion was not compared with the path: too much of it is near at a time"
            return None, Violation("unproved", 0.0, message, details)
        if near == len(chords) - 1:
            return _sharp_bound(chords, line, tolerance - chord) + chord, None
    time = float(times[near])
    message = f"the motion is farther than {tolerance:g} from the path, from {time:.4f} s on"
    return None, Violation("path_deviation", time, message, details)


def chord_counts(motion: Trajectory, within: float) -> Array:
    """Numbers of equal parts of each piece whose chords are within a distance of it, (m,)."""
    lengths, orders = np.diff(motion.breaks), np.arange(2, motion.degree + 1)
    powers = lengths[:, None] ** (orders - 2) * orders * (orders - 1)
    bend = np.einsum("mnk,mk->mn", np.abs(motion.coefficients[:, :, 2:]), powers).max(axis=1)
    return np.asarray(np.maximum(np.ceil(lengths * np.sqrt(bend / (8.0 * within))), 1.0))


def times_of_parts(motion: Trajectory, parts: Array) -> Array:
    """Times at which the parts of a motion begin, and its end, shape (sum of parts + 1,) [s]."""
    counts = parts.astype(np.int64)
    places = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    lengths = np.repeat(np.diff(motion.breaks) / counts, counts)
    starts = np.repeat(motion.breaks[:-1], counts)
    return np.append(starts + places * lengths, motion.breaks[-1])


def _sharp_bound(chords: Array, line: Array, within: float) -> float:
    """About the least distance, up to one that two polylines are known to be within."""
    low, high = 0.0, within
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        is_near = near_parts_kernel(chords, line, middle) == len(chords) - 1
        low, high = (low, middle) if is_near else (middle, high)
    return high


@kernel
def near_parts_kernel(chords: Array, line: Array, within: float) -> int:
    """Number of chords, from the first on, that can be near a line; all where both are near.

    -1 where too many pairs would have to be looked at.

    Args:
        chords: Corners of the one polyline, shape (m + 1, n).
        line: Corners of the other one, shape (k + 1, n).
        within: Largest distance of any joint.
    """
    last: int = chords.shape[0] - 1
    rows = line.shape[0] - 1
    # Places on each line that can be reached together with the corner that chord i begins at.
    left = np.ones((rows, 2))
    left[:, 1] = 0.0
    lowest, highest, pairs = 0, -1, 0
    for j in range(rows):
        low, high = near_places_kernel(chords[0], line[j], line[j + 1], within)
        if low > 0.0 or low > high:
            break
        left[j, 0], left[j, 1], highest = low, high, j
        if high < 1.0:
            break
    if highest < 0:
        return 0
    at_start = True
    for i in range(last):
        # Places on the chord that can be reached together with the corner that line j begins at.
        low, high = 1.0, 0.0
        if at_start:
            low, high = near_places_kernel(line[0], chords[i], chords[i + 1], within)
            at_start = low == 0.0 and high == 1.0
            low, high = (low, high) if low == 0.0 else (1.0, 0.0)
        first, final = rows, -1
        for j in range(lowest, rows):
            is_left, is_below = left[j, 0] <= left[j, 1], low <= high
            if not is_left and not is_below:
                if j > highest:
                    break
                continue
            pairs += 1
            right, top = near_places_kernel(chords[i + 1], line[j], line[j + 1], within)
            if not is_below:
                right = max(right, left[j, 0])
            begin, end = near_places_kernel(line[j + 1], chords[i], chords[i + 1], within)
            if not is_left:
                begin = max(begin, low)
            left[j, 0], left[j, 1], low, high = right, top, begin, end
            if right <= top:
                first, final = min(first, j), j
        if final < 0 and not at_start:
            return i
        if pairs > _MOST_PAIRS:
            return -1
        lowest, highest = 0 if at_start else first, final
    return last if left[rows - 1, 0] <= left[rows - 1, 1] == 1.0 else last - 1


@kernel(allocates=False)
def near_places_kernel(point: Array, a: Array, b: Array, within: float) -> tuple[float, float]:
    """The first and the last place from a to b within a distance of a point; 1 and 0 for none."""
    low, high = 0.0, 1.0
    for j in range(point.shape[0]):
        step, off = b[j] - a[j], point[j] - a[j]
        if step == 0.0:
            if abs(off) > within:
                return 1.0, 0.0
            continue
        middle, half = off / step, within / abs(step)
        low, high = max(low, middle - half), min(high, middle + half)
    return (low, high) if low <= high else (1.0, 0.0)
