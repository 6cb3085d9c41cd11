"""Fewest waypoints whose polyline follows another one within a tolerance, in kernels.

A leg between two waypoints stands for those between them where each has a place on it within the
tolerance and the places ascend: the two are straight between, and the distance of two points that
move evenly along straight lines is convex, so that it is largest at a waypoint. This decides
exactly whether the Frechet distance of leg and path is within the tolerance.

The way from the first to the last waypoint with the fewest legs is found by a search in breadth.
Long paths offer so many waypoints to it for each leg that the number of legs is linear in theirs.
"""

import math

import numpy as np

from compiled.kernel import kernel
from kinematics.arrays import Array, Indices

# Waypoints up to which each is a possible end of each leg: the number found is the fewest.
_EXACT = 500
# Possible ends of a leg in longer paths, spread over the leg that goes as far as it can.
_ENDS = 24
# Possible ends in a row that are tried from each: beyond more than twice the longest leg.
_WINDOW = 64


@kernel(allocates=False)
def distance_from_leg_kernel(
    points: Array, numbers: tuple[int, int, int], share: float, norm: float
) -> float:
    """The distance of a waypoint from a place on a leg.

    Args:
        points: Shape (k, n).
        numbers: Waypoints at which the leg begins and ends, and the third.
        share: The place, 0 at the leg's beginning and 1 at its end.
        norm: 2 for the Euclidean distance, inf for that of the joint that is farthest off.
    """
    first, last, at = numbers
    square, most = 0.0, 0.0
    for joint in range(points.shape[1]):
        step = points[last, joint] - points[first, joint]
        off = points[at, joint] - points[first, joint] - share * step
        square += off * off
        most = max(most, abs(off))
    return most if norm == np.inf else math.sqrt(square)


@kernel(allocates=False)
def share_of_leg_kernel(points: Array, first: int, last: int, at: int) -> float:
    """The place on the line of a leg that is nearest to a waypoint; 0 on a leg without length."""
    square, along = 0.0, 0.0
    for joint in range(points.shape[1]):
        step = points[last, joint] - points[first, joint]
        square += step * step
        along += (points[at, joint] - points[first, joint]) * step
    return along / square if square > 0.0 else 0.0


@kernel(allocates=False)
def near_places_kernel(
    points: Array, numbers: tuple[int, int, int], within: float, norm: float
) -> tuple[float, float]:
    """The first and the last place on a leg within a distance of a waypoint; 1 and 0 for none.

    Args:
        points: Shape (k, n).
        numbers: Same as in ``distance_from_leg_kernel``.
        within: The distance.
        norm: Same as in ``distance_from_leg_kernel``.
    """
    first, last, at = numbers
    low, high, square = 0.0, 1.0, 0.0
    for joint in range(points.shape[1]):
        step = points[last, joint] - points[first, joint]
        square += step * step
        if norm == np.inf:
            off = points[at, joint] - points[first, joint]
            if step != 0.0:
                middle, half = off / step, within / abs(step)
                low, high = max(low, middle - half), min(high, middle + half)
            elif abs(off) > within:
                return 1.0, 0.0
    if norm == np.inf:
        return low, high
    nearest = share_of_leg_kernel(points, first, last, at)
    off = distance_from_leg_kernel(points, numbers, nearest, norm)
    if off > within:
        return 1.0, 0.0
    if square > 0.0:
        half = math.sqrt((within - off) * (within + off) / square)
        low, high = max(0.0, nearest - half), min(1.0, nearest + half)
    return low, high


@kernel(allocates=False)
def leg_stands_kernel(points: Array, first: int, last: int, within: float, norm: float) -> bool:
    """Whether a leg stands for the waypoints between its ends.

    Args:
        points: Shape (k, n).
        first: Waypoint at which the leg begins.
        last: Waypoint at which it ends.
        within: The tolerance.
        norm: Same as in ``distance_from_leg_kernel``.
    """
    if last - first > 8:
        # Legs that are too long mostly fail here, far from their ends.
        for part in range(1, 4):
            at = first + (last - first) * part // 4
            low, high = near_places_kernel(points, (first, last, at), within, norm)
            if low > high:
                return False
    place = 0.0
    for at in range(first + 1, last):
        low, high = near_places_kernel(points, (first, last, at), within, norm)
        place = max(place, low)
        if place > high:
            return False
    return True


@kernel(allocates=False)
def _farthest_end_kernel(points: Array, first: int, within: float, norm: float) -> int:
    """About the last waypoint that a leg can end at: steps twice as long, then half as long."""
    last, low, step = points.shape[0] - 1, first + 1, 2
    while low < last:
        far = min(first + step, last)
        if not leg_stands_kernel(points, first, far, within, norm):
            break
        low, step = far, 2 * step
    high = min(first + step, last)
    while low < high - 1:
        middle = (low + high) // 2
        if leg_stands_kernel(points, first, middle, within, norm):
            low = middle
        else:
            high = middle
    return low


@kernel
def _possible_ends_kernel(points: Array, within: float, norm: float) -> Indices:
    """The waypoints that legs may begin and end at, ascending."""
    k = points.shape[0]
    if k <= _EXACT:
        return np.arange(k)
    is_end, at = np.zeros(k, dtype=np.bool_), 0
    is_end[0] = True
    while at < k - 1:
        far = _farthest_end_kernel(points, at, within, norm)
        for part in range(1, _ENDS + 1):
            is_end[at + (far - at) * part // _ENDS] = True
        at = far
    return np.flatnonzero(is_end)


@kernel
def fewest_kernel(points: Array, within: float, norm: float, kept: Indices) -> int:
    """Write the numbers of the waypoints that stay, the first and the last included; how many.

    Args:
        points: Shape (k, n), k >= 2.
        within: Largest distance of the waypoints left out from the polyline through the others.
        norm: Same as in ``distance_from_leg_kernel``.
        kept: Shape (k,).
    """
    ends = _possible_ends_kernel(points, within, norm)
    goal = ends.shape[0] - 1
    window = goal if points.shape[0] <= _EXACT else _WINDOW
    legs, before = np.full(goal + 1, -1), np.zeros(goal + 1, dtype=np.int64)
    legs[0], low, high, count = 0, 0, 0, 0
    while legs[goal] < 0:
        next_low, next_high = goal, high
        for source in range(high, low - 1, -1):
            if legs[source] != count:
                continue
            for end in range(min(source + window, goal), source, -1):
                if legs[end] >= 0:
                    continue
                if leg_stands_kernel(points, ends[source], ends[end], within, norm):
                    legs[end], before[end] = count + 1, source
                    next_low, next_high = min(next_low, end), max(next_high, end)
            if legs[goal] >= 0:
                break
        low, high, count = next_low, next_high, count + 1
    at = goal
    for number in range(count, -1, -1):
        kept[number] = ends[at]
        at = before[at]
    return count + 1
