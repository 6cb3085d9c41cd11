"""Moves of the local search: reversals, shifts of segments, and whether an order allows them."""

import numpy as np

from compiled.kernel import kernel
from kinematics.arrays import Indices
from planning.tours.network import Network, TourState


@kernel
def time_kernel(network: Network, state: TourState, a: int, b: int) -> float:
    """Time between two stops in their chosen configurations [s], in double precision.

    Sums of single precision would be off by more than a move saves, and moves would go in circles.
    """
    return np.float64(network.times[state.choice[a], state.choice[b]])


@kernel(allocates=False)
def may_reverse(network: Network, state: TourState, low: int, high: int) -> bool:
    """Whether the stops at positions ``low`` to ``high`` may be visited the other way round."""
    if network.followers.shape[0] == 0:
        return True
    for k in range(low, high):
        stop = state.order[k]
        for f in range(network.first_follower[stop], network.first_follower[stop + 1]):
            place = state.position[network.followers[f]]
            if k < place <= high:
                return False
    return True


@kernel(allocates=False)
def may_swap(network: Network, state: TourState, low: int, middle: int, high: int) -> bool:
    """Whether the stops from ``low`` to before ``middle`` may come after those up to ``high``."""
    if network.followers.shape[0] == 0:
        return True
    for k in range(low, middle):
        stop = state.order[k]
        for f in range(network.first_follower[stop], network.first_follower[stop + 1]):
            if middle <= state.position[network.followers[f]] <= high:
                return False
    return True


@kernel
def reverse(state: TourState, low: int, high: int) -> None:
    """Visit the stops at positions ``low`` to ``high`` the other way round."""
    order, position = state.order, state.position
    while low < high:
        a, b = order[low], order[high]
        order[low], order[high] = b, a
        position[b], position[a] = low, high
        low += 1
        high -= 1


@kernel(allocates=False)
def swap_blocks(state: TourState, low: int, middle: int, high: int, work: Indices) -> None:
    """Visit the stops from ``low`` to before ``middle`` after those from ``middle`` to ``high``.

    Args:
        state: The tour, changed.
        low: First position of the first block.
        middle: First position of the second block.
        high: Last position of the second block.
        work: Memory, shape (s,).
    """
    order, position = state.order, state.position
    length = middle - low
    for k in range(length):
        work[k] = order[low + k]
    for k in range(middle, high + 1):
        order[k - length] = order[k]
        position[order[k]] = k - length
    for k in range(length):
        place = high + 1 - length + k
        order[place] = work[k]
        position[work[k]] = place
