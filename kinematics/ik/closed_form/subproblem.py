"""The small equations that closed forms of inverse kinematics are made of.

Angles travel as cosine and sine; only the answer is turned into angles. A frame in a row of
numbers is laid out as in ``Chain.model``: one number, then its upper three rows.
Sources: "The kinematics of manipulators under computer control", 1968 (decoupling); "IK-Geo:
unified robot inverse kinematics using subproblem decomposition", 2022 (which subproblems suffice).
"""

import math

import numpy as np

from compiled.kernel import kernel
from compiled.simd import on_stack
from compiled.vec3 import Vector
from kinematics.arrays import Array
from kinematics.trajectory.polynomial import horner_kernel, unit_roots_kernel

#: A status, then the cosines and sines of three angles.
Angles = tuple[int, float, float, float, float, float, float]

# Statuses of a solution.
#: There is none: the target is out of reach.
NO_SOLUTION = 0
#: There is one on this side.
SOLVED = 1
#: Any angle is one; where there are more angles, the first is.
ANY_ANGLE = 2
#: Both sides have the same one.
BOTH_SIDES = 3

#: Lengths [m] and sines below this are rounding: the angle about such a lever is free.
TINY = 1e-11
#: Within this [m, rad] axes have a form exactly: it is far below what is asked of a solution.
EXACT = 1e-10
#: Each chart t = tan(x / 2) of the circle holds |t| up to this.
_CHART = 1.001
#: Below this ratio of its singular values a matrix is read as of rank one.
_THIN = 1e-5
#: Sweeps that find what such a matrix has beyond rank one.
_SWEEPS = 5
#: Rounding of a sum of products, relative to the largest of them.
_ROUNDING = 1e-14


@kernel(allocates=False)
def cosine_kernel(
    a: float, b: float, d: float, slack: float
) -> tuple[int, float, float, float, float]:
    """Solve a cos(x) + b sin(x) = d: x = phi -+ delta, as status, cos and sin of phi and of delta.

    The status is NO_SOLUTION, SOLVED or ANY_ANGLE. ``slack`` is what |d| may exceed the amplitude
    by and still be taken for it.
    """
    r = math.sqrt(a * a + b * b)
    if r < TINY:
        return (ANY_ANGLE if abs(d) <= TINY + slack else NO_SOLUTION), 1.0, 0.0, 1.0, 0.0
    if abs(d) > r + slack:
        return NO_SOLUTION, 1.0, 0.0, 1.0, 0.0
    square = (r - d) * (r + d)
    return SOLVED, a / r, b / r, min(max(d / r, -1.0), 1.0), math.sqrt(max(square, 0.0)) / r


@kernel(allocates=False)
def orient_kernel(
    B: Array, C: Array, w: Array, m0: Vector, m2: Vector, side: float, slack: float
) -> Angles:  # fmt: skip
    """Solve Rz(a) B Rz(b) C Rz(c) = M for three angles, M by its columns 0 and 2.

    The z column gives u . Rz(b) v = m_z with u = B^T z, v = C z. Half angles, from the distances
    of m to z and to -z, keep all digits where the wrist is straight or folded.

    Args:
        B: Row of the fixed rotation before the second joint.
        C: Rotation before the third angle.
        w: alpha, beta, cos and sin of the middle of b; see ``wrist_constants``.
        m0: Column 0 of M.
        m2: Column 2 of M.
        side: +1 or -1, which of the two solutions.
        slack: Distance by which outside its range a squared sine may lie and be cut.

    Returns:
        The status, where ANY_ANGLE means that a is free and taken as 0; then the cosines and sines
        of a, b and c.
    """
    m0x, m0y, m0z = m0
    m2x, m2y, m2z = m2
    across = m2x * m2x + m2y * m2y
    c4, s4 = 1.0, 0.0
    if m2z > 0.0:
        near = across * (1.0 + across / ((1.0 + m2z) * (1.0 + m2z)))
        far = 4.0 - near
    else:
        far = across * (1.0 + across / ((1.0 - m2z) * (1.0 - m2z)))
        near = 4.0 - far
    S, K = near - w[0], far - w[1]
    if min(S, K) < -slack:
        return NO_SOLUTION, 1.0, 0.0, 1.0, 0.0, 1.0, 0.0
    S, K = max(S, 0.0), max(K, 0.0)
    cosine, sine = (K - S) / (S + K), side * 2.0 * math.sqrt(S * K) / (S + K)
    c5, s5 = w[2] * cosine - w[3] * sine, w[3] * cosine + w[2] * sine
    tx, ty, tz = c5 * C[3] - s5 * C[7], s5 * C[3] + c5 * C[7], C[11]
    kx, ky = B[1] * tx + B[2] * ty + B[3] * tz, B[5] * tx + B[6] * ty + B[7] * tz
    status = BOTH_SIDES if abs(sine) < TINY else SOLVED
    if across < TINY * TINY:
        status = ANY_ANGLE
    else:
        c, s = m2x * kx + m2y * ky, m2y * kx - m2x * ky
        r = math.sqrt(c * c + s * s)
        if r > 0.0:
            c4, s4 = c / r, s / r
    x, y = c4 * m0x + s4 * m0y, c4 * m0y - s4 * m0x
    bx = B[1] * x + B[5] * y + B[9] * m0z
    by = B[2] * x + B[6] * y + B[10] * m0z
    bz = B[3] * x + B[7] * y + B[11] * m0z
    x, y = c5 * bx + s5 * by, c5 * by - s5 * bx
    c6, s6 = C[1] * x + C[5] * y + C[9] * bz, C[2] * x + C[6] * y + C[10] * bz
    r = math.sqrt(c6 * c6 + s6 * s6)
    if r > 0.0:
        c6, s6 = c6 / r, s6 / r
    return status, c4, s4, c5, s5, c6, s6


def wrist_constants(B: Array, C: Array) -> Array:
    """Constants of ``orient_kernel`` from the two fixed rotations (3, 3): shape (4,)."""
    u, v = B[2, :], C[:, 2]
    ru, rv = math.hypot(u[0], u[1]), math.hypot(v[0], v[1])
    phase = math.atan2(u[1], u[0]) - math.atan2(v[1], v[0])
    alpha = (u[2] - v[2]) ** 2 + (ru - rv) ** 2
    beta = (u[2] + v[2]) ** 2 + (ru - rv) ** 2
    return np.array([alpha, beta, math.cos(phase), math.sin(phase)])


@kernel(allocates=False)
def elbow_kernel(
    px: float, py: float, ax: float, ay: float, bx: float, by: float, side: float, slack: float
) -> tuple[int, float, float, float, float]:
    """Solve Rz(x) (a + Rz(y) b) = p in the plane for two angles.

    Returns:
        The status, where ANY_ANGLE means that x is free since p and the folded arm are at the
        origin; then cosines and sines of x and y.
    """
    # |a|^2 + |b|^2 + 2 a . Rz(y) b = |p|^2
    c0, s0 = 2.0 * (ax * bx + ay * by), 2.0 * (ay * bx - ax * by)
    d = px * px + py * py - ax * ax - ay * ay - bx * bx - by * by
    status, cp, sp, cd, sd = cosine_kernel(c0, s0, d, slack)
    if status != SOLVED:
        return NO_SOLUTION, 1.0, 0.0, 1.0, 0.0
    sd *= side
    cy, sy = cp * cd - sp * sd, sp * cd + cp * sd
    fx, fy = ax + cy * bx - sy * by, ay + sy * bx + cy * by
    c, s = px * fx + py * fy, py * fx - px * fy
    r = math.sqrt(c * c + s * s)
    if r < TINY * TINY:
        return ANY_ANGLE, 1.0, 0.0, cy, sy
    return (BOTH_SIDES if abs(sd) < TINY else SOLVED), c / r, s / r, cy, sy


@kernel(allocates=False)
def circle_roots_kernel(E: Array, noise: float, depth: float, work: Array, roots: Array) -> int:
    """Write cosines and sines (8, 2) of the zeros of a quadratic in cosine and sine; their count.

    E = (e0, ec, es, ecc, ecs, ess): e0 + ec c + es s + ecc c^2 + ecs c s + ess s^2. Where it is
    even about the phase of its first harmonic, as behind parallel axes, it is a quadratic in the
    cosine from there. Else two charts t = tan(x / 2) of the circle each give a quartic; they
    overlap a little, so that rounding loses no zero between them. Where one touches zero within
    rounding, or misses it by no more than ``depth``, its extremum counts as a root.

    Args:
        E: The coefficients, shape (6,).
        noise: Error of the coefficients.
        depth: Difference that they may have from those of the arm that is meant.
        work: Room, at least (8, 6).
        roots: The answer.

    Returns:
        The number of zeros, -1 where E is nothing but noise, so that any angle is one.
    """
    count = 0
    scale = 0.0
    for k in range(6):
        scale = max(scale, abs(E[k]))
    if scale <= noise:
        return -1
    touch = max(1e-12, max(noise, depth) / scale)
    r = math.sqrt(E[1] * E[1] + E[2] * E[2])
    if r > noise:
        cp, sp = E[1] / r, E[2] / r
        if abs(2.0 * cp * sp * (E[5] - E[3]) + (cp * cp - sp * sp) * E[4]) <= noise:
            return _even_roots(E, (cp, sp, r), touch * scale, roots)
    c, zeros, extrema = work[5], work[6], work[7]
    for chart in range(2):
        sign = 1.0 if chart == 0 else -1.0
        e0, ec, es = E[0] / scale, sign * E[1] / scale, sign * E[2] / scale
        ecc, ecs, ess = E[3] / scale, E[4] / scale, E[5] / scale
        # Times (1 + t^2)^2, with c = (1 - t^2) / (1 + t^2), s = 2 t / (1 + t^2), for t / _CHART.
        p0, p1 = e0 + ec + ecc, _CHART * 2.0 * (es + ecs)
        p2 = _CHART**2 * (2.0 * e0 - 2.0 * ecc + 4.0 * ess)
        p3, p4 = _CHART**3 * 2.0 * (es - ecs), _CHART**4 * (e0 - ec + ecc)
        # In u with t = _CHART (2 u - 1), as roots are looked for between 0 and 1.
        c[0] = p0 - p1 + p2 - p3 + p4
        c[1] = 2.0 * (p1 - 2.0 * p2 + 3.0 * p3 - 4.0 * p4)
        c[2] = 4.0 * (p2 - 3.0 * p3 + 6.0 * p4)
        c[3] = 8.0 * (p3 - 4.0 * p4)
        c[4] = 16.0 * p4
        number = unit_roots_kernel(c, 5, work, zeros, extrema)
        for k in range(number):
            count = _add_root_of_chart(_CHART * (2.0 * zeros[k] - 1.0), sign, roots, count)
        for k in range(5):
            u = extrema[k]
            if u >= 1.0:
                break
            if abs(horner_kernel(c, 5, u)) < touch:
                count = _add_root_of_chart(_CHART * (2.0 * u - 1.0), sign, roots, count)
    return count


@kernel(allocates=False)
def _even_roots(E: Array, phase: Vector, touch: float, roots: Array) -> int:
    """Write the roots of an even equation, its phase given as cosine, sine and amplitude r.

    With z the cosine from the phase it is e + r z + a z^2. Its roots, cut to [-1, 1], its vertex
    and the ends are tried, and are answered where it is below ``touch``.
    """
    c, s, r = phase
    across = E[3] * s * s - E[4] * c * s + E[5] * c * c
    e, a, count = E[0] + across, E[3] + E[5] - 2.0 * across, 0
    t = -0.5 * (r + math.sqrt(max(r * r - 4.0 * a * e, 0.0)))
    for root in (t / a, e / t, -0.5 * r / a, 1.0, -1.0):
        z = min(max(root, -1.0), 1.0)
        if abs(e + (r + a * z) * z) <= touch:
            sine = math.sqrt((1.0 - z) * (1.0 + z))
            count = _add_root(z * c - sine * s, z * s + sine * c, roots, count)
            count = _add_root(z * c + sine * s, z * s - sine * c, roots, count)
    return count


@kernel(allocates=False)
def _add_root_of_chart(t: float, sign: float, roots: Array, count: int) -> int:
    square = 1.0 + t * t
    return _add_root(sign * (1.0 - t * t) / square, sign * 2.0 * t / square, roots, count)


@kernel(allocates=False)
def _add_root(c: float, s: float, roots: Array, count: int) -> int:
    for k in range(count):
        if abs(roots[k, 0] - c) + abs(roots[k, 1] - s) < 1e-12:
            return count
    if count < roots.shape[0]:
        roots[count, 0], roots[count, 1] = c, s
        return count + 1
    return count


@kernel(allocates=False)
def pair_kernel(
    N: tuple[float, float, float, float], h: Array, rho: Array, slack: float, miss: float,
    free: Array, out: Array,
) -> tuple[int, bool]:  # fmt: skip
    """Solve N y = h(x), |y|^2 = rho(x) for an angle x and a vector y of the plane.

    With N = U diag(s1, s2) V^T and h' = U^T h, either s2 vanishes, then h'_2(x) = 0 has two
    solutions with two signs of the second component of V^T y each, or nearly so, or the component
    is h'_2 / s2 and x is one of the four zeros of s2^2 (rho - h'_1^2 / s1^2) - h'_2^2.

    Args:
        N: The matrix by rows.
        h: Coefficients of 1, cos(x), sin(x), shape (2, 3).
        rho: Coefficients of 1, c, s, c^2, cs, s^2, shape (6,).
        slack: Slack as ``cosine_kernel`` has it.
        miss: Distance of the arm from the one that is meant [m or rad].
        free: Angles to take where any is a solution.
        out: The answer: cos(x), sin(x), y_0, y_1 a row, shape (24, 4).

    Returns:
        The number of rows, and whether any angle is a solution.
    """
    N00, N01, N10, N11 = N
    # N N^T = U diag(s^2) U^T.
    a, b = N00 * N00 + N01 * N01, N10 * N10 + N11 * N11
    turn = 0.5 * math.atan2(2.0 * (N00 * N10 + N01 * N11), a - b)
    cu, su = math.cos(turn), math.sin(turn)
    r0, r1 = cu * N00 + su * N10, cu * N01 + su * N11
    s1 = math.sqrt(r0 * r0 + r1 * r1)
    if s1 < TINY:
        return 0, False
    v0, v1 = r0 / s1, r1 / s1
    # The second right vector is (-v1, v0): what is left of N along it is s2 with its sign.
    s2 = -(cu * N10 - su * N00) * v1 + (cu * N11 - su * N01) * v0
    g0, g1, g2 = (
        (cu * h[0, 0] + su * h[1, 0]) / s1, (cu * h[0, 1] + su * h[1, 1]) / s1,
        (cu * h[0, 2] + su * h[1, 2]) / s1,
    )  # fmt: skip
    k0, k1, k2 = (
        cu * h[1, 0] - su * h[0, 0], cu * h[1, 1] - su * h[0, 1], cu * h[1, 2] - su * h[0, 2],
    )  # fmt: skip
    count = 0
    if abs(s2) < _THIN * s1:
        status, _, _, _, _ = cosine_kernel(k1, k2, -k0, slack)
        # What s2 moves is found by iteration, as it is little.
        room = slack + 10.0 * abs(s2)
        for i in range(2 if status != ANY_ANGLE else free.shape[0]):
            for j in range(2):
                second = 0.0
                for _ in range(_SWEEPS):
                    state, cp, sp, cd, sd = cosine_kernel(k1, k2, s2 * second - k0, room)
                    sd = sd if i == 0 else -sd
                    c, s = cp * cd - sp * sd, sp * cd + cp * sd
                    if status == ANY_ANGLE:
                        c, s = math.cos(free[i]), math.sin(free[i])
                    first = g0 + g1 * c + g2 * s
                    square = (
                        rho[0] + rho[1] * c + rho[2] * s
                        + rho[3] * c * c + rho[4] * c * s + rho[5] * s * s - first * first
                    )  # fmt: skip
                    before, second = second, math.sqrt(max(square, 0.0))
                    second = second if j == 0 else -second
                    if abs(s2 * (second - before)) < _ROUNDING * TINY:
                        break
                if state == NO_SOLUTION or square < -room:
                    continue
                count = _add_pair(out, count, c, s, first, second, v0, v1)
        return count, status == ANY_ANGLE
    E, roots, work = on_stack(6), on_stack(16).reshape((8, 2)), on_stack(48).reshape((8, 6))
    q = s2 * s2
    E[0] = q * (rho[0] - g0 * g0) - k0 * k0
    E[1] = q * (rho[1] - 2.0 * g0 * g1) - 2.0 * k0 * k1
    E[2] = q * (rho[2] - 2.0 * g0 * g2) - 2.0 * k0 * k2
    E[3] = q * (rho[3] - g1 * g1) - k1 * k1
    E[4] = q * (rho[4] - 2.0 * g1 * g2) - 2.0 * k1 * k2
    E[5] = q * (rho[5] - g2 * g2) - k2 * k2
    size = max(k0 * k0, k1 * k1, k2 * k2)
    size = max(size, q * (rho[0] + g0 * g0 + g1 * g1 + g2 * g2))
    number = circle_roots_kernel(E, _ROUNDING * size, 10.0 * miss * size, work, roots)
    for i in range(number if number >= 0 else free.shape[0]):
        if number >= 0:
            c, s = roots[i, 0], roots[i, 1]
        else:
            c, s = math.cos(free[i]), math.sin(free[i])
        first, second = g0 + g1 * c + g2 * s, (k0 + k1 * c + k2 * s) / s2
        count = _add_pair(out, count, c, s, first, second, v0, v1)
    return count, number < 0


@kernel(allocates=False)
def _add_pair(
    out: Array, count: int, c: float, s: float, first: float, second: float, v0: float, v1: float
) -> int:
    a, b = first * v0 - second * v1, first * v1 + second * v0
    for k in range(count):
        far = abs(out[k, 0] - c) + abs(out[k, 1] - s) + abs(out[k, 2] - a) + abs(out[k, 3] - b)
        if far < TINY:
            return count
    if count == out.shape[0]:
        return count
    out[count, 0], out[count, 1] = c, s
    out[count, 2], out[count, 3] = a, b
    return count + 1
