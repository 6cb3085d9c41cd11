"""Bounds of the residuals of path constraints for every instant of a motion, not at samples.

A row bounds a scalar of the configuration (``planning.constraints.row``); its residual is

    r(t) = max(value(t) - upper, lower - value(t)),

and it holds where that is at most 0. Over an interval of time the value is enclosed from its value
in the middle and the bounds of ``relative_motion``. Intervals that these leave open are halved, so
the residual is bounded for all t. Values and bounds are the proof's own: planners judge their edges
by ``planning.constraints.edge_bounds``, and a fault there must not be believed here.
"""

import math

from compiled.kernel import kernel
from compiled.vec3 import Vector, cross, dot, scale, subtract
from kinematics.arrays import Array, Indices
from planning.constraints.row import Column, RowKind
from planning.proof.collision.separating_direction import rounding_bound
from planning.proof.constraints.rotation_bounds import rotation_bounds
from planning.proof.motion_bounds import RADIUS, VALUE
from planning.proof.relative_motion import RelativeMotion, axis_motion, relative_motion

#: Below this a length or a sine names no direction.
_NO_DIRECTION = 1e-12
#: What rounding may take off a cosine.
_COSINE_ROUNDING = 1e-14

_JOINT = int(RowKind.JOINT)
_COORDINATE = int(RowKind.COORDINATE)
_DISTANCE = int(RowKind.DISTANCE)
_ANGLE = int(RowKind.ANGLE)
_LOOK = int(RowKind.LOOK)


@kernel
def row_bounds(
    types: Indices, row: Array, frames: Array, joints: Array, half: float, lengths: float
) -> tuple[float, float]:
    """Residual of a row in the middle of an interval, and an upper bound of it all over.

    Args:
        types: Types of the joints, shape (n,).
        row: Row from ``pack``, shape (WIDTH,).
        frames: T_base_joint in the middle of the interval, shape (n, 4, 4).
        joints: Joints from ``enclose``, shape (n, JOINT_COLUMNS).
        half: Half the interval's length [s].
        lengths: Size of the numbers that the frames are summed from [m].
    """
    value, lowest, highest = value_bounds(types, row, frames, joints, half, lengths)
    residual = max(value - row[Column.UPPER], row[Column.LOWER] - value)
    return residual, max(highest - row[Column.UPPER], row[Column.LOWER] - lowest)


@kernel
def value_bounds(
    types: Indices, row: Array, frames: Array, joints: Array, half: float, lengths: float
) -> tuple[float, float, float]:
    """Value of a row in the middle of an interval, and its least and largest all over.

    Arguments are those of ``row_bounds``.
    """
    kind, carrier, reference = (
        int(row[Column.KIND]),
        int(row[Column.CARRIER]),
        int(row[Column.REFERENCE]),
    )
    if kind == _JOINT:
        value, radius = joints[carrier, VALUE], joints[carrier, RADIUS]
        return value, value - radius, value + radius
    n = types.shape[0]
    point, center = (
        _point_in_base(frames, row, Column.POINT.value, carrier),
        _point_in_base(frames, row, Column.CENTER.value, reference),
    )
    d = _vector_in_base(frames, row, Column.DIRECTION.value, reference)
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
        a = _vector_in_base(frames, row, Column.AXIS.value, carrier)
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
