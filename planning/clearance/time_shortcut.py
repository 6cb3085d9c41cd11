"""A path made quicker where that is worth the clearance it costs.

A path that was moved away from what it passes has many corners, and each of them costs time. Here
waypoints are left out, drawn half-way or a fifth of the way to the line between their neighbours,
put together two by two, or cut off, whichever brings most, as long as

    cost = sum over legs of  time (1 + weight * shortfall / preferred)

falls: the time estimated, and how far the leg is below the preferred clearance on average. So a
long way round is not taken for the sake of a few millimetres, nor clearance given away for nothing.
Where the legs that a step replaces lack nothing the new ones are proved to lack nothing either.
A step is only looked at for clearance where the time alone would make it worth its while, and only
proved where it still is then.
"""

from collections.abc import Callable, Sequence
from enum import IntEnum
from functools import cache
from typing import NamedTuple

import numpy as np

from compiled.kernel import direct, kernel
from kinematics.arrays import Array, Indices
from obstacles.collision.checker import Checker, any_model
from obstacles.collision.model.kernel_work import Workspace, workspace
from obstacles.collision.model.model_arrays import ModelArrays, at_margins
from obstacles.collision.proximity import line_deficit
from planning.search.shortcut import Held, Look, are_proved, is_free, look_of, looks_free
from planning.timing.estimate import LEG_ROWS, Leg, estimated_time

#: States looked at for their clearance are this far apart at most, Euclidean in joint space.
_SPACING = 0.25


class Step(IntEnum):
    """Change at one waypoint of a path.

    It is left out, drawn in, put together with the next half-way, cut off at the half and at the
    quarter of its legs, drawn in by less.
    """

    LEFT_OUT = 0
    DRAWN_IN = 1
    JOINED = 2
    CUT_AT_HALF = 3
    CUT_AT_QUARTER = 4
    DRAWN_LESS = 5


_STEPS = len(Step)


#: Edge checks after which the path stays as it is.
_MAX_CHECKS = 60
#: Paths with more waypoints stay as they are.
MAX_WAYPOINTS = 48


class _Way(NamedTuple):
    """A path that is made quicker, with room for c waypoints.

    Args:
        points: The waypoints, shape (c, n).
        shortfall: Mean of each leg, shape (c,) [m].
        trial: The waypoints after a step, shape (c, n).
        expected: Shortfalls after it, shape (c,).
        legs: As ``estimated_time`` fills them.
        tried: Steps of each waypoint that are known to bring nothing, a bit each, shape (c,).
        costs: After each step, shape (c, _STEPS).
        checks: Edge checks that were made, shape (1,).
    """

    points: Array
    shortfall: Array
    trial: Array
    expected: Array
    legs: Array
    tried: Indices
    costs: Array
    checks: Indices


class _Bounds(NamedTuple):
    """Distances and limits that a path is held to.

    Args:
        preferred: The preferred clearance.
        least: The margins, and the slack.
        slack: Distance to keep beyond the margins [m].
        limits: Of velocity, acceleration and jerk, shape (3, n).
        weight: Of a shortfall [1/m].
        later: Whether legs that lack nothing by the looks are proved free in the end.
    """

    preferred: Look
    least: Look
    slack: float
    limits: Array
    weight: float
    later: bool


def quicken(
    levels: Sequence[Checker],
    waypoints: Array,
    limits: Array,
    *,
    spacious: bool = False,
    proves: bool = True,
) -> Array:
    """Make a polyline quicker whose legs are proved free; what comes back is proved too.

    Args:
        levels: Checkers of falling clearance, of one robot in one scene; the legs are proved free
            by the last.
        waypoints: The polyline, shape (k, n) [rad or m]; its ends stay.
        limits: Of velocity, acceleration and jerk, shape (3, n), as ``estimate_limits`` has them.
        spacious: Whether the legs are known to lack nothing of what the first asks for.
        proves: Whether legs that lack nothing are proved, in the end; otherwise they are only
            looked at, before and afterwards.
    """
    preferred, least = levels[0], levels[-1]
    if len(levels) < 2 or not 2 < len(waypoints) <= MAX_WAYPOINTS:
        return waypoints
    # Time that a motion in contact costs, as a multiple of that of one with the preferred
    # clearance.
    weight = 6.0 / preferred.model.margin
    points = np.ascontiguousarray(waypoints, np.float64)
    slack = float(least.slack)
    bounds = _Bounds(look_of(preferred, 0.0), look_of(least), slack, limits, weight, True)
    return _quicken_directly()(least.model.arrays, bounds, points, spacious, proves)


@cache
def _quicken_directly() -> Callable[[ModelArrays, _Bounds, Array, bool, bool], Array]:
    """``quicken_kernel`` without the look at its arguments' types, which would cost too much."""
    look, points = Look(0.0, 0.0, 0.0), np.zeros((1, 1))
    bounds = _Bounds(look, look, 0.0, points, 0.0, True)
    return direct(quicken_kernel, any_model(), bounds, points, True, True)


@kernel
def quicken_kernel(
    model: ModelArrays, bounds: _Bounds, waypoints: Array, spacious: bool, proves: bool
) -> Array:
    """``quicken`` of waypoints (k, n), k >= 3, legs that lack nothing proved later, or never."""
    room, n = waypoints.shape[0] + _MAX_CHECKS, waypoints.shape[1]
    way = _Way(
        np.empty((room, n)), np.empty(room), np.empty((room, n)), np.empty(room),
        np.empty((LEG_ROWS, room)), np.zeros(room, dtype=np.int64), np.empty((room, _STEPS)),
        np.empty(1, dtype=np.int64),
    )  # fmt: skip
    work, held = workspace(model), Held(bounds.preferred, bounds.slack, True)
    count = _start(model, work, bounds, way, waypoints, spacious)
    count = _quicken(model, work, bounds, way, count)
    if proves and not are_proved(model, work, held, way.points[:count], waypoints):
        # Between two looks it came too near: once more, with a proof of every leg.
        at_once = _Bounds(
            bounds.preferred, bounds.least, bounds.slack, bounds.limits, bounds.weight, False
        )
        count = _start(model, work, at_once, way, waypoints, spacious)
        count = _quicken(model, work, at_once, way, count)
    return way.points[:count].copy()


@kernel(allocates=False)
def _start(
    model: ModelArrays, work: Workspace, bounds: _Bounds, way: _Way, waypoints: Array,
    spacious: bool,
) -> int:  # fmt: skip
    """Write the waypoints (k, n) and what their legs lack; their number."""
    count = int(waypoints.shape[0])
    for k in range(count):
        way.tried[k], way.shortfall[k] = 0, 0.0
        for j in range(waypoints.shape[1]):
            way.points[k, j] = waypoints[k, j]
    if not spacious:
        _write_shortfalls(model, work, bounds, way, count)
    return count


@kernel(allocates=False)
def _write_shortfalls(
    model: ModelArrays, work: Workspace, bounds: _Bounds, way: _Way, count: int
) -> None:
    """Write what each leg lacks."""
    points, look = way.points, bounds.preferred
    looked = at_margins(model, look.margin, look.own_margin)
    for k in range(count - 1):
        way.shortfall[k] = line_deficit(looked, work, points[k], points[k + 1], _SPACING, np.inf)


@kernel(allocates=False)
def _quicken(model: ModelArrays, work: Workspace, bounds: _Bounds, way: _Way, count: int) -> int:
    """Take steps while they bring something; the number of waypoints then."""
    checks = way.checks
    checks[0] = 0
    cost = _cost(bounds, way.points, way.shortfall, way.legs, count)
    while checks[0] < _MAX_CHECKS:
        # A step that lowers the cost by less than 0.5 % is none.
        enough = 0.995 * cost
        _write_costs(bounds, way, count)
        after = enough
        while checks[0] < _MAX_CHECKS:
            k, step = _cheapest(way.costs, count)
            if not way.costs[k, step] < enough:
                break
            way.costs[k, step] = np.inf
            way.tried[k] |= 1 << step
            after = _try(model, work, bounds, way, count, k, step, enough)
            if after < enough:
                count = _take(way, count, k, step)
                break
        if not after < enough:
            break
        cost = after
    return count


@kernel(allocates=False)
def _write_costs(bounds: _Bounds, way: _Way, count: int) -> None:
    """Write what the path costs after each step if its new legs lack nothing."""
    for k in range(1, count - 1):
        for step in range(_STEPS):
            way.costs[k, step] = np.inf
            if way.tried[k] & (1 << step) or (step == Step.JOINED and k == count - 2):
                continue
            size = _step(way, count, k, step)
            way.costs[k, step] = _cost(bounds, way.trial, way.expected, way.legs, size)


@kernel(allocates=False)
def _cheapest(costs: Array, count: int) -> tuple[int, int]:
    """The waypoint and the step after which the path costs least."""
    at, best = 1, 0
    for k in range(1, count - 1):
        for step in range(_STEPS):
            if costs[k, step] < costs[at, best]:
                at, best = k, step
    return at, best


@kernel(allocates=False)
def _cost(bounds: _Bounds, points: Array, shortfall: Array, legs: Array, count: int) -> float:
    """Cost of a path of ``count`` waypoints [s]."""
    total = estimated_time(points, count, bounds.limits, legs)
    for k in range(count - 1):
        total += bounds.weight * shortfall[k] * legs[Leg.TIME, k]
    return total


@kernel(allocates=False)
def _sizes(step: int) -> tuple[int, int]:
    """Numbers of waypoints that a step takes out and brings in their place."""
    if step == Step.LEFT_OUT:
        return 1, 0
    if step in (Step.DRAWN_IN, Step.DRAWN_LESS):
        return 1, 1
    return (2, 1) if step == Step.JOINED else (1, 2)


@kernel(allocates=False)
def _step(way: _Way, count: int, k: int, step: int) -> int:
    """Write the path after a step of waypoint k, its new legs lacking nothing; its waypoints."""
    points, trial, expected = way.points, way.trial, way.expected
    taken, brought = _sizes(step)
    size = count - taken + brought
    for i in range(size):
        source = i if i < k else i + taken - brought
        if i < k or i >= k + brought:
            for j in range(points.shape[1]):
                trial[i, j] = points[source, j]
        if i < k - 1 or i >= k + brought:
            expected[i] = way.shortfall[source]
        else:
            expected[i] = 0.0
    # How far a waypoint is drawn in, as part of the way to the line between its neighbours.
    half_way, less = 0.5, 0.2
    if step == Step.DRAWN_IN:
        _draw_in(points, k, half_way, trial)
    elif step == Step.DRAWN_LESS:
        _draw_in(points, k, less, trial)
    elif step == Step.JOINED:
        for j in range(points.shape[1]):
            trial[k, j] = 0.5 * (points[k, j] + points[k + 1, j])
    elif step != Step.LEFT_OUT:
        share = 0.5 if step == Step.CUT_AT_HALF else 0.25
        for j in range(points.shape[1]):
            trial[k, j] = points[k, j] + share * (points[k - 1, j] - points[k, j])
            trial[k + 1, j] = points[k, j] + share * (points[k + 1, j] - points[k, j])
    return size


@kernel(allocates=False)
def _draw_in(points: Array, k: int, part: float, trial: Array) -> None:
    """Write waypoint k a part of the way to its place on the line between its neighbours."""
    before, after = 0.0, 0.0
    for j in range(points.shape[1]):
        before += (points[k, j] - points[k - 1, j]) ** 2
        after += (points[k + 1, j] - points[k, j]) ** 2
    before, after = np.sqrt(before), np.sqrt(after)
    share = before / max(before + after, 1e-12)
    for j in range(points.shape[1]):
        on_line = points[k - 1, j] + share * (points[k + 1, j] - points[k - 1, j])
        trial[k, j] = points[k, j] + part * (on_line - points[k, j])


@kernel(allocates=False)
def _try(
    model: ModelArrays, work: Workspace, bounds: _Bounds, way: _Way, count: int, k: int, step: int,
    enough: float,
) -> float:  # fmt: skip
    """Cost of the path after a step; infinite where that is not enough or not proved free."""
    trial, expected, legs = way.trial, way.expected, way.legs
    size = _step(way, count, k, step)
    cost = _cost(bounds, trial, expected, legs, size)
    taken, brought = _sizes(step)
    if not np.any(way.shortfall[k - 1 : k + taken]):
        way.checks[0] += 1
        for i in range(k - 1, k + brought):
            if not looks_free(model, work, bounds.preferred, trial[i], trial[i + 1]):
                return np.inf
        way.checks[0] += brought
        if bounds.later:
            return cost
        held = Held(bounds.preferred, bounds.slack, False)
        for i in range(k - 1, k + brought):
            if not is_free(model, work, held, trial[i], trial[i + 1], way.checks):
                return np.inf
        return cost
    looked = at_margins(model, bounds.preferred.margin, bounds.preferred.own_margin)
    for i in range(k - 1, k + brought):
        worth = bounds.weight * legs[Leg.TIME, i]
        most = (enough - cost) / worth if worth > 0.0 else np.inf
        expected[i] = line_deficit(looked, work, trial[i], trial[i + 1], _SPACING, most)
        cost += worth * expected[i]
        if not cost < enough:
            return np.inf
    held = Held(bounds.least, bounds.slack, False)
    for i in range(k - 1, k + brought):
        if not is_free(model, work, held, trial[i], trial[i + 1], way.checks):
            return np.inf
    return cost


@kernel(allocates=False)
def _take(way: _Way, count: int, k: int, step: int) -> int:
    """Make the path after a step the path; its waypoints. Steps beside it may be tried again."""
    taken, brought = _sizes(step)
    size, tried = count - taken + brought, way.tried
    if brought < taken:
        for i in range(k, size):
            tried[i] = tried[i + 1]
    elif brought > taken:
        for i in range(size - 1, k, -1):
            tried[i] = tried[i - 1]
    for i in range(max(k - 2, 0), min(k + brought + 1, size)):
        tried[i] = 0
    for i in range(size):
        way.shortfall[i] = way.expected[i]
        for j in range(way.points.shape[1]):
            way.points[i, j] = way.trial[i, j]
    return size
