"""Bounds of rotation vectors over an interval of motion.

Rows of path constraints, packed for the proof's kernels.
"""

import math
from collections.abc import Sequence

import numpy as np

from compiled.kernel import kernel
from compiled.vec3 import Vector, cross, dot, scale
from kinematics.arrays import Array
from planning.constraints.row import WIDTH, Column, Row
from planning.proof.relative_motion import RelativeMotion


def pack(rows: Sequence[Row]) -> Array:
    """Rows as the kernels here read them, shape (m, WIDTH)."""
    packed = np.empty((len(rows), WIDTH))
    for k, row in enumerate(rows):
        packed[k, : Column.POINT] = row.kind, row.carrier, row.reference
        packed[k, Column.POINT : Column.LOWER] = np.concatenate(
            [row.point, row.axis, row.center, row.direction]
        )
        packed[k, Column.LOWER : Column.TURN] = row.lower, row.upper
        packed[k, Column.TURN :] = row.turn.reshape(9)
    return packed


#: Below this a sine names no direction.
_NO_DIRECTION = 1e-12


@kernel
def rotation_bounds(
    frames: Array, row: Array, motion: RelativeMotion, half: float, lost: float
) -> tuple[float, float, float]:
    """Component of e = log(K X) along a row's axis while X turns.

    e' = J^-1 w with |J^-1| = (t / 2) / sin(t / 2) at a rotation by t; across half a turn e changes
    its sign alone, so that the size of a component has no jump. For t <= 1, |J^-1| <= 1.05 and its
    slope is at most 0.675 |e'|, so that |e''| <= 1.05 |w'| + 0.71 |w|^2.
    """
    E, covector = np.empty((3, 3)), (0.0, 0.0, 0.0)
    e = _rotation_error(frames, row, E)
    a = (row[Column.AXIS], row[Column.AXIS + 1], row[Column.AXIS + 2])
    value, angle = dot(a, e), math.sqrt(dot(e, e))
    largest = angle + motion.turned + lost
    if largest >= math.pi:
        size = abs(value) + 0.5 * math.pi * (motion.turned + lost)
        if row[Column.LOWER] != -row[Column.UPPER]:
            size = math.pi
        return value, -size, size
    factor = 0.5 * largest / math.sin(0.5 * largest) if largest > 1e-6 else 1.0 + 1e-12
    change = factor * (motion.turned + lost)
    if largest <= 1.0:
        covector = _log_covector(frames, row, e, a)
        second = 1.05 * motion.turn_acceleration + 0.71 * motion.turn_speed * motion.turn_speed
        curved = abs(dot(covector, motion.turn_rate)) * half + 1.05 * motion.turn_bend
        curved += 0.5 * second * half * half + 1.05 * lost
        change = min(change, curved)
    return value, value - change, value + change


@kernel(allocates=False)
def _rotation_error(frames: Array, row: Array, E: Array) -> Vector:
    """Write K X into E (3, 3), X the carrier's rotation seen from the reference; its log."""
    carrier, reference = int(row[Column.CARRIER]), int(row[Column.REFERENCE])
    for i in range(3):
        for column in range(3):
            E[i, column] = 0.0
            for k in range(3):
                x = 0.0
                for r in range(3):
                    left = 1.0 * (r == k) if reference < 0 else frames[reference, r, k]
                    right = 1.0 * (r == column) if carrier < 0 else frames[carrier, r, column]
                    x += left * right
                E[i, column] += row[Column.TURN + 3 * i + k] * x
    return rotation_log(E)


@kernel(allocates=False)
def rotation_log(E: Array) -> Vector:
    """Rotation vector of E (3, 3), from the quaternion with the largest component."""
    trace = E[0, 0] + E[1, 1] + E[2, 2]
    best, k = trace, 3
    for i in range(3):
        if E[i, i] > best:
            best, k = E[i, i], i
    if k == 3:
        w = 1.0 + trace
        v = (E[2, 1] - E[1, 2], E[0, 2] - E[2, 0], E[1, 0] - E[0, 1])
    elif k == 0:
        w = E[2, 1] - E[1, 2]
        v = (1.0 + 2.0 * E[0, 0] - trace, E[0, 1] + E[1, 0], E[0, 2] + E[2, 0])
    elif k == 1:
        w = E[0, 2] - E[2, 0]
        v = (E[0, 1] + E[1, 0], 1.0 + 2.0 * E[1, 1] - trace, E[1, 2] + E[2, 1])
    else:
        w = E[1, 0] - E[0, 1]
        v = (E[0, 2] + E[2, 0], E[1, 2] + E[2, 1], 1.0 + 2.0 * E[2, 2] - trace)
    if w < 0.0:
        w, v = -w, scale(-1.0, v)
    length = math.sqrt(dot(v, v))
    if length < _NO_DIRECTION * w:
        return scale(2.0 / w, v)
    return scale(2.0 * math.atan2(length, w) / length, v)


@kernel(allocates=False)
def _log_covector(frames: Array, row: Array, e: Vector, a: Vector) -> Vector:
    """The covector, in the base's axes, that makes the rate of a . e of an angular velocity.

    K^T (a + e x a / 2 + (1 - (t / 2) cot(t / 2)) / t^2  e x (e x a)) in the reference, t = |e|.
    """
    square = dot(e, e)
    factor = 1.0 / 12.0 + square / 720.0
    if square >= 1e-8:
        half = 0.5 * math.sqrt(square)
        factor = (1.0 - half * math.cos(half) / math.sin(half)) / square
    first = cross(e, a)
    second = cross(e, first)
    b = (
        a[0] + 0.5 * first[0] + factor * second[0],
        a[1] + 0.5 * first[1] + factor * second[1],
        a[2] + 0.5 * first[2] + factor * second[2],
    )
    c = (
        row[Column.TURN] * b[0] + row[Column.TURN + 3] * b[1] + row[Column.TURN + 6] * b[2],
        row[Column.TURN + 1] * b[0] + row[Column.TURN + 4] * b[1] + row[Column.TURN + 7] * b[2],
        row[Column.TURN + 2] * b[0] + row[Column.TURN + 5] * b[1] + row[Column.TURN + 8] * b[2],
    )
    reference = int(row[Column.REFERENCE])
    if reference < 0:
        return c
    R = frames[reference]
    return (
        R[0, 0] * c[0] + R[0, 1] * c[1] + R[0, 2] * c[2],
        R[1, 0] * c[0] + R[1, 1] * c[1] + R[1, 2] * c[2],
        R[2, 0] * c[0] + R[2, 1] * c[1] + R[2, 2] * c[2],
    )
