"""Shortening a path by straight cuts that are proved free.

Waypoints are left out as far as can be. Then, round by round, every corner that is left is cut off:
whole, or else by a line between the middles of its legs, their quarters, their eighths, and the new
corners in the next round. What failed at a corner is not tried again before a neighbour of it has
moved. In the end waypoints are left out once more. Which cut is tried next depends on what the last
ones gained, so few edge checks are spent where there is nothing to gain, and nothing is random. All
of it is one kernel: a cut is an edge check and little else. Random cuts along the path, the
usual way, need several times as many checks for paths of the same length.

A cut is proved before it is taken. Where cuts are looked for with more clearance than is proved,
states of each are looked at, and the legs that are left in the end are proved; those of a path that
was only looked at itself wait for what is done to it next.

Looks at states of straight motions, which cost a fraction of a proof and mostly tell as much.
"""

import math
from typing import NamedTuple

import numpy as np

from compiled.kernel import directly, kernel
from compiled.simd import on_stack
from kinematics.arrays import Array, Indices
from kinematics.model.chain import MAX_JOINTS
from obstacles.collision.checker import Checker
from obstacles.collision.edge_check import FREE
from obstacles.collision.lanes.check import blocked_between
from obstacles.collision.line_check import prove_line
from obstacles.collision.model.kernel_work import Workspace, workspace
from obstacles.collision.model.model_arrays import ModelArrays, at_margins
from planning.values.deadline import Deadline

#: States of a leg that are looked at are this far apart at most, Euclidean in
#: joint space, as far as so many parts of it go. A link of a metre goes 3 cm between two of them:
#: the preferred clearance is mostly 2 cm, and corners of obstacles would reach into wider gaps.
_SPACING = 0.03
_MAX_PARTS = 64


class Look(NamedTuple):
    """Distances that states which are looked at keep.

    Args:
        margin: Margin from obstacles, beyond their own margins [m].
        own_margin: Distance between the robot's own pieces [m].
        slack: Distance from everything, beyond these [m].
    """

    margin: float
    own_margin: float
    slack: float


def look_of(checker: Checker, slack: float | None = None) -> Look:
    """Distances that a checker keeps; ``slack`` in place of its own [m]."""
    model = checker.model
    spare = checker.slack if slack is None else slack
    return Look(float(model.margin), float(model.own_margin), float(spare))


@kernel(allocates=False)
def looks_free(model: ModelArrays, work: Workspace, look: Look, a: Array, b: Array) -> bool:
    """Whether all states are free that are looked at between a and b, both (n,)."""
    parts, length = 2, distance(a, b)
    while parts < _MAX_PARTS and parts * _SPACING < length:
        parts *= 2
    looked = at_margins(model, look.margin, look.own_margin)
    return not blocked_between(looked, work, a, b, look.slack, 2, parts)


@kernel(allocates=False)
def distance(a: Array, b: Array) -> float:
    """Euclidean distance of two configurations (n,)."""
    square = 0.0
    for k in range(a.shape[0]):
        square += (b[k] - a[k]) ** 2
    return math.sqrt(square)


#: Edge checks, in all rounds together, after which it does.
_MAX_CHECKS = 250
#: A cut that needs more intervals is not worth its proof.
_MAX_INTERVALS = 800


class Held(NamedTuple):
    """Distances that a straight motion is held to.

    Args:
        look: Kept by the states of it that are looked at.
        slack: Distance to keep beyond the model's margins, which is proved [m].
        later: Whether the motion is proved later, when all that was cut off since is not proved any
            more.
    """

    look: Look
    slack: float
    later: bool


class Corners(NamedTuple):
    """A path whose corners are being cut.

    Args:
        points: The waypoints, with capacity for one more a check, shape (c, n).
        tried: Cuts at each waypoint that are known to fail, from the widest on, shape (c,).
        checks: Edge checks that were made, shape (1,).
    """

    points: Array
    tried: Indices
    checks: Indices


def shortcut(
    checker: Checker,
    waypoints: Array,
    deadline: Deadline,
    proof: Checker | None = None,
    *,
    cuts: bool = True,
    proves: bool = True,
) -> Array:
    """Shorten a polyline whose legs are proved free, or checked at states; what comes back is too.

    The budget is counted in edge checks, so that the same path is shortened in the same way.

    Args:
        checker: Finds the cuts.
        waypoints: The polyline, shape (k, n) [rad or m].
        deadline: When to stop trying.
        proof: Proves what comes back, with less clearance in the same scene than ``checker`` asks
            for; without it each cut is proved by ``checker``.
        cuts: Whether corners are cut; otherwise waypoints are left out and no more is done.
        proves: Whether what comes back is proved; otherwise states of it are checked alone.
    """
    proof = checker if proof is None else proof
    held = Held(look_of(checker), float(proof.slack), proof is not checker or not proves)
    points = np.ascontiguousarray(waypoints, np.float64)
    # Rounds after which a path counts as short.
    rounds = 6 if cuts and not deadline.passed else 0
    return directly(shorten_kernel, proof.model.arrays, held, points, proves, rounds)


def path_is_free(checker: Checker, waypoints: Array) -> bool:
    """Whether every leg of a polyline, shape (k, n) [rad or m], is proved free soon enough."""
    points = np.ascontiguousarray(waypoints, np.float64)
    return directly(prove_kernel, checker.model.arrays, float(checker.slack), points)


@kernel
def prove_kernel(model: ModelArrays, slack: float, waypoints: Array) -> bool:
    """``path_is_free`` with a distance to keep beyond the model's margins [m]."""
    held = Held(Look(model.margin, model.own_margin, slack), slack, True)
    return are_proved(model, workspace(model), held, waypoints, waypoints[:0])


@kernel
def shorten_kernel(
    model: ModelArrays, held: Held, waypoints: Array, proves: bool, rounds: int
) -> Array:
    """``shortcut`` of waypoints (k, n) in so many rounds.

    Cuts that are proved later have clearance to spare by the looks, and most are cut off again.
    Where the proof fails in the end, all is done once more with a proof of every cut.
    """
    work, room = workspace(model), waypoints.shape[0] + _MAX_CHECKS
    corners = Corners(
        np.empty((room, waypoints.shape[1])), np.empty(room, dtype=np.int64),
        np.empty(1, dtype=np.int64),
    )  # fmt: skip
    count = _shorten(model, work, held, corners, waypoints, rounds)
    proves = proves and held.later
    if proves and not are_proved(model, work, held, corners.points[:count], waypoints):
        at_once = Held(held.look, held.slack, False)
        count = _shorten(model, work, at_once, corners, waypoints, rounds)
    return corners.points[:count].copy()


@kernel(allocates=False)
def _shorten(
    model: ModelArrays, work: Workspace, held: Held, corners: Corners, waypoints: Array, rounds: int
) -> int:
    """Fill the corners with a path that is shortened; the number of its waypoints."""
    points, count = corners.points, waypoints.shape[0]
    for k in range(count):
        for j in range(waypoints.shape[1]):
            points[k, j] = waypoints[k, j]
    corners.tried[:] = 0
    corners.checks[0] = 0
    count, before = skip_waypoints(model, work, held, points, count, corners.checks), np.inf
    for _ in range(rounds):
        length = path_length(points, count)
        # A round that gains less than 1 % of the length was the last.
        if count < 3 or before - length < 0.01 * before:
            break
        before = length
        # A corner that is worth less than 0.05 % of the length is left as it is.
        count = cut_corners(model, work, held, corners, count, 5e-4 * length)
    return thin_waypoints(model, work, held, corners, count)


@kernel(allocates=False)
def is_free(
    model: ModelArrays, work: Workspace, held: Held, a: Array, b: Array, checks: Indices
) -> bool:
    """Whether the straight motion from a to b, both (n,), is free by looks and, if now, proved."""
    checks[0] += 1
    if not looks_free(model, work, held.look, a, b):
        return False
    if held.later:
        return True
    outcome = on_stack(4)
    verdict = prove_line(model, work, a, b, held.slack, _MAX_INTERVALS, outcome)
    # A motion that grazes takes thousands of intervals: every 40 count as another check.
    checks[0] += int(outcome[2]) // 40
    return bool(verdict == FREE)


@kernel(allocates=False)
def are_proved(
    model: ModelArrays, work: Workspace, held: Held, points: Array, known: Array
) -> bool:
    """Whether the legs of a path (k, n) are proved free that are not legs of one known to be."""
    outcome = on_stack(4)
    for k in range(points.shape[0] - 1):
        a, b, is_known = points[k], points[k + 1], False
        for i in range(known.shape[0] - 1):
            is_known |= distance(known[i], a) == 0.0 and distance(known[i + 1], b) == 0.0
        if is_known:
            continue
        if prove_line(model, work, a, b, held.slack, _MAX_INTERVALS, outcome) != FREE:
            return False
    return True


@kernel(allocates=False)
def skip_waypoints(
    model: ModelArrays, work: Workspace, held: Held, points: Array, count: int, checks: Indices
) -> int:
    """From each of ``count`` waypoints go straight to the farthest that a bisection finds in sight.

    The waypoints that stay are moved to the front of ``points``; returns their number.
    """
    at, size = 0, 1
    while at < count - 1:
        low, high = at + 1, count - 1
        while low < high and checks[0] < _MAX_CHECKS:
            # Waypoints before ``size`` are final; ``at`` itself may have been overwritten.
            if is_free(model, work, held, points[size - 1], points[high], checks):
                low = high
            else:
                high = (low + high) // 2
        _copy(points, low, size)
        at, size = low, size + 1
    return size


@kernel(allocates=False)
def thin_waypoints(
    model: ModelArrays, work: Workspace, held: Held, corners: Corners, count: int
) -> int:
    """From each of ``count`` waypoints go straight past as many others as can be left out.

    Corners whose whole cut is known to fail are not tried again. The waypoints that stay are moved
    to the front; returns their number.
    """
    points, tried, checks = corners.points, corners.tried, corners.checks
    at, size = 0, 1
    while at < count - 1:
        at += 1
        # The waypoint before it is still the one that it was tried with.
        known = tried[at] > 0
        while at < count - 1 and not known and checks[0] < _MAX_CHECKS:
            if not is_free(model, work, held, points[size - 1], points[at + 1], checks):
                break
            at += 1
        _copy(points, at, size)
        size += 1
    return size


@kernel(allocates=False)
def cut_corners(
    model: ModelArrays, work: Workspace, held: Held, corners: Corners, count: int, worth: float
) -> int:
    """Cut off every corner of a path as far as is free; the number of waypoints then.

    Args:
        model: The packed robot and scene.
        work: A workspace of theirs.
        held: The distances to be kept.
        corners: The path.
        count: Number of waypoints.
        worth: A corner that is worth less is left as it is, in the unit of the path's length.
    """
    points, tried, checks = corners.points, corners.tried, corners.checks
    n = points.shape[1]
    a, b = on_stack(MAX_JOINTS)[:n], on_stack(MAX_JOINTS)[:n]
    k = 1
    # Cuts tried at a corner: the whole of it, a half, a quarter, an eighth of its legs.
    cuts = 4
    while k < count - 1:
        before, after = distance(points[k - 1], points[k]), distance(points[k], points[k + 1])
        if before + after - distance(points[k - 1], points[k + 1]) < worth:
            k += 1
            continue
        while tried[k] < cuts:
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
            if is_free(model, work, held, a, b, checks):
                break
            tried[k] += 1
        if tried[k] == cuts:
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


@kernel(allocates=False)
def path_length(points: Array, count: int) -> float:
    """Length of the path through the first ``count`` points."""
    length = 0.0
    for k in range(count - 1):
        length += distance(points[k], points[k + 1])
    return length
