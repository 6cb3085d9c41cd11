"""A lower bound of the time that any motion takes along the way of a given one.

Where the path parameter s has the speed x = (ds/dt)^2, joint j moves at w_j = |q_j'| sqrt(x). An
acceleration of at most a_j changes w_j^2 by at most 2 a_j on each unit of the joint's own way, so
that over a cell of the path

    |w_j(end)^2 - w_j(begin)^2| <= 2 a_j * variation of q_j in the cell.

Every motion holds this, whatever it does within the cell: the largest speeds that it leaves, found
forwards and backwards, are never exceeded, and the joint that needs longest at these speeds bounds
the time of the cell. The variation is bounded by that of the Bernstein polygon. Jerk, torques and
the tool's speed are left out, which makes the bound lower.
"""

import math

import numpy as np

from compiled.kernel import kernel
from kinematics.arrays import Array
from kinematics.trajectory.polynomial import shift_kernel
from kinematics.trajectory.trajectory import Trajectory
from planning.timing.speed.constraints import to_bernstein_kernel

# Cells that a motion has at least: with thousands the bound rises by
# less than a hundredth.
_CELLS = 128
# Coefficients of a velocity below this part of the largest in a cell are rounding [-].
_ROUNDING = 1e-6
# Unit directions before and after a rest that differ by more than this make a corner, which no
# motion passes without a rest.
_CORNER = 1e-3
# Part of the bound that is given away for rounding [-].
_HAIR = 1e-9


@kernel
def _cell_kernel(c: Array, start: float, h: float, work: Array, cell: Array) -> None:
    """Write what a cell is to the bound.

    Args:
        c: Coefficients of the piece, shape (n, k).
        start: Beginning of the cell in the piece's time.
        h: Length of the cell.
        work: Scratch, shape (n + 1, k).
        cell: Rows of the way of each joint, of its variation at most, and of the velocity at both
            ends, a direction where it is 0, shape (4, n).
    """
    n, size = c.shape
    count = size - 1
    largest = 0.0
    for j in range(n):
        shift_kernel(c[j], start, work[n])
        power = 1.0
        for k in range(count):
            work[j, k] = (k + 1) * work[n, k + 1] * power
            power *= h
        to_bernstein_kernel(work[j], count)
        for k in range(count):
            cell[0, j] += work[j, k] * h / count
            cell[1, j] += abs(work[j, k]) * h / count
            largest = max(largest, abs(work[j, k]))
    for end in range(2):
        for k in range(count):
            at = count - 1 - k if end == 1 else k
            size_here = 0.0
            for j in range(n):
                size_here = max(size_here, abs(work[j, at]))
            if size_here > _ROUNDING * largest:
                for j in range(n):
                    cell[2 + end, j] = work[j, at]
                break


@kernel(allocates=False)
def _normalised_kernel(row: Array) -> None:
    """Divide a row by its Euclidean norm, unless that is 0."""
    square = 0.0
    for j in range(row.shape[0]):
        square += row[j] * row[j]
    for j in range(row.shape[0] if square > 0.0 else 0):
        row[j] /= math.sqrt(square)


@kernel(allocates=False)
def _joint_time(way: float, most: float, ends: tuple[float, float], v: float, a: float) -> float:
    """The least time in which a joint goes a way whose variation is at most ``most``."""
    w0, w1 = ends
    if not a < np.inf:
        return way / v
    peak = math.sqrt(0.5 * (w0 * w0 + w1 * w1) + a * way)
    fastest = min(v, math.sqrt(0.5 * (w0 * w0 + w1 * w1) + a * most))
    time = way / fastest if fastest > 0.0 else 0.0
    # Rounding may leave a peak that is an end's speed below it.
    if peak < max(w0, w1) * (1.0 - _HAIR):
        return time
    if peak <= v:
        return max(time, (2.0 * peak - w0 - w1) / a)
    cruise = way - (2.0 * v * v - w0 * w0 - w1 * w1) / (2.0 * a)
    return max(time, (2.0 * v - w0 - w1) / a + cruise / v)


@kernel
def _caps_kernel(cells: Array, bounds: Array, squares: Array) -> None:
    """Lower squared speeds to the limits of velocity, before a joint turns back, to 0 at corners.

    Args:
        cells: What ``_cell_kernel`` writes, directions as unit vectors, shape (N, 4, n).
        bounds: Limits of velocity and acceleration in each cell, shape (2, N, n).
        squares: Shape (N + 1,).
    """
    count, _, n = cells.shape
    for i in range(count):
        for end in range(2):
            for j in range(n):
                u = abs(cells[i, 2 + end, j])
                most = bounds[0, i, j] ** 2
                if cells[i, 2, j] * cells[i, 3, j] < 0.0:
                    most = min(most, 2.0 * bounds[1, i, j] * cells[i, 1, j])
                if u > 0.0:
                    squares[i + end] = min(squares[i + end], most / (u * u))
    for i in range(1, count):
        for j in range(n):
            if abs(cells[i, 2, j] - cells[i - 1, 3, j]) > _CORNER:
                squares[i] = 0.0


@kernel
def lower_bound_kernel(breaks: Array, coefficients: Array, limits: Array, per_piece: int) -> float:
    """The bound [s].

    Args:
        breaks: Shape (m + 1,) [s].
        coefficients: Shape (m, n, k), k >= 2.
        limits: Limits of velocity and acceleration in each piece, inf for none, shape (2, m, n).
        per_piece: Cells in each piece.
    """
    m, n, size = coefficients.shape
    count = m * per_piece
    cells, work = np.zeros((count, 4, n)), np.empty((n + 1, size))
    bounds, squares = np.empty((2, count, n)), np.full(count + 1, 1e300)
    for i in range(count):
        piece, part = i // per_piece, i % per_piece
        h = (breaks[piece + 1] - breaks[piece]) / per_piece
        _cell_kernel(coefficients[piece], part * h, h, work, cells[i])
        _normalised_kernel(cells[i, 2])
        _normalised_kernel(cells[i, 3])
        bounds[:, i] = limits[:, piece]
    _caps_kernel(cells, bounds, squares)
    start, end, h = 0.0, 0.0, breaks[m] - breaks[m - 1]
    for j in range(n):
        start += coefficients[0, j, 1] ** 2
        velocity = 0.0
        for k in range(size - 1, 0, -1):
            velocity = velocity * h + k * coefficients[m - 1, j, k]
        end += velocity * velocity
    squares[0], squares[count] = min(squares[0], start), min(squares[count], end)
    for backwards in range(2):
        for step in range(count):
            i = count - 1 - step if backwards else step
            here, there = i + backwards, i + 1 - backwards
            for j in range(n):
                u, w = cells[i, 2 + backwards, j], cells[i, 3 - backwards, j]
                if w != 0.0:
                    most = u * u * squares[here] + 2.0 * bounds[1, i, j] * cells[i, 1, j]
                    squares[there] = min(squares[there], most / (w * w))
    total = 0.0
    for i in range(count):
        slowest, v0, v1 = 0.0, math.sqrt(squares[i]), math.sqrt(squares[i + 1])
        for j in range(n):
            speeds = abs(cells[i, 2, j]) * v0, abs(cells[i, 3, j]) * v1
            v, a = bounds[0, i, j], bounds[1, i, j]
            slowest = max(slowest, _joint_time(abs(cells[i, 0, j]), cells[i, 1, j], speeds, v, a))
        total += slowest
    return total


def lower_bound(motion: Trajectory, velocity: Array, acceleration: Array) -> float:
    """Lower bound of the time of any motion along the same way, with the same speeds at its ends.

    Args:
        motion: The motion; only its way counts, and its speeds at its ends.
        velocity: Limits, inf where there is none, shape (n,), or (m, n) for each piece.
        acceleration: Limits, likewise.
    """
    if motion.coefficients.shape[2] < 2:
        return 0.0
    limits = np.empty((2, motion.pieces, motion.n))
    limits[0], limits[1] = velocity, acceleration
    per_piece = -(-_CELLS // motion.pieces)
    found = lower_bound_kernel(motion.breaks, motion.coefficients, limits, per_piece)
    return float(found) * (1.0 - _HAIR)
