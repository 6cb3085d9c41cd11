"""Orders of items by the least times of the motions between them.

What an item's stages take among themselves is the same in every order. Between items the arm goes
from where one ends to where the next is taken, and with places that go by number from each item to
the place of its turn. Times are those of straight joint motions from rest to rest between the
configurations of a planned order, or of its motions where they are planned; of several planned
orders the least times count. An item ends elsewhere than it begins, so that these times differ by
direction, and moves of blocks take the place of a tour's reversals.
"""

from collections.abc import Iterator, Sequence
from itertools import permutations
from typing import NamedTuple

import numpy as np

from kinematics.arrays import Array, Indices
from planning.sequence.result import StagePlan, total_duration
from planning.timing.rest_to_rest import motion_times
from planning.values.deadline import Deadline

#: All orders of so many items are compared; of more, moves of blocks of so many, from kicks.
_ALL, _BLOCK, _KICKS = 8, 3, 30
#: Gains below this are rounding [s].
_GAIN = 1e-6


class Visit(NamedTuple):
    """An item with its stages in a flat list.

    Args:
        item: Number of the item.
        first: Number of its first stage.
        end: Number of the stage after its last.
    """

    item: int
    first: int
    end: int


class OrderSearch:
    """Proposes orders, and learns from those that were planned.

    Args:
        count: Number of items.
        by_place: Whether each item ends where its turn has it, not where it itself has.
        seed: Seed of the kicks.
    """

    def __init__(self, count: int, by_place: bool, seed: int) -> None:
        self._count, self._by_place = count, by_place
        self._random = np.random.default_rng(seed)
        self._rules: list[tuple[int, list[int]]] = []
        self._tried: set[tuple[int, ...]] = set()
        self._best: tuple[float, Indices] = (np.inf, np.arange(count))
        self._inner, self._first, self._last = np.full((3, count), np.inf)
        self._step, self._rest = np.full((count, count), np.inf), 0.0

    def learn(self, visits: Sequence[Visit], stages: Sequence[StagePlan]) -> None:
        """Learn the times of a planned order, and where its items begin and end.

        Args:
            visits: The items in their order.
            stages: All stages, proved.
        """
        chain, n = stages[0].after.robot.chain, self._count
        order = np.array([visit.item for visit in visits])
        self._tried.add(tuple(order.tolist()))
        self._best = min(self._best, (total_duration(stages), order), key=lambda best: best[0])
        begin, end = np.zeros((n, chain.n)), np.zeros((n, chain.n))
        inner, ways = np.zeros(n), np.zeros(n)
        for place, visit in enumerate(visits):
            own = stages[visit.first : visit.end]
            moving = next(_moving(own), own[0])
            begin[visit.item] = moving.trajectory.end
            end[place if self._by_place else visit.item] = own[-1].trajectory.end
            ways[place] = moving.trajectory.duration
            inner[visit.item] = total_duration(own) - ways[place]
        step = np.array([motion_times(chain, q, begin) for q in end])
        if self._by_place:
            inner[order] -= step[np.arange(n), order]
        else:
            step[order[:-1], order[1:]] = ways[1:]
        first = motion_times(chain, stages[visits[0].first].trajectory.start, begin)
        after = next(_moving(stages[visits[-1].end :]), None)
        last = np.zeros(n) if after is None else motion_times(chain, after.trajectory.end, end)
        for known, new in (
            (self._inner, inner), (self._step, step), (self._first, first), (self._last, last)
        ):  # fmt: skip
            np.minimum(known, new, out=known)
        rest = (*stages[: visits[0].first], *stages[visits[-1].end :])
        self._rest = total_duration(rest) - (0.0 if after is None else after.trajectory.duration)

    def rule_out(self, visits: Sequence[Visit], stage: int) -> None:
        """Learn that an order can't be done: an item can't be taken before any of those after it.

        Args:
            visits: The items in their order.
            stage: Number of the stage that fails.
        """
        order = [visit.item for visit in visits]
        self._tried.add(tuple(order))
        stuck = next((k for k, visit in enumerate(visits) if stage < visit.end), 0)
        if order[stuck + 1 :]:
            self._rules.append((order[stuck], order[stuck + 1 :]))

    def propose(self, deadline: Deadline) -> list[int] | None:
        """An order that was not planned yet and promises the least time; None if none does.

        Args:
            deadline: Time at which to search no longer.
        """
        if self._count <= _ALL:
            rows = np.array([*permutations(range(self._count))])
        else:
            rows = self._descents(deadline)
        times = self._times(rows)
        for k in np.argsort(times, kind="stable"):
            order = rows[k].tolist()
            if not times[k] < self._best[0] - _GAIN:
                break
            if tuple(order) not in self._tried:
                return list(order)
        return None

    def _times(self, orders: Indices) -> Array:
        """Least times of orders (m, n), shape (m,) [s]; infinite where one can't be done."""
        step, turns = self._step, np.arange(self._count)
        times = self._rest + self._inner.sum() + self._first[orders[:, 0]]
        if self._by_place:
            times += step[turns, orders].sum(axis=1) + self._last[-1]
            times += step[turns[:-1], orders[:, 1:]].sum(axis=1)
        else:
            times += step[orders[:, :-1], orders[:, 1:]].sum(axis=1) + self._last[orders[:, -1]]
        turn = np.argsort(orders, axis=1)
        for item, others in self._rules:
            times[(turn[:, others] > turn[:, [item]]).all(axis=1)] = np.inf
        return np.asarray(times)

    def _descents(self, deadline: Deadline) -> Indices:
        """Orders by moves of blocks, begun anew from kicks; shape (k, n)."""
        best = self._descend(self._best[1], deadline)
        found = [best]
        for _ in range(_KICKS):
            if deadline.passed:
                break
            cuts = np.sort(self._random.choice(self._count + 1, 3, replace=False))
            a, b, c = cuts.tolist()
            kicked = np.concatenate([best[:a], best[b:c], best[a:b], best[c:]])
            other = self._descend(kicked, deadline)
            best = min(best, other, key=lambda order: float(self._times(order[None])[0]))
            found.append(best)
        return np.array(found)

    def _descend(self, order: Indices, deadline: Deadline) -> Indices:
        known, length = float(self._times(order[None])[0]), 1
        while length <= _BLOCK and not deadline.passed:
            row, places = order.tolist(), range(self._count - length + 1)
            rows = [
                [*rest[:to], *row[a : a + length], *rest[to:]]
                for a in places
                for rest in [row[:a] + row[a + length :]]
                for to in places
                if to != a
            ]
            times = self._times(np.array(rows))
            best = int(times.argmin())
            if times[best] < known - _GAIN:
                order, known, length = np.array(rows[best]), float(times[best]), 1
            else:
                length += 1
        return order


def _moving(stages: Sequence[StagePlan]) -> Iterator[StagePlan]:
    """The stages in which the arm moves."""
    return (one for one in stages if (one.trajectory.start != one.trajectory.end).any())
