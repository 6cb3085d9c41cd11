"""Reachability analysis for the fastest speeds on a grid, compiled.

Backwards, the largest x_i from which the next cell can still be braked through; then forwards, the
largest x_(i+1) that each x_i can reach ("A new approach to time-optimal path parameterization based
on reachability analysis", 2018). With limits that are the same in both directions standing still
is always possible, so the sets of speeds all begin at 0 and a single number bounds each. The same
quantities as in ``planning.timing.speed.toppra``, 30 to 100 times as fast and without fixed
tolerances.
"""

import numpy as np
from numpy.typing import NDArray

from compiled.kernel import kernel
from kinematics.arrays import Array
from planning.timing.failure import TimingFailed
from planning.timing.speed.constraints import Cells, guards


def squared_speeds(cells: Cells) -> Array:
    """The largest (ds/dt)^2 at the N + 1 grid points that all rows and rests allow.

    Raises:
        TimingFailed: Some speed is not bounded by any limit, or nothing but standing still is left.
    """
    squares = np.zeros(len(cells.lengths) + 1)
    caps = cells.caps.copy()
    reachability_kernel(cells.rows, caps, guards(cells), cells.rest, squares)
    if not (np.isfinite(squares).all() and (squares[~cells.rest] > 0.0).all()):
        raise TimingFailed(
            "no finite speed along the path was found",
            hint="Look for limits or lengths of very different sizes.",
        )
    return squares


@kernel
def reachability_kernel(
    rows: Array, caps: Array, guards: Array, rest: NDArray[np.bool_], squares: Array
) -> None:
    """Write the squared speeds: backward and forward pass, caps lowered where that was a trap."""
    count = rows.shape[0]
    most = np.empty(count + 1)
    # Few paths have a trap, and one or two rounds free them.
    for _ in range(20):
        most[count] = 0.0 if rest[count] else caps[count]
        for i in range(count - 1, -1, -1):
            most[i] = 0.0
            if not rest[i]:
                most[i] = min(caps[i], _controllable_kernel(rows[i], most[i + 1]))
        squares[0] = most[0]
        trapped = False
        for i in range(count):
            squares[i + 1] = 0.0
            if not rest[i + 1]:
                squares[i + 1] = _reachable_kernel(rows[i], squares[i], most[i + 1])
            # A cell is a trap where x has to fall below this part both of what it was and of what
            # the way to the goal allows. Few paths have one, and one or two rounds free them.
            forced = squares[i + 1] < 0.5 * min(squares[i], most[i + 1])
            if forced and guards[i] < caps[i]:
                caps[i] = guards[i]
                trapped = True
        if not trapped:
            break


@kernel(allocates=False)
def _reachable_kernel(rows: Array, x0: float, most: float) -> float:
    """The largest x_1 <= ``most`` with a x_0 + b x_1 <= 1 for all rows.

    Where x_0 leaves one x_1 only, rounding may put its upper bound below its lower one: then the
    bound with the larger coefficient is the sharper one, and breaks the other by rounding only.
    """
    upper, lower, upper_weight, lower_weight = np.inf, 0.0, 0.0, 0.0
    for k in range(rows.shape[0]):
        a, b = rows[k, 0], rows[k, 1]
        if b == 0.0:
            continue
        bound = (1.0 - a * x0) / b
        if b > 0.0 and bound < upper:
            upper, upper_weight = bound, b
        elif b < 0.0 and bound > lower:
            lower, lower_weight = bound, -b
    best = lower if lower > upper and lower_weight > upper_weight else upper
    return min(max(best, 0.0), most)


@kernel(allocates=False)
def _controllable_kernel(rows: Array, most: float) -> float:
    """The largest x_0 for which some x_1 in [0, ``most``] has a x_0 + b x_1 <= 1 for all rows.

    By duality 1 / x_0 is the largest a for which (a, 0) lies in the hull of the rows' points
    (a, b), the bound's (0, 1 / most), and all below them (x_1 >= 0). So it is the largest a of the
    points with b >= 0, or where the rightmost edge of the hull crosses b = 0. The edge is found by
    exchanging one of its ends for the point farthest outside, as long as the crossing moves right.
    No division by a small coefficient occurs.
    """
    count = rows.shape[0]
    best, highest_below = 0.0, -1
    above_a, above_b = 0.0, (1.0 / most if most > 0.0 else np.inf)
    for k in range(count):
        a, b = rows[k, 0], rows[k, 1]
        if a > best and (b >= 0.0 or most == 0.0):
            best = a
        if b < 0.0 and (highest_below < 0 or a > rows[highest_below, 0]):
            highest_below = k
    if highest_below < 0 or most == 0.0:
        return 1.0 / best
    below_a, below_b = rows[highest_below, 0], rows[highest_below, 1]
    crossing = -np.inf
    # Each exchange is for good; there are never more than a few.
    for _ in range(200):
        right = (above_a * -below_b + below_a * above_b) / (above_b - below_b)
        if right <= crossing:
            break
        crossing = right
        rise, run = above_b - below_b, above_a - below_a
        farthest, outside = -1, 0.0
        for k in range(count):
            distance = (rows[k, 0] - below_a) * rise - (rows[k, 1] - below_b) * run
            if distance > outside:
                farthest, outside = k, distance
        if farthest < 0:
            break
        if rows[farthest, 1] >= 0.0:
            above_a, above_b = rows[farthest, 0], rows[farthest, 1]
        else:
            below_a, below_b = rows[farthest, 0], rows[farthest, 1]
    return 1.0 / max(best, crossing)
