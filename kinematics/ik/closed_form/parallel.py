"""Closed form for six revolute joints whose axes 2, 3 and 4 are parallel (the UR class).

With n the direction of axis 2, T_1 = Rz(q1) A_2 and the origin o of joint 6, the motion of joints 2
to 4 keeps n and the depth along it. Seen from the frame A_1 fixed before joint 1 that says

    n . Rz(-q1) o   = depth + z . R_5 Rz(q5) p_6       (depth)
    n . Rz(-q1) z_6 = z . R_5 Rz(q5) R_6 z             (direction)

Where axes 5 and 6 meet, p_6 = 0 and the first gives q1 alone; else both together are solved by
``pair_kernel``. Then q5, q6 and q2 + q3 + q4 follow from the rotation that is left, and a triangle
in the plane gives the rest.
"""

import math

from compiled.kernel import kernel
from compiled.simd import on_stack
from compiled.vec3 import Vector
from kinematics.arrays import Array
from kinematics.ik.closed_form.spherical import (
    Flange,
    Turn,
    TwoTurns,
    add_kernel,
    back_kernel,
    family_kernel,
)
from kinematics.ik.closed_form.structure import (
    GENERAL,
    HEADER,
    MISS,
    TURN_COSINE,
    TURN_SINE,
    WRIST,
    CandidateTable,
)
from kinematics.ik.closed_form.subproblem import (
    ANY_ANGLE,
    BOTH_SIDES,
    EXACT,
    NO_SOLUTION,
    SOLVED,
    TINY,
    cosine_kernel,
    elbow_kernel,
    orient_kernel,
    pair_kernel,
)

#: Cosine and sine of a joint whose two sides are both right: of no angle.
_BOTH = (0.0, 0.0)


@kernel(allocates=False)
def parallel_kernel(plan: Array, flange: Flange, table: CandidateTable, count: int) -> int:
    """Add the candidates for one pose from row ``count`` on; the new count."""
    free, slack = table.free, table.slack
    z, o = flange.z, flange.origin
    A2, A3, A4, A5, A6 = plan[2], plan[3], plan[4], plan[5], plan[6]
    nx, ny, nz = A2[3], A2[7], A2[11]
    depth = A3[12] + A4[12] + A5[12] + nx * A2[4] + ny * A2[8] + nz * A2[12]
    a1, b1 = nx * o[0] + ny * o[1], nx * o[1] - ny * o[0]
    if plan[HEADER, GENERAL] == 0.0:
        status, cp, sp, cd, sd = cosine_kernel(a1, b1, depth - nz * o[2], slack)
        if status == NO_SOLUTION:
            return count
        family = -(count + 1.0) if status == ANY_ANGLE else 0.0
        for i in range(2 if status == SOLVED else free.shape[0]):
            side = 1.0 - 2.0 * i
            c1, s1 = cp * cd - side * sp * sd, sp * cd + side * cp * sd
            code = 4.0 * i
            if status == ANY_ANGLE:
                c1, s1 = math.cos(free[i, 0]), math.sin(free[i, 0])
                code = 0.0
            elif i == 1 and sd < TINY:
                break
            count = _add_behind_first(plan, table, flange, (c1, s1), _BOTH, code, family, count)
        return count
    h, rho, out = on_stack(6).reshape((2, 3)), on_stack(6), on_stack(96).reshape((24, 4))
    rho[0], rho[1:] = 1.0, 0.0
    ux, uy, uz = A5[9], A5[10], A5[11]
    h[0, 0] = depth - nz * o[2] + uz * A6[12]
    h[0, 1], h[0, 2] = ux * A6[4] + uy * A6[8], uy * A6[4] - ux * A6[8]
    h[1, 0] = uz * A6[11] - nz * z[2]
    h[1, 1], h[1, 2] = ux * A6[3] + uy * A6[7], uy * A6[3] - ux * A6[7]
    a2, b2 = nx * z[0] + ny * z[1], nx * z[1] - ny * z[0]
    pairs, any_fifth = pair_kernel(
        (a1, b1, a2, b2), h, rho, slack, plan[HEADER, MISS], free[:, 4], out
    )
    family = -(count + 1.0) if any_fifth else 0.0
    for i in range(pairs):
        c1, s1 = out[i, 2], out[i, 3]
        r = math.sqrt(c1 * c1 + s1 * s1)
        front = 0.0 if b1 * c1 - a1 * s1 > 0.0 else 4.0
        first, fifth = (c1 / r, s1 / r), (out[i, 0], out[i, 1])
        count = _add_behind_first(plan, table, flange, first, fifth, front, family, count)
    return count


@kernel(allocates=False)
def _add_behind_first(
    plan: Array, table: CandidateTable, flange: Flange, first: Turn, fifth: Turn, code: float,
    family: float, count: int,
) -> int:  # fmt: skip
    """Add the candidates behind q1.

    Args:
        plan: The arm.
        table: The candidates.
        flange: The frame of the last joint.
        first: Cosine and sine of q1.
        fifth: Cosine and sine of q5, _BOTH where both sides of joint 5 are right.
        code: Bits of the branch so far.
        family: Number of the family that q1 and q5 are of, or 0.
        count: Rows that are taken.
    """
    c1, s1 = first
    c5, s5 = fifth
    free, slack = table.free, table.slack
    x, z, o = flange.x, flange.z, flange.origin
    A2 = plan[2]
    m0 = back_kernel(c1, s1, A2, x[0], x[1], x[2])
    m2 = back_kernel(c1, s1, A2, z[0], z[1], z[2])
    p = back_kernel(
        c1, s1, A2,
        o[0] - (c1 * A2[4] - s1 * A2[8]), o[1] - (s1 * A2[4] + c1 * A2[8]), o[2] - A2[12],
    )  # fmt: skip
    for i in range(2):
        status, ct, st, cb, sb, cc, sc = orient_kernel(
            plan[5], plan[6], plan[WRIST], m0, m2, 1.0 - 2.0 * i, slack
        )
        if status == NO_SOLUTION:
            break
        # The pair named joint 5's side already.
        if c5 != 0.0 or s5 != 0.0:
            other = abs(cb - c5) + abs(sb - s5) > 1e-4
            if other and status == SOLVED:
                continue
        # Where an arm misses the form, its turn is known to that over the angle of axis 6 with n.
        loose, elbows = False, table
        if plan[HEADER, MISS] > EXACT:
            lever, least = math.hypot(m2[0], m2[1]), math.sqrt(plan[HEADER, MISS])
            loose = lever < least
            elbows = CandidateTable(free, slack / max(lever, least), table.rows)
        if status != ANY_ANGLE:
            count = _add_elbows(
                plan, elbows, p, (c1, s1, ct, st), (cb, sb, cc, sc), code + i, family, count
            )
            if status == BOTH_SIDES and not loose:
                break
            if not loose or i == 1:
                continue
        # Axis 6 is parallel to the three: a plane arm of four joints, the last one free.
        same = 1.0 if m2[2] > 0.0 else -1.0
        number = count + 1.0 if family == 0.0 else family
        rest = math.atan2(sc, cc)
        if status != ANY_ANGLE:
            rest += same * math.atan2(st, ct)
        middle, least, most = _reach_window(plan, p, cb, sb)
        fixed = math.atan2(plan[HEADER, TURN_SINE], plan[HEADER, TURN_COSINE])
        for k in range(2 * free.shape[0] + 2):
            half = k // 2
            if half >= free.shape[0]:
                turn = middle + (k - 2 * free.shape[0] - 0.5) * (least + most)
            elif k % 2 == 0:
                turn = same * (rest - free[half, 5])
            else:
                turn = free[half, 1] + free[half, 2] + free[half, 3] + fixed
            q6 = rest - same * turn
            # Two windows that do not touch hold a family each.
            other = least > 0.0 and most < math.pi and math.sin(turn - middle) < 0.0
            arm = (c1, s1, math.cos(turn), math.sin(turn))
            wrist = (cb, sb, math.cos(q6), math.sin(q6))
            half_family = number + (0.5 if other else 0.0)
            count = _add_elbows(plan, table, p, arm, wrist, code, half_family, count)
        if status != SOLVED:
            break
    return count


@kernel(allocates=False)
def _reach_window(plan: Array, p: Vector, c5: float, s5: float) -> tuple[float, float, float]:
    """The values of q2 + q3 + q4 at which both links reach p.

    Returns:
        A middle, and how far from it they are at least and at most [rad].
    """
    u, v = _wrist_offset(plan, c5, s5)
    A3, A4 = plan[3], plan[4]
    a, b = math.hypot(A3[4], A3[8]), math.hypot(A4[4], A4[8])
    middle = math.atan2(p[1], p[0]) - math.atan2(v, u)
    # |p - Rz o|^2 = |p|^2 + |o|^2 - 2 |p| |o| cos
    scale = 2.0 * math.hypot(p[0], p[1]) * math.hypot(u, v)
    square = p[0] * p[0] + p[1] * p[1] + u * u + v * v
    if scale < TINY * TINY:
        return middle, 0.0, math.pi
    least = min(max((square - (a - b) * (a - b)) / scale, -1.0), 1.0)
    most = min(max((square - (a + b) * (a + b)) / scale, -1.0), 1.0)
    return middle, math.acos(least), math.acos(most)


@kernel(allocates=False)
def _wrist_offset(plan: Array, c5: float, s5: float) -> tuple[float, float]:
    """Joint 6's origin in the frame of joint 4, across its axis."""
    A5, A6 = plan[5], plan[6]
    u, v = c5 * A6[4] - s5 * A6[8], s5 * A6[4] + c5 * A6[8]
    return (
        A5[4] + A5[1] * u + A5[2] * v + A5[3] * A6[12],
        A5[8] + A5[5] * u + A5[6] * v + A5[7] * A6[12],
    )


@kernel(allocates=False)
def _add_elbows(
    plan: Array, table: CandidateTable, p: Vector, arm: TwoTurns, wrist: TwoTurns, code: float,
    family: float, count: int,
) -> int:  # fmt: skip
    """Add both sides of the elbow.

    Args:
        plan: The arm.
        table: The candidates.
        p: Origin of joint 6 in the frame of joint 2 before its turn [m].
        arm: Cosines and sines of q1, and of q2 + q3 + q4 with the fixed angles.
        wrist: Cosines and sines of q5 and q6.
        code: Bits of the branch so far.
        family: Number of the family that these angles are of, or 0.
        count: Rows that are taken.
    """
    free, slack = table.free, table.slack
    A3, A4 = plan[3], plan[4]
    c1, s1, ct, st = arm
    c5, s5, c6, s6 = wrist
    u, v = _wrist_offset(plan, c5, s5)
    px, py = p[0] - (ct * u - st * v), p[1] - (st * u + ct * v)
    bx, by = A3[1] * A4[4] + A3[2] * A4[8], A3[5] * A4[4] + A3[6] * A4[8]
    # Without the turns that the offsets of joints 3 and 4 make.
    turn_c, turn_s = plan[HEADER, TURN_COSINE], plan[HEADER, TURN_SINE]
    ct, st = turn_c * ct + turn_s * st, turn_c * st - turn_s * ct
    for j in range(2):
        state, c2, s2, c3, s3 = elbow_kernel(px, py, A3[4], A3[8], bx, by, 1.0 - 2.0 * j, slack)
        if state == NO_SOLUTION:
            break
        many = family_kernel(family, count) if state == ANY_ANGLE else family
        for k in range(free.shape[0] if state == ANY_ANGLE else 1):
            if state == ANY_ANGLE:
                c2, s2 = math.cos(free[k, 1]), math.sin(free[k, 1])
            c, s = c2 * c3 - s2 * s3, s2 * c3 + c2 * s3
            c4, s4 = ct * c + st * s, st * c - ct * s
            code_j = code if state == ANY_ANGLE else code + 2.0 * j
            first = (c1, s1, c2, s2, c3, s3)
            last = (c4, s4, c5, s5, c6, s6)
            count = add_kernel(table.rows, count, 3, first, (c4, s4), last, code_j, many)
        if state != SOLVED:
            break
    return count
