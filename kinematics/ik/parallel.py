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

from kinematics.arrays import Array
from kinematics.compiled.kernel import kernel
from kinematics.compiled.simd import on_stack
from kinematics.ik.spherical import (
    TIP,
    WRIST,
    add_kernel,
    back_kernel,
    family_kernel,
    flange_kernel,
)
from kinematics.ik.subproblem import (
    EXACT,
    TINY,
    cosine_kernel,
    elbow_kernel,
    orient_kernel,
    pair_kernel,
)
from kinematics.vec3 import Vector

__all__ = ["TIP", "parallel_kernel"]


@kernel(allocates=False)
def parallel_kernel(
    plan: Array, t: Array, free: Array, slack: float, raw: Array, count: int
) -> int:
    """Add the candidates for one pose; arguments as ``spherical_kernel`` has them."""
    x, z, o = flange_kernel(plan, t)
    A2, A3, A4, A5, A6 = plan[2], plan[3], plan[4], plan[5], plan[6]
    nx, ny, nz = A2[3], A2[7], A2[11]
    depth = A3[12] + A4[12] + A5[12] + nx * A2[4] + ny * A2[8] + nz * A2[12]
    a1, b1 = nx * o[0] + ny * o[1], nx * o[1] - ny * o[0]
    if plan[0, 4] == 0.0:
        status, cp, sp, cd, sd = cosine_kernel(a1, b1, depth - nz * o[2], slack)
        if status == 0:
            return count
        family = -(count + 1.0) if status == 2 else 0.0
        for i in range(2 if status == 1 else free.shape[0]):
            side = 1.0 - 2.0 * i
            c1, s1 = cp * cd - side * sp * sd, sp * cd + side * cp * sd
            code = 4.0 * i
            if status == 2:
                c1, s1 = math.cos(free[i, 0]), math.sin(free[i, 0])
                code = 0.0
            elif i == 1 and sd < TINY:
                break
            count = _behind_first(
                plan, x, z, o, c1, s1, 0.0, 0.0, code, family, free, slack, raw, count
            )
        return count
    h, rho, out = on_stack(6).reshape((2, 3)), on_stack(6), on_stack(96).reshape((24, 4))
    rho[0], rho[1:] = 1.0, 0.0
    ux, uy, uz = A5[9], A5[10], A5[11]
    h[0, 0] = depth - nz * o[2] + uz * A6[12]
    h[0, 1], h[0, 2] = ux * A6[4] + uy * A6[8], uy * A6[4] - ux * A6[8]
    h[1, 0] = uz * A6[11] - nz * z[2]
    h[1, 1], h[1, 2] = ux * A6[3] + uy * A6[7], uy * A6[3] - ux * A6[7]
    a2, b2 = nx * z[0] + ny * z[1], nx * z[1] - ny * z[0]
    pairs, any_fifth = pair_kernel((a1, b1, a2, b2), h, rho, slack, plan[0, 5], free[:, 4], out)
    family = -(count + 1.0) if any_fifth else 0.0
    for i in range(pairs):
        c1, s1 = out[i, 2], out[i, 3]
        r = math.sqrt(c1 * c1 + s1 * s1)
        front = 0.0 if b1 * c1 - a1 * s1 > 0.0 else 4.0
        count = _behind_first(
            plan,
            x,
            z,
            o,
            c1 / r,
            s1 / r,
            out[i, 0],
            out[i, 1],
            front,
            family,
            free,
            slack,
            raw,
            count,
        )
    return count


@kernel(allocates=False)
def _behind_first(
    plan: Array, x: Vector, z: Vector, o: Vector, c1: float, s1: float, c5: float, s5: float,
    code: float, family: float, free: Array, slack: float, raw: Array, count: int,
) -> int:  # fmt: skip
    """Add the candidates behind q1; (c5, s5) is (0, 0) where both sides of joint 5 are right."""
    A2 = plan[2]
    m0 = back_kernel(c1, s1, A2, x[0], x[1], x[2])
    m2 = back_kernel(c1, s1, A2, z[0], z[1], z[2])
    p = back_kernel(
        c1, s1, A2,
        o[0] - (c1 * A2[4] - s1 * A2[8]), o[1] - (s1 * A2[4] + c1 * A2[8]), o[2] - A2[12],
    )  # fmt: skip
    for i in range(2):
        status, ct, st, cb, sb, cc, sc = orient_kernel(
            plan[5], plan[6], plan[WRIST], m0, m2, 1.0 - 2.0 * i, slack,
        )  # fmt: skip
        if status == 0:
            break
        # The pair named joint 5's side already.
        if c5 != 0.0 or s5 != 0.0:
            other = abs(cb - c5) + abs(sb - s5) > 1e-4
            if other and status == 1:
                continue
        # Where an arm misses the form, its turn is known to that over the angle of axis 6 with n.
        loose, room = False, slack
        if plan[0, 5] > EXACT:
            lever, least = math.hypot(m2[0], m2[1]), math.sqrt(plan[0, 5])
            loose, room = lever < least, slack / max(lever, least)
        if status != 2:
            count = _elbows(
                plan, p, (c1, s1, ct, st), (cb, sb, cc, sc), code + i, family, free, room, raw,
                count,
            )  # fmt: skip
            if status == 3 and not loose:
                break
            if not loose or i == 1:
                continue
        # Axis 6 is parallel to the three: a plane arm of four joints, the last one free.
        same = 1.0 if m2[2] > 0.0 else -1.0
        number = count + 1.0 if family == 0.0 else family
        rest = math.atan2(sc, cc)
        if status != 2:
            rest += same * math.atan2(st, ct)
        toward, least, most = _window(plan, p, cb, sb)
        fixed = math.atan2(plan[0, 7], plan[0, 6])
        for k in range(2 * free.shape[0] + 2):
            half = k // 2
            if half >= free.shape[0]:
                turn = toward + (k - 2 * free.shape[0] - 0.5) * (least + most)
            elif k % 2 == 0:
                turn = same * (rest - free[half, 5])
            else:
                turn = free[half, 1] + free[half, 2] + free[half, 3] + fixed
            q6 = rest - same * turn
            # Two windows that do not touch hold a family each.
            other = least > 0.0 and most < math.pi and math.sin(turn - toward) < 0.0
            count = _elbows(
                plan, p, (c1, s1, math.cos(turn), math.sin(turn)),
                (cb, sb, math.cos(q6), math.sin(q6)), code, number + (0.5 if other else 0.0),
                free, slack, raw, count,
            )  # fmt: skip
        if status != 1:
            break
    return count


@kernel(allocates=False)
def _window(plan: Array, p: Vector, c5: float, s5: float) -> tuple[float, float, float]:
    """Where q2 + q3 + q4 lets both links reach: that far [rad] at least and most from a middle."""
    u, v = _offset(plan, c5, s5)
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
def _offset(plan: Array, c5: float, s5: float) -> tuple[float, float]:
    """Joint 6's origin in the frame of joint 4, across its axis."""
    A5, A6 = plan[5], plan[6]
    u, v = c5 * A6[4] - s5 * A6[8], s5 * A6[4] + c5 * A6[8]
    return (
        A5[4] + A5[1] * u + A5[2] * v + A5[3] * A6[12],
        A5[8] + A5[5] * u + A5[6] * v + A5[7] * A6[12],
    )


@kernel(allocates=False)
def _elbows(
    plan: Array, p: Vector, turn: tuple[float, float, float, float],
    wrist: tuple[float, float, float, float], code: float, family: float, free: Array,
    slack: float, raw: Array, count: int,
) -> int:  # fmt: skip
    """Add both sides of the elbow, ``turn`` holding q1 and q2 + q3 + q4 with the fixed angles."""
    A3, A4 = plan[3], plan[4]
    c1, s1, ct, st = turn
    c5, s5, c6, s6 = wrist
    u, v = _offset(plan, c5, s5)
    px, py = p[0] - (ct * u - st * v), p[1] - (st * u + ct * v)
    bx, by = A3[1] * A4[4] + A3[2] * A4[8], A3[5] * A4[4] + A3[6] * A4[8]
    # Without the turns that the offsets of joints 3 and 4 make.
    ct, st = plan[0, 6] * ct + plan[0, 7] * st, plan[0, 6] * st - plan[0, 7] * ct
    for j in range(2):
        state, c2, s2, c3, s3 = elbow_kernel(px, py, A3[4], A3[8], bx, by, 1.0 - 2.0 * j, slack)
        if state == 0:
            break
        many = family_kernel(family, count) if state == 2 else family
        for k in range(free.shape[0] if state == 2 else 1):
            if state == 2:
                c2, s2 = math.cos(free[k, 1]), math.sin(free[k, 1])
            c, s = c2 * c3 - s2 * s3, s2 * c3 + c2 * s3
            c4, s4 = ct * c + st * s, st * c - ct * s
            code_j = code if state == 2 else code + 2.0 * j
            count = add_kernel(
                raw, count, (c1, s1, c2, s2, c3, s3), (c4, s4, c5, s5, c6, s6), code_j, many
            )
        if state != 1:
            break
    return count
