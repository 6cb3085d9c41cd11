"""Sweep along a trajectory that proves all pairs apart on every interval of time, earliest first.

Intervals whose pairs are not all settled (``interval_check``) are halved; a pair whose interval is
so short that halving can't help is left to a referee.
"""

from kinematics.arrays import Array
from kinematics.compiled.kernel import kernel
from planning.proof.interval_check import check_interval
from planning.proof.pair_table import PairArrays
from planning.proof.sweep_state import (
    OPEN,
    PROBE,
    REFERRED,
    SHARP,
    TOP,
    VISITS,
    Sweep,
    moves_far,
    pass_on,
    pop_interval,
    push_halves,
)

# Why a sweep stops.
#: All pairs are settled on all intervals.
DONE = 0
#: The referee has to decide about pairs of the last interval.
ASKING = 1
#: It has looked at as many intervals as it may at once.
PAUSED = 2
#: There is no room for the pairs that are open: the interval has to be looked at again.
FULL = 3


@kernel(allocates=False)
def run(
    model: PairArrays, breaks: Array, coefficients: Array, w: Sweep, sharp: bool, most: int
) -> int:
    """Sweep on until DONE, ASKING, FULL, or PAUSED after ``most`` intervals.

    Args:
        model: The pairs.
        breaks: Of the trajectory, shape (m + 1,) [s].
        coefficients: Of the trajectory, shape (m, n, k).
        w: The sweep.
        sharp: Whether intervals are halved until the clearance told is sharp, not only until all
            is free.
        most: Intervals to look at.
    """
    w.counters[SHARP] = 1 if sharp else 0
    seen = 0
    while w.counters[TOP] > 0:
        if seen >= most:
            return PAUSED
        seen += 1
        pop_interval(breaks, coefficients, w)
        if moves_far(w):
            pass_on(w, breaks)
            continue
        if not check_interval(model, w):
            w.counters[TOP] += 1
            w.counters[VISITS] -= 1
            return FULL
        if w.counters[PROBE] == 1:
            continue
        if w.counters[REFERRED] > 0:
            return ASKING
        if w.counters[OPEN] > 0:
            push_halves(w, breaks, True)
    return DONE
