"""Polylines that stand for recorded or sampled paths: fewer waypoints, near all that are left out.

The line has the fewest corners; then these move to where the lines on both
sides are about as near. Waypoints are matched in their
order with places on the line, never back, and both polylines are straight between them: at the same
share of the way they are nowhere farther apart than at a waypoint. A curve that rounds a corner is
matched with its legs likewise. Its offset and the distance of the waypoints are convex between
them, so that their sum is largest at a waypoint too, and is kept within the tolerance there.

Without a tolerance only what rounding explains is left out: numbers that are written with so many
decimals are off by up to half a unit of the last one, and so is the line between two of them.

Fewest waypoints whose polyline follows another one within a tolerance, in kernels.

A leg between two waypoints stands for those between them where each has a place on it within the
tolerance and the places ascend: the two are straight between, and the distance of two points that
move evenly along straight lines is convex, so that it is largest at a waypoint. This decides
exactly whether the Frechet distance of leg and path is within the tolerance.

The way from the first to the last waypoint with the fewest legs is found by a search in breadth.
Long paths offer so many waypoints to it for each leg that the number of legs is linear in theirs.
"""

import math
from typing import NamedTuple

import numpy as np

from compiled.kernel import kernel
from kinematics.arrays import Array, Indices
from planning.timing.path.blend import corner_indices, largest_reaches, reach_for_deviation

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


class Polyline(NamedTuple):
    """Corners that stand for a path.

    Args:
        corners: Shape (k', n); one where the path keeps near its start and ends there [rad or m].
        numbers: The waypoints that they are, shape (k',).
        left_out: How many waypoints are left out; 0 where all are exactly on the line.
        reaches: Largest reach of each inner corner for ``blend``, shape (k' - 2,); 0 for a stop.
        deviation: Largest distance of a waypoint left out from the line [rad or m].
        rounding: Largest distance that was put down to the waypoints' last decimal; 0 where a
            tolerance decided [rad or m].
    """

    corners: Array
    numbers: Indices
    left_out: int
    reaches: Array
    deviation: float
    rounding: float


def simplified_polyline(
    points: Array, tolerance: float, smooth: bool, moving: bool = False, norm: float = 2.0
) -> Polyline:
    """The polyline with rounded corners that stands for a path.

    Args:
        points: Shape (k, n), at least two of them distinct.
        tolerance: Largest distance of the line with rounded corners from the path. Where it is 0,
            waypoints are left out that are off by no more than their last decimal tells, and
            corners rounded whose widest curve is not farther off.
        smooth: Whether cubics round corners, as in ``blend``, or parabolas.
        moving: Whether the motion has a velocity at an end, along the leg there: all legs stay.
        norm: 2 for Euclidean distances in joint space, inf for those of the joint that is farthest
            off.

    Raises:
        InvalidOption: The tolerance is negative or no number.
        InvalidTrajectory: As in ``merge``.
    """
    merged = corner_indices(points)
    rounding = 0.0 if tolerance else math.sqrt(points.shape[1]) * written_unit(points)
    rows = points[merged]
    # Share of the tolerance that waypoints left out may use: the rest is for corners beside them.
    within = 0.0 if moving else max(0.9 * tolerance, rounding)
    kept, beside = _kept(rows, within, norm)
    # Loops within the tolerance may leave a corner twice.
    kept = kept[corner_indices(rows[kept])]
    corners = rows[kept]
    reaches = reach_for_deviation(corners, tolerance or rounding, smooth, norm)
    if tolerance and len(kept) > 2:
        narrow_kernel(tolerance, 3 if smooth else 2, kept, beside, _turns(corners, norm), reaches)
    else:
        reaches[reaches < largest_reaches(corners)] = 0.0
    left_out = len(points) - len(kept) if len(kept) < len(rows) else 0
    return Polyline(corners, merged[kept], left_out, reaches, float(beside[0].max()), rounding)


def fewest_waypoints(points: Array, within: float, norm: float = np.inf) -> tuple[Indices, float]:
    """Indices of the fewest waypoints (k, n) whose legs follow the path within a tolerance.

    Args:
        points: Shape (k, n), finite [rad or m].
        within: Largest distance from the path, at every place.
        norm: inf for the distance of the joint that is farthest off, 2 for the Euclidean one.

    Returns:
        The indices, the first and last included, and the largest distance.
    """
    kept, beside = _kept(points, within, norm)
    return kept, float(beside[0].max())


def _kept(points: Array, within: float, norm: float) -> tuple[Indices, Array]:
    """The waypoints that stay, with what ``simplify_kernel`` writes beside them."""
    kept, beside = np.zeros(len(points), dtype=np.int64), np.zeros((3, len(points)))
    if len(points) < 2:
        return kept, beside
    count = simplify_kernel(np.ascontiguousarray(points), within, norm, kept, beside)
    return kept[:count], beside


def written_unit(points: Array) -> float:
    """The unit of the last decimal that waypoints (k, n) are rounded to [rad or m].

    It is 0 where they are not: with few decimals, with many, or with decimals that are coarse for
    the way that they describe.
    """
    # Numbers with at most so many decimals are meant as they stand, with more than the other they
    # are not rounded [-].
    few_decimals, many_decimals = 2, 12
    for decimals in range(few_decimals, many_decimals + 1):
        if np.array_equal(np.round(points, decimals), points):
            unit = 10.0**-decimals
            # Part of the way of the joint that goes farthest that a unit of the last decimal is at
            # most: where hardly more than one digit changes, numbers tell steps and not a rounded
            # path [-].
            is_fine = unit <= 0.005 * float(np.ptp(points, axis=0).max())
            return unit if decimals > few_decimals and is_fine else 0.0
    return 0.0


def _turns(corners: Array, norm: float) -> Array:
    """|u_out - u_in| at inner corners, shape (k - 2,)."""
    legs = np.diff(corners, axis=0)
    directions = legs / np.linalg.norm(legs, axis=1)[:, None]
    return np.asarray(np.linalg.norm(np.diff(directions, axis=0), ord=norm, axis=1))


@kernel
def simplify_kernel(points: Array, within: float, norm: float, kept: Indices, beside: Array) -> int:
    """Write the numbers of the waypoints that stay; how many.

    Args:
        points: Shape (k, n), k >= 2.
        within: Largest distance of a waypoint left out.
        norm: 2 for Euclidean distances, inf for those of the joint that is farthest off.
        kept: Shape (k,).
        beside: Table of each waypoint, zeros come in: its distance from the line, and the lengths
            from the place that it is matched with back to the leg's beginning and on to its end,
            shape (3, k).
    """
    count = fewest_kernel(points, within, norm, kept)
    # Rounds in which corners move: more change durations by less than a hundredth.
    for _ in range(4):
        for i in range(1, count - 1):
            kept[i] = _even_corner_kernel(points, kept[i - 1 : i + 2], within, norm, beside)
    for i in range(count - 1):
        leg_kernel(points, (kept[i], kept[i + 1]), within, norm, beside)
    for i in range(count):
        beside[:, kept[i]] = 0.0
    return count


@kernel(allocates=False)
def _even_corner_kernel(
    points: Array, corners: Indices, within: float, norm: float, beside: Array
) -> int:
    """The waypoint at which the legs on both sides of a corner are about as near, if that helps.

    Args:
        points: Shape (k, n).
        corners: The one before, the corner, and the one after, shape (3,).
        within: Spans same as in ``simplify_kernel``.
        norm: Same as in ``simplify_kernel``.
        beside: Scratch, shape (3, k).
    """
    before, here, after = corners
    low, high = before + 1, after - 1
    while low < high:
        middle = (low + high) // 2
        left = leg_kernel(points, (before, middle), within, norm, beside)
        if left < leg_kernel(points, (middle, after), within, norm, beside):
            low = middle + 1
        else:
            high = middle
    now = leg_kernel(points, (before, here), within, norm, beside)
    now = max(now, leg_kernel(points, (here, after), within, norm, beside))
    then = leg_kernel(points, (before, low), within, norm, beside)
    then = max(then, leg_kernel(points, (low, after), within, norm, beside))
    return int(low if then < now else here)


@kernel(allocates=False)
def leg_kernel(
    points: Array, ends: tuple[int, int], within: float, norm: float, beside: Array
) -> float:
    """The largest distance of waypoints from the leg between two others; inf where it is too large.

    Args:
        points: Shape (k, n).
        ends: Waypoints at which the leg begins and ends.
        within: Spans same as in ``simplify_kernel``.
        norm: Same as in ``simplify_kernel``.
        beside: Filled for the waypoints between, as in ``simplify_kernel``.
    """
    # Places nearest to the waypoints, in their order; else the first ones that are near.
    most = _match_kernel(points, ends, (within, norm), False, beside)
    if most > within:
        most = _match_kernel(points, ends, (within, norm), True, beside)
    return most


@kernel(allocates=False)
def _match_kernel(
    points: Array,
    ends: tuple[int, int],
    near: tuple[float, float],
    is_early: bool,
    beside: Array,
) -> float:
    """Match waypoints with places on a leg; their largest distance, inf where it is too large."""
    (first, last), (within, norm) = ends, near
    square, most, share = 0.0, 0.0, 0.0
    for joint in range(points.shape[1]):
        square += (points[last, joint] - points[first, joint]) ** 2
    length = math.sqrt(square)
    for at in range(first + 1, last):
        low, high = near_places_kernel(points, (first, last, at), within, norm)
        if low > high or share > high:
            return np.inf
        if not is_early:
            low = min(max(low, share_of_leg_kernel(points, first, last, at)), high)
        share = max(share, low)
        away = distance_from_leg_kernel(points, (first, last, at), share, norm)
        # At the edge of what is near a place is as near as that, but for rounding.
        away = min(away, within)
        most = max(most, away)
        beside[0, at], beside[1, at], beside[2, at] = away, share * length, (1.0 - share) * length
    return most


@kernel
def narrow_kernel(
    tolerance: float, order: int, kept: Indices, beside: Array, turns: Array, reaches: Array
) -> None:
    """Lower reaches until curve and waypoints left out are within the tolerance together.

    At the length w from its corner the curve of reach r is |u_out - u_in| (r - w)^p / (2 p r^(p-1))
    off its leg, with p = 2 for a parabola and 3 for cubics.

    Args:
        tolerance: Tolerance of their sum.
        order: The p.
        kept: Numbers of the waypoints that are corners, shape (k',).
        beside: Table as ``simplify_kernel`` leaves it, shape (3, k).
        turns: |u_out - u_in|, shape (k' - 2,).
        reaches: Shape (k' - 2,).
    """
    for corner in range(1, kept.shape[0] - 1):
        reach, half = reaches[corner - 1], turns[corner - 1] / (2.0 * order)
        for i in range(kept[corner - 1] + 1, kept[corner + 1]):
            away = beside[2, i] if i < kept[corner] else beside[1, i]
            spare = tolerance - beside[0, i]
            low, high = away, reach
            if high <= low or half * (high - away) ** order <= spare * high ** (order - 1):
                continue
            # Halvings of what is not known of a reach.
            for _ in range(30):
                middle = 0.5 * (low + high)
                if half * (middle - away) ** order <= spare * middle ** (order - 1):
                    low = middle
                else:
                    high = middle
            reach = low
        reaches[corner - 1] = reach
