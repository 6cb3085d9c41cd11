"""Worst residuals of path constraints along a motion, and the first instant of a violation.

Intervals of time on which the bounds of ``residual_bounds`` leave a row open are halved, so the
residual is bounded for all t: the worst one by branch and bound, the first violation from the
earliest intervals on.
"""

from collections.abc import Sequence
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from compiled.kernel import kernel
from kinematics.arrays import Array, Indices
from kinematics.model.chain import Chain
from kinematics.trajectory.trajectory import Trajectory
from planning.constraints.row import Row
from planning.proof.constraints.residual_bounds import row_bounds
from planning.proof.constraints.rotation_bounds import pack
from planning.proof.joint_frames import forward_kernel
from planning.proof.motion_bounds import JOINT_COLUMNS, VALUE, enclose, piece_length, reach

#: Residuals that count as none: what rounding leaves of a bound that is met exactly [m or rad].
TOLERANCE = 1e-6
#: The residual told is above the largest that was found by this share of it, or by the least gap
#: [m or rad], at most.
SHARP = 0.009
LEAST_GAP = 5e-7
#: Halvings of a piece.
_MAX_DEPTH = 60
#: Halvings after which the beginning of a violation is known well enough.
_BEGIN_DEPTH = 40
#: Halvings in search of the largest residual.
_LARGEST_DEPTH = 40
#: Intervals looked at for one constraint, at most: for the verdict, and for the largest residual.
_MAX_INTERVALS = 2_000_000
_MAX_LARGEST = 50_000
#: Intervals that are looked at for a violation after one that rounding leaves open.
_AFTER_OPEN = 20_000
#: Where halving an interval leaves this share of a bound's excess, rounding is what is left; asked
#: after so many halvings, of small excesses [m or rad] sooner.
_ROUNDED_SHARE, _ROUNDED_DEPTH = 0.9, 16
_SMALL, _SMALL_SHARE, _SMALL_DEPTH = 1e-3, 0.7, 12
#: Places of a piece that are looked at first, so that most intervals are settled at once.
_FIRST_LOOKS = 3


class Verdict(IntEnum):
    """Verdict on rows along a motion."""

    HOLDS = 0
    VIOLATED = 1
    UNDECIDED = 2


class ResidualBounds(NamedTuple):
    """Bounds of the residuals of rows along a motion.

    Args:
        verdict: Whether all rows hold for all t.
        worst: Upper bound of all residuals for all t [m or rad].
        worst_time: Instant of the largest residual that was found [s].
        worst_row: The row it is of.
        time: The first instant of a violation, or where the rows are undecided [s].
        row: The row it is of.
        residual: Residual at the first violation [m or rad].
    """

    verdict: Verdict
    worst: float
    worst_time: float
    worst_row: int
    time: float
    row: int
    residual: float


def bound_residuals(chain: Chain, rows: Sequence[Row], trajectory: Trajectory) -> ResidualBounds:
    """Bound the residuals of rows along a trajectory, for every t.

    Args:
        chain: The robot.
        rows: Rows of the constraints, at least one.
        trajectory: Trajectory of all its joints, in its order.
    """
    largest, first = np.zeros(4), np.array([np.inf, 0.0, 0.0])
    motion = (chain.joint_types, chain.offsets, pack(rows), trajectory.breaks)
    largest_residual_kernel(*motion, trajectory.coefficients, largest)
    bound, _, worst_time, worst_row = largest.tolist()
    verdict = Verdict.HOLDS
    if bound > TOLERANCE:
        verdict = Verdict(first_violation_kernel(*motion, trajectory.coefficients, first))
        # Where all rows are proved to hold that is a bound as well.
        bound = min(bound, TOLERANCE) if verdict == Verdict.HOLDS else bound
    time, row, residual = first.tolist()
    return ResidualBounds(verdict, bound, worst_time, int(worst_row), time, int(row), residual)


@kernel
def largest_residual_kernel(
    types: Indices,
    offsets: Array,
    rows: Array,
    breaks: Array,
    coefficients: Array,
    largest: Array,
) -> None:
    """Bound the largest residual of all rows along a motion, by branch and bound.

    Args:
        types: Types of the joints, shape (n,).
        offsets: T_(i-1)_i of every joint at 0, shape (n, 4, 4).
        rows: Rows from ``pack``, shape (m, WIDTH).
        breaks: Breaks of the motion, shape (p + 1,) [s].
        coefficients: Coefficients of the motion, shape (p, n, k).
        largest: Filled: bound, largest residual found, its time [s] and its row, shape (4,).
    """
    n, size = offsets.shape[0], coefficients.shape[2]
    shift, joints, frames = np.empty((2, size)), np.empty((n, JOINT_COLUMNS)), np.empty((n, 4, 4))
    # Begin, end and number of halvings of an interval, and the excess of the bound before.
    spans = np.empty((_LARGEST_DEPTH + 2, 4))
    bound = best = -np.inf
    at, row, looked_at = breaks[0], 0, 0
    for first in (True, False):
        for piece in range(coefficients.shape[0]):
            length = piece_length(breaks, piece)
            for look in range(_FIRST_LOOKS if first else 0):
                middle = length * (look / (_FIRST_LOOKS - 1.0))
                enclose(coefficients[piece], middle, 0.0, shift, joints)
                found, _, i = _worst_row(types, offsets, rows, joints, frames, 0.0)
                if found > best:
                    best, at, row = found, breaks[piece] + middle, i
            spans[0, 0], spans[0, 1], spans[0, 2], spans[0, 3] = 0.0, length, 0.0, np.inf
            top = 0 if first else 1
            while top > 0:
                top -= 1
                low, high, depth, before = (
                    spans[top, 0], spans[top, 1], spans[top, 2], spans[top, 3],
                )  # fmt: skip
                middle = 0.5 * (low + high)
                half = max(high - middle, middle - low) * (1.0 + 4e-16)
                enclose(coefficients[piece], middle, half, shift, joints)
                found, highest, i = _worst_row(types, offsets, rows, joints, frames, half)
                looked_at += 1
                if found > best:
                    best, at, row = found, breaks[piece] + middle, i
                excess = highest - found
                done = depth >= _LARGEST_DEPTH or looked_at >= _MAX_LARGEST
                done = done or (depth >= _ROUNDED_DEPTH and excess > _ROUNDED_SHARE * before)
                small = depth >= _SMALL_DEPTH and excess < _SMALL
                done = done or (small and excess > _SMALL_SHARE * before)
                if done or highest <= best + max(SHARP * abs(best), LEAST_GAP):
                    bound = max(bound, highest)
                    continue
                for begin, end in ((middle, high), (low, middle)):
                    spans[top, 0], spans[top, 1] = begin, end
                    spans[top, 2], spans[top, 3] = depth + 1.0, excess
                    top += 1
    largest[0], largest[1], largest[2], largest[3] = bound, best, at, row


@kernel
def _worst_row(
    types: Indices, offsets: Array, rows: Array, joints: Array, frames: Array, half: float
) -> tuple[float, float, int]:
    """Largest residual in the middle of an interval, bound of all over it, and the first's row."""
    forward_kernel(types, offsets, joints[:, VALUE], frames)
    lengths = reach(types, offsets, joints)
    largest, highest, row = -np.inf, -np.inf, 0
    for i in range(rows.shape[0]):
        residual, bound = row_bounds(types, rows[i], frames, joints, half, lengths)
        highest = max(highest, bound)
        if residual > largest:
            largest, row = residual, i
    return largest, highest, row


@kernel
def first_violation_kernel(
    types: Indices,
    offsets: Array,
    rows: Array,
    breaks: Array,
    coefficients: Array,
    first: Array,
) -> int:
    """Find the first instant of a violation; earliest intervals first.

    Args:
        types: Types of the joints, shape (n,).
        offsets: T_(i-1)_i of every joint at 0, shape (n, 4, 4).
        rows: Rows from ``pack``, shape (m, WIDTH).
        breaks: Breaks of the motion, shape (p + 1,) [s].
        coefficients: Coefficients of the motion, shape (p, n, k).
        first: Filled: time [s], row and residual, shape (3,).

    Returns:
        A ``Verdict``; UNDECIDED where no violation was found and rounding hides whether there is.
    """
    n, m, size = offsets.shape[0], rows.shape[0], coefficients.shape[2]
    shift, joints, frames = np.empty((2, size)), np.empty((n, JOINT_COLUMNS)), np.empty((n, 4, 4))
    is_open = np.ones((_MAX_DEPTH + 2, m), dtype=np.bool_)
    spans, depths = np.empty((_MAX_DEPTH + 2, 2)), np.zeros(_MAX_DEPTH + 2, dtype=np.int64)
    looked_at, most, found, open_at, open_row = 0, _MAX_INTERVALS, False, -1.0, 0
    residual = np.empty(1)
    for piece in range(coefficients.shape[0]):
        spans[0, 0], spans[0, 1], depths[0] = 0.0, piece_length(breaks, piece), 0
        top = 1
        while top > 0:
            top -= 1
            low, high, depth = spans[top, 0], spans[top, 1], depths[top]
            middle = 0.5 * (low + high)
            half, time = max(high - middle, middle - low) * (1.0 + 4e-16), breaks[piece] + middle
            enclose(coefficients[piece], middle, half, shift, joints)
            left, violated = _open_rows(
                types, offsets, rows, joints, frames, half, is_open[depth : depth + 2], residual
            )
            if violated >= 0:
                first[0], first[1], first[2], found = time, violated, residual[0], True
            looked_at += 1
            if violated >= 0:
                top = 0  # only what comes before it is of interest now
            if left < 0:
                continue
            if looked_at >= most or depth == _MAX_DEPTH or (found and depth >= _BEGIN_DEPTH):
                if found:
                    return 1
                if open_at < 0.0:
                    open_at, open_row = time, left
                    most = min(_MAX_INTERVALS, looked_at + _AFTER_OPEN)
                if looked_at >= most:
                    first[0], first[1] = open_at, open_row
                    return 2
                continue
            if violated < 0:
                spans[top, 0], spans[top, 1], depths[top] = middle, high, depth + 1
                top += 1
            spans[top, 0], spans[top, 1], depths[top] = low, middle, depth + 1
            top += 1
        if found:
            return 1
    if open_at >= 0.0:
        first[0], first[1] = open_at, open_row
        return 2
    return 0


@kernel
def _open_rows(
    types: Indices,
    offsets: Array,
    rows: Array,
    joints: Array,
    frames: Array,
    half: float,
    is_open: NDArray[np.bool_],
    residual: Array,
) -> tuple[int, int]:
    """Look at the rows that are open on an interval, the first of ``is_open`` (2, m).

    Returns:
        The last row that stays open, written to the second of them, and the first one that is
        violated in the middle, by ``residual`` (1,); -1 for none.
    """
    forward_kernel(types, offsets, joints[:, VALUE], frames)
    lengths, left, violated = reach(types, offsets, joints), -1, -1
    for i in range(rows.shape[0]):
        is_open[1, i] = False
        if is_open[0, i]:
            here, bound = row_bounds(types, rows[i], frames, joints, half, lengths)
            if bound > TOLERANCE:
                is_open[1, i], left = True, i
            if here > TOLERANCE and violated < 0:
                violated, residual[0] = i, here
    return left, violated
