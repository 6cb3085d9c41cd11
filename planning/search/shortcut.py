"""Shortening a path by straight cuts, each of them proved free before it is taken.

Waypoints are left out as far as can be. Then, round by round, every corner that is left is cut off:
whole, or else by a line between the middles of its legs, their quarters, their eighths, and the new
corners in the next round. What failed at a corner is not tried again before a neighbour of it has
moved. In the end waypoints are left out once more. Which cut is tried next depends on what the last
ones gained, so few edge checks are spent where there is nothing to gain, and nothing is random. All
of a round is one kernel: a cut is an edge check and little else. Random cuts along the path, the
usual way, need several times as many checks for paths of the same length.
"""

import math
from typing import NamedTuple

import numpy as np

from kinematics.arrays import Array, Indices
from kinematics.chain import MAX_JOINTS
from kinematics.compiled.kernel import kernel
from kinematics.compiled.simd import on_stack
from obstacles.checker import Checker
from obstacles.collision_model import ModelArrays
from obstacles.edge_check import FREE
from obstacles.kernel_work import Workspace, workspace
from obstacles.line_check import certify_line
from obstacles.state_check import blocked_at
from planning.deadline import Deadline

#: Rounds after which a path counts as short.
_ROUNDS = 6
#: Edge checks, in all rounds together, after which it does.
_MAX_CHECKS = 250
#: Intervals of a check beyond which it counts as another one.
_INTERVALS_A_CHECK = 40
#: States between the ends of a cut that are looked at before it is proved.
_LOOKS = 8
#: A cut that needs more intervals is not worth its proof.
_MAX_INTERVALS = 800
#: A round that gains less than this share of the length was the last.
_LEAST_ROUND = 0.01
#: Cuts tried at a corner: the whole of it, a half, a quarter, an eighth of its legs.
_CUTS = 4
#: A corner that is worth less than this share of the length is left as it is.
_LEAST_GAIN = 5e-4


class _Corners(NamedTuple):
    """A path whose corners are being cut, as ``round_kernel`` has it.

    Args:
        points: The waypoints, shape (c, n).
        tried: Cuts at each waypoint that are known to fail, shape (c,).
        checks: Edge checks that were made, shape (1,).
    """

    points: Array
    tried: Indices
    checks: Indices


def shortcut(checker: Checker, waypoints: Array, deadline: Deadline) -> Array:
    """Shorten a polyline whose legs are proved free; what comes back is too.

    The budget is counted in edge checks, so that the same path is shortened in the same way.

    Args:
        checker: Proves the cuts.
        waypoints: The polyline, shape (k, n) [rad or m].
        deadline: When to stop trying.
    """
    # A check brings one corner more at most.
    capacity = len(waypoints) + _MAX_CHECKS
    points, tried = np.empty((capacity, waypoints.shape[1])), np.zeros(capacity, dtype=np.int64)
    points[: len(waypoints)] = waypoints
    model, slack, checks = checker.model.arrays, checker.slack, np.zeros(1, dtype=np.int64)
    count = skip_kernel(model, slack, points, len(waypoints), checks)
    before = np.inf
    for _ in range(_ROUNDS):
        length = length_kernel(points, count)
        if deadline.passed or count < 3 or before - length < _LEAST_ROUND * before:
            break
        before = length
        count = round_kernel(model, slack, points, tried, count, _LEAST_GAIN * length, checks)
    return np.array(points[: thin_kernel(model, slack, points, tried, count, checks)])


@kernel(allocates=False)
def is_free(
    model: ModelArrays, work: Workspace, a: Array, b: Array, slack: float, checks: Indices
) -> bool:
    """Whether the straight motion from a to b, both (n,), is proved free."""
    asked, outcome = on_stack(1).view(np.int64), on_stack(4)
    if blocked_at(model, work, a, b, slack, 2, _LOOKS, asked) >= 0.0:
        checks[0] += 1
        return False
    verdict = certify_line(model, work, a, b, slack, _MAX_INTERVALS, outcome)
    # A motion that grazes takes thousands of intervals: it counts as many checks.
    checks[0] += 1 + int(outcome[2]) // _INTERVALS_A_CHECK
    return bool(verdict == FREE)


@kernel
def skip_kernel(
    model: ModelArrays, slack: float, points: Array, count: int, checks: Indices
) -> int:
    """From each of ``count`` waypoints go straight to the farthest that a bisection finds in sight.

    The waypoints that stay are moved to the front of ``points``; returns their number.
    """
    return _skip(model, workspace(model), slack, points, count, checks)


@kernel(allocates=False)
def _skip(
    model: ModelArrays, work: Workspace, slack: float, points: Array, count: int, checks: Indices
) -> int:
    """``skip_kernel`` in a workspace."""
    at, size = 0, 1
    while at < count - 1:
        low, high = at + 1, count - 1
        while low < high and checks[0] < _MAX_CHECKS:
            # Waypoints before ``size`` are final; ``at`` itself may have been overwritten.
            if is_free(model, work, points[size - 1], points[high], slack, checks):
                low = high
            else:
                high = (low + high) // 2
        _copy(points, low, size)
        at, size = low, size + 1
    return size


@kernel
def thin_kernel(
    model: ModelArrays,
    slack: float,
    points: Array,
    tried: Indices,
    count: int,
    checks: Indices,
) -> int:
    """From each of ``count`` waypoints go straight past as many others as can be left out.

    Corners whose whole cut is known to fail, as ``tried`` of ``round_kernel`` tells, are not tried
    again. The waypoints that stay are moved to the front of ``points``; returns their number.
    """
    return _thin(model, workspace(model), _Corners(points, tried, checks), slack, count)


@kernel(allocates=False)
def _thin(model: ModelArrays, work: Workspace, corners: _Corners, slack: float, count: int) -> int:
    """``thin_kernel`` in a workspace."""
    points, tried, checks = corners.points, corners.tried, corners.checks
    at, size = 0, 1
    while at < count - 1:
        at += 1
        # The waypoint before it is still the one that it was tried with.
        known = tried[at] > 0
        while at < count - 1 and not known and checks[0] < _MAX_CHECKS:
            if not is_free(model, work, points[size - 1], points[at + 1], slack, checks):
                break
            at += 1
        _copy(points, at, size)
        size += 1
    return size


@kernel
def round_kernel(
    model: ModelArrays,
    slack: float,
    points: Array,
    tried: Indices,
    count: int,
    worth: float,
    checks: Indices,
) -> int:
    """Cut off every corner of a path as far as is proved free; the number of waypoints then.

    Args:
        model: The packed robot and scene.
        slack: Distance to keep beyond the margins [m].
        points: The waypoints, with capacity for one more a check, shape (c, n).
        tried: Cuts at each waypoint that are known to fail, from the widest on, shape (c,).
        count: Number of waypoints.
        worth: A corner that is worth less is left as it is, in the unit of the path's length.
        checks: Edge checks that were made, shape (1,).
    """
    return _round(model, workspace(model), _Corners(points, tried, checks), slack, count, worth)


@kernel(allocates=False)
def _round(
    model: ModelArrays, work: Workspace, corners: _Corners, slack: float, count: int, worth: float
) -> int:
    """``round_kernel`` in a workspace."""
    points, tried, checks = corners.points, corners.tried, corners.checks
    n = points.shape[1]
    a, b = on_stack(MAX_JOINTS)[:n], on_stack(MAX_JOINTS)[:n]
    k = 1
    while k < count - 1:
        before, after = _distance(points[k - 1], points[k]), _distance(points[k], points[k + 1])
        if before + after - _distance(points[k - 1], points[k + 1]) < worth:
            k += 1
            continue
        while tried[k] < _CUTS:
            if checks[0] >= _MAX_CHECKS:
                return count
            share = 0.5 ** tried[k]
            for j in range(n):
                a[j] = points[k, j] + share * (points[k - 1, j] - points[k, j])
                b[j] = points[k, j] + share * (points[k + 1, j] - points[k, j])
            if tried[k] == 0:
                # To the last bit: these two stay waypoints.
                for j in range(n):
                    a[j], b[j] = points[k - 1, j], points[k + 1, j]
            if is_free(model, work, a, b, slack, checks):
                break
            tried[k] += 1
        if tried[k] == _CUTS:
            k += 1
            continue
        tried[k - 1] = tried[k + 1] = 0
        if tried[k] == 0:
            # Both ends of the cut are waypoints already.
            for i in range(k, count - 1):
                _copy(points, i + 1, i)
                tried[i] = tried[i + 1]
            count -= 1
            continue
        for i in range(count, k + 1, -1):
            _copy(points, i - 1, i)
            tried[i] = tried[i - 1]
        for j in range(n):
            points[k, j], points[k + 1, j] = a[j], b[j]
        tried[k] = tried[k + 1] = 0
        count += 1
        k += 2
    return count


@kernel(allocates=False)
def _copy(points: Array, source: int, place: int) -> None:
    """Copy one row of points (c, n) over another."""
    for j in range(points.shape[1]):
        points[place, j] = points[source, j]


@kernel
def length_kernel(points: Array, count: int) -> float:
    """Length of the path through the first ``count`` points."""
    length = 0.0
    for k in range(count - 1):
        length += _distance(points[k], points[k + 1])
    return length


@kernel(allocates=False)
def _distance(a: Array, b: Array) -> float:
    square = 0.0
    for k in range(a.shape[0]):
        square += (b[k] - a[k]) ** 2
    return math.sqrt(square)
