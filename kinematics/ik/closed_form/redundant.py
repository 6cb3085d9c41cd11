"""Closed form for seven joints, spherical shoulder and wrist (S-R-S), by the arm angle.

Shoulder S and wrist W are fixed points of the first and last three joints. |W - S| gives q4; then
the arm may still turn about the line SW. The arm angle is that of the elbow's plane normal about
SW, counted from the horizontal direction z_1 x SW (from y of the base where SW is along axis 1).
The normal is axis 4, with the sign of the elbow's side, so that it exists in the stretched arm too.
Source: "Position-based kinematics for 7-DoF serial manipulators with global configuration control,
joint limit and singularity avoidance", 2018.
"""

import math
from typing import NamedTuple

from compiled.kernel import kernel
from compiled.vec3 import Vector, add, cross, dot, scale
from kinematics.arrays import Array
from kinematics.ik.closed_form.spherical import (
    Flange,
    Turn,
    add_hands_kernel,
    back_kernel,
)
from kinematics.ik.closed_form.structure import SHOULDER, CandidateTable
from kinematics.ik.closed_form.subproblem import (
    ANY_ANGLE,
    BOTH_SIDES,
    NO_SOLUTION,
    SOLVED,
    TINY,
    cosine_kernel,
    orient_kernel,
)


class _Forearm(NamedTuple):
    """The arm from the elbow on, at one side of it.

    Args:
        x: x axis of the last joint's frame, seen from the frame fixed before joint 5.
        z: Axis z of the frame.
        turn: Cosine and sine of q4.
    """

    x: Vector
    z: Vector
    turn: Turn


@kernel(allocates=False)
def _unit(a: Vector) -> Vector:
    r = math.sqrt(dot(a, a))
    return (a[0] / r, a[1] / r, a[2] / r)


@kernel(allocates=False)
def _across(a: Vector, unit: Vector) -> Vector:
    """The direction of ``a`` across ``unit``."""
    d = dot(a, unit)
    return _unit((a[0] - d * unit[0], a[1] - d * unit[1], a[2] - d * unit[2]))


@kernel(allocates=False)
def _reference(s: Vector) -> Vector:
    """The horizontal direction across the unit vector ``s`` that arm angles count from."""
    if s[0] * s[0] + s[1] * s[1] < 1e-16:
        return _across((0.0, 1.0, 0.0), s)
    return _unit((-s[1], s[0], 0.0))


@kernel(allocates=False)
def _elbow(plan: Array, c4: float, s4: float) -> tuple[Vector, Vector]:
    """SW and axis 4 in the frame of joint 3."""
    A, p = plan[4], plan[5]
    x, y, z = c4 * p[4] - s4 * p[8], s4 * p[4] + c4 * p[8], p[12]
    f = (
        A[4] + A[1] * x + A[2] * y + A[3] * z,
        A[8] + A[5] * x + A[6] * y + A[7] * z,
        A[12] + A[9] * x + A[10] * y + A[11] * z,
    )
    return f, (A[3], A[7], A[11])


@kernel(allocates=False)
def _reach(plan: Array) -> tuple[float, float, float]:
    """|SW|^2 = r[0] + r[1] cos(q4) + r[2] sin(q4)."""
    A, p = plan[4], plan[5]
    x, y, z = back_kernel(1.0, 0.0, A, A[4], A[8], A[12])
    square = A[4] * A[4] + A[8] * A[8] + A[12] * A[12]
    square += p[4] * p[4] + p[8] * p[8] + p[12] * p[12]
    return (
        square + 2.0 * z * p[12],
        2.0 * (x * p[4] + y * p[8]),
        2.0 * (y * p[4] - x * p[8]),
    )


@kernel(allocates=False)
def arm_angle_kernel(plan: Array, angles: Array) -> float:
    """The arm angle of a configuration, its angles in plan order."""
    _, a, b = _reach(plan)
    c4, s4 = math.cos(angles[3]), math.sin(angles[3])
    side = 1.0 if a * s4 - b * c4 >= 0.0 else -1.0
    f, normal = _elbow(plan, c4, s4)
    e2 = _across(normal, _unit(f))
    s, g2 = f, (side * e2[0], side * e2[1], side * e2[2])
    for j in (2, 1, 0):
        c, d = math.cos(angles[j]), math.sin(angles[j])
        s = _turn(plan, j, c, d, s)
        g2 = _turn(plan, j, c, d, g2)
    s = _unit(s)
    r = _reference(s)
    t = cross(s, r)
    return math.atan2(dot(g2, t), dot(g2, r))


@kernel(allocates=False)
def _turn(plan: Array, j: int, c: float, s: float, v: Vector) -> Vector:
    """A direction behind joint j as seen before its turn and, but for the first, its offset."""
    x, y, z = c * v[0] - s * v[1], s * v[0] + c * v[1], v[2]
    if j == 0:
        return (x, y, z)
    A = plan[1 + j]
    return (
        A[1] * x + A[2] * y + A[3] * z,
        A[5] * x + A[6] * y + A[7] * z,
        A[9] * x + A[10] * y + A[11] * z,
    )


@kernel(allocates=False)
def redundant_kernel(
    plan: Array, flange: Flange, table: CandidateTable, angle: float, count: int
) -> int:
    """Add the candidates for one pose and arm angle [rad] from row ``count`` on; the new count."""
    x, z, o = flange.x, flange.z, flange.origin
    r0, a, b = _reach(plan)
    square = dot(o, o)
    status, cp, sp, cd, sd = cosine_kernel(a, b, square - r0, table.slack)
    if status != SOLVED or square < TINY:
        return count
    s = _unit(o)
    r = _reference(s)
    t2 = cross(s, r)
    ca, sa = math.cos(angle), math.sin(angle)
    for j in range(2):
        side = 1.0 - 2.0 * j
        if j == 1 and sd < TINY:
            break
        c4, s4 = cp * cd - side * sp * sd, sp * cd + side * cp * sd
        f, normal = _elbow(plan, c4, s4)
        e1 = _unit(f)
        e2 = _across(normal, e1)
        e3 = cross(e1, e2)
        g2 = (
            side * (ca * r[0] + sa * t2[0]),
            side * (ca * r[1] + sa * t2[1]),
            side * (ca * r[2] + sa * t2[2]),
        )
        g3 = cross(s, g2)
        # R = [s g2 g3] [e1 e2 e3]^T by columns.
        m0 = add(add(scale(e1[0], s), scale(e2[0], g2)), scale(e3[0], g3))
        m1 = add(add(scale(e1[1], s), scale(e2[1], g2)), scale(e3[1], g3))
        m2 = add(add(scale(e1[2], s), scale(e2[2], g2)), scale(e3[2], g3))
        w0 = _behind(plan, c4, s4, m0, m1, m2, x)
        w2 = _behind(plan, c4, s4, m0, m1, m2, z)
        forearm = _Forearm(w0, w2, (c4, s4))
        count = _add_shoulders(plan, table, m0, m2, forearm, 2.0 * j, count)
    return count


@kernel(allocates=False)
def _behind(
    plan: Array, c4: float, s4: float, m0: Vector, m1: Vector, m2: Vector, v: Vector
) -> Vector:
    """A direction as the frame before joint 5's turn sees it."""
    x, y, z = dot(m0, v), dot(m1, v), dot(m2, v)
    x, y, z = back_kernel(1.0, 0.0, plan[4], x, y, z)
    return back_kernel(c4, s4, plan[5], x, y, z)


@kernel(allocates=False)
def _add_shoulders(
    plan: Array, table: CandidateTable, m0: Vector, m2: Vector, forearm: _Forearm, code: float,
    count: int,
) -> int:  # fmt: skip
    """Add both sides of the shoulder, each with both of the wrist.

    Args:
        plan: The arm.
        table: The candidates.
        m0: x axis of joint 3's frame, seen from the frame fixed before joint 1.
        m2: Axis z of the frame.
        forearm: The arm from the elbow on.
        code: Bits of the branch so far.
        count: Rows that are taken.
    """
    free, hand_axes = table.free, (forearm.x, forearm.z)
    for i in range(2):
        status, ca, sa, cb, sb, cc, sc = orient_kernel(
            plan[2], plan[3], plan[SHOULDER], m0, m2, 1.0 - 2.0 * i, table.slack
        )
        if status == NO_SOLUTION:
            break
        if status != ANY_ANGLE:
            first = (ca, sa, cb, sb, cc, sc)
            count = add_hands_kernel(
                plan, table, hand_axes, first, forearm.turn, code + 4.0 * i, 0.0, count
            )
            if status == BOTH_SIDES:
                break
            continue
        # Axes 1 and 3 are one.
        same = 1.0 if m2[2] > 0.0 else -1.0
        q3, number = math.atan2(sc, cc), count + 1.0
        for k in range(2 * free.shape[0]):
            half = k // 2
            a = free[half, 0] if k % 2 == 0 else same * (q3 - free[half, 2])
            c = q3 - same * a
            first = (math.cos(a), math.sin(a), cb, sb, math.cos(c), math.sin(c))
            count = add_hands_kernel(
                plan, table, hand_axes, first, forearm.turn, code, number, count
            )
        break
    return count
