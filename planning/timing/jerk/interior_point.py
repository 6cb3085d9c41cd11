"""An interior-point method for the least time along a path with bounded jerk, compiled.

``jerk_limits`` states the problem: a quadratic B-spline c of the squared speed, its limits, and the
time. Each limit involves three neighbouring unknowns at most, so that a step of Newton's method is
the solution of a system with two diagonals on either side.

All limits but that of the jerk are linear, and the time is convex. A primal-dual method that never
leaves the inside ("Numerical Optimization", 2006, chapter 19) gets within a thousandth of the least
time in some 30 steps, and has an answer that keeps every limit whenever it is stopped.

Cholesky's factors of matrices with few diagonals on either side, in place.
"""

import math
from typing import NamedTuple

import numpy as np

from compiled.kernel import kernel
from compiled.simd import LANES, load, store
from kinematics.arrays import Array
from planning.timing.jerk.grid import (
    JerkLimits,
    count_kernel,
    inside_kernel,
    jerk_at_kernel,
    knot_kernel,
    time_kernel,
    weight_kernel,
)


@kernel(allocates=False)
def solve_banded_kernel(band: Array, right: Array, width: int) -> bool:
    """Solve A X = B in place by Cholesky's factors; False where A is not positive definite.

    Args:
        band: The symmetric A with w - 1 diagonals on either side, shape (N, >= w): ``band[i, k]``
            is the entry in row i, column i - k. Its factors take its place.
        right: B, and the answer X, its columns to whole vectors, shape (N, 8 b).
        width: w.
    """
    size = band.shape[0]
    for i in range(size):
        for k in range(min(width - 1, i), -1, -1):
            column = i - k
            value = band[i, k]
            for m in range(max(0, i - width + 1, column - width + 1), column):
                value -= band[i, i - m] * band[column, column - m]
            if k > 0:
                band[i, k] = value / band[column, 0]
                continue
            if not value > 0.0:
                return False
            band[i, 0] = math.sqrt(value)
    for block in range(0, right.shape[1], LANES):
        for i in range(size):
            total = load(right[i], block)
            for m in range(max(0, i - width + 1), i):
                total = total - band[i, i - m] * load(right[m], block)
            store(right[i], block, total / band[i, 0])
        for i in range(size - 1, -1, -1):
            total = load(right[i], block)
            for m in range(i + 1, min(size, i + width)):
                total = total - band[m, m - i] * load(right[m], block)
            store(right[i], block, total / band[i, 0])
    return True


# Weight that ties the ends to their neighbours, beside which all else is nothing.
_STIFF = 1e6


class Duals(NamedTuple):
    """A multiplier for each limit.

    Args:
        caps: Shape (N + 1,).
        knots: Knots of the lower and the upper bound, shape (N + 1, R, 2).
        jerks: Jerks the same for it, shape (N, 2, S, 2).
    """

    caps: Array
    knots: Array
    jerks: Array


@kernel
def least_time_kernel(rows: JerkLimits, z: Array, centrality: float, tolerance: float) -> int:
    """Improve z until the time is within about ``tolerance`` (a part of it) of the least.

    Args:
        rows: The limits.
        z: The unknowns, strictly inside all limits; the answer too, shape (N + 2,).
        centrality: Part of the time that the limits cost at first, all together: 1 keeps well
            away from them, less is for a z that is nearly right.
        tolerance: Time at which to stop.

    Returns:
        The number of steps, negative where it gave up early.
    """
    size = rows.lengths.shape[0]
    duals = Duals(
        np.empty(size - 1),
        np.empty((size - 1, rows.knot_rows.shape[1], 2)),
        np.empty((size - 2, 2, rows.jerk_rows.shape[2], 2)),
    )
    step, trial = np.empty(size), np.empty(size)
    # The right-hand side is the first column of a vector's width.
    system = np.empty((size, 3)), np.zeros((size, LANES))
    time, count = time_kernel(rows, z), count_kernel(rows)
    mu = centrality * time / count
    most = mu
    _start_kernel(rows, z, mu, duals)
    max_steps = 60
    for steps in range(max_steps):
        if not _step_kernel(rows, z, mu, duals, step, system):
            return -steps
        length = _length_kernel(rows, z, step, trial)
        if length <= 0.0:
            return -steps
        gap = _duals_kernel(rows, z, trial, step, mu, duals, length)
        z[:] = trial
        before, time = time, time_kernel(rows, z)
        if gap < tolerance * time and length > 0.5:
            return steps + 1
        # Where a step was cut short the next ones aim at the middle of what is allowed; while the
        # time still falls fast there is no hurry to the limits either.
        # The complementarity aimed at by the next step, as part of what it is.
        centering = max(0.15, 1.0 - length) if length > 0.1 else 2.0
        if time < 0.9 * before:
            centering = max(centering, 0.8)
        mu = min(max(centering * mu, 0.2 * tolerance * time / count), most)
    return max_steps


@kernel
def _step_kernel(
    rows: JerkLimits, z: Array, mu: float, duals: Duals, step: Array, system: tuple[Array, Array]
) -> bool:
    """Write Newton's step, without the indefinite part of the Hessian if need be."""
    band, right = system
    for convex in (False, True):
        _system_kernel(rows, z, mu, duals, convex, step, band)
        for k in range(step.shape[0]):
            right[k, 0] = -step[k]
        if solve_banded_kernel(band, right, 3):
            step[:] = right[:, 0]
            step[0], step[-1] = step[1], step[-2]
            return True
    return False


@kernel(allocates=False)
def _length_kernel(rows: JerkLimits, z: Array, step: Array, trial: Array) -> float:
    """Write z + length step, with a length of at most 1 that stays inside; 0 if there is none."""
    length = 1.0
    for k in range(z.shape[0]):
        if step[k] < 0.0:
            # Of c near 0 nothing is to be gained by going below this part of what it was in one
            # step.
            length = min(length, 0.9 * z[k] / -step[k])
    for _ in range(100):
        for k in range(z.shape[0]):
            # Part of the way to the nearest limit that a step may go.
            trial[k] = z[k] + length / 0.95 * step[k]
        if inside_kernel(rows, trial):
            for k in range(z.shape[0]):
                trial[k] = z[k] + length * step[k]
            return length
        # A step is shortened by this factor until it is inside.
        length *= 0.85
    return 0.0


@kernel(allocates=False)
def _start_kernel(
    rows: JerkLimits,
    z: Array,
    mu: float,
    duals: Duals,
) -> None:
    """Write multipliers that are on the central path of ``mu``."""
    h, caps, knot_rows, knot_counts, jerk_rows, jerk_counts = rows[:6]
    cap_duals, knot_duals, jerk_duals = duals
    cells = h.shape[0] - 2
    for i in range(cells + 1):
        c, d = knot_kernel(h, z, i)
        cap_duals[i] = mu / (1.0 - c / caps[i])
        for k in range(knot_counts[i]):
            value = knot_rows[i, k, 0] * c + knot_rows[i, k, 1] * d
            knot_duals[i, k, 0] = mu / (value - knot_rows[i, k, 2])
            knot_duals[i, k, 1] = mu / (knot_rows[i, k, 3] - value)
    for k in range(1, cells + 1):
        c0, d0 = knot_kernel(h, z, k - 1)
        c1, d1 = knot_kernel(h, z, k)
        e = (d1 - d0) / h[k]
        for end in range(2):
            c, d = (c0, d0) if end == 0 else (c1, d1)
            bound = 1.0 / math.sqrt(c)
            for j in range(jerk_counts[k - 1]):
                value = jerk_at_kernel(jerk_rows[k - 1, end, j], c, d, e)
                jerk_duals[k - 1, end, j, 0] = mu / (bound + value)
                jerk_duals[k - 1, end, j, 1] = mu / (bound - value)


@kernel
def _system_kernel(
    rows: JerkLimits,
    z: Array,
    mu: float,
    duals: Duals,
    convex: bool,
    gradient: Array,
    band: Array,
) -> None:
    """Write the gradient of the barrier function and the diagonals (0, 1, 2 below) of its Hessian.

    With ``convex`` the part of the Hessian is left out that can make it indefinite.
    """
    h, caps, knot_rows, knot_counts = rows[:4]
    cap_duals, knot_duals, jerk_duals = duals
    cells = h.shape[0] - 2
    gradient[:] = 0.0
    band[:] = 0.0
    for k in range(cells + 2):
        slope = -0.5 * weight_kernel(rows, k) / (z[k] * math.sqrt(z[k]))
        gradient[k] = slope
        band[k, 0] = -1.5 * slope / z[k]
    for i in range(cells + 1):
        c, d = knot_kernel(h, z, i)
        g_c, g_d, h_cc, h_cd, h_dd = 0.0, 0.0, 0.0, 0.0, 0.0
        if caps[i] < np.inf:
            s = 1.0 - c / caps[i]
            g_c += mu / (s * caps[i])
            h_cc += cap_duals[i] / (s * caps[i] * caps[i])
        for k in range(knot_counts[i]):
            e, f = knot_rows[i, k, 0], knot_rows[i, k, 1]
            value = e * c + f * d
            low, high = value - knot_rows[i, k, 2], knot_rows[i, k, 3] - value
            below, above = 1.0 / low, 1.0 / high
            pull = mu * (above - below)
            weight = knot_duals[i, k, 0] * below + knot_duals[i, k, 1] * above
            g_c += pull * e
            g_d += pull * f
            h_cc += weight * e * e
            h_cd += weight * e * f
            h_dd += weight * f * f
        total = h[i] + h[i + 1]
        u0, u1 = h[i + 1] / total, h[i] / total
        v0, v1 = -2.0 / total, 2.0 / total
        gradient[i] += g_c * u0 + g_d * v0
        gradient[i + 1] += g_c * u1 + g_d * v1
        band[i, 0] += h_cc * u0 * u0 + 2.0 * h_cd * u0 * v0 + h_dd * v0 * v0
        band[i + 1, 0] += h_cc * u1 * u1 + 2.0 * h_cd * u1 * v1 + h_dd * v1 * v1
        band[i + 1, 1] += h_cc * u0 * u1 + h_cd * (u0 * v1 + u1 * v0) + h_dd * v0 * v1
    _jerk_system_kernel(rows, z, mu, jerk_duals, convex, gradient, band)
    # The ends go with their neighbours: c' is 0 there.
    stiff = _STIFF * band[1, 0]
    band[0, 0] += stiff
    band[1, 0] += stiff
    band[1, 1] -= stiff
    stiff = _STIFF * band[cells, 0]
    band[cells, 0] += stiff
    band[cells + 1, 0] += stiff
    band[cells + 1, 1] -= stiff


@kernel
def _jerk_system_kernel(
    rows: JerkLimits,
    z: Array,
    mu: float,
    jerk_duals: Array,
    convex: bool,
    gradient: Array,
    band: Array,
) -> None:
    """Add the jerk's part of the gradient and the Hessian."""
    h, jerk_rows, jerk_counts = rows.lengths, rows.jerk_rows, rows.jerk_counts
    cells = h.shape[0] - 2
    map_c, map_d, map_e = np.zeros(3), np.zeros(3), np.zeros(3)
    for k in range(1, cells + 1):
        before, after = h[k - 1] + h[k], h[k] + h[k + 1]
        map_e[0] = 2.0 / (before * h[k])
        map_e[2] = 2.0 / (after * h[k])
        map_e[1] = -map_e[0] - map_e[2]
        for end in range(2):
            if end == 0:
                c, d = knot_kernel(h, z, k - 1)
                map_c[0], map_c[1], map_c[2] = h[k] / before, h[k - 1] / before, 0.0
                map_d[0], map_d[1], map_d[2] = -2.0 / before, 2.0 / before, 0.0
            else:
                c, d = knot_kernel(h, z, k)
                map_c[0], map_c[1], map_c[2] = 0.0, h[k + 1] / after, h[k] / after
                map_d[0], map_d[1], map_d[2] = 0.0, -2.0 / after, 2.0 / after
            e = map_e[0] * z[k - 1] + map_e[1] * z[k] + map_e[2] * z[k + 1]
            bound = 1.0 / math.sqrt(c)
            slope = -0.5 * bound / c
            bend = 0.75 * bound / (c * c)
            g_c, g_d, g_e = 0.0, 0.0, 0.0
            h_cc, h_cd, h_ce, h_dd, h_de, h_ee = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for j in range(jerk_counts[k - 1]):
                row = jerk_rows[k - 1, end, j]
                value = jerk_at_kernel(row, c, d, e)
                low, high = bound + value, bound - value
                dual_low, dual_high = jerk_duals[k - 1, end, j, 0], jerk_duals[k - 1, end, j, 1]
                w, r, p = row[0], row[1], row[2]
                # The slacks' derivatives by (c, d, e) are (slope +- w, +- r, +- p).
                below, above = 1.0 / low, 1.0 / high
                pull = mu * (above - below)
                g_c += pull * w - slope * mu * (above + below)
                g_d += pull * r
                g_e += pull * p
                a, b = dual_low * below, dual_high * above
                both, apart = a + b, a - b
                h_cc += both * (w * w + slope * slope) + 2.0 * apart * w * slope
                h_cd += (both * w + apart * slope) * r
                h_ce += (both * w + apart * slope) * p
                h_dd += both * r * r
                h_de += both * r * p
                h_ee += both * p * p
                if not convex:
                    h_cc -= bend * (dual_low + dual_high)
            for a_ in range(3):
                gradient[k - 1 + a_] += g_c * map_c[a_] + g_d * map_d[a_] + g_e * map_e[a_]
                row_c = h_cc * map_c[a_] + h_cd * map_d[a_] + h_ce * map_e[a_]
                row_d = h_cd * map_c[a_] + h_dd * map_d[a_] + h_de * map_e[a_]
                row_e = h_ce * map_c[a_] + h_de * map_d[a_] + h_ee * map_e[a_]
                for b_ in range(a_ + 1):
                    band[k - 1 + a_, a_ - b_] += (
                        row_c * map_c[b_] + row_d * map_d[b_] + row_e * map_e[b_]
                    )


@kernel(allocates=False)
def _step_dual(
    dual: float, slack: float, change: float, mu: float, after: float, length: float
) -> float:
    """A multiplier after its Newton step, kept near the central path."""
    wanted = dual + length * ((mu - dual * change) / slack - dual)
    center = mu / after
    # Within two orders of magnitude of the central path no multiplier is ever lost.
    return min(max(wanted, 0.01 * center), 100.0 * center)


@kernel(allocates=False)
def _duals_kernel(
    rows: JerkLimits,
    z: Array,
    after: Array,
    step: Array,
    mu: float,
    duals: Duals,
    length: float,
) -> float:
    """Step the multipliers; the sum of their products with the slacks that are left."""
    h, caps, knot_rows, knot_counts, jerk_rows, jerk_counts = rows[:6]
    cap_duals, knot_duals, jerk_duals = duals
    cells = h.shape[0] - 2
    gap = 0.0
    for i in range(cells + 1):
        c, d = knot_kernel(h, z, i)
        dc, dd = knot_kernel(h, step, i)
        nc, nd = knot_kernel(h, after, i)
        if caps[i] < np.inf:
            s, n = 1.0 - c / caps[i], 1.0 - nc / caps[i]
            cap_duals[i] = _step_dual(cap_duals[i], s, -dc / caps[i], mu, n, length)
            gap += cap_duals[i] * n
        for k in range(knot_counts[i]):
            e, f = knot_rows[i, k, 0], knot_rows[i, k, 1]
            low, high = knot_rows[i, k, 2], knot_rows[i, k, 3]
            value, change, now = e * c + f * d, e * dc + f * dd, e * nc + f * nd
            dual = _step_dual(knot_duals[i, k, 0], value - low, change, mu, now - low, length)
            knot_duals[i, k, 0] = dual
            gap += dual * (now - low)
            dual = _step_dual(knot_duals[i, k, 1], high - value, -change, mu, high - now, length)
            knot_duals[i, k, 1] = dual
            gap += dual * (high - now)
    for k in range(1, cells + 1):
        c0, d0 = knot_kernel(h, z, k - 1)
        c1, d1 = knot_kernel(h, z, k)
        dc0, dd0 = knot_kernel(h, step, k - 1)
        dc1, dd1 = knot_kernel(h, step, k)
        nc0, nd0 = knot_kernel(h, after, k - 1)
        nc1, nd1 = knot_kernel(h, after, k)
        e, de, ne = (d1 - d0) / h[k], (dd1 - dd0) / h[k], (nd1 - nd0) / h[k]
        for end in range(2):
            c, d, dc, dd = (c0, d0, dc0, dd0) if end == 0 else (c1, d1, dc1, dd1)
            nc, nd = (nc0, nd0) if end == 0 else (nc1, nd1)
            bound, bound_after = 1.0 / math.sqrt(c), 1.0 / math.sqrt(nc)
            falls = -0.5 * bound / c * dc
            for j in range(jerk_counts[k - 1]):
                row = jerk_rows[k - 1, end, j]
                value = jerk_at_kernel(row, c, d, e)
                change = jerk_at_kernel(row, dc, dd, de)
                now = jerk_at_kernel(row, nc, nd, ne)
                pair = jerk_duals[k - 1, end, j]
                pair[0] = _step_dual(
                    pair[0], bound + value, falls + change, mu, bound_after + now, length
                )
                pair[1] = _step_dual(
                    pair[1], bound - value, falls - change, mu, bound_after - now, length
                )
                gap += pair[0] * (bound_after + now) + pair[1] * (bound_after - now)
    return gap
