"""Searches for a path that keeps the preferred clearance: in which room, and over how many edges.

A search where there is no room is lost time. So it is short where it is seen beforehand that it
mostly leads nowhere: where own links are in the way, and where the straight motion comes near
something that it does not meet, which trees rarely find a way around.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from kinematics.arrays import Array
from obstacles.collision.checker import Checker
from planning.clearance.levels import Room, rooms
from planning.preflight_result import Ready

#: Edges that trees may look at, and where the straight motion is free but for the clearance.
_MOST_EDGES, _FEW_EDGES = 2000, 500
#: Edges where own links are in the way: what finds a path all the same has it after 100 mostly.
_FEWEST_EDGES = 300
#: Where states of a straight motion are that are looked at, shape (24, 1).
_SHARES = np.linspace(0.0, 1.0, 24)[:, None]


class Trial(NamedTuple):
    """A search for a path in a room.

    Args:
        room: The clearance.
        max_edges: Edges that trees may look at.
        keeps_start: Whether the start is known to keep the clearance that is looked for.
        keeps_goal: Whether the first goal is.
    """

    room: Room
    max_edges: int
    keeps_start: bool = False
    keeps_goal: bool = False


@dataclass(slots=True)
class RoomTrials:
    """The searches in rooms for the path of one problem, in turn until one finds it.

    Args:
        ready: Start and goals.
        levels: As ``clearance_levels`` gives them, two at least.
    """

    ready: Ready
    levels: tuple[Checker, ...]
    _rooms: list[Room] = field(default_factory=list, init=False)
    _choices: Iterator[Room] = field(init=False)
    _own_are_near: bool = field(default=False, init=False)

    def __post_init__(self) -> None:
        self._choices = rooms(self.levels)

    def first(self) -> Iterator[Trial]:
        """Searches before a path is looked for that comes nearer.

        Where own links are too near on the straight way between ends at which they are not, they
        are mostly so on every way: such pairs move by a joint or two.
        """
        ready, room = self.ready, next(self._choices)
        self._rooms.append(room)
        states = leg_states(np.array([ready.start, ready.goals[0]]))
        kept = room.look.each_valid(states)
        ends = bool(kept[0]), bool(kept[-1])
        if kept.all():
            yield Trial(room, _MOST_EDGES, *ends)
            return
        close = states[~kept]
        max_edges = _FEW_EDGES if self.levels[-1].all_valid(close) else _MOST_EDGES
        nearer = self._nearer()
        self._own_are_near = nearer is not None and bool(nearer.look.each_valid(close).any())
        if nearer is None or not self._own_are_near:
            yield Trial(room, max_edges, *ends)
            return
        yield Trial(room, _FEWEST_EDGES, *ends)
        yield Trial(nearer, max_edges)

    def later(self, path: Array) -> Iterator[Trial]:
        """Searches after those, when a path was found that comes nearer, shape (k, n)."""
        nearer = self._nearer()
        if nearer is not None and not self._own_are_near and self._has_own_links_near(path):
            yield Trial(nearer, _FEW_EDGES)

    def _nearer(self) -> Room | None:
        """The room with what is needed alone between own links, where it is another one."""
        if len(self._rooms) < 2:
            self._rooms.extend(self._choices)
        return self._rooms[1] if len(self._rooms) > 1 else None

    def _has_own_links_near(self, path: Array) -> bool:
        """Whether own links are nearer than preferred somewhere on a path that is free."""
        least, own = self.levels[-1], self._rooms[0].look.model.own_margin
        apart = Checker(least.model.with_margins(least.model.margin, own), least.slack)
        return not apart.all_valid(leg_states(path))


def leg_states(path: Array) -> Array:
    """States of each leg of a path (k, n), its ends among them, shape (24 (k - 1), n)."""
    legs: Array = path[:-1, None] + _SHARES * (path[1:] - path[:-1])[:, None]
    return legs.reshape(-1, path.shape[1])
