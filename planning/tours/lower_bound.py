"""Lower bound of the time of tours, by Lagrangian relaxation of spanning trees.

A tour is a spanning tree of its stops in which the start and the end have one leg, all others
two, and both legs of a stop meet in one configuration. Prices on the configurations replace these
rules: for any prices the cheapest tree is a bound (Held and Karp, The traveling-salesman problem
and minimum spanning trees, 1971; with a price for each configuration in place of each stop).
Order constraints are left out, which only lowers the bound.
"""

import numpy as np

from compiled.kernel import kernel
from kinematics.arrays import Array, Indices
from planning.timing.rest_to_rest import Times
from planning.values.deadline import Deadline


@kernel
def spanning_tree(times: Times, first: Indices, price: Array, ends: Indices, legs: Array) -> float:
    """Length of the least spanning tree with prices on configurations, by Prim's algorithm.

    Args:
        times: Shape (m, m) [s].
        first: First configuration of each stop, and m, shape (s + 1,).
        price: Prices of a leg at each configuration, shape (m,) [s].
        ends: Stops with one leg instead of two, shape (2,).
        legs: Written: legs of the tree at each configuration less those that a tour has at the
            dearest configuration of its stop, shape (m,).

    Returns:
        The bound [s].
    """
    stops = first.shape[0] - 1
    done = np.zeros(stops, dtype=np.bool_)
    nearest = np.full(stops, np.inf)
    here = np.zeros(stops, dtype=np.int64)
    there = np.zeros(stops, dtype=np.int64)
    legs[:] = 0.0
    total = 0.0
    current = 0
    done[0] = True
    for _ in range(stops - 1):
        following = -1
        # Start and end of a tour are never beside each other.
        for stop in range(stops):
            if done[stop]:
                continue
            if (current, stop) == (ends[0], ends[1]) or (stop, current) == (ends[0], ends[1]):
                continue
            for b in range(first[stop], first[stop + 1]):
                for a in range(first[current], first[current + 1]):
                    reduced = times[b, a] + price[a] + price[b]
                    if reduced < nearest[stop]:
                        nearest[stop], here[stop], there[stop] = reduced, b, a
        for stop in range(stops):
            if not done[stop] and (following < 0 or nearest[stop] < nearest[following]):
                following = stop
        total += nearest[following]
        legs[here[following]] += 1.0
        legs[there[following]] += 1.0
        done[following] = True
        current = following
    for stop in range(stops):
        degree = 1.0 if stop in (ends[0], ends[1]) else 2.0
        dearest = first[stop]
        for a in range(first[stop], first[stop + 1]):
            if price[a] > price[dearest]:
                dearest = a
        total -= degree * price[dearest]
        legs[dearest] -= degree
    return total


def lower_bound(
    times: Times, first: Indices, upper: float, deadline: Deadline | None = None
) -> float:
    """A time that no tour of the configurations beats [s].

    Args:
        times: Bounds of the times between configurations, shape (m, m) [s].
        first: First configuration of each stop, and m, shape (s + 1,); the last two stops are the
            start and the end.
        upper: Time of a known tour, which sets the steps [s].
        deadline: Time at which to end with the bound so far, 0 if there is none.
    """
    stops, m = len(first) - 1, len(times)
    ends = np.array([stops - 2, stops - 1])
    price, legs = np.zeros(m), np.zeros(m)
    best, best_price = -np.inf, price
    scale, since = 1.0, 0
    # Lookups of times that all rounds together may take: about a second.
    rounds = int(np.clip(4e8 / m**2, 10, 400))
    for _ in range(rounds):
        if deadline is not None and deadline.passed:
            break
        value = spanning_tree(times, first, price, ends, legs)
        since += 1
        if value > best:
            best, best_price, since = value, price.copy(), 0
        square = float(legs @ legs)
        # Steps end below this part of the gap.
        if square == 0.0 or scale < 1e-3:
            break
        # Rounds without a better bound after which steps are halved.
        if since >= 8:
            scale, since, price = 0.5 * scale, 0, best_price.copy()
            continue
        price = price + scale * max(upper - value, 0.0) / square * legs
    # Single precision rounds every time by less than this part.
    return max(0.0, best - 1e-6 * upper)
