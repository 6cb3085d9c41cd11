"""A path made quicker where that is worth the clearance it costs: shortcuts in time, not in length.

A path that was moved away from what it passes has many corners, and each of them costs time. Here
waypoints are left out, cut off, drawn towards the line between their neighbours, or shifted in some
joints, at random and always alike, as long as the time estimated falls, and

    cost = sum over legs of  time (1 + weight * shortfall / preferred)

too, where the shortfall is how far the leg is below the preferred clearance on average. So a
long way round is not taken for the sake of a few millimetres, nor clearance given away for nothing.
The slowest joint alone counts for the time of a leg: to lead it straight and the others round
something is quicker than the shortest path. Where the legs that a step replaces lack nothing the
new ones are proved to lack nothing either, and states of the curves that round their corners keep
it. A step is only looked at for clearance where the time alone would make it worth its while; what
is left in the end is proved.
"""

from collections.abc import Sequence
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from compiled.kernel import directly, kernel
from compiled.random import State, uniform_kernel
from compiled.simd import LANES
from kinematics.arrays import Array
from obstacles.collision.checker import Checker
from obstacles.collision.lanes.check import blocked_lanes
from obstacles.collision.model.kernel_work import Workspace, workspace
from obstacles.collision.model.model_arrays import ModelArrays, at_margins
from obstacles.collision.proximity import line_deficit
from planning.search.shortcut import (
    Held,
    Look,
    are_proved,
    distance,
    look_of,
    looks_free,
)
from planning.timing.estimate import LEG_ROWS, Leg, estimated_time

#: States looked at for their clearance are this far apart at most, Euclidean in joint space.
_SPACING = 0.25


class Step(IntEnum):
    """Change at one waypoint of a path.

    It is left out, cut off, drawn towards the line between its neighbours, or shifted.
    """

    LEFT_OUT = 0
    CUT_OFF = 1
    DRAWN_IN = 2
    SHIFTED = 3


#: Steps that are drawn, and those among them that are looked at for clearance, at most.
_MAX_TRIALS, _MAX_CHECKS = 250, 120
#: Waypoints that a path may get more, at most.
_MORE_WAYPOINTS = 8


class _Way(NamedTuple):
    """A path that is made quicker, with room for c waypoints.

    Args:
        points: The waypoints, shape (c, n).
        shortfall: Mean of each leg, shape (c,) [m].
        trial: The waypoints after a step, shape (c, n).
        expected: Shortfalls after it, shape (c,).
        legs: As ``estimated_time`` fills them.
        random: Generator of the steps.
    """

    points: Array
    shortfall: Array
    trial: Array
    expected: Array
    legs: Array
    random: State


class _Bounds(NamedTuple):
    """Distances and limits that a path is held to.

    Args:
        preferred: The preferred clearance.
        least: The margins, and the slack.
        slack: Distance to keep beyond the margins [m].
        limits: Of velocity, acceleration and jerk, shape (3, n).
        positions: Lower and upper limits of the joints, shape (2, n).
        weight: Of a shortfall [1/m].
    """

    preferred: Look
    least: Look
    slack: float
    limits: Array
    positions: Array
    weight: float


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
            by the last; one alone asks for nothing beyond what is needed.
        waypoints: The polyline, shape (k, n) [rad or m]; its ends stay.
        limits: Of velocity, acceleration and jerk, shape (3, n), as ``estimate_limits`` has them.
        spacious: Whether the legs are known to lack nothing of what the first asks for.
        proves: Whether legs are proved in the end; otherwise they are only looked at, before and
            afterwards.
    """
    preferred, least = levels[0], levels[-1]
    if len(waypoints) < 3:
        return waypoints
    looks, weight = (look_of(least), look_of(least)), 0.0
    if len(levels) > 1:
        # Time that a motion in contact costs, as a multiple of that of one with the preferred
        # clearance.
        looks, weight = (look_of(preferred, 0.0), looks[1]), 6.0 / preferred.model.margin
    points = np.ascontiguousarray(waypoints, np.float64)
    slack = float(least.slack)
    joints, spacious = least.model.robot.chain.limits, spacious or len(levels) == 1
    positions = np.stack([joints.lower, joints.upper])
    bounds = _Bounds(*looks, slack, limits, positions, weight)
    return directly(quicken_kernel, least.model.arrays, bounds, points, spacious, proves)


@kernel
def quicken_kernel(
    model: ModelArrays, bounds: _Bounds, waypoints: Array, spacious: bool, proves: bool
) -> Array:
    """``quicken`` of waypoints (k, n), k >= 3, proved in the end, or never."""
    room, n = waypoints.shape[0] + _MORE_WAYPOINTS, waypoints.shape[1]
    way = _Way(
        np.empty((room, n)), np.empty(room), np.empty((room, n)), np.empty(room),
        np.empty((LEG_ROWS, room)), np.zeros(1, dtype=np.uint64),
    )  # fmt: skip
    work, held = workspace(model), Held(bounds.preferred, bounds.slack, True)
    count = _start(model, work, bounds, way, waypoints, spacious)
    count = _quicken(model, work, bounds, way, count)
    points = way.points[:count]
    # Between two looks it may have come too near: the path stays what it was then.
    if proves and not are_proved(model, work, held, points, waypoints):
        return waypoints
    return points.copy()


@kernel(allocates=False)
def _start(
    model: ModelArrays, work: Workspace, bounds: _Bounds, way: _Way, waypoints: Array,
    spacious: bool,
) -> int:  # fmt: skip
    """Write the waypoints (k, n) and what their legs lack; their number."""
    count = int(waypoints.shape[0])
    way.random[0] = 0
    for k in range(count):
        way.shortfall[k] = 0.0
        for j in range(waypoints.shape[1]):
            way.points[k, j] = waypoints[k, j]
    if not spacious:
        points, look = way.points, bounds.preferred
        looked = at_margins(model, look.margin, look.own_margin)
        for k in range(count - 1):
            deficit = line_deficit(looked, work, points[k], points[k + 1], _SPACING, np.inf)
            way.shortfall[k] = deficit
    return count


@kernel(allocates=False)
def _quicken(model: ModelArrays, work: Workspace, bounds: _Bounds, way: _Way, count: int) -> int:
    """Take steps that bring something; the number of waypoints then."""
    legs, checks = way.legs, 0
    time = estimated_time(way.points, count, bounds.limits, legs)
    cost = time + _shortfall_cost(bounds, way.shortfall, legs, count)
    for _ in range(_MAX_TRIALS):
        if count < 3 or checks >= _MAX_CHECKS:
            break
        # A step that lowers time or cost by less than 0.05 % is none.
        less = 0.9995
        k, step = _draw(way, count)
        size = _step(way, count, k, step)
        if not _is_inside(bounds.positions, way.trial[k]):
            continue
        after = estimated_time(way.trial, size, bounds.limits, legs)
        total = after + _shortfall_cost(bounds, way.expected, legs, size)
        if not (after < less * time and total < less * cost):
            continue
        # Shortfalls take several times as long as looks.
        checks += 4 if np.any(way.shortfall[k - 1 : k + 1]) else 1
        total = _look(model, work, bounds, way, (size, k, step), total, less * cost)
        if total < less * cost:
            count, time, cost = _take(way, size), after, total
    return count


@kernel
def _is_inside(positions: Array, q: Array) -> bool:
    """Whether a configuration (n,) is within bounds (2, n)."""
    return bool(np.all((positions[0] <= q) & (q <= positions[1])))


@kernel(allocates=False)
def _draw(way: _Way, count: int) -> tuple[int, Step]:
    """An inner waypoint and a step of it, at random."""
    k = 1 + int((count - 2) * uniform_kernel(way.random))
    share = uniform_kernel(way.random)
    if share < 0.1:
        return k, Step.LEFT_OUT
    if share < 0.2 and count < way.points.shape[0]:
        return k, Step.CUT_OFF
    return k, Step.DRAWN_IN if share < 0.5 else Step.SHIFTED


@kernel(allocates=False)
def _shortfall_cost(bounds: _Bounds, shortfall: Array, legs: Array, count: int) -> float:
    """Cost of what the legs of a path of ``count`` waypoints lack [s]."""
    total = 0.0
    for k in range(count - 1):
        total += bounds.weight * shortfall[k] * legs[Leg.TIME, k]
    return total


@kernel(allocates=False)
def _sizes(step: int) -> tuple[int, int]:
    """Numbers of waypoints that a step takes out and brings in their place."""
    if step == Step.LEFT_OUT:
        return 1, 0
    return (1, 2) if step == Step.CUT_OFF else (1, 1)


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
        expected[i] = way.shortfall[source] if i < k - 1 or i >= k + brought else 0.0
    if step == Step.CUT_OFF:
        # Shares of the legs that are cut off.
        share = 0.1 + 0.5 * uniform_kernel(way.random)
        for j in range(points.shape[1]):
            trial[k, j] = points[k, j] + share * (points[k - 1, j] - points[k, j])
            trial[k + 1, j] = points[k, j] + share * (points[k + 1, j] - points[k, j])
    elif step == Step.DRAWN_IN:
        share, part = uniform_kernel(way.random), uniform_kernel(way.random)
        for j in range(points.shape[1]):
            on_line = points[k - 1, j] + share * (points[k + 1, j] - points[k - 1, j])
            trial[k, j] = points[k, j] + part * (on_line - points[k, j])
    elif step == Step.SHIFTED:
        # About half of the joints, by at most 20 to 500 mrad.
        most = 0.02 * 25.0 ** uniform_kernel(way.random)
        for j in range(points.shape[1]):
            shift = most * (4.0 * uniform_kernel(way.random) - 2.0)
            trial[k, j] = points[k, j] + (shift if abs(shift) < most else 0.0)
    return size


@kernel(allocates=False)
def _look(
    model: ModelArrays, work: Workspace, bounds: _Bounds, way: _Way, change: tuple[int, int, int],
    cost: float, enough: float,
) -> float:  # fmt: skip
    """Cost of the path after a step; infinite where that is not enough or not free.

    Args:
        model: The packed robot and scene.
        work: A workspace of theirs.
        bounds: Distances and limits.
        way: The path, and the one after the step.
        change: Number of its waypoints, the waypoint of the step, and the step.
        cost: Its cost if the new legs lack nothing.
        enough: Cost that is too much.
    """
    trial, expected, legs, (size, k, step) = way.trial, way.expected, way.legs, change
    taken, brought = _sizes(step)
    lacks = np.any(way.shortfall[k - 1 : k + taken])
    look = bounds.least if lacks else bounds.preferred
    looked = at_margins(model, look.margin, look.own_margin)
    for i in range(max(k - 1, 1), min(k + brought + 1, size - 1)):
        if _is_blocked_corner(looked, work, trial, i, look.slack):
            return np.inf
    for i in range(k - 1, k + brought):
        if not looks_free(model, work, look, trial[i], trial[i + 1]):
            return np.inf
    if lacks:
        deficits = at_margins(model, bounds.preferred.margin, bounds.preferred.own_margin)
        for i in range(k - 1, k + brought):
            worth = bounds.weight * legs[Leg.TIME, i]
            most = (enough - cost) / worth if worth > 0.0 else np.inf
            expected[i] = line_deficit(deficits, work, trial[i], trial[i + 1], _SPACING, most)
            cost += worth * expected[i]
            if not cost < enough:
                return np.inf
    return cost


@kernel(allocates=False)
def _is_blocked_corner(
    model: ModelArrays, work: Workspace, points: Array, k: int, slack: float
) -> bool:
    """Whether a state on the widest curve about waypoint k is not free."""
    before, after = distance(points[k - 1], points[k]), distance(points[k], points[k + 1])
    reach = 0.5 * min(before, after)
    for number in range(LANES):
        # The way left to the middle of the curve of two cubics, from either end.
        way = (number + 1.0) / (0.5 * LANES + 0.5)
        rest = abs(way - 1.0)
        off = reach * (1.0 - rest) ** 3 / 6.0
        for j in range(points.shape[1]):
            u = (points[k, j] - points[k - 1, j]) / max(before, 1e-12)
            v = (points[k + 1, j] - points[k, j]) / max(after, 1e-12)
            along = -rest * reach * u if way < 1.0 else rest * reach * v
            work.lanes[LANES * j + number] = points[k, j] + along + off * (v - u)
    every = (1 << LANES) - 1
    return bool(blocked_lanes(model, work, slack, every, every) != 0)


@kernel(allocates=False)
def _take(way: _Way, size: int) -> int:
    """Make the path after a step the path; its waypoints."""
    for i in range(size):
        way.shortfall[i] = way.expected[i]
        for j in range(way.points.shape[1]):
            way.points[i, j] = way.trial[i, j]
    return size
