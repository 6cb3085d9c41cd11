"""Local search over order and configurations: shifts of stops, reversals, short layers.

Moves are those of 2-opt and of single stops between near ones; a stop that is moved takes the
configuration that suits its new place, and the stops around a move choose theirs anew by dynamic
programming. Kicks that swap two neighbouring blocks lead out of local optima.

Stops, their configurations and the times between these, as the search kernels take them.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from compiled.kernel import kernel
from kinematics.arrays import Array, Indices
from planning.timing.rest_to_rest import Times


class Network(NamedTuple):
    """Stops with their configurations, and the times between these.

    The stops are the goals, then the start, then the end of the tour.

    Args:
        times: Times between configurations, symmetric, shape (m, m) [s].
        first: First configuration of each stop, and m, shape (s + 1,).
        near: Stops nearest to each stop, by least time, shape (s, k).
        least: Least times between stops, shape (s, s) [s].
        first_follower: Place at which the followers of each stop begin, shape (s + 1,).
        followers: Stops that have to come after, shape (p,).
    """

    times: Times
    first: Indices
    near: Indices
    least: Times
    first_follower: Indices
    followers: Indices


class TourState(NamedTuple):
    """A tour while it is being searched.

    Args:
        order: Stops in the order of their visit, the start first and the end last, shape (s,).
        position: Place of each stop in that order, shape (s,).
        choice: Configuration of each stop, shape (s,).
    """

    order: Indices
    position: Indices
    choice: Indices

    def copy(self) -> "TourState":
        """A copy whose arrays are its own."""
        return TourState(self.order.copy(), self.position.copy(), self.choice.copy())


def tour_state(order: Indices, choice: Indices) -> TourState:
    """The state of a tour from the order of its stops (s,) and their configurations (s,)."""
    position = np.empty_like(order)
    position[order] = np.arange(len(order))
    return TourState(order.astype(np.int64), position, choice.astype(np.int64))


def set_state(state: TourState, source: TourState) -> None:
    """Make a tour the same as another one."""
    for target, values in zip(state, source, strict=True):
        target[:] = values


def least_times(times: Times, first: Indices) -> Times:
    """Least times between stops, shape (s, s) [s].

    Args:
        times: Times between configurations, shape (m, m) [s].
        first: First configuration of each stop, and m, shape (s + 1,).
    """
    rows = np.minimum.reduceat(times, first[:-1], axis=0)
    least: Times = np.minimum.reduceat(rows, first[:-1], axis=1)
    np.fill_diagonal(least, 0.0)
    return np.ascontiguousarray(least)


def make_network(
    times: Times, first: Indices, precedence: tuple[Indices, Indices], neighbours: int
) -> Network:
    """The network of stops with times between their configurations.

    Args:
        times: Shape (m, m) [s].
        first: First configuration of each stop, and m, shape (s + 1,).
        precedence: Place at which the followers of each stop begin, shape (s + 1,), and the
            numbers of these stops, shape (p,).
        neighbours: How many near stops moves of the search check.
    """
    least = least_times(times, first)
    apart: Array = least.astype(np.float64)
    np.fill_diagonal(apart, np.inf)
    count = min(neighbours, len(least) - 1)
    near = np.argsort(apart, axis=1, kind="stable")[:, :count]
    near = np.ascontiguousarray(near, dtype=np.int64)
    return Network(times, first, near, least, *precedence)


#: Gains below this are rounding of single precision [s].
_GAIN = 1e-6


def nearest_neighbour_tour(
    network: Network, groups: Indices, pairs: list[tuple[int, int]]
) -> TourState:
    """A tour that goes to the nearest goal that may come next.

    A goal may come next when all that come before it, or before its group, are visited, and no
    other group is half done.

    Args:
        network: The stops and times.
        groups: Group of each goal, shape (m,).
        pairs: Goals, the first before the second.
    """
    m = len(groups)
    outer: dict[int, set[int]] = {}
    inner: dict[int, set[int]] = {}
    for a, b in pairs:
        if groups[a] == groups[b]:
            inner.setdefault(b, set()).add(a)
        else:
            outer.setdefault(int(groups[b]), set()).add(a)
    members = {int(g): {int(k) for k in np.flatnonzero(groups == g)} for g in groups}
    order, choice = [m], np.zeros(m + 2, dtype=np.int64)
    choice[m:] = network.first[m : m + 2]
    visited: set[int] = set()
    current = int(choice[m])
    while len(visited) < m:
        half_done = len(order) > 1 and bool(members[int(groups[order[-1]])] - visited)
        candidates = [
            k
            for k in range(m)
            if k not in visited
            and (not half_done or groups[k] == groups[order[-1]])
            and inner.get(k, set()) <= visited
            and outer.get(int(groups[k]), set()) <= visited
        ]
        stop, entry = _nearest(network, current, candidates)
        order.append(stop)
        visited.add(stop)
        choice[stop] = current = entry
    return tour_state(np.array([*order, m + 1]), choice)


def _nearest(network: Network, current: int, candidates: list[int]) -> tuple[int, int]:
    """The stop nearest to a configuration, and its nearest configuration."""
    row, first = network.times[current], network.first
    best = min(candidates, key=lambda k: float(row[first[k] : first[k + 1]].min()))
    return best, int(first[best] + row[first[best] : first[best + 1]].argmin())


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
        Change of the time of the tour: 0 or below [s].
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


class SearchWork(NamedTuple):
    """Memory of the local search.

    Args:
        queue: Stops to be checked, a ring, shape (s + 1,).
        waiting: Whether each stop is in the queue, shape (s,).
        ends: Places at which the queue begins and ends, shape (2,).
        block: Memory for moves of blocks, shape (s,).
        value: Value of dynamic programming, shape (m,).
        back: Choices of dynamic programming, shape (m,).
        random: State of the random generator, shape (1,).
    """

    queue: Indices
    waiting: NDArray[np.bool_]
    ends: Indices
    block: Indices
    value: Array
    back: Indices
    random: NDArray[np.uint64]


def search_work(network: Network, seed: int) -> SearchWork:
    """Memory for a search, its random generator seeded."""
    stops, configurations = len(network.least), len(network.times)
    return SearchWork(
        np.zeros(stops + 1, np.int64),
        np.zeros(stops, np.bool_),
        np.zeros(2, np.int64),
        np.zeros(stops, np.int64),
        np.zeros(configurations),
        np.zeros(configurations, np.int64),
        np.array([seed], np.uint64),
    )


@kernel
def draw(random: NDArray[np.uint64], count: int) -> int:
    """A random number from 0 to below ``count``, by splitmix64."""
    random[0] += np.uint64(0x9E3779B97F4A7C15)
    z = random[0]
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z ^= z >> np.uint64(31)
    return int((z >> np.uint64(11)) % np.uint64(count))


@kernel
def enqueue(work: SearchWork, stop: int) -> None:
    """Put a stop into the queue."""
    if not work.waiting[stop]:
        work.waiting[stop] = True
        work.queue[work.ends[1]] = stop
        work.ends[1] = (work.ends[1] + 1) % work.queue.shape[0]


@kernel(allocates=False)
def enqueue_around(work: SearchWork, state: TourState, position: int) -> None:
    """Put the stop at a position and those beside it into the queue."""
    for k in range(max(position - 1, 0), min(position + 2, state.order.shape[0])):
        enqueue(work, state.order[k])


@kernel(allocates=False)
def shift_gain(network: Network, state: TourState, place: int, left: int) -> tuple[float, int]:
    """Time saved by putting the stop at a position behind that at ``left``.

    The second number is the configuration that it takes then.
    """
    order, choice, times = state.order, state.choice, network.times
    stop, now = order[place], choice[order[place]]
    before, behind = choice[order[place - 1]], choice[order[place + 1]]
    x, y = choice[order[left]], choice[order[left + 1]]
    gain = np.float64(times[before, now]) + np.float64(times[now, behind])
    gain += np.float64(times[x, y]) - np.float64(times[before, behind])
    best, chosen = np.inf, now
    for v in range(network.first[stop], network.first[stop + 1]):
        added = np.float64(times[x, v]) + np.float64(times[v, y])
        if added < best:
            best, chosen = added, v
    return gain - best, chosen


@kernel(allocates=False)
def improve_by_shift(network: Network, state: TourState, stop: int, work: SearchWork) -> float:
    """Make the best move of a stop by itself; the time saved."""
    count, place = state.order.shape[0], state.position[stop]
    if place < 1 or place > count - 2:
        return 0.0
    best, best_left, best_choice = _GAIN, -1, -1
    freed = time_kernel(network, state, state.order[place - 1], stop)
    freed += time_kernel(network, state, stop, state.order[place + 1])
    for k in range(network.near.shape[1]):
        other = network.near[stop, k]
        if network.least[stop, other] >= freed:
            break
        for left in range(state.position[other] - 1, state.position[other] + 1):
            if left < 0 or left > count - 2 or place - 1 <= left <= place:
                continue
            gain, chosen = shift_gain(network, state, place, left)
            # As two blocks that change places, one of which is the stop.
            low, high = min(place, left + 1), max(place, left)
            middle = place if left < place else place + 1
            if gain > best and may_swap(network, state, low, middle, high):
                best, best_left, best_choice = gain, left, chosen
    if best_left < 0:
        return 0.0
    for k in (place - 1, place + 1, best_left):
        enqueue_around(work, state, k)
    state.choice[stop] = best_choice
    low, high = min(place, best_left + 1), max(place, best_left)
    swap_blocks(state, low, place if best_left < place else place + 1, high, work.block)
    enqueue_around(work, state, state.position[stop])
    return best


@kernel(allocates=False)
def improve_by_reversal(network: Network, state: TourState, stop: int, work: SearchWork) -> float:
    """Make the best reversal that brings a stop next to a near one; the time saved."""
    count = state.order.shape[0]
    place = state.position[stop]
    best = _GAIN
    best_low = best_high = -1
    for side in range(2):
        beside = place + 1 if side == 0 else place - 1
        if beside < 0 or beside > count - 1:
            continue
        neighbour = state.order[beside]
        freed = time_kernel(network, state, stop, neighbour)
        for k in range(network.near.shape[1]):
            other = network.near[stop, k]
            if network.least[stop, other] >= freed:
                break
            at = state.position[other]
            next_at = at + 1 if side == 0 else at - 1
            if next_at < 0 or next_at > count - 1:
                continue
            following = state.order[next_at]
            gain = (
                freed
                + time_kernel(network, state, other, following)
                - time_kernel(network, state, stop, other)
                - time_kernel(network, state, neighbour, following)
            )
            low = min(beside, next_at) if side == 0 else min(place, at)
            high = max(place, at) if side == 0 else max(beside, next_at)
            if gain > best and may_reverse(network, state, low, high):
                best, best_low, best_high = gain, low, high
    if best_low < 0:
        return 0.0
    reverse(state, best_low, best_high)
    enqueue_around(work, state, best_low)
    enqueue_around(work, state, best_high)
    return best


@kernel
def improve(network: Network, state: TourState, work: SearchWork) -> float:
    """Improve a tour until no move from a stop in the queue does; the time saved."""
    count = state.order.shape[0]
    saved = 0.0
    # Stops on either side of a move that choose their configurations anew.
    window = 2
    while work.ends[0] != work.ends[1]:
        stop = work.queue[work.ends[0]]
        work.ends[0] = (work.ends[0] + 1) % work.queue.shape[0]
        work.waiting[stop] = False
        gain = improve_by_shift(network, state, stop, work)
        if gain == 0.0:
            gain = improve_by_reversal(network, state, stop, work)
        place = state.position[stop]
        low, high = max(place - window, 1), min(place + window, count - 2)
        chosen = -choose_configurations(network, state, low, high, work.value, work.back)
        if gain + chosen > 0.0:
            enqueue_around(work, state, place)
            saved += gain + chosen
    return saved


@kernel(allocates=False)
def tour_time(network: Network, state: TourState) -> float:
    """Time of all legs of a tour [s]."""
    total = 0.0
    for k in range(state.order.shape[0] - 1):
        total += time_kernel(network, state, state.order[k], state.order[k + 1])
    return total


@kernel
def search_kernel(network: Network, state: TourState, work: SearchWork, kicks: int) -> float:
    """Improve a tour by local search with kicks.

    Args:
        network: The stops and times.
        state: The tour, changed where a shorter one is found.
        work: Memory; stops in the queue are checked first.
        kicks: How many kicks.

    Returns:
        Time of the tour [s].
    """
    count = state.order.shape[0]
    improve(network, state, work)
    choose_configurations(network, state, 1, count - 2, work.value, work.back)
    goals = count - 2
    order, choice = state.order.copy(), state.choice.copy()
    for _ in range(kicks if goals > 2 else 0):
        # Longest block that a kick swaps.
        longest = min(40, goals // 2)
        first = 1 + draw(work.random, longest)
        second = 1 + draw(work.random, longest)
        low = 1 + draw(work.random, goals - first - second + 1)
        middle, high = low + first, low + first + second - 1
        if not may_swap(network, state, low, middle, high):
            continue
        change = -ends_time(network, state, low, middle, high)
        swap_blocks(state, low, middle, high, work.block)
        middle = low + second
        change += ends_time(network, state, low, middle, high)
        enqueue_around(work, state, low)
        enqueue_around(work, state, middle)
        enqueue_around(work, state, high)
        change -= improve(network, state, work)
        if change > _GAIN:
            state.order[:] = order
            state.choice[:] = choice
            for k in range(count):
                state.position[order[k]] = k
        else:
            order[:] = state.order
            choice[:] = state.choice
    choose_configurations(network, state, 1, count - 2, work.value, work.back)
    return tour_time(network, state)


@kernel(allocates=False)
def ends_time(network: Network, state: TourState, low: int, middle: int, high: int) -> float:
    """Time of the legs before, between and behind two neighbouring blocks [s]."""
    total = 0.0
    for k in (low, middle, high + 1):
        total += time_kernel(network, state, state.order[k - 1], state.order[k])
    return total
