"""Limits of velocity, acceleration and jerk on a spline of the squared speed, evaluated in kernels.

With x = c(tau) the square of dtau/dt on a path q(tau), the limits of velocity, acceleration and
jerk on the path are

    c <= x_max,    lo <= e c + f c' <= up,    |w c + r c' + p c''| <= c^(-1/2),

and the time is the integral of c^(-1/2). Let c be a quadratic B-spline: with cell lengths h_k, the
unknown z_k belonging to cell k, and knot i between the cells i and i + 1,

    C_i = (h_(i+1) z_i + h_i z_(i+1)) / (h_i + h_(i+1)),
    D_i = 2 (z_(i+1) - z_i) / (h_i + h_(i+1))

are c and c' at the knot, and c'' = (D_k - D_(k-1)) / h_k all over cell k. Two cells of length 0 at
the ends carry c at the ends.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from compiled.kernel import kernel
from kinematics.arrays import Array


class JerkLimits(NamedTuple):
    """Limits on c over N cells.

    Args:
        lengths: Lengths of the cells, 0 at both ends, shape (N + 2,).
        caps: Largest c at the knots, inf where there is none, shape (N + 1,).
        knot_rows: (e, f, lo, up) of lo <= e c + f c' <= up, shape (N + 1, R, 4).
        knot_counts: How many rows of each knot count, shape (N + 1,).
        jerk_rows: (w, r, p) of |w c + r c' + p c''| <= c^(-1/2) at the two ends of each cell,
            shape (N, 2, S, 3).
        jerk_counts: How many rows of each cell count, shape (N,).
        pulls: Time that c at the two ends is made to stand for, so that it is as large as can be
            although it hardly matters for the true time, shape (2,).
    """

    lengths: Array
    caps: Array
    knot_rows: Array
    knot_counts: NDArray[np.int64]
    jerk_rows: Array
    jerk_counts: NDArray[np.int64]
    pulls: Array


@kernel(allocates=False)
def knot_kernel(h: Array, z: Array, i: int) -> tuple[float, float]:
    """C_i and D_i."""
    total = h[i] + h[i + 1]
    c = (h[i + 1] * z[i] + h[i] * z[i + 1]) / total
    d = 2.0 * (z[i + 1] - z[i]) / total
    return c, d


@kernel(allocates=False)
def jerk_at_kernel(row: Array, c: float, d: float, e: float) -> float:
    """The linear part w c + r c' + p c'' of a jerk row."""
    value: float = row[0] * c + row[1] * d + row[2] * e
    return value


@kernel
def inside_kernel(rows: JerkLimits, z: Array) -> bool:
    """Whether every limit is kept strictly."""
    h, caps, knot_rows, knot_counts, jerk_rows, jerk_counts = rows[:6]
    cells = h.shape[0] - 2
    for k in range(cells + 2):
        if not z[k] > 0.0:
            return False
    for i in range(cells + 1):
        c, d = knot_kernel(h, z, i)
        if not c < caps[i]:
            return False
        for k in range(knot_counts[i]):
            value = knot_rows[i, k, 0] * c + knot_rows[i, k, 1] * d
            if not knot_rows[i, k, 2] < value < knot_rows[i, k, 3]:
                return False
    for k in range(1, cells + 1):
        c0, d0 = knot_kernel(h, z, k - 1)
        c1, d1 = knot_kernel(h, z, k)
        e = (d1 - d0) / h[k]
        bound0, bound1 = 1.0 / math.sqrt(c0), 1.0 / math.sqrt(c1)
        for j in range(jerk_counts[k - 1]):
            if not abs(jerk_at_kernel(jerk_rows[k - 1, 0, j], c0, d0, e)) < bound0:
                return False
            if not abs(jerk_at_kernel(jerk_rows[k - 1, 1, j], c1, d1, e)) < bound1:
                return False
    return True


@kernel
def decisive_kernel(rows: JerkLimits, z: Array, share: float) -> JerkLimits:
    """The limits of which more than a share is used at z, and all caps; the others don't count."""
    h, caps, knot_rows, knot_counts, jerk_rows, jerk_counts, pulls = rows
    cells = h.shape[0] - 2
    knots, knots_left = knot_rows.copy(), np.zeros_like(knot_counts)
    jerks, jerks_left = jerk_rows.copy(), np.zeros_like(jerk_counts)
    for i in range(cells + 1):
        c, d = knot_kernel(h, z, i)
        for k in range(knot_counts[i]):
            value = knot_rows[i, k, 0] * c + knot_rows[i, k, 1] * d
            if value > share * knot_rows[i, k, 3] or value < share * knot_rows[i, k, 2]:
                knots[i, knots_left[i]] = knot_rows[i, k]
                knots_left[i] += 1
    for k in range(1, cells + 1):
        c0, d0 = knot_kernel(h, z, k - 1)
        c1, d1 = knot_kernel(h, z, k)
        e = (d1 - d0) / h[k]
        steepest = 0.0
        for j in range(jerk_counts[k - 1]):
            steepest = max(steepest, abs(jerk_rows[k - 1, 0, j, 2]))
        for j in range(jerk_counts[k - 1]):
            # That of the joint that moves most always counts: nothing else keeps c from swinging.
            leads = abs(jerk_rows[k - 1, 0, j, 2]) == steepest
            used0 = abs(jerk_at_kernel(jerk_rows[k - 1, 0, j], c0, d0, e)) * math.sqrt(c0)
            used1 = abs(jerk_at_kernel(jerk_rows[k - 1, 1, j], c1, d1, e)) * math.sqrt(c1)
            if leads or max(used0, used1) > share:
                jerks[k - 1, :, jerks_left[k - 1]] = jerk_rows[k - 1, :, j]
                jerks_left[k - 1] += 1
    return JerkLimits(h, caps, knots, knots_left, jerks, jerks_left, pulls)


@kernel
def time_kernel(rows: JerkLimits, z: Array) -> float:
    """The time that is made the least: the integral of c^(-1/2), each cell at its own z."""
    time = 0.0
    for k in range(z.shape[0]):
        time += weight_kernel(rows, k) / math.sqrt(z[k])
    return time


@kernel(allocates=False)
def weight_kernel(rows: JerkLimits, k: int) -> float:
    """Weight of z_k in the integral over tau."""
    weight: float = rows.lengths[k]
    if k == 0:
        weight = rows.pulls[0]
    elif k == rows.lengths.shape[0] - 1:
        weight = rows.pulls[1]
    return weight


@kernel(allocates=False)
def count_kernel(rows: JerkLimits) -> int:
    """Number of limits."""
    count = 0
    for i in range(rows.caps.shape[0]):
        count += 2 * rows.knot_counts[i] + (1 if rows.caps[i] < np.inf else 0)
    for k in range(rows.jerk_counts.shape[0]):
        count += 4 * rows.jerk_counts[k]
    return count


@kernel
def envelope_kernel(h: Array, rises: Array, z: Array) -> None:
    """Lower z until no step from cell to cell is above ``rises`` (N + 1,), and smooth it."""
    cells = h.shape[0] - 2
    for i in range(cells + 1):
        z[i + 1] = min(z[i + 1], z[i] + rises[i])
    for i in range(cells, -1, -1):
        z[i] = min(z[i], z[i + 1] + rises[i])
    # How often the first guess is smoothed: without, its kinks would ask for jerk without end.
    for _ in range(3):
        z[0], z[cells + 1] = z[1], z[cells]
        before = z[0]
        for k in range(1, cells + 1):
            here = z[k]
            z[k] = math.sqrt(math.sqrt(before * z[k + 1]) * here)
            before = here
    z[0], z[cells + 1] = z[1], z[cells]
