"""Bounds of the residuals of path constraints for every instant of a motion, not at samples.

A row bounds a scalar of the configuration (``planning.constraints.row``); its residual is

    r(t) = max(value(t) - upper, lower - value(t)),

and it holds where that is at most 0. Over an interval of time the value is enclosed from its value
in the middle and the bounds of ``relative_motion``. Intervals that these leave open are halved, so
the residual is bounded for all t. Values and bounds are the proof's own: planners judge their edges
by ``planning.constraints.edge_bounds``, and a fault there must not be believed here.
"""

import math
from collections.abc import Sequence
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from kinematics.arrays import Array, Indices
from kinematics.chain import Chain
from kinematics.compiled.kernel import kernel
from kinematics.trajectory import Trajectory
from kinematics.vec3 import Vector, cross, dot, scale, subtract
from planning.constraints.row import Row, RowKind
from planning.proof.joint_frames import forward_kernel
from planning.proof.motion_bounds import JOINT_COLUMNS, RADIUS, VALUE, enclose, piece_length, reach
from planning.proof.relative_motion import RelativeMotion, axis_motion, relative_motion
from planning.proof.residual_row import (
    AXIS,
    CARRIER,
    CENTER,
    DIRECTION,
    KIND,
    LOWER,
    POINT,
    REFERENCE,
    UPPER,
    pack,
)
from planning.proof.rotation_bounds import rotation_bounds
from planning.proof.separating_direction import rounding_bound

#: Residuals that count as none: what rounding leaves of a bound that is met exactly [m or rad].
TOLERANCE = 1e-6
#: The residual told is at most this share of a row's width above the true one.
_SHARP = 0.02
#: Halvings of a piece.
_MAX_DEPTH = 60
#: Halvings after which the beginning of a violation is known well enough.
_BEGIN_DEPTH = 40
#: Intervals looked at for one constraint, at most.
_MAX_INTERVALS = 2_000_000
#: Below this a length or a sine names no direction.
_NO_DIRECTION = 1e-12
#: What rounding may take off a cosine.
_COSINE_ROUNDING = 1e-14

_JOINT = int(RowKind.JOINT)
_COORDINATE = int(RowKind.COORDINATE)
_DISTANCE = int(RowKind.DISTANCE)
_ANGLE = int(RowKind.ANGLE)
_LOOK = int(RowKind.LOOK)


class Verdict(IntEnum):
    """Verdict on rows along a motion."""

    HOLDS = 0
    VIOLATED = 1
    UNDECIDED = 2


class Report(NamedTuple):
    """Report of the kernel (m rows).

    Args:
        worst: Upper bounds of the residuals for all t, shape (m,); of what was looked at where a
            row is violated.
        times: When the largest residuals were found, shape (m,) [s].
        best: These residuals, shape (m,) [m or rad].
        first: Time [s], row and residual of the earliest violation that was found, shape (3,).
    """

    worst: Array
    times: Array
    best: Array
    first: Array


class ResidualBounds(NamedTuple):
    """Bounds of the residuals of rows along a motion (m rows).

    Args:
        verdict: Whether all rows hold for all t.
        worst: Upper bounds of the residuals for all t, shape (m,) [m or rad]; where a row is
            violated, of what was looked at.
        times: When the largest residuals were found, shape (m,) [s].
        time: The earliest violation that was found, or where the rows are undecided [s].
        row: The row it is of.
        residual: Its residual there [m or rad].
    """

    verdict: Verdict
    worst: Array
    times: Array
    time: float
    row: int
    residual: float


def bound_residuals(chain: Chain, rows: Sequence[Row], trajectory: Trajectory) -> ResidualBounds:
    """Bound the residuals of rows along a trajectory, for every t.

    Args:
        chain: The robot.
        rows: On it, at least one.
        trajectory: Of all its joints, in its order.
    """
    m = len(rows)
    report = Report(
        np.full(m, -np.inf), np.zeros(m), np.full(m, -np.inf), np.array([np.inf, 0.0, 0.0])
    )
    gaps = np.array([max(_SHARP * row.width, TOLERANCE) for row in rows])
    verdict = bound_residuals_kernel(
        chain.joint_types,
        chain.offsets,
        pack(rows),
        trajectory.breaks,
        trajectory.coefficients,
        gaps,
        report,
    )
    time, row, residual = report.first.tolist()
    return ResidualBounds(
        Verdict(verdict), report.worst, report.times, float(time), int(row), float(residual)
    )


def sample_residuals(
    chain: Chain, rows: Sequence[Row], trajectory: Trajectory, times: Array
) -> Array:
    """Residuals of rows at times (k,) of a trajectory, shape (k, m) [m or rad].

    Args:
        chain: The robot.
        rows: On it.
        trajectory: Of all its joints, in its order.
        times: Within the trajectory [s].
    """
    residuals = np.empty((len(times), len(rows)))
    sample_residuals_kernel(
        chain.joint_types, chain.offsets, pack(rows), trajectory.sample(times), residuals
    )
    return residuals


@kernel
def bound_residuals_kernel(
    types: Indices,
    offsets: Array,
    rows: Array,
    breaks: Array,
    coefficients: Array,
    gaps: Array,
    report: Report,
) -> int:
    """Bound residuals along a motion; earliest intervals first, a violation ends it.

    Args:
        types: Of the joints, shape (n,).
        offsets: T_(i-1)_i of every joint at 0, shape (n, 4, 4).
        rows: From ``pack``, shape (m, WIDTH).
        breaks: Of the motion, shape (p + 1,) [s].
        coefficients: Of the motion, shape (p, n, k).
        gaps: How far above the largest residual found a bound may be, shape (m,) [m or rad].
        report: Filled.

    Returns:
        A ``Verdict``.
    """
    n, m, size = offsets.shape[0], rows.shape[0], coefficients.shape[2]
    shift, joints, frames = np.empty((2, size)), np.empty((n, JOINT_COLUMNS)), np.empty((n, 4, 4))
    is_open = np.ones((_MAX_DEPTH + 2, m), dtype=np.bool_)
    spans, depths = np.empty((_MAX_DEPTH + 2, 2)), np.zeros(_MAX_DEPTH + 2, dtype=np.int64)
    looked_at = 0
    for piece in range(coefficients.shape[0]):
        spans[0, 0], spans[0, 1], depths[0] = 0.0, piece_length(breaks, piece), 0
        top = 1
        while top > 0:
            top -= 1
            low, high, depth = spans[top, 0], spans[top, 1], depths[top]
            middle = 0.5 * (low + high)
            half, time = max(high - middle, middle - low) * (1.0 + 4e-16), breaks[piece] + middle
            enclose(coefficients[piece], middle, half, shift, joints)
            forward_kernel(types, offsets, joints[:, VALUE], frames)
            lengths, left = reach(types, offsets, joints), False
            for i in range(m):
                if is_open[depth, i]:
                    residual, bound = row_bounds(types, rows[i], frames, joints, half, lengths)
                    is_open[depth + 1, i] = not _note(report, i, residual, bound, gaps[i], time)
                    left = left or is_open[depth + 1, i]
                else:
                    is_open[depth + 1, i] = False
            looked_at += 1
            violated = report.first[0] < np.inf
            if violated and report.first[0] == time:
                top = 0  # only what comes before it is of interest now
            if not left:
                continue
            last = depth == _MAX_DEPTH or looked_at >= _MAX_INTERVALS
            if last or (violated and depth >= _BEGIN_DEPTH):
                if not violated:
                    report.first[0], report.first[1] = time, np.argmax(is_open[depth + 1])
                    return 2
                return 1
            if report.first[0] != time:
                spans[top, 0], spans[top, 1], depths[top] = middle, high, depth + 1
                top += 1
            spans[top, 0], spans[top, 1], depths[top] = low, middle, depth + 1
            top += 1
        if report.first[0] < np.inf:
            return 1
    return 0


@kernel
def _note(report: Report, i: int, residual: float, bound: float, gap: float, time: float) -> bool:
    """Note a row's residual in the middle of an interval and its bound; whether it is settled."""
    if residual > report.best[i]:
        report.best[i], report.times[i] = residual, time
    if residual > TOLERANCE and time < report.first[0]:
        report.first[0], report.first[1], report.first[2] = time, i, residual
    settled = bound <= TOLERANCE and bound <= report.best[i] + gap
    if settled:
        report.worst[i] = max(report.worst[i], bound)
    elif residual > TOLERANCE:
        report.worst[i] = max(report.worst[i], residual)
    return settled


@kernel
def sample_residuals_kernel(
    types: Indices, offsets: Array, rows: Array, q: Array, residuals: Array
) -> None:
    """Write the residuals of rows (m, WIDTH) at configurations q (k, n), shape (k, m)."""
    n = offsets.shape[0]
    joints, frames = np.zeros((n, JOINT_COLUMNS)), np.empty((n, 4, 4))
    for k in range(q.shape[0]):
        joints[:, VALUE] = q[k]
        forward_kernel(types, offsets, q[k], frames)
        for i in range(rows.shape[0]):
            residuals[k, i], _ = row_bounds(types, rows[i], frames, joints, 0.0, 0.0)


@kernel
def row_bounds(
    types: Indices, row: Array, frames: Array, joints: Array, half: float, lengths: float
) -> tuple[float, float]:
    """Residual of a row in the middle of an interval, and an upper bound of it all over.

    Args:
        types: Of the joints, shape (n,).
        row: From ``pack``, shape (WIDTH,).
        frames: T_base_joint in the middle of the interval, shape (n, 4, 4).
        joints: From ``enclose``, shape (n, JOINT_COLUMNS).
        half: Half the interval's length [s].
        lengths: Size of the numbers that the frames are summed from [m].
    """
    value, lowest, highest = value_bounds(types, row, frames, joints, half, lengths)
    residual = max(value - row[UPPER], row[LOWER] - value)
    return residual, max(highest - row[UPPER], row[LOWER] - lowest)


@kernel
def value_bounds(
    types: Indices, row: Array, frames: Array, joints: Array, half: float, lengths: float
) -> tuple[float, float, float]:
    """Value of a row in the middle of an interval, and its least and largest all over.

    Arguments are those of ``row_bounds``.
    """
    kind, carrier, reference = int(row[KIND]), int(row[CARRIER]), int(row[REFERENCE])
    if kind == _JOINT:
        value, radius = joints[carrier, VALUE], joints[carrier, RADIUS]
        return value, value - radius, value + radius
    n = types.shape[0]
    point, center = (
        _point_in_base(frames, row, POINT, carrier),
        _point_in_base(frames, row, CENTER, reference),
    )
    d = _vector_in_base(frames, row, DIRECTION, reference)
    motion = relative_motion(types, frames, point, carrier, reference, joints, half)
    y = subtract(point, center)
    if kind in (_COORDINATE, _DISTANCE):
        size = math.sqrt(dot(y, y)) + lengths
        lost = rounding_bound(n, size) if half > 0.0 or lengths > 0.0 else 0.0
        if kind == _COORDINATE:
            value = dot(d, y)
            change = min(abs(dot(d, motion.velocity)) * half + motion.bend, motion.moved) + lost
            return value, value - change, value + change
        return _distance_bounds(y, d, motion, half, lost)
    lost = rounding_bound(n, 1.0)
    if kind in (_ANGLE, _LOOK):
        a = _vector_in_base(frames, row, AXIS, carrier)
        moved, bend = axis_motion(types, frames, a, carrier, reference, joints, half)
        # A chord of this length spans an angle that is somewhat larger.
        swept = min(motion.turned, 2.0 * math.asin(min(0.5 * moved, 1.0))) + lost
        if kind == _LOOK:
            return _sight_bounds(a, y, swept, motion.moved)
        value = _angle(a, d)
        cosine = dot(a, d)
        change = abs(dot(d, cross(motion.turn_rate, a))) * half + bend + _COSINE_ROUNDING
        widest = math.acos(min(max(cosine - change, -1.0), 1.0))
        narrowest = math.acos(min(max(cosine + change, -1.0), 1.0))
        return value, max(narrowest - lost, value - swept), min(widest + lost, value + swept)
    return rotation_bounds(frames, row, motion, half, lost)


@kernel(allocates=False)
def _point_in_base(frames: Array, row: Array, first: int, joint: int) -> Vector:
    """A row's point, fixed to a joint, in the base frame [m]."""
    x, y, z = _vector_in_base(frames, row, first, joint)
    if joint < 0:
        return x, y, z
    return x + frames[joint, 0, 3], y + frames[joint, 1, 3], z + frames[joint, 2, 3]


@kernel(allocates=False)
def _vector_in_base(frames: Array, row: Array, first: int, joint: int) -> Vector:
    """A row's vector, fixed to a joint, in the base's axes."""
    v = (row[first], row[first + 1], row[first + 2])
    if joint < 0:
        return v
    R = frames[joint]
    return (
        R[0, 0] * v[0] + R[0, 1] * v[1] + R[0, 2] * v[2],
        R[1, 0] * v[0] + R[1, 1] * v[1] + R[1, 2] * v[2],
        R[2, 0] * v[0] + R[2, 1] * v[1] + R[2, 2] * v[2],
    )


@kernel
def _angle(a: Vector, b: Vector) -> float:
    """Angle of two unit vectors [rad], exact near 0 and pi too."""
    c = cross(a, b)
    return math.atan2(math.sqrt(dot(c, c)), dot(a, b))


@kernel(allocates=False)
def _distance_bounds(
    y: Vector, d: Vector, motion: RelativeMotion, half: float, lost: float
) -> tuple[float, float, float]:
    """Length of y without its part along d; convex in y, so largest at an end of its motion."""
    y = subtract(y, scale(dot(d, y), d))
    v = subtract(motion.velocity, scale(dot(d, motion.velocity), d))
    value, largest = math.sqrt(dot(y, y)), 0.0
    for sign in (half, -half):
        end = (y[0] + sign * v[0], y[1] + sign * v[1], y[2] + sign * v[2])
        largest = max(largest, math.sqrt(dot(end, end)))
    highest = min(largest + motion.bend, value + motion.moved) + lost
    return value, max(value - motion.moved - lost, 0.0), highest


@kernel(allocates=False)
def _sight_bounds(a: Vector, y: Vector, swept: float, moved: float) -> tuple[float, float, float]:
    """Angle of the axis a and the line of sight -y while these turn and move."""
    distance = math.sqrt(dot(y, y))
    if distance <= _NO_DIRECTION:
        return math.pi, 0.0, math.pi
    value = _angle(a, scale(-1.0 / distance, y))
    sight = math.asin(moved / distance) if moved < distance else math.pi
    change = swept + sight
    return value, max(value - change, 0.0), min(value + change, math.pi)
