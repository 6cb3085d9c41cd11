"""Waypoints that stay of a polyline, and the largest reaches of its corners, in kernels."""

import math

import numpy as np

from compiled.kernel import kernel
from kinematics.arrays import Array, Indices
from planning.timing.path.path import SAME_DIRECTION


@kernel
def kept_waypoints_kernel(points: Array, kept: Indices) -> int:
    """Write the indices of the waypoints (k, n) that stay into ``kept`` (k,); their number.

    A direction is compared with that of the whole leg since the last waypoint that stayed, so a
    slow bend of many small turns is not taken for a straight line.
    """
    k, n = points.shape
    scale = 1.0
    for i in range(k):
        for joint in range(n):
            scale = max(scale, abs(points[i, joint]))
    distinct = 1
    kept[0] = 0
    for i in range(1, k):
        # Waypoints nearer than this, relative to the largest coordinate (at least 1), are the same
        # one: what rounding leaves of a direction there is no direction.
        if distance(points[i], points[kept[distinct - 1]]) > 1e-12 * scale:
            kept[distinct] = i
            distinct += 1
    if distinct == 1:
        return 1
    # The very last waypoint stands for those it repeats: the goal is met exactly.
    kept[distinct - 1] = k - 1
    used = 1
    for at in range(1, distinct - 1):
        last, here, after = kept[used - 1], kept[at], kept[at + 1]
        before = distance(points[here], points[last])
        ahead = distance(points[after], points[here])
        square = 0.0
        for joint in range(n):
            turn = (points[after, joint] - points[here, joint]) / ahead
            turn -= (points[here, joint] - points[last, joint]) / before
            square += turn * turn
        if math.sqrt(square) > SAME_DIRECTION:
            kept[used] = here
            used += 1
    kept[used] = k - 1
    return used + 1


@kernel
def merge_kernel(points: Array) -> Array:
    """The waypoints (k, n) that stay, shape (k', n); none where a number is not finite."""
    k, n = points.shape
    if not _are_finite(points):
        return np.empty((0, n))
    kept = np.empty(k, dtype=np.int64)
    count = kept_waypoints_kernel(points, kept)
    merged = np.empty((count, n))
    for i in range(count):
        for joint in range(n):
            merged[i, joint] = points[kept[i], joint]
    return merged


@kernel
def find_largest_kernel(points: Array) -> Array:
    """``largest_reaches`` of waypoints (k, n); none where a number is not finite."""
    k = points.shape[0]
    if k < 3 or not _are_finite(points):
        return np.zeros(0)
    kept, reaches = np.empty(k, dtype=np.int64), np.zeros(k - 2)
    largest_reaches_kernel(points, kept[: kept_waypoints_kernel(points, kept)], reaches)
    return reaches


@kernel(allocates=False)
def _are_finite(points: Array) -> bool:
    finite = True
    for number in points.reshape(points.size):
        finite &= bool(abs(number) < np.inf)
    return finite


@kernel
def largest_reaches_kernel(points: Array, kept: Indices, reaches: Array) -> None:
    """Write the ``largest_reaches`` of waypoints of which some are ``kept``; zeros come in."""
    n = points.shape[1]
    for at in range(1, kept.shape[0] - 1):
        last, here, after = kept[at - 1], kept[at], kept[at + 1]
        before = distance(points[here], points[last])
        ahead = distance(points[after], points[here])
        square = 0.0
        for joint in range(n):
            total = (points[after, joint] - points[here, joint]) / ahead
            total += (points[here, joint] - points[last, joint]) / before
            square += total * total
        # Within this of a full reversal, |u_in + u_out|, the parabola would turn round before it
        # gets to the corner: the motion stops at the corner instead.
        if math.sqrt(square) >= 1e-3:
            reaches[here - 1] = 0.5 * min(before, ahead)


@kernel
def distance(a: Array, b: Array) -> float:
    """Euclidean distance of two configurations (n,)."""
    square = 0.0
    for joint in range(a.shape[0]):
        square += (a[joint] - b[joint]) ** 2
    return math.sqrt(square)
