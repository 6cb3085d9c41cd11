"""Dynamic programming over the configurations of stops in a given order."""

import numpy as np

from compiled.kernel import kernel
from kinematics.arrays import Array, Indices
from planning.tours.network import Network, TourState


@kernel(allocates=False)
def choose_configurations(
    network: Network, state: TourState, low: int, high: int, value: Array, back: Indices
) -> float:
    """Choose the configurations of the stops at some positions for the least time.

    Bellman's recursion over the layers: the least time to configuration b of a stop is the least
    over the configurations a of the stop before of its time and that from a to b. The stops just
    before and behind keep theirs.

    Args:
        network: The stops and times.
        state: The tour, changed where that saves time.
        low: First of the positions, at least 1.
        high: Last of them, before the end of the tour.
        value: Memory, shape (m,).
        back: Memory, shape (m,).

    Returns:
        By how much the tour gets longer: 0 or below [s].
    """
    times, first, order, choice = network.times, network.first, state.order, state.choice
    before = 0.0
    for k in range(low, high + 2):
        before += np.float64(times[choice[order[k - 1]], choice[order[k]]])
    entry = choice[order[low - 1]]
    begin, end = entry, entry + 1
    value[entry] = 0.0
    for k in range(low, high + 1):
        stop = order[k]
        for b in range(first[stop], first[stop + 1]):
            best = np.inf
            source = begin
            for a in range(begin, end):
                total = value[a] + np.float64(times[a, b])
                if total < best:
                    best, source = total, a
            value[b] = best
            back[b] = source
        begin, end = first[stop], first[stop + 1]
    leave = choice[order[high + 1]]
    best = np.inf
    last = begin
    for a in range(begin, end):
        total = value[a] + np.float64(times[a, leave])
        if total < best:
            best, last = total, a
    after, stop_choice = 0.0, last
    previous = leave
    for _ in range(low, high + 1):
        after += np.float64(times[stop_choice, previous])
        previous = stop_choice
        stop_choice = back[stop_choice]
    after += np.float64(times[entry, previous])
    if after >= before - 1e-7:
        return 0.0
    stop_choice = last
    for k in range(high, low - 1, -1):
        choice[order[k]] = stop_choice
        stop_choice = back[stop_choice]
    return after - before
