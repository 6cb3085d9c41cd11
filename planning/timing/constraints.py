"""Velocity and acceleration limits on a path, as linear rows on each cell of a grid.

Along the path q(s) with x = (ds/dt)^2 and d2s/dt2 = u,

    dq/dt^2 = q'(s)^2 x,    d2q/dt2 = q'(s) u + q''(s) x.

Within a cell of length l the path acceleration u is constant, hence x runs linearly from x_0 to
x_1 and u = (x_1 - x_0) / (2 l). On a polynomial path both right-hand sides are polynomials of the
place w in [0, 1] within the cell, linear in (x_0, x_1). Their Bernstein coefficients enclose them,
so that rows a x_0 + b x_1 <= 1, one for each coefficient and sign, hold the limits at every
place of the cell, not only at its ends. For the acceleration on a quadratic path (degree 1 in w)
the coefficients are the values at the two ends: there is no slack at all.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics.chain import Array
from kinematics.kernel import kernel
from kinematics.polynomial import shift_kernel
from planning.timing.path import JointPath


class Cells(NamedTuple):
    """A grid on a path and the limits upon it; N cells, at most R rows each.

    Args:
        pieces: The path's piece that each cell lies on, shape (N,).
        starts: Where the cell begins, in the piece's own parameter, shape (N,).
        lengths: Shape (N,).
        straight: Whether q' is constant on the cell, shape (N,).
        rest: Where the motion stands still: at both ends and at sharp corners, shape (N + 1,).
        rows: (a, b) of a x_0 + b x_1 <= 1, filled up with zeros, shape (N, R, 2).
    """

    pieces: NDArray[np.int64]
    starts: Array
    lengths: Array
    straight: NDArray[np.bool_]
    rest: NDArray[np.bool_]
    rows: Array


def cells(path: JointPath, per_piece: int, limits: Array) -> Cells:
    """The grid on a path: one cell a straight piece, ``per_piece`` on others, and their rows.

    On a straight piece the limits are the same everywhere, so that whatever speeds can be joined
    over it by any motion can be joined at constant acceleration: one cell decides the speeds at
    its ends exactly (the best motion between them is known in closed form).

    Args:
        path: The path.
        per_piece: Number of cells on a piece that is not straight, at least 2.
        limits: Of velocity (inf where there is none) and acceleration, shape (2, n).
    """
    c = path.coefficients
    straight_piece = ~(c[:, :, 2:] != 0.0).any(axis=(1, 2))
    counts = np.where(straight_piece, 1, per_piece)
    pieces = np.repeat(np.arange(len(counts)), counts)
    firsts = np.cumsum(counts) - counts
    lengths = path.lengths[pieces] / counts[pieces]
    starts = (np.arange(len(pieces)) - firsts[pieces]) * lengths
    straight = straight_piece[pieces]
    rest = np.zeros(len(pieces) + 1, dtype=np.bool_)
    rest[[0, -1, *firsts[list(path.corners)]]] = True
    degree = c.shape[2] - 1
    rows = np.zeros((len(pieces), 4 * path.n * degree, 2))
    work = np.empty((4, 2 * degree + 1))
    rows_kernel(c, pieces, starts, lengths, straight, limits, work, rows)
    return Cells(pieces, starts, lengths, straight, rest, rows)


@kernel
def rows_kernel(
    coefficients: Array,
    pieces: NDArray[np.int64],
    starts: Array,
    lengths: Array,
    straight: NDArray[np.bool_],
    limits: Array,
    work: Array,
    rows: Array,
) -> None:
    """Write the rows of all cells; ``rows`` comes filled with zeros, ``work`` is (4, 2 k - 1)."""
    n, size = coefficients.shape[1:]
    shifted, p = work[0, :size], work[1, : size - 1]
    for i in range(pieces.shape[0]):
        length = lengths[i]
        used = 0
        for j in range(n):
            c = coefficients[pieces[i], j]
            v, a = limits[0, j], limits[1, j]
            if straight[i]:
                used = _straight_rows_kernel(c[1], length, v, a, rows[i], used)
                continue
            shift_kernel(c, starts[i], shifted)
            power = 1.0
            for k in range(size - 1):
                # q' at start + length w, in powers of w.
                p[k] = (k + 1) * shifted[k + 1] * power
                power *= length
            used = _curved_rows_kernel(p, length, v, a, work[2:], rows[i], used)


@kernel
def _straight_rows_kernel(
    slope: float, length: float, velocity: float, acceleration: float, rows: Array, used: int
) -> int:
    """x_0, x_1 <= (v / q')^2 and |x_1 - x_0| <= 2 l a / |q'|."""
    speed = (slope / velocity) ** 2
    rate = abs(slope) / (2.0 * length * acceleration)
    if slope != 0.0:
        rows[used, 0] = speed
        rows[used + 1, 1] = speed
        rows[used + 2, 0], rows[used + 2, 1] = -rate, rate
        rows[used + 3, 0], rows[used + 3, 1] = rate, -rate
        used += 4
    return used


@kernel
def _curved_rows_kernel(
    p: Array,
    length: float,
    velocity: float,
    acceleration: float,
    work: Array,
    rows: Array,
    used: int,
) -> int:
    """Rows of one joint on one cell, from q' = sum_k p_k w^k."""
    count = p.shape[0]
    a, b = work[0], work[1]
    for k in range(count):
        # q' u, with u = (x_1 - x_0) / (2 l), and q'' x, with x = x_0 (1 - w) + x_1 w.
        bend = (k + 1) * p[k + 1] / length if k + 1 < count else 0.0
        bend_before = k * p[k] / length
        a[k] = -p[k] / (2.0 * length) + bend - bend_before
        b[k] = p[k] / (2.0 * length) + bend_before
    _to_bernstein_kernel(a, count)
    _to_bernstein_kernel(b, count)
    for k in range(count):
        if a[k] != 0.0 or b[k] != 0.0:
            rows[used, 0], rows[used, 1] = a[k] / acceleration, b[k] / acceleration
            rows[used + 1, 0], rows[used + 1, 1] = -a[k] / acceleration, -b[k] / acceleration
            used += 2
    if velocity == np.inf:
        return used
    terms = 2 * count
    for k in range(terms):
        a[k], b[k] = 0.0, 0.0
    for k in range(count):
        for m in range(count):
            # q'^2 x, with x = x_0 (1 - w) + x_1 w.
            square = p[k] / velocity * (p[m] / velocity)
            a[k + m] += square
            a[k + m + 1] -= square
            b[k + m + 1] += square
    _to_bernstein_kernel(a, terms)
    _to_bernstein_kernel(b, terms)
    for k in range(terms):
        if a[k] != 0.0 or b[k] != 0.0:
            rows[used, 0], rows[used, 1] = a[k], b[k]
            used += 1
    return used


@kernel
def _to_bernstein_kernel(c: Array, count: int) -> None:
    """Turn power coefficients on [0, 1] into Bernstein coefficients, in place."""
    binomial = 1.0
    for k in range(count):
        c[k] /= binomial
        binomial = binomial * (count - 1 - k) / (k + 1)
    for sweep in range(1, count):
        for k in range(count - 1, sweep - 1, -1):
            c[k] += c[k - 1]
