"""An interior-point method for the least time along a path with bounded jerk, compiled.

``jerk.grid`` states the problem: a quadratic B-spline c of the squared speed, its limits, and the
time. Each limit involves three neighbouring unknowns at most, so that a step of Newton's method is
the solution of a system with two diagonals on either side.

All limits but that of the jerk are linear, and the time is convex. A primal-dual method that never
leaves the inside ("Numerical Optimization", 2006, chapter 19) gets within a thousandth of the least
time in some 30 steps, and has an answer that keeps every limit whenever it is stopped.

Cholesky's factors of matrices with few diagonals on either side, in place.
"""

import math

import numpy as np

from compiled.kernel import kernel
from compiled.simd import LANES, load, store
from kinematics.arrays import Array
from planning.timing.jerk.grid import (
    JerkLimits,
    inside_kernel,
    place_kernel,
    slacks_kernel,
    time_kernel,
    value_kernel,
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


@kernel
def least_time_kernel(limits: JerkLimits, z: Array, centrality: float, tolerance: float) -> int:
    """Improve z until the time is within about ``tolerance`` (a part of it) of the least.

    Args:
        limits: The limits.
        z: The unknowns, strictly inside all limits; the answer too, shape (N + 2,).
        centrality: Part of the time that the limits cost at first, all together: 1 keeps well
            away from them, less is for a z that is nearly right.
        tolerance: Time at which to stop.

    Returns:
        The number of steps, negative where it gave up early.
    """
    size = limits.lengths.shape[0]
    # Multipliers of the lower and the upper bound of each row.
    duals = np.empty((*limits.rows.shape[:2], 2))
    step, trial = np.empty(size), np.empty(size)
    # The right-hand side is the first column of a vector's width.
    system = np.empty((size, 3)), np.zeros((size, LANES))
    time, count = time_kernel(limits, z), _count_kernel(limits)
    mu = centrality * time / count
    most = mu
    _start_kernel(limits, z, mu, duals)
    max_steps = 60
    for steps in range(max_steps):
        if not _step_kernel(limits, z, mu, duals, step, system):
            return -steps
        length = _length_kernel(limits, z, step, trial)
        if length <= 0.0:
            return -steps
        gap = _duals_kernel(limits, z, trial, step, mu, duals, length)
        z[:] = trial
        before, time = time, time_kernel(limits, z)
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
    limits: JerkLimits, z: Array, mu: float, duals: Array, step: Array, system: tuple[Array, Array]
) -> bool:
    """Write Newton's step, without the indefinite part of the Hessian if need be."""
    band, right = system
    for convex in (False, True):
        _system_kernel(limits, z, mu, duals, convex, step, band)
        for k in range(step.shape[0]):
            right[k, 0] = -step[k]
        if solve_banded_kernel(band, right, 3):
            step[:] = right[:, 0]
            step[0], step[-1] = step[1], step[-2]
            return True
    return False


@kernel(allocates=False)
def _length_kernel(limits: JerkLimits, z: Array, step: Array, trial: Array) -> float:
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
        if inside_kernel(limits, trial):
            for k in range(z.shape[0]):
                trial[k] = z[k] + length * step[k]
            return length
        # A step is shortened by this factor until it is inside.
        length *= 0.85
    return 0.0


@kernel(allocates=False)
def _count_kernel(limits: JerkLimits) -> int:
    """Number of the bounds that are there."""
    count = 0
    for i in range(limits.counts.shape[0]):
        for k in range(limits.counts[i]):
            count += 2 if limits.rows[i, k, 3] > -np.inf else 1
    return count


@kernel(allocates=False)
def _start_kernel(limits: JerkLimits, z: Array, mu: float, duals: Array) -> None:
    """Write multipliers that are on the central path of ``mu``."""
    for i in range(limits.counts.shape[0]):
        c, d, e = place_kernel(limits.maps, z, i)
        root = 1.0 / math.sqrt(c)
        for k in range(limits.counts[i]):
            row = limits.rows[i, k]
            low, high = slacks_kernel(row, value_kernel(row, c, d, e), root)
            duals[i, k, 0], duals[i, k, 1] = mu / low, mu / high


@kernel(allocates=False)
def _system_kernel(
    limits: JerkLimits,
    z: Array,
    mu: float,
    duals: Array,
    convex: bool,
    gradient: Array,
    band: Array,
) -> None:
    """Write the gradient of the barrier function and the diagonals (0, 1, 2 below) of its Hessian.

    With ``convex`` the part of the Hessian is left out that can make it indefinite.
    """
    band[:] = 0.0
    for k in range(z.shape[0]):
        gradient[k] = -0.5 * weight_kernel(limits, k) / (z[k] * math.sqrt(z[k]))
        band[k, 0] = -1.5 * gradient[k] / z[k]
    for i in range(limits.counts.shape[0]):
        c, d, e = place_kernel(limits.maps, z, i)
        root = 1.0 / math.sqrt(c)
        slope, bend = -0.5 * root / c, 0.75 * root / (c * c)
        g_c, g_d, g_e = 0.0, 0.0, 0.0
        h_cc, h_cd, h_ce, h_dd, h_de, h_ee = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for k in range(limits.counts[i]):
            row, dual_low, dual_high = limits.rows[i, k], duals[i, k, 0], duals[i, k, 1]
            low, high = slacks_kernel(row, value_kernel(row, c, d, e), root)
            w, r, p = row[0], row[1], row[2]
            below, above = 1.0 / low, 1.0 / high
            pull = mu * (above - below)
            a, b = dual_low * below, dual_high * above
            both, apart = a + b, a - b
            g_c += pull * w
            g_d += pull * r
            h_cc += both * w * w
            h_cd += both * w * r
            h_dd += both * r * r
            if row[5] > 0.0:
                # The slacks' derivatives by (c, d, e) are (slope +- w, +- r, +- p).
                g_c -= slope * mu * (above + below)
                g_e += pull * p
                h_cc += both * slope * slope + 2.0 * apart * w * slope
                h_cd += apart * slope * r
                h_ce += (both * w + apart * slope) * p
                h_de += both * r * p
                h_ee += both * p * p
                if not convex:
                    h_cc -= bend * (dual_low + dual_high)
        first, m = i // 2, limits.maps[i]
        for a_ in range(3):
            gradient[first + a_] += g_c * m[0, a_] + g_d * m[1, a_] + g_e * m[2, a_]
            row_c = h_cc * m[0, a_] + h_cd * m[1, a_] + h_ce * m[2, a_]
            row_d = h_cd * m[0, a_] + h_dd * m[1, a_] + h_de * m[2, a_]
            row_e = h_ce * m[0, a_] + h_de * m[1, a_] + h_ee * m[2, a_]
            for b_ in range(a_ + 1):
                change = row_c * m[0, b_] + row_d * m[1, b_] + row_e * m[2, b_]
                band[first + a_, a_ - b_] += change
    # The ends go with their neighbours: c' is 0 there.
    last = z.shape[0] - 1
    for end, beside in ((0, 1), (last, last - 1)):
        stiff = _STIFF * band[beside, 0]
        band[end, 0] += stiff
        band[beside, 0] += stiff
        band[max(end, beside), 1] -= stiff


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
    limits: JerkLimits, z: Array, after: Array, step: Array, mu: float, duals: Array, length: float
) -> float:
    """Step the multipliers; the sum of their products with the slacks that are left."""
    gap = 0.0
    for i in range(limits.counts.shape[0]):
        c, d, e = place_kernel(limits.maps, z, i)
        dc, dd, de = place_kernel(limits.maps, step, i)
        nc, nd, ne = place_kernel(limits.maps, after, i)
        root, root_after = 1.0 / math.sqrt(c), 1.0 / math.sqrt(nc)
        slope = -0.5 * root / c * dc
        for k in range(limits.counts[i]):
            row, pair = limits.rows[i, k], duals[i, k]
            low, high = slacks_kernel(row, value_kernel(row, c, d, e), root)
            left = slacks_kernel(row, value_kernel(row, nc, nd, ne), root_after)
            change, falls = value_kernel(row, dc, dd, de), row[5] * slope
            pair[0] = _step_dual(pair[0], low, falls + change, mu, left[0], length)
            pair[1] = _step_dual(pair[1], high, falls - change, mu, left[1], length)
            # Of a lower bound that is not there the multiplier is 0, the slack infinite.
            gap += pair[0] * min(left[0], 1e300) + pair[1] * left[1]
    return gap
