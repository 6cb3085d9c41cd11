"""Exact worst ratios of a motion's velocity, acceleration and jerk to their limits.

Vectors hold a number of eight joints. The ends of all pieces come first. A piece holds nothing
worse where the sums of its coefficients, or its Bernstein coefficients, are within what is known
to be the worst of all joints; only the others cost roots.
"""

import numpy as np

from compiled.kernel import kernel
from compiled.simd import LANES, Lanes, bits, fill, lane, load, store
from kinematics.arrays import Array
from kinematics.trajectory.polynomial import widen_inside_kernel

_ALL = (1 << LANES) - 1


@kernel
def worst_kernel(breaks: Array, coefficients: Array, limits: Array, worst: Array) -> None:
    """Write the exact worst ratios of velocity, acceleration and jerk to their limits.

    Args:
        breaks: Shape (m + 1,) [s].
        coefficients: Shape (m, n, k).
        limits: inf where there is none, shape (3, n).
        worst: Comes as zeros, shape (3,).
    """
    m, n, size = coefficients.shape
    width = -(-n // LANES) * LANES
    pieces, rates = np.zeros((m, size, width)), np.zeros((m, size, width))
    bounds, peaks = np.full(width, np.inf), np.empty(width)
    spare, work = np.empty(size * LANES), np.empty((size + 4, max(size, 4)))
    for i in range(m):
        for joint in range(n):
            for k in range(size):
                pieces[i, k, joint] = coefficients[i, joint, k]
    for row in range(3):
        least = np.inf
        for joint in range(n):
            bounds[joint] = limits[row, joint]
            least = min(least, bounds[joint])
        if not least < np.inf:
            continue
        count = max(size - row - 1, 1)
        for i in range(m):
            _write_rates(pieces[i], breaks[i + 1] - breaks[i], row + 1, rates[i])
        ratio = _ratio_at_ends(rates, count, bounds, peaks)
        if count > 2:
            ratio = _ratio_inside(rates, count, bounds, ratio, peaks, spare, work)
        worst[row] = max(worst[row], ratio)


@kernel(allocates=False)
def _write_rates(piece: Array, h: float, order: int, rates: Array) -> None:
    """Write a derivative of a piece (k, n') in powers of u, t = h u; nothing beyond its degree."""
    size, width = piece.shape
    power = 1.0
    for k in range(size - order):
        factor = power
        for i in range(order):
            factor *= k + order - i
        for block in range(0, width, LANES):
            store(rates[k], block, load(piece[k + order], block) * factor)
        power *= h
    if size <= order:
        for block in range(0, width, LANES):
            store(rates[0], block, 0.0)


@kernel(allocates=False)
def _ratio_at_ends(rates: Array, count: int, bounds: Array, peaks: Array) -> float:
    """Write the largest values at the ends of pieces, ``peaks`` (n',); their worst ratio."""
    worst = 0.0
    for block in range(0, peaks.shape[0], LANES):
        peak = fill(0.0)
        for i in range(rates.shape[0]):
            begins, ends = load(rates[i, 0], block), load(rates[i, count - 1], block)
            for k in range(count - 2, -1, -1):
                ends = ends + load(rates[i, k], block)
            peak = max(peak, abs(begins))
            peak = max(peak, abs(ends))
        store(peaks, block, peak)
        worst = max(worst, largest_lane(peak / load(bounds, block)))
    return worst


@kernel(allocates=False)
def _ratio_inside(
    rates: Array, count: int, bounds: Array, ratio: float, peaks: Array, spare: Array, work: Array
) -> float:
    """The worst ratio at the ends of pieces and inside them.

    Args:
        rates: Rates of the pieces, in powers of u in [0, 1], shape (m, >= count, n').
        count: Coefficients that count.
        bounds: Shape (n',).
        ratio: Ratio at the ends.
        peaks: Peaks at the ends, of each joint, shape (n',); changed.
        spare: Room, shape (8 count,).
        work: Room, shape (count + 4, >= max(count, 4)).
    """
    for i in range(rates.shape[0]):
        for block in range(0, rates.shape[2], LANES):
            # Pieces are passed over that stay below the worst ratio by this part of it: far more
            # than rounding.
            cap = load(bounds, block) * (ratio * (1.0 - 1e-12))
            cap = max(load(peaks, block), cap)
            open_lanes = _ALL ^ bits(_sums_inside(rates[i], count, block, cap))
            if open_lanes == 0:
                continue
            open_lanes &= _ALL ^ _hull_inside(rates[i], count, block, cap, spare)
            for number in range(LANES):
                if open_lanes >> number & 1:
                    joint = block + number
                    peak = _peak_inside(rates[i], count, joint, peaks[joint], work)
                    peaks[joint] = peak
                    ratio = max(ratio, peak / bounds[joint])
    return ratio


@kernel(inline="code", allocates=False)
def _sums_inside(rates: Array, count: int, block: int, cap: Lanes) -> bool:
    """Whether a coefficient and the sums of those of one sign beyond it are within +-``cap``."""
    below = load(rates[0], block)
    above = below
    for k in range(1, count):
        c = load(rates[k], block)
        below, above = below + min(c, 0.0), above + max(c, 0.0)
    # Said this way round a NaN is never inside.
    return (-cap <= below) & (above <= cap)


@kernel(allocates=False)
def _hull_inside(rates: Array, count: int, block: int, cap: Lanes, spare: Array) -> int:
    """Bits of the joints whose Bernstein coefficients on [0, 1] are within +-``cap``.

    b_i = sum_(j<=i) C(i, j) / C(d, j) c_j, by d sweeps of additions.
    """
    degree, binomial = count - 1, 1.0
    for k in range(count):
        store(spare, k * LANES, load(rates[k], block) / binomial)
        binomial = binomial * (degree - k) / (k + 1)
    for sweep in range(1, count):
        for k in range(degree, sweep - 1, -1):
            raised = load(spare, k * LANES) + load(spare, (k - 1) * LANES)
            store(spare, k * LANES, raised)
    inside = _ALL
    for k in range(count):
        b = load(spare, k * LANES)
        inside &= bits((-cap <= b) & (b <= cap))
    return inside


@kernel(allocates=False)
def _peak_inside(rates: Array, count: int, joint: int, peak: float, work: Array) -> float:
    """The largest absolute value of a joint's rate at its stationary points, or ``peak``."""
    c, roots, spare, best, table = work[0], work[1], work[2], work[3], work[4:]
    for k in range(count):
        c[k] = rates[k, joint]
    # Pieces of a lower degree than the rest cost no more than they must.
    while count > 1 and c[count - 1] == 0.0:
        count -= 1
    if count < 3:
        return peak
    best[0], best[1], best[2], best[3] = -peak, 0.0, peak, 0.0
    widen_inside_kernel(c, count, 0.0, 1.0, table, roots, spare, best)
    return float(max(best[2], -best[0]))


@kernel(inline="code", allocates=False)
def largest_lane(value: Lanes) -> float:
    """The largest number of a vector."""
    largest = lane(value, 0)
    for number in range(1, LANES):
        largest = max(largest, lane(value, number))
    return largest
