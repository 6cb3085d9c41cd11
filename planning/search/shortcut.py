"""Shortening a path by leaving waypoints out where the straight way is proved free.

First as far as a bisection finds, then one by one. Nothing is random, and all of it is one kernel:
a shortcut is an edge check and little else. Corners that are left are cut where that saves time, by
``planning.clearance.time_shortcut``.

A shortcut is proved before it is taken. Where they are looked for with more clearance than is
proved, states of each are looked at, and the legs that are left in the end are proved; those of a
path that was only looked at itself wait for what is done to it next.

Looks at states of straight motions, which cost a fraction of a proof and mostly tell as much.
"""

import math
from typing import NamedTuple

import numpy as np

from compiled.kernel import directly, kernel
from compiled.simd import on_stack
from kinematics.arrays import Array, Indices
from obstacles.collision.checker import Checker
from obstacles.collision.edge_check import FREE
from obstacles.collision.lanes.check import blocked_between
from obstacles.collision.line_check import prove_line
from obstacles.collision.model.kernel_work import Workspace, workspace
from obstacles.collision.model.model_arrays import ModelArrays, at_margins

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


#: Edge checks after which the path stays as it is.
_MAX_CHECKS = 250
#: A shortcut that needs more intervals is not worth its proof.
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


def shortcut(
    checker: Checker, waypoints: Array, proof: Checker | None = None, *, proves: bool = True
) -> Array:
    """Shorten a polyline whose legs are proved free, or checked at states; what comes back is too.

    The budget is counted in edge checks, so that the same path is shortened in the same way.

    Args:
        checker: Finds the shortcuts.
        waypoints: The polyline, shape (k, n) [rad or m].
        proof: Proves what comes back, with less clearance in the same scene than ``checker`` asks
            for; without it each shortcut is proved by ``checker``.
        proves: Whether what comes back is proved; otherwise states of it are checked alone.
    """
    proof = checker if proof is None else proof
    held = Held(look_of(checker), float(proof.slack), proof is not checker or not proves)
    points = np.ascontiguousarray(waypoints, np.float64)
    return directly(shorten_kernel, proof.model.arrays, held, points, proves)


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
def shorten_kernel(model: ModelArrays, held: Held, waypoints: Array, proves: bool) -> Array:
    """``shortcut`` of waypoints (k, n).

    Where the proof fails in the end, all is done once more with a proof of every shortcut.
    """
    work = workspace(model)
    points = _shortened(model, work, held, waypoints)
    if proves and held.later and not are_proved(model, work, held, points, waypoints):
        return _shortened(model, work, Held(held.look, held.slack, False), waypoints)
    return points


@kernel
def _shortened(model: ModelArrays, work: Workspace, held: Held, waypoints: Array) -> Array:
    """Waypoints (k, n) without those that can be left out."""
    points, checks = waypoints.copy(), np.zeros(1, dtype=np.int64)
    count = skip_waypoints(model, work, held, points, points.shape[0], checks)
    return points[: _thin_waypoints(model, work, held, points, count, checks)].copy()


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
def _thin_waypoints(
    model: ModelArrays, work: Workspace, held: Held, points: Array, count: int, checks: Indices
) -> int:
    """From each of ``count`` waypoints go straight past as many others as can be left out.

    The waypoints that stay are moved to the front of ``points``; returns their number.
    """
    at, size = 0, 1
    while at < count - 1:
        at += 1
        while at < count - 1 and checks[0] < _MAX_CHECKS:
            if not is_free(model, work, held, points[size - 1], points[at + 1], checks):
                break
            at += 1
        _copy(points, at, size)
        size += 1
    return size


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
