"""Moving a path, or its ends, away from what is nearer than preferred, as far as there is space.

Legs that come nearer than the preferred clearance are cut into short ones. Their ends step away
from everything that is nearer than preferred, along the gradients of the distances. Each leg then
counts as one of the highest clearance that its states keep, and of stretches of legs of one
clearance waypoints are left out at that clearance. All of it is one kernel, which checks states and
proves the legs that it makes.

A path that has to begin or end nearer than preferred is planned between retreats: short straight
ways from there to where the clearance is kept. Its true ends are then joined to it by legs that
come too near only next to the start and to the goal.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from compiled.kernel import directly, kernel
from compiled.linear_solve import cholesky_solve_kernel
from compiled.simd import on_stack
from kinematics.arrays import Array, Indices
from kinematics.model.chain import MAX_JOINTS
from obstacles.collision.checker import Checker
from obstacles.collision.edge_check import FREE
from obstacles.collision.model.kernel_work import Workspace, workspace
from obstacles.collision.model.model_arrays import ModelArrays, at_margins
from obstacles.collision.proximity import NearPairs, near_pairs_in, stand_in
from obstacles.collision.state_check import verdict_in
from planning.search.shortcut import (
    Held,
    Look,
    distance,
    is_free,
    look_of,
    looks_free,
    path_length,
    skip_waypoints,
)
from planning.values.deadline import Deadline

#: Waypoints that a path is cut into at most: more are left as they are.
_MAX_WAYPOINTS = 60
#: Near pairs that a step takes into account.
_NEAR_PAIRS = 64
#: Places on the legs next to an end that are tried as corners, farthest first: the leg, and how far
#: along it.
_PLACES = ((2, 0.0), (1, 0.5), (1, 0.0), (0, 0.5), (0, 0.25))


def retreat(clear: Checker, least: Checker, q: Array) -> Array | None:
    """A configuration near another one that keeps more clearance, and is reached straight.

    Args:
        clear: Has the clearance that is to be kept.
        least: Has that which the straight motion there is proved to keep.
        q: Shape (n,) [rad or m].

    Returns:
        Shape (n,), ``q`` itself where it keeps the clearance; None where none is found.
    """
    if clear.valid(q):
        return q
    reach, away = clear.model.robot.chain.limits, np.array(q, np.float64)
    limits = np.array([reach.lower, reach.upper])
    kept = directly(retreat_kernel, clear.model.arrays, look_of(clear), limits, away)
    return away if kept and least.free(q, away) else None


def join_ends(clear: Checker, least: Checker, start: Array, path: Array, goal: Array) -> Array:
    """A path between retreats with its true ends, each joined as far along it as it can be.

    Args:
        clear: Has the clearance of the path, which legs to the ends only lack next to these.
        least: Proves those legs.
        start: Whose retreat the path begins at, or where it begins, shape (n,) [rad or m].
        path: Shape (k, n).
        goal: Likewise, shape (n,).
    """
    # A leg to an end may be too near over 1.3 times the length of the retreat from there.
    near_start = 1.3 * float(np.linalg.norm(path[0] - start))
    near_goal = 1.3 * float(np.linalg.norm(path[-1] - goal))
    if _is_near_at_ends(clear, start, goal, near_start, near_goal) and least.free(start, goal):
        return np.array([start, goal])
    if near_start > 0.0:
        path = _join(clear, least, start, path, near_start)
    if near_goal > 0.0:
        path = _join(clear, least, goal, path[::-1], near_goal)[::-1]
    return np.ascontiguousarray(path)


def _join(clear: Checker, least: Checker, end: Array, path: Array, near: float) -> Array:
    """The path (k, n) from an end (n,) on, too near as far as ``near`` from there at most."""
    for leg, share in _PLACES:
        if leg > len(path) - 2:
            continue
        corner = path[leg] + share * (path[leg + 1] - path[leg])
        if _is_near_at_ends(clear, end, corner, near, 0.0) and least.free(end, corner):
            return np.array([end, corner, *path[leg + 1 :]])
    return np.array([end, *path])


def _is_near_at_ends(clear: Checker, a: Array, b: Array, begin: float, end: float) -> bool:
    """Whether a leg from a to b, both (n,), is only too near so far from its two ends at most."""
    length = float(np.linalg.norm(b - a))
    if length <= begin + end:
        return False
    first, last = begin / length, 1.0 - end / length
    # States are 0.03 apart, Euclidean in joint space, as those of ``sampled_check``.
    count = max(2, int(np.ceil((last - first) * length / 0.03)))
    # As np.linspace, in a third of its time.
    shares: Array = first + np.arange(count + 1.0) * ((last - first) / count)
    return clear.all_valid(a + shares[:, None] * (b - a))


class _Levels(NamedTuple):
    """Distances of falling clearance, and what is proved.

    Args:
        preferred: The preferred clearance.
        half: A half of it.
        least: The margins, and the slack.
        slack: Distance to keep beyond the margins [m].
        last: The level that the path keeps already: 1 is ``half``, 2 ``least``.
        limits: Least and greatest positions, shape (2, n).
    """

    preferred: Look
    half: Look
    least: Look
    slack: float
    last: int
    limits: Array


class _Points(NamedTuple):
    """A path that is moved, with room for c waypoints.

    Args:
        before: The waypoints as they were, shape (c, n).
        after: As they are, shape (c, n).
        valid: Whether each keeps the preferred clearance, shape (c,).
        level: Of each leg; while it is cut, whether it keeps the preferred clearance, shape (c,).
        moved: Whether each waypoint has moved, shape (c,).
        checks: Edge checks that were made, shape (1,).
    """

    before: Array
    after: Array
    valid: Indices
    level: Indices
    moved: Indices
    checks: Indices


def keep_clear(
    levels: Sequence[Checker], waypoints: Array, deadline: Deadline, reached: int | None = None
) -> Array:
    """Move a polyline to where it keeps the preferred clearance; legs that are moved are proved.

    Args:
        levels: Checkers of falling clearance, three at most, of one robot in one scene; the last
            proves what comes back.
        waypoints: The polyline, shape (k, n) [rad or m], proved free or looked at; its ends stay.
        deadline: When to stop trying.
        reached: The level that the polyline keeps; the last where it is not told.

    Returns:
        A polyline from the same start to the same goal; proved free by the last checker if that
        given is.
    """
    last = len(levels) - 1
    reached = last if reached is None else reached
    if reached < 1 or deadline.passed:
        return waypoints
    half, least = levels[min(1, last)], levels[-1]
    reach = least.model.robot.chain.limits
    # Of two levels, the second one is the last.
    number = 2 if reached == last else 1
    held = _Levels(
        look_of(levels[0], 0.0), look_of(half, 0.0), look_of(least), float(least.slack), number,
        np.array([reach.lower, reach.upper]),
    )  # fmt: skip
    points = np.ascontiguousarray(waypoints, np.float64)
    answer = directly(keep_clear_kernel, least.model.arrays, held, points)
    return waypoints if len(answer) == 0 else answer


@kernel
def keep_clear_kernel(model: ModelArrays, levels: _Levels, waypoints: Array) -> Array:
    """``keep_clear`` of waypoints (k, n); none where they are to stay as they are."""
    room, n = max(waypoints.shape[0], _MAX_WAYPOINTS) + 2, waypoints.shape[1]
    work = workspace(model)
    points = _Points(
        np.empty((room, n)), np.empty((room, n)), np.zeros(room, dtype=np.int64),
        np.zeros(room, dtype=np.int64), np.zeros(room, dtype=np.int64),
        np.zeros(1, dtype=np.int64),
    )  # fmt: skip
    count, spacious = _split(model, work, levels, points, waypoints, np.empty((room, n)))
    if spacious:
        return waypoints[:0].copy()
    for k in range(count):
        _copy(points.before[k], points.after[k])
    near = NearPairs(
        np.empty(_NEAR_PAIRS, dtype=np.int64), np.empty(_NEAR_PAIRS), np.empty((_NEAR_PAIRS, n))
    )
    normal = np.empty((n, n))
    for k in range(1, count - 1):
        if not points.valid[k]:
            points.moved[k] = _retreat(model, work, levels, near, normal, points.after[k])
    _prove(model, work, levels, points, count)
    _rate(model, work, levels, points, count)
    count = _skip_stretches(model, work, levels, points, count)
    # The path is not to become longer by more than 7 %.
    if path_length(points.after, count) > 1.07 * path_length(waypoints, waypoints.shape[0]):
        return waypoints[:0].copy()
    return points.after[:count].copy()


@kernel
def retreat_kernel(model: ModelArrays, look: Look, limits: Array, q: Array) -> bool:
    """Move q (n,), within limits (2, n), to where it keeps distances; whether it does."""
    n, work, levels = q.shape[0], workspace(model), _Levels(look, look, look, 0.0, 1, limits)
    near = NearPairs(
        np.empty(_NEAR_PAIRS, dtype=np.int64), np.empty(_NEAR_PAIRS), np.empty((_NEAR_PAIRS, n))
    )
    normal = np.empty((n, n))
    # Three times the steps of a waypoint are enough for an end.
    for _ in range(3):
        if not _retreat(model, work, levels, near, normal, q):
            return False
        if _keeps(model, work, look, q):
            return True
    return False


@kernel(allocates=False)
def _keeps(model: ModelArrays, work: Workspace, look: Look, q: Array) -> bool:
    """Whether q (n,) keeps distances."""
    looked = at_margins(model, look.margin, look.own_margin)
    return bool(verdict_in(looked, work, q, look.slack, on_stack(1).view(np.int64)) == FREE)


@kernel(allocates=False)
def _clears(model: ModelArrays, work: Workspace, look: Look, a: Array, b: Array) -> bool:
    """Whether a, b and the states looked at between them keep distances."""
    ends = _keeps(model, work, look, a) and _keeps(model, work, look, b)
    return ends and looks_free(model, work, look, a, b)


@kernel(allocates=False)
def _split(
    model: ModelArrays, work: Workspace, levels: _Levels, points: _Points, waypoints: Array,
    ends: Array,
) -> tuple[int, bool]:  # fmt: skip
    """Write the path with its legs halved until they keep the preferred clearance, or are short.

    Args:
        model: The packed robot and scene.
        work: A workspace.
        levels: The distances.
        points: Filled.
        waypoints: The path, shape (k, n).
        ends: Room for ends of legs that wait, the next one last, shape (c, n).

    Returns:
        The number of waypoints, and whether all of the path keeps the preferred clearance.
    """
    before, valid, level, n = points.before, points.valid, points.level, waypoints.shape[1]
    waiting, count, spacious = waypoints.shape[0] - 1, 1, True
    for k in range(waiting):
        _copy(waypoints[waiting - k], ends[k])
    _copy(waypoints[0], before[0])
    valid[0] = _keeps(model, work, levels.preferred, before[0])
    while waiting > 0:
        a, b = before[count - 1], ends[waiting - 1]
        valid[count] = _keeps(model, work, levels.preferred, b)
        both = valid[count - 1] and valid[count]
        if both and looks_free(model, work, levels.preferred, a, b):
            _copy(b, before[count])
            level[count - 1] = 1
            count, waiting = count + 1, waiting - 1
            continue
        spacious = False
        # Legs are cut no shorter than 0.18, Euclidean in joint space.
        short = distance(a, b) < 2.0 * 0.18
        if count + waiting >= _MAX_WAYPOINTS or (short and not both):
            _copy(b, before[count])
            level[count - 1] = 0
            count, waiting = count + 1, waiting - 1
            continue
        if short:
            # Only what lies between its ends is too near.
            for j in range(n):
                before[count + 1, j] = b[j]
                before[count, j] = 0.5 * (a[j] + b[j])
            valid[count + 1], valid[count] = 1, _keeps(model, work, levels.preferred, before[count])
            level[count - 1] = level[count] = 0
            count, waiting = count + 2, waiting - 1
            continue
        for j in range(n):
            ends[waiting, j] = 0.5 * (a[j] + b[j])
        waiting += 1
    return count, spacious


@kernel(allocates=False)
def _retreat(
    model: ModelArrays, work: Workspace, levels: _Levels, near: NearPairs, normal: Array, q: Array
) -> bool:
    """Move q (n,) to where it keeps more of the preferred clearance; whether it has moved.

    With G the gradients of the distances and w what they are to gain, a step is
    (G^T G + mu 1)^-1 G^T w, as damped least squares.
    """
    looked = at_margins(model, levels.preferred.margin, levels.preferred.own_margin)
    n, least = q.shape[0], np.inf
    best, step = on_stack(MAX_JOINTS)[:n], on_stack(MAX_JOINTS)[:n]
    _copy(q, best)
    moved = False
    # Steps of a waypoint away from what is too near.
    steps = 4
    for attempt in range(steps + 1):
        work.joints[:] = 0.0
        stand_in(model, work, q)
        count = min(near_pairs_in(looked, work, 0.0, near), _NEAR_PAIRS)
        missing = 0.0
        for row in range(count):
            missing = max(missing, -near.distances[row])
        if missing < least:
            least, moved = missing, attempt > 0
            _copy(q, best)
        if count == 0 or attempt == steps:
            break
        _write_normal_equations(near, count, normal, step)
        if cholesky_solve_kernel(normal, step, n) >= 0:
            break
        square = 0.0
        for j in range(n):
            square += step[j] * step[j]
        # A step is at most 0.1 long, Euclidean in joint space.
        share = min(1.0, 0.1 / max(math.sqrt(square), 1e-12))
        for j in range(n):
            q[j] = min(max(q[j] + share * step[j], levels.limits[0, j]), levels.limits[1, j])
    _copy(best, q)
    return moved


@kernel(allocates=False)
def _write_normal_equations(near: NearPairs, count: int, normal: Array, step: Array) -> None:
    """Write G^T G + mu 1, shape (n, n), and G^T w, shape (n,)."""
    n, total = step.shape[0], 0.0
    for i in range(n):
        for j in range(i + 1):
            normal[i, j] = 0.0
            for row in range(count):
                normal[i, j] += near.gradients[row, i] * near.gradients[row, j]
        step[i] = 0.0
        for row in range(count):
            # 5 mm more than is missing, for the legs beside it.
            step[i] += near.gradients[row, i] * (5e-3 - near.distances[row])
        total += normal[i, i]
    # Directions in which distances change by less than this share of what they do in all are
    # damped.
    damping = 1e-2
    for i in range(n):
        normal[i, i] += damping * damping * total + 1e-12


@kernel(allocates=False)
def _prove(
    model: ModelArrays, work: Workspace, levels: _Levels, points: _Points, count: int
) -> None:
    """Take the waypoints back that have moved and whose legs are not proved free."""
    before, after, moved = points.before, points.after, points.moved
    floor = _floor(levels, levels.last)
    k = 0
    while k < count - 1:
        free = not (moved[k] or moved[k + 1])
        if free or is_free(model, work, floor, after[k], after[k + 1], points.checks):
            k += 1
            continue
        for i in (k, k + 1):
            moved[i] = 0
            _copy(before[i], after[i])
        # The leg before has another end now.
        k = max(k - 1, 0)


@kernel(allocates=False)
def _floor(levels: _Levels, level: int) -> Held:
    """Distances that legs of a level are held to: by looks its own, proved the margins."""
    if level == 0:
        return Held(levels.preferred, levels.slack, False)
    if level == 1:
        return Held(levels.half, levels.slack, False)
    return Held(levels.least, levels.slack, False)


@kernel(allocates=False)
def _rate(
    model: ModelArrays, work: Workspace, levels: _Levels, points: _Points, count: int
) -> None:
    """Write the level of each leg: the first that its ends and the looks between them keep."""
    after, valid, level, moved = points.after, points.valid, points.level, points.moved
    for k in range(count):
        if moved[k]:
            valid[k] = _keeps(model, work, levels.preferred, after[k])
    for k in range(count - 1):
        if level[k] and not (moved[k] or moved[k + 1]):
            level[k] = 0
            continue
        a, b = after[k], after[k + 1]
        level[k] = levels.last
        if valid[k] and valid[k + 1] and looks_free(model, work, levels.preferred, a, b):
            level[k] = 0
        elif levels.last > 1 and _clears(model, work, levels.half, a, b):
            level[k] = 1


@kernel(allocates=False)
def _skip_stretches(
    model: ModelArrays, work: Workspace, levels: _Levels, points: _Points, count: int
) -> int:
    """Leave waypoints out between legs of one level, at that level; how many there are then."""
    after, level, checks = points.after, points.level, points.checks
    size, first = 1, 0
    while first < count - 1:
        end = first + 1
        while end < count - 1 and level[end] == level[first]:
            end += 1
        stretch, held = after[first : end + 1], _floor(levels, level[first])
        left = end + 1 - first
        if left > 2:
            left = skip_waypoints(model, work, held, stretch, left, checks)
        for k in range(1, left):
            _copy(stretch[k], after[size])
            size += 1
        first = end
    return size


@kernel(allocates=False)
def _copy(source: Array, place: Array) -> None:
    for j in range(source.shape[0]):
        place[j] = source[j]
