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
"""

import itertools

import numpy as np
from numpy.typing import ArrayLike

from kinematics.arrays import Array
from kinematics.errors import InvalidOption, InvalidTrajectory
from planning.timing.path import SAME_DIRECTION, JointPath

# Waypoints nearer than this, relative to the largest coordinate (at least 1), are the same one:
# what rounding leaves of a direction there is no direction.
_SAME_POINT = 1e-12
# Within this of a full reversal, |u_in + u_out|, the parabola would turn round before it gets to
# the corner: the motion stops at the corner instead.
_REVERSAL = 1e-3
# A reach below this part of the shorter leg would let the corner be passed at a thousandth of the
# leg's speed: a stop costs no more.
_LEAST_REACH = 1e-6
# Two parabolas that meet in the middle of a leg leave this part of it: rounding, no piece.
_NOTHING = 1e-15
# A straight piece between two parabolas has at least this part of its leg. On a shorter one the
# rounding of a speed would count as an acceleration, x eps / length.
_LEAST_STRAIGHT = 1e-7
# A reach may exceed half a leg by what computing it rounds off.
_ROUNDING = 1e-9


def merge(waypoints: ArrayLike) -> Array:
    """The waypoints without those that repeat their predecessor or lie on a straight leg.

    Args:
        waypoints: Shape (k, n), k >= 1.

    Returns:
        Shape (k', n); the first and the last waypoint always stay. One row where all are the same.

    Raises:
        InvalidTrajectory: There is no waypoint, rows differ in length, or a value is not finite.
    """
    points = _points(waypoints)
    return points[_keep(points)]


def largest_reaches(waypoints: ArrayLike) -> Array:
    """The largest reach at each inner waypoint, shape (k - 2,): half the shorter neighbouring leg.

    It is 0 where the path reverses, goes straight on or pauses: nothing is to be rounded there.

    Raises:
        InvalidTrajectory: As in ``merge``.
    """
    points = _points(waypoints)
    kept = _keep(points)
    reaches = np.zeros(max(len(points) - 2, 0))
    if len(kept) > 2:
        lengths, directions = _legs(points[kept])
        half = 0.5 * np.minimum(lengths[:-1], lengths[1:])
        reversal = np.linalg.norm(directions[1:] + directions[:-1], axis=1) < _REVERSAL
        reaches[kept[1:-1] - 1] = np.where(reversal, 0.0, half)
    return reaches


def reach_for_deviation(waypoints: ArrayLike, deviation: float, smooth: bool = False) -> Array:
    """The reach at each inner waypoint whose curve passes its corner within ``deviation``.

    r = 4 deviation / |u_out - u_in| for a parabola, with 6 for cubics, at most
    ``largest_reaches``; shape (k - 2,).

    Args:
        waypoints: Shape (k, n).
        deviation: Euclidean distance in joint space, not negative.
        smooth: Whether cubics round the corners.

    Raises:
        InvalidOption: The deviation is negative or no number.
        InvalidTrajectory: As in ``merge``.
    """
    if not deviation >= 0.0:
        raise InvalidOption(
            f"the blend tolerance is {deviation}", hint="Give a number that is 0 or positive."
        )
    points = _points(waypoints)
    reaches = largest_reaches(points)
    kept = _keep(points)
    if len(kept) > 2:
        _, directions = _legs(points[kept])
        turns = np.linalg.norm(np.diff(directions, axis=0), axis=1)
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
    points = _points(waypoints)
    kept = _keep(points)
    if len(kept) < 2:
        raise InvalidTrajectory(
            "all waypoints are the same: the path has no length",
            hint="Give at least two distinct waypoints.",
        )
    corner_reaches = _reaches(points, reaches)[kept[1:-1] - 1]
    corners = points[kept]
    lengths, directions = _legs(corners)
    least = _LEAST_REACH * np.minimum(lengths[:-1], lengths[1:])
    corner_reaches[corner_reaches < least] = 0.0
    ends = np.concatenate([[0.0], corner_reaches, [0.0]])
    return _alternate_pieces(corners, lengths, directions, ends, smooth)


def _alternate_pieces(
    corners: Array, lengths: Array, directions: Array, reaches: Array, smooth: bool
) -> JointPath:
    """Legs and curves in turn; ``reaches`` has one value a corner, 0 at the two ends."""
    zero = np.zeros((corners.shape[1], 2 if smooth else 1))
    reaches = _usable_reaches(lengths, reaches)
    coefficients, spans = [], []
    for i, (length, u) in enumerate(zip(lengths, directions, strict=True)):
        r = reaches[i]
        if r > 0.0:
            curve = _cubics if smooth else _parabola
            for piece, span in curve(corners[i], directions[i - 1], u, float(r)):
                coefficients.append(piece)
                spans.append(span)
        straight = length - r - reaches[i + 1]
        if straight > _NOTHING * length:
            coefficients.append(np.column_stack([corners[i] + r * u, u, zero]))
            spans.append(straight)
    return JointPath(np.array(coefficients), np.array(spans))


def _parabola(corner: Array, u_in: Array, u_out: Array, r: float) -> list[tuple[Array, float]]:
    start = corner - r * u_in
    return [(np.column_stack([start, u_in, (u_out - u_in) / (4.0 * r)]), 2.0 * r)]


def _cubics(corner: Array, u_in: Array, u_out: Array, r: float) -> list[tuple[Array, float]]:
    turn, zero = u_out - u_in, np.zeros_like(corner)
    bend = turn / (6.0 * r * r)
    first = np.column_stack([corner - r * u_in, u_in, zero, bend])
    middle, along = corner + r * turn / 6.0, 0.5 * (u_in + u_out)
    second = np.column_stack([middle, along, turn / (2.0 * r), -bend])
    return [(first, r), (second, r)]


def _usable_reaches(lengths: Array, reaches: Array) -> Array:
    """Reaches that leave of each leg either nothing or a piece long enough to reckon with."""
    reaches = reaches.copy()
    for i, length in enumerate(lengths):
        straight = length - reaches[i] - reaches[i + 1]
        if _NOTHING * length < straight < _LEAST_STRAIGHT * length:
            larger = i if reaches[i] > reaches[i + 1] else i + 1
            reaches[larger] -= _LEAST_STRAIGHT * length
    return reaches


def _points(waypoints: ArrayLike) -> Array:
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


def _reaches(points: Array, reaches: ArrayLike) -> Array:
    limits = largest_reaches(points)
    values = np.array(reaches, dtype=np.float64).reshape(-1)
    if values.shape != limits.shape or not (values >= 0.0).all():
        raise InvalidOption(
            f"{len(points)} waypoints need {len(limits)} reaches that are 0 or positive",
            hint="Give one number for each inner waypoint.",
        )
    # Where nothing is to be rounded the limit is 0 and the reach without meaning.
    excess = np.where(limits > 0.0, values - (1.0 + _ROUNDING) * limits, 0.0)
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


def _keep(points: Array) -> "np.ndarray[tuple[int], np.dtype[np.int64]]":
    """Indices of the waypoints that stay: ends, and where the direction changes.

    A direction is compared with that of the whole leg since the last waypoint that stayed, so a
    slow bend of many small turns is not taken for a straight line.
    """
    near = _SAME_POINT * max(1.0, float(np.abs(points).max()))
    distinct = [0]
    for i in range(1, len(points)):
        if np.linalg.norm(points[i] - points[distinct[-1]]) > near:
            distinct.append(i)
    if len(distinct) > 1:
        # The very last waypoint stands for those it repeats: the goal is met exactly.
        distinct[-1] = len(points) - 1
    kept = distinct[:1]
    for here, after in itertools.pairwise(distinct[1:]):
        before = points[here] - points[kept[-1]]
        ahead = points[after] - points[here]
        turn = ahead / np.linalg.norm(ahead) - before / np.linalg.norm(before)
        if np.linalg.norm(turn) > SAME_DIRECTION:
            kept.append(here)
    return np.array(kept + distinct[1:][-1:], dtype=np.int64)
