"""Velocity and acceleration limits on a path, as linear rows on each cell of a grid.

Along the path q(s) with x = (ds/dt)^2 and d2s/dt2 = u,

    dq/dt^2 = q'(s)^2 x,    d2q/dt2 = q'(s) u + q''(s) x.

Within a cell of length l the path acceleration u is constant, hence x runs linearly from x_0 to
x_1 and u = (x_1 - x_0) / (2 l). On a polynomial path both right-hand sides are polynomials of the
place w in [0, 1] within the cell, linear in (x_0, x_1). Their Bernstein coefficients enclose them,
so that bounds on the coefficients hold at every place of the cell, not only at its ends.

For the acceleration each coefficient gives two rows a x_0 + b x_1 <= 1. On a quadratic path
(degree 1 in w) the coefficients are the values at the two ends: there is no slack at all.

For the velocity, rows would let a large x_0 be bought with a small x_1, which a solver that goes
step by step would do. So the velocity gives a cap for each grid point instead, such that any
speeds below the caps are good: the tighter end of the cell is given all that the limit allows
there, the other end what that leaves.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from compiled.kernel import kernel
from kinematics.arrays import Array
from kinematics.trajectory.polynomial import shift_kernel
from planning.timing.path.path import JointPath


class Cells(NamedTuple):
    """A grid on a path and the limits upon it; N cells, at most R rows each.

    Args:
        pieces: The path's piece that each cell lies on, shape (N,).
        starts: Beginning of the cell, in the piece's own parameter, shape (N,).
        lengths: Shape (N,).
        straight: Whether q' is constant on the cell, shape (N,).
        rest: Whether ds/dt must be 0: at sharp corners, and at both ends unless q' is 0 there,
            which is standing still already, shape (N + 1,).
        rows: (a, b) of a x_0 + b x_1 <= 1, filled up with zeros, shape (N, R, 2).
        caps: Largest x at each grid point, inf where there is none, shape (N + 1,).
    """

    pieces: NDArray[np.int64]
    starts: Array
    lengths: Array
    straight: NDArray[np.bool_]
    rest: NDArray[np.bool_]
    rows: Array
    caps: Array


def cells(path: JointPath, resolution: int, limits: Array, *, everywhere: bool = False) -> Cells:
    """The grid on a path, with its limits: one cell a straight piece, more on the others.

    On a straight piece the limits are the same everywhere, so that whatever speeds can be joined
    over it by any motion can be joined at constant acceleration: one cell decides the speeds at
    its ends exactly (the best motion between them is known in closed form).

    Args:
        path: The path.
        resolution: Number of cells that a path without straight pieces would have; a curved piece
            has its share by length, or more if it turns much at high speed.
        limits: Limits of velocity (inf where there is none) and acceleration, shape (2, n), or
            those of each piece, (p, 2, n).
        everywhere: Whether straight pieces get cells as curved ones do, since there are other
            limits too that change along them.
    """
    c = path.coefficients
    limits = np.ascontiguousarray(np.broadcast_to(limits, (len(c), 2, path.n)))
    straight_piece = ~(c[:, :, 2:] != 0.0).any(axis=(1, 2)) & (not everywhere)
    counts = np.where(straight_piece, 1, _curved_counts(path, resolution, limits))
    pieces = np.repeat(np.arange(len(counts)), counts)
    firsts = np.cumsum(counts) - counts
    lengths = path.lengths[pieces] / counts[pieces]
    starts = (np.arange(len(pieces)) - firsts[pieces]) * lengths
    straight = straight_piece[pieces]
    rest = np.zeros(len(pieces) + 1, dtype=np.bool_)
    rest[[*firsts[list(path.corners)]]] = True
    rest[[0, -1]] = _moves_at_ends(path)
    degree = c.shape[2] - 1
    rows = np.zeros((len(pieces), 2 * path.n * degree, 2))
    caps = np.full(len(rest), np.inf)
    geometry = np.column_stack([starts, lengths])
    limits_kernel(c, pieces, geometry, straight, limits, rows, caps)
    return Cells(pieces, starts, lengths, straight, rest, rows, caps)


def guards(cells: Cells) -> Array:
    """Largest x with which each cell can be entered at constant speed, shape (N,).

    Of a joint that q' hardly moves but q'' does, the acceleration may be kept at a higher x by
    braking hard. A solver that takes the highest x at each step is then made to brake nearly to a
    stop, and would better have been slower before.
    """
    with np.errstate(all="ignore"):
        worst = (cells.rows[:, :, 0] + cells.rows[:, :, 1]).max(axis=1)
        return np.asarray(np.where(cells.straight | (worst <= 0.0), np.inf, 1.0 / worst))


def _moves_at_ends(path: JointPath) -> list[bool]:
    first, last = path.coefficients[0], path.coefficients[-1]
    powers = np.arange(1, first.shape[1])
    tangents = last[:, 1:] * powers * path.lengths[-1] ** (powers - 1)
    ends = np.abs(first[:, 1]), np.abs(tangents.sum(axis=1))
    scales = np.abs(first[:, 1:]).max(), np.abs(tangents).max()
    # A tangent at an end is none if it is but this part of what it is made up from: rounding.
    return [bool(e.max() > 1e-13 * scale) for e, scale in zip(ends, scales, strict=True)]


def _curved_counts(path: JointPath, resolution: int, limits: Array) -> NDArray[np.int64]:
    """Number of cells of each piece if it is curved, shape (p,)."""
    shares = resolution * path.lengths / path.lengths.sum()
    entering = path.coefficients[:, :, 1]
    powers = np.arange(2, path.coefficients.shape[2])
    turns = path.coefficients[:, :, 2:] * powers * path.lengths[:, None, None] ** (powers - 1)
    change = (np.abs(turns.sum(axis=2)) / limits[:, 0]).max(axis=1)
    slowness = np.maximum((np.abs(entering) / limits[:, 0]).max(axis=1), change)
    reluctance = (np.abs(entering) / limits[:, 1]).max(axis=1)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        turn = np.nan_to_num(change / slowness)
        room = np.nan_to_num(path.lengths * slowness**2 / reluctance, nan=1.0)
    # On a parabola between directions as different as can be, run through at speeds that the
    # velocity limits: with 24 cells the duration is within 0.4 % of what thousands give. A cubic
    # piece needs twice as many, its acceleration bends within a cell.
    # A piece this many times as long as V^2 / A (speed and acceleration limit along it) counts as
    # one where the velocity decides throughout.
    per_turn = 24 * len(powers) * turn * np.minimum(1.0, room / 4.0)
    # On a short or flat parabola, where the acceleration alone decides, more cells gain nothing.
    counts = np.ceil(np.maximum(np.maximum(shares, per_turn), 8))
    return np.asarray(counts, dtype=np.int64)


@kernel
def limits_kernel(
    coefficients: Array,
    pieces: NDArray[np.int64],
    geometry: Array,
    straight: NDArray[np.bool_],
    limits: Array,
    rows: Array,
    caps: Array,
) -> None:
    """Write the rows, which come as zeros, and lower the caps; ``geometry`` is (start, length)."""
    n, size = coefficients.shape[1:]
    work = np.empty((4, 2 * size - 1))
    shifted, p = work[0, :size], work[1, : size - 1]
    for i in range(pieces.shape[0]):
        start, length = geometry[i]
        used = 0
        for j in range(n):
            c = coefficients[pieces[i], j]
            v, a = limits[pieces[i], 0, j], limits[pieces[i], 1, j]
            if straight[i]:
                cap = (v / c[1]) ** 2
                caps[i], caps[i + 1] = min(caps[i], cap), min(caps[i + 1], cap)
                # One pair of rows is enough: |x_1 - x_0| <= 2 l a / |q'| of the tightest joint.
                rate = max(rows[i, 0, 1], abs(c[1]) / (2.0 * length * a))
                rows[i, 0, 0], rows[i, 0, 1] = -rate, rate
                rows[i, 1, 0], rows[i, 1, 1] = rate, -rate
                continue
            shift_kernel(c, start, shifted)
            power = 1.0
            for k in range(size - 1):
                # q' at start + length w, in powers of w.
                p[k] = (k + 1) * shifted[k + 1] * power
                power *= length
            used = _acceleration_kernel(p, length, a, work[2:], rows[i], used)
            if v < np.inf:
                cap, cap_after = _velocity_kernel(p, v, work[2:])
                caps[i], caps[i + 1] = min(caps[i], cap), min(caps[i + 1], cap_after)


@kernel(allocates=False)
def _acceleration_kernel(
    p: Array, length: float, limit: float, work: Array, rows: Array, used: int
) -> int:
    """Rows of one joint on one cell, from q' = sum_k p_k w^k; answers how many there are now."""
    count = p.shape[0]
    a, b = work[0], work[1]
    for k in range(count):
        # q' u, with u = (x_1 - x_0) / (2 l), and q'' x, with x = x_0 (1 - w) + x_1 w.
        bend = (k + 1) * p[k + 1] / length if k + 1 < count else 0.0
        bend_before = k * p[k] / length
        a[k] = -p[k] / (2.0 * length) + bend - bend_before
        b[k] = p[k] / (2.0 * length) + bend_before
    to_bernstein_kernel(a, count)
    to_bernstein_kernel(b, count)
    for k in range(count):
        if a[k] != 0.0 or b[k] != 0.0:
            rows[used, 0], rows[used, 1] = a[k] / limit, b[k] / limit
            rows[used + 1, 0], rows[used + 1, 1] = -a[k] / limit, -b[k] / limit
            used += 2
    return used


@kernel(allocates=False)
def _velocity_kernel(p: Array, limit: float, work: Array) -> tuple[float, float]:
    """Caps on (x_0, x_1) of one joint on one cell, from q' = sum_k p_k w^k."""
    count = p.shape[0]
    terms = 2 * count
    a, b = work[0], work[1]
    a[:terms] = 0.0
    b[:terms] = 0.0
    for k in range(count):
        for m in range(count):
            # q'^2 x, with x = x_0 (1 - w) + x_1 w.
            square = p[k] / limit * (p[m] / limit)
            a[k + m] += square
            a[k + m + 1] -= square
            b[k + m + 1] += square
    to_bernstein_kernel(a, terms)
    to_bernstein_kernel(b, terms)
    before, after = a[0], b[terms - 1]
    both, cap = 0.0, np.inf
    for k in range(terms):
        # A negative coefficient would only help: speeds are not negative.
        slack_a, slack_b = max(a[k], 0.0), max(b[k], 0.0)
        both = max(both, slack_a + slack_b)
        if before > after and slack_b > 0.0:
            cap = min(cap, (1.0 - slack_a / before) / slack_b)
        elif before <= after and slack_a > 0.0 and k < terms - 1:
            cap = min(cap, (1.0 - slack_b / after) / slack_a)
    if before > after and cap * before >= 1.0:
        return 1.0 / before, cap
    if before <= after and cap * after >= 1.0:
        return cap, 1.0 / after
    # Faster inside than at its ends, or not moving at all: one cap for both.
    return 1.0 / both, 1.0 / both


@kernel(allocates=False)
def to_bernstein_kernel(c: Array, count: int) -> None:
    """Turn power coefficients on [0, 1] into Bernstein coefficients, in place."""
    binomial = 1.0
    for k in range(count):
        c[k] /= binomial
        binomial = binomial * (count - 1 - k) / (k + 1)
    for sweep in range(1, count):
        for k in range(count - 1, sweep - 1, -1):
            c[k] += c[k - 1]
