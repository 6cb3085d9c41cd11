"""Polylines in joint space whose corners are rounded by parabolas or by cubics.

With unit directions u_in before and u_out after a corner c, the parabola of reach r is

    q(w) = c - r u_in + u_in w + (u_out - u_in) w^2 / (4 r),    0 <= w <= 2 r.

It leaves the first leg at c - r u_in with tangent u_in and joins the second at c + r u_out with
tangent u_out, so dq/ds is continuous, with s the arc length on the legs and w on the parabola. At
w = r it is nearest to the corner: |q(r) - c| = r |u_out - u_in| / 4.

For motion of bounded jerk d2q/ds2 has to be continuous too. Then two cubics take the parabola's
place, from the same point to the same point,

    q(w) = c - r u_in + u_in w + (u_out - u_in) w^3 / (6 r^2),    0 <= w <= r,

and its mirror image: d2q/ds2 grows from 0 to (u_out - u_in) / r in the middle and falls back to 0.
These pass the corner within r |u_out - u_in| / 6.

Waypoints that stay of a polyline, and the largest reaches of its corners, in kernels.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from compiled.kernel import kernel
from kinematics.arrays import Array, Indices
from kinematics.errors import InvalidOption, InvalidTrajectory
from obstacles.collision.checker import Checker
from planning.timing.path.path import SAME_DIRECTION, JointPath
from planning.values.deadline import Deadline


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


# A reach below this part of the shorter leg would let the corner be passed at a thousandth of the
# leg's speed: a stop costs no more.
_LEAST_REACH = 1e-6


def merge(waypoints: ArrayLike) -> Array:
    """The waypoints without those that repeat their predecessor or lie on a straight leg.

    Args:
        waypoints: Shape (k, n), k >= 1.

    Returns:
        Shape (k', n); the first and the last waypoint always stay. One row where all are the same.

    Raises:
        InvalidTrajectory: There is no waypoint, rows differ in length, or a value is not finite.
    """
    points = checked_waypoints(waypoints)
    return points[_keep(points)]


def corner_indices(waypoints: ArrayLike) -> Indices:
    """Indices of the waypoints that ``merge`` leaves: the ends, and where the direction changes.

    Args:
        waypoints: Shape (k, n), k >= 1.

    Raises:
        InvalidTrajectory: As in ``merge``.
    """
    return _keep(checked_waypoints(waypoints))


def largest_reaches(waypoints: ArrayLike) -> Array:
    """The largest reach at each inner waypoint, shape (k - 2,): half the shorter neighbouring leg.

    It is 0 where the path reverses, goes straight on or pauses: nothing is to be rounded there.

    Raises:
        InvalidTrajectory: As in ``merge``.
    """
    points = checked_waypoints(waypoints)
    return _largest_reaches(points, _keep(points))


def _largest_reaches(points: Array, kept: Indices) -> Array:
    reaches = np.zeros(max(len(points) - 2, 0))
    largest_reaches_kernel(points, kept, reaches)
    return reaches


def reach_for_deviation(
    waypoints: ArrayLike, deviation: float, smooth: bool = False, norm: float = 2.0
) -> Array:
    """The reach at each inner waypoint whose curve passes its corner within ``deviation``.

    r = 4 deviation / |u_out - u_in| for a parabola, with 6 for cubics, at most
    ``largest_reaches``; shape (k - 2,).

    Args:
        waypoints: Shape (k, n).
        deviation: Distance in joint space, not negative.
        smooth: Whether cubics round the corners.
        norm: 2 for the Euclidean distance, inf for that of the joint that is farthest off.

    Raises:
        InvalidOption: The deviation is negative or no number.
        InvalidTrajectory: As in ``merge``.
    """
    if not deviation >= 0.0:
        raise InvalidOption(
            f"the blend tolerance is {deviation}", hint="Give a number that is 0 or positive."
        )
    points = checked_waypoints(waypoints)
    kept = _keep(points)
    reaches = _largest_reaches(points, kept)
    if len(kept) > 2:
        _, directions = _legs(points[kept])
        turns = np.linalg.norm(np.diff(directions, axis=0), ord=norm, axis=1)
        inner = kept[1:-1] - 1
        reaches[inner] = np.minimum(reaches[inner], (6.0 if smooth else 4.0) * deviation / turns)
    return reaches


def blend(waypoints: ArrayLike, reaches: ArrayLike, smooth: bool = False) -> JointPath:
    """The polyline through the waypoints with its corners replaced by parabolas or cubics.

    Args:
        waypoints: Shape (k, n), at least two of them distinct.
        reaches: How far before and after each inner waypoint its parabola begins and ends, in
            joint-space arc length, shape (k - 2,); 0 keeps the corner sharp. That of a waypoint
            where the path goes straight on, pauses or reverses is ignored.
        smooth: Whether to round them by cubics, which makes d2q/ds2 continuous.

    Raises:
        InvalidTrajectory: As in ``merge``, or all waypoints are the same.
        InvalidOption: A reach is negative, or more than half of a neighbouring leg.
    """
    points = checked_waypoints(waypoints)
    kept = _keep(points)
    if len(kept) < 2:
        raise InvalidTrajectory(
            "all waypoints are the same: the path has no length",
            hint="Give at least two distinct waypoints.",
        )
    return JointPath(*rounded_kernel(points, _reaches(points, kept, reaches), smooth))


@kernel
def rounded_kernel(waypoints: Array, reaches: Array, smooth: bool) -> tuple[Array, Array]:
    """Coefficients and lengths (p,) of ``blend``.

    Args:
        waypoints: Shape (k, n), at least two of them distinct.
        reaches: Reaches of the corners, not negative, shape (k - 2,).
        smooth: Whether cubics round the corners, or parabolas.

    Returns:
        Coefficients of shape (p, n, 4), or (p, n, 3) for parabolas, and the lengths.
    """
    k, n = waypoints.shape
    kept = np.empty(k, dtype=np.int64)
    count = kept_waypoints_kernel(waypoints, kept)
    widest = np.zeros(max(k - 2, 0))
    largest_reaches_kernel(waypoints, kept[:count], widest)
    corners, lengths = np.empty((count, n)), np.zeros(count - 1)
    directions, ends = np.empty((count - 1, n)), np.zeros(count)
    for i in range(count):
        for joint in range(n):
            corners[i, joint] = waypoints[kept[i], joint]
    for i in range(count - 1):
        lengths[i] = distance(corners[i + 1], corners[i])
        for joint in range(n):
            directions[i, joint] = (corners[i + 1, joint] - corners[i, joint]) / lengths[i]
    for i in range(1, count - 1):
        reach = min(reaches[kept[i] - 1], widest[kept[i] - 1])
        if reach >= _LEAST_REACH * min(lengths[i - 1], lengths[i]):
            ends[i] = reach
    room = 3 * count - 5 if count > 2 else 1
    coefficients, spans = np.zeros((room, n, 4 if smooth else 3)), np.empty(room)
    used = blend_kernel(corners, lengths, directions, ends, smooth, coefficients, spans)
    return coefficients[:used], spans[:used]


@kernel
def blend_kernel(
    corners: Array,
    lengths: Array,
    directions: Array,
    reaches: Array,
    smooth: bool,
    coefficients: Array,
    spans: Array,
) -> int:
    """Write legs and curves in turn; the number of pieces.

    Args:
        corners: Shape (k, n).
        lengths: Lengths of the legs, shape (k - 1,).
        directions: Unit vectors along them, shape (k - 1, n).
        reaches: Reaches of the corners, 0 at the two ends, shape (k,); changed where a leg would be
            left with next to nothing.
        smooth: Whether cubics round the corners, or parabolas.
        coefficients: Coefficients of the pieces, come as zeros, shape (>= 3 k - 5, n, 4), (.., 3)
            for parabolas.
        spans: Lengths of the pieces, shape (>= 3 k - 5,).
    """
    n, used = corners.shape[1], 0
    # Two parabolas that meet in the middle of a leg leave this part of it: rounding, no piece.
    nothing = 1e-15
    # A straight piece between two parabolas has at least this part of its leg. On a shorter one the
    # rounding of a speed would count as an acceleration, x eps / length, and phases of it take no
    # time.
    least_straight = 1e-3
    for i in range(lengths.shape[0]):
        straight = lengths[i] - reaches[i] - reaches[i + 1]
        if nothing * lengths[i] < straight < least_straight * lengths[i]:
            larger = i if reaches[i] > reaches[i + 1] else i + 1
            reaches[larger] -= least_straight * lengths[i]
    for i in range(lengths.shape[0]):
        r = reaches[i]
        if r > 0.0:
            for joint in range(n):
                corner = corners[i, joint]
                before, after = directions[i - 1, joint], directions[i, joint]
                turn, c = after - before, coefficients[used, joint]
                c[0], c[1] = corner - r * before, before
                if not smooth:
                    c[2] = turn / (4.0 * r)
                    continue
                bend = turn / (6.0 * r * r)
                c[3] = bend
                c = coefficients[used + 1, joint]
                c[0], c[1] = corner + r * turn / 6.0, 0.5 * (before + after)
                c[2], c[3] = turn / (2.0 * r), -bend
            spans[used] = r if smooth else 2.0 * r
            used += 1
            if smooth:
                spans[used] = r
                used += 1
        straight = lengths[i] - r - reaches[i + 1]
        if straight > nothing * lengths[i]:
            for joint in range(n):
                u = directions[i, joint]
                coefficients[used, joint, 0] = corners[i, joint] + r * u
                coefficients[used, joint, 1] = u
            spans[used] = straight
            used += 1
    return used


def checked_waypoints(waypoints: ArrayLike) -> Array:
    """The waypoints as an array of their own.

    Raises:
        InvalidTrajectory: As in ``merge``.
    """
    try:
        points = np.array(waypoints, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InvalidTrajectory(f"the waypoints are not an array of numbers: {error}") from None
    if points.ndim != 2 or points.shape[0] < 1 or points.shape[1] < 1:
        raise InvalidTrajectory(
            f"waypoints of shape {points.shape} describe no path",
            hint="Give a list of joint vectors, at least one.",
        )
    if not np.isfinite(points).all():
        row = int(np.argwhere(~np.isfinite(points))[0, 0])
        raise InvalidTrajectory(f"waypoint {row} is not finite")
    return points


def _reaches(points: Array, kept: Indices, reaches: ArrayLike) -> Array:
    limits = _largest_reaches(points, kept)
    values = np.array(reaches, dtype=np.float64).reshape(-1)
    if values.shape != limits.shape or not (values >= 0.0).all():
        raise InvalidOption(
            f"{len(points)} waypoints need {len(limits)} reaches that are 0 or positive",
            hint="Give one number for each inner waypoint.",
        )
    # Where nothing is to be rounded the limit is 0 and the reach without meaning.
    # A reach may exceed half a leg by what computing it rounds off.
    excess = np.where(limits > 0.0, values - (1.0 + 1e-9) * limits, 0.0)
    if (excess > 0.0).any():
        i = int(np.argmax(excess))
        raise InvalidOption(
            f"the reach {values[i]} at waypoint {i + 1} is more than half of a neighbouring leg",
            hint=f"Give at most {limits[i]}.",
            waypoint=i + 1,
        )
    return np.minimum(values, limits)


def _legs(corners: Array) -> tuple[Array, Array]:
    """Lengths (k - 1,) and unit directions (k - 1, n) of the legs."""
    legs = np.diff(corners, axis=0)
    lengths = np.linalg.norm(legs, axis=1)
    return lengths, legs / lengths[:, None]


def _keep(points: Array) -> Indices:
    """Indices of the waypoints that stay: ends, and where the direction changes."""
    kept = np.empty(len(points), dtype=np.int64)
    return kept[: kept_waypoints_kernel(points, kept)]


def certified_reaches(
    checker: Checker,
    waypoints: Array,
    deadline: Deadline,
    *,
    smooth: bool = False,
    most: Array | None = None,
    preferred: Sequence[Checker] = (),
) -> Array:
    """Largest reach of each corner of a polyline whose curve is proved free.

    Args:
        checker: The robot in its scene.
        waypoints: Shape (k, n), merged: no repeated or collinear ones, legs proved free.
        deadline: Corners not checked by then stay sharp.
        smooth: Whether cubics round the corners, as in ``blend``, or parabolas.
        most: Largest reaches asked for, shape (k - 2,).
        preferred: Checkers of falling clearance that are tried first at corners that keep it.

    Returns:
        Reaches for ``blend``, shape (k - 2,); 0 where nothing but a stop could be proved.
    """
    widest = largest_reaches(waypoints)
    if most is not None:
        widest = np.minimum(widest, most)
    found = np.zeros(len(widest))
    trial = widest.copy()
    if deadline.passed:
        return found
    for level in (*preferred, checker):
        is_last = level is checker
        # How often a corner's reach is halved before the motion stops there instead.
        # Reaches tried at a corner to keep a preferred clearance: narrower ones cost much time.
        halvings = 7 if is_last else 3
        if not any(trial.tolist()):
            break
        search = level.round_corners(waypoints, trial, halvings, keep=not is_last, smooth=smooth)
        for done in search:
            np.maximum(found[:done], trial[:done], out=found[:done])
            if deadline.passed:
                return found
        if not is_last:
            trial = np.where(found > 0.0, 0.0, widest)
    return found
