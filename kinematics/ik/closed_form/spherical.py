"""Closed form for six revolute joints whose last three axes meet in one point (decoupling).

The wrist point W depends on the first three joints only. In the frame A_1 fixed before joint 1 it
is p, and with f(q3) = p_3 + R_3 Rz(q3) w in the frame that turns with joint 2,

    Rz(-q1) p = p_2 + R_2 Rz(q2) f(q3).

The turn by q1 keeps the z component and the length. With y = Rz(q2) f in the plane across axis 2
these are two linear equations N y = h(q3) with |y|^2 = |f|^2 - f_z^2, solved by ``pair_kernel`` for
any three axes, parallel ones too. The last three angles are those of the rotation that is left.
"""

import math
from typing import NamedTuple

from compiled.kernel import kernel
from compiled.simd import on_stack
from compiled.vec3 import Vector
from kinematics.arrays import Array
from kinematics.ik.closed_form.structure import (
    BRANCH,
    FAMILY,
    HEADER,
    KIND,
    MISS,
    REDUNDANT,
    TIP,
    WRIST,
    CandidateTable,
)
from kinematics.ik.closed_form.subproblem import (
    ANY_ANGLE,
    BOTH_SIDES,
    NO_SOLUTION,
    TINY,
    orient_kernel,
    pair_kernel,
)

#: Cosine and sine of one angle, of two and of three.
Turn = tuple[float, float]
TwoTurns = tuple[float, float, float, float]
ThreeTurns = tuple[float, float, float, float, float, float]


class Flange(NamedTuple):
    """The frame of a form's last joint, seen from the frame fixed before its first.

    Args:
        x: Axis x of the frame.
        z: Axis z of the frame.
        origin: Origin of the frame [m].
    """

    x: Vector
    z: Vector
    origin: Vector


@kernel(allocates=False)
def back_kernel(c: float, s: float, A: Array, x: float, y: float, z: float) -> Vector:
    """R_A^T Rz^T v: a direction seen from before a joint's offset and turn."""
    u, v = c * x + s * y, c * y - s * x
    return (
        A[1] * u + A[5] * v + A[9] * z,
        A[2] * u + A[6] * v + A[10] * z,
        A[3] * u + A[7] * v + A[11] * z,
    )


@kernel(allocates=False)
def rotation_column(t: Array, tip: Array, k: int) -> Vector:
    """Column k of R_t R_tip^T."""
    i = 1 + 4 * k
    return (
        t[1] * tip[i] + t[2] * tip[i + 1] + t[3] * tip[i + 2],
        t[5] * tip[i] + t[6] * tip[i + 1] + t[7] * tip[i + 2],
        t[9] * tip[i] + t[10] * tip[i + 1] + t[11] * tip[i + 2],
    )


@kernel(allocates=False)
def flange_kernel(plan: Array, t: Array) -> Flange:
    """The frame of the last joint, from the pose of the tip in a row."""
    A1, tip = plan[1], plan[TIP]
    x, y, z = rotation_column(t, tip, 0), rotation_column(t, tip, 1), rotation_column(t, tip, 2)
    a, b, c = tip[4], tip[8], tip[12]
    return Flange(
        back_kernel(1.0, 0.0, A1, x[0], x[1], x[2]),
        back_kernel(1.0, 0.0, A1, z[0], z[1], z[2]),
        back_kernel(
            1.0, 0.0, A1,
            t[4] - x[0] * a - y[0] * b - z[0] * c - A1[4],
            t[8] - x[1] * a - y[1] * b - z[1] * c - A1[8],
            t[12] - x[2] * a - y[2] * b - z[2] * c - A1[12],
        ),
    )  # fmt: skip


@kernel(allocates=False)
def family_kernel(family: float, count: int) -> float:
    """The number of a family that begins at row ``count``, inside another or not (0).

    It is positive where any member has all the branches of the family, as with a straight wrist,
    else negative.
    """
    return family if family != 0.0 else -(count + 1.0)


@kernel(allocates=False)
def _add_wrists(
    plan: Array, table: CandidateTable, x: Vector, z: Vector, arm: ThreeTurns, code: float,
    family: float, count: int,
) -> int:  # fmt: skip
    """Add both sides of the wrist behind the cosines and sines ``arm`` of the first three joints.

    Args:
        plan: The arm.
        table: The candidates.
        x: x axis of the last joint's frame, as in ``Flange``.
        z: Axis z of the frame.
        arm: Cosines and sines of the first three joints.
        code: Bits of the branch so far.
        family: Number of the family that the first three joints are of, or 0.
        count: Rows that are taken.
    """
    c1, s1, c2, s2, c3, s3 = arm
    A2, A3, A4 = plan[2], plan[3], plan[4]
    m0 = back_kernel(c1, s1, A2, x[0], x[1], x[2])
    m0 = back_kernel(c2, s2, A3, m0[0], m0[1], m0[2])
    m0 = back_kernel(c3, s3, A4, m0[0], m0[1], m0[2])
    m2 = back_kernel(c1, s1, A2, z[0], z[1], z[2])
    m2 = back_kernel(c2, s2, A3, m2[0], m2[1], m2[2])
    m2 = back_kernel(c3, s3, A4, m2[0], m2[1], m2[2])
    return add_hands_kernel(plan, table, (m0, m2), arm, (1.0, 0.0), code, family, count)


@kernel(allocates=False)
def add_hands_kernel(
    plan: Array, table: CandidateTable, axes: tuple[Vector, Vector], arm: ThreeTurns, fourth: Turn,
    code: float, family: float, count: int,
) -> int:  # fmt: skip
    """Add both sides of a wrist that is the last three joints.

    Args:
        plan: The arm.
        table: The candidates.
        axes: Directions x and z of the last joint's frame, seen from before the wrist.
        arm: Cosines and sines of the first three joints.
        fourth: Cosine and sine of the joint before the wrist where that is the fourth.
        code: Bits of the branch so far.
        family: Number of the family that the joints before are of, or 0.
        count: Rows that are taken.
    """
    free, m0, m2 = table.free, axes[0], axes[1]
    before = 4 if plan[HEADER, KIND] == REDUNDANT else 3
    for i in range(2):
        status, ca, sa, cb, sb, cc, sc = orient_kernel(
            plan[before + 2], plan[before + 3], plan[WRIST], m0, m2, 1.0 - 2.0 * i, table.slack
        )
        if status == NO_SOLUTION:
            break
        if status != ANY_ANGLE:
            hand = (ca, sa, cb, sb, cc, sc)
            count = add_kernel(table.rows, count, before, arm, fourth, hand, code + i, family)
            if status == BOTH_SIDES:
                break
            continue
        # The outer axes are one: only the sum of their angles, or the difference, is determined.
        same = 1.0 if m2[2] > 0.0 else -1.0
        last, number = math.atan2(sc, cc), count + 1.0 if family == 0.0 else family
        for k in range(2 * free.shape[0]):
            half = k // 2
            a = free[half, before] if k % 2 == 0 else same * (last - free[half, before + 2])
            c = last - same * a
            hand = (math.cos(a), math.sin(a), cb, sb, math.cos(c), math.sin(c))
            count = add_kernel(table.rows, count, before, arm, fourth, hand, code, number)
        break
    return count


@kernel(allocates=False)
def add_kernel(
    candidates: Array, count: int, before: int, arm: ThreeTurns, fourth: Turn, hand: ThreeTurns,
    code: float, family: float,
) -> int:  # fmt: skip
    """Write a candidate into row ``count``, if there is one; the new count.

    Of six joints the hand is the last three, ``before`` is 3, and ``fourth`` means nothing.
    """
    if count >= candidates.shape[0]:
        return count
    row = candidates[count]
    row[0], row[1], row[2], row[3], row[4], row[5] = arm
    row[6], row[7] = fourth
    for k in range(6):
        row[2 * before + k] = hand[k]
    row[BRANCH], row[FAMILY] = code, family
    return count + 1


@kernel(allocates=False)
def spherical_kernel(plan: Array, table: CandidateTable, flange: Flange, count: int) -> int:
    """Add the candidates for one pose from row ``count`` on; the new count."""
    free, p = table.free, flange.origin
    A2, A3, A4 = plan[2], plan[3], plan[4]
    # Joint 2's frame sees p_2 and axis 1 so.
    B = back_kernel(1.0, 0.0, A2, A2[4], A2[8], A2[12])
    R = (A2[9], A2[10], A2[11])
    h, rho, out = on_stack(6).reshape((2, 3)), on_stack(6), on_stack(96).reshape((24, 4))
    # f = f[0] + f[1] cos(q3) + f[2] sin(q3), and the same for |f|^2 with half of it in n.
    f, n = on_stack(9).reshape((3, 3)), on_stack(3)
    n[0] = 0.5 * (A4[4] * A4[4] + A4[8] * A4[8] + A4[12] * A4[12])
    n[1] = n[2] = 0.0
    for row in range(3):
        a, b, c, o = A3[1 + 4 * row], A3[2 + 4 * row], A3[3 + 4 * row], A3[4 + 4 * row]
        f[0, row] = o + c * A4[12]
        f[1, row], f[2, row] = a * A4[4] + b * A4[8], b * A4[4] - a * A4[8]
        n[0] += 0.5 * o * o + o * c * A4[12]
        n[1] += o * f[1, row]
        n[2] += o * f[2, row]
    half = 0.5 * (p[0] * p[0] + p[1] * p[1] + p[2] * p[2])
    half -= 0.5 * (A2[4] * A2[4] + A2[8] * A2[8] + A2[12] * A2[12])
    for k in range(3):
        h[0, k] = -n[k] - B[2] * f[k, 2]
        h[1, k] = -R[2] * f[k, 2]
    h[0, 0] += half
    h[1, 0] += p[2] - A2[12]
    for k in range(3):
        rho[k] = 2.0 * n[k] - (1.0 if k == 0 else 2.0) * f[0, 2] * f[k, 2]
    rho[3], rho[4], rho[5] = -(f[1, 2] ** 2), -2.0 * f[1, 2] * f[2, 2], -(f[2, 2] ** 2)
    pairs, any_third = pair_kernel(
        (B[0], B[1], R[0], R[1]), h, rho, table.slack, plan[HEADER, MISS], free[:, 2], out
    )
    whole = -(count + 1.0) if any_third else 0.0
    for i in range(pairs):
        c3, s3, y0, y1 = out[i, 0], out[i, 1], out[i, 2], out[i, 3]
        fx = f[0, 0] + f[1, 0] * c3 + f[2, 0] * s3
        fy = f[0, 1] + f[1, 1] * c3 + f[2, 1] * s3
        fz = f[0, 2] + f[1, 2] * c3 + f[2, 2] * s3
        c2, s2 = y0 * fx + y1 * fy, y1 * fx - y0 * fy
        r = math.sqrt(c2 * c2 + s2 * s2)
        turns = free.shape[0] if fx * fx + fy * fy < TINY * TINY or r == 0.0 else 1
        family = family_kernel(whole, count) if turns > 1 else whole
        for j in range(turns):
            if turns > 1:
                c2, s2, r = math.cos(free[j, 1]), math.sin(free[j, 1]), 1.0
            arm = (c2 / r, s2 / r, c3, s3)
            count = _add_first_joints(plan, table, flange, arm, (fx, fy, fz), family, count)
    return count


@kernel(allocates=False)
def _add_first_joints(
    plan: Array,
    table: CandidateTable,
    flange: Flange,
    arm: TwoTurns,
    f: Vector,
    family: float,
    count: int,
) -> int:
    """Add the candidates behind q2 and q3: q1 turns Rz(q1) (p_2 + R_2 Rz(q2) f) onto p."""
    free, p = table.free, flange.origin
    A2, A3 = plan[2], plan[3]
    c2, s2, c3, s3 = arm
    u, v = c2 * f[0] - s2 * f[1], s2 * f[0] + c2 * f[1]
    gx = A2[4] + A2[1] * u + A2[2] * v + A2[3] * f[2]
    gy = A2[8] + A2[5] * u + A2[6] * v + A2[7] * f[2]
    # The sign of the depth across the plane of axes 1 and 2, and that of the Jacobian without it.
    front = 1.0 if A2[3] * gy - A2[7] * gx < 0.0 else -1.0
    ax, ay, az = A2[9], A2[10], A2[11]
    ax, ay = c2 * ax + s2 * ay, c2 * ay - s2 * ax
    bx, by, bz = back_kernel(1.0, 0.0, A2, A2[4], A2[8], A2[12])
    bx, by = f[0] + c2 * bx + s2 * by, f[1] + c2 * by - s2 * bx
    bz += f[2]
    jx, jy, jz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    ex, ey, ez = f[0] - A3[4], f[1] - A3[8], f[2] - A3[12]
    kx, ky = A3[7] * ez - A3[11] * ey, A3[11] * ex - A3[3] * ez
    kz = A3[3] * ey - A3[7] * ex
    # j . ((z x f) x k)
    determinant = jx * (f[0] * kz) + jy * (f[1] * kz) - jz * (f[1] * ky + f[0] * kx)
    code = (0.0 if front > 0.0 else 4.0) + (0.0 if determinant * front > 0.0 else 2.0)
    c1, s1 = gx * p[0] + gy * p[1], gx * p[1] - gy * p[0]
    r = math.sqrt(c1 * c1 + s1 * s1)
    if r > TINY * TINY:
        arm6 = (c1 / r, s1 / r, c2, s2, c3, s3)
        return _add_wrists(plan, table, flange.x, flange.z, arm6, code, family, count)
    number = family_kernel(family, count)
    for k in range(free.shape[0]):
        arm6 = (math.cos(free[k, 0]), math.sin(free[k, 0]), c2, s2, c3, s3)
        count = _add_wrists(plan, table, flange.x, flange.z, arm6, code, number, count)
    return count
