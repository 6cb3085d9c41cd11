"""Requests that arrive at the same time, parsed one after the other."""

import asyncio
from collections import deque
from collections.abc import Callable

#: Turns that a request leaves, one after the other, to connections that are being made. The event
#: loop makes one in each turn: a crowd that connects at once would else wait for a request a head.
_MOST_TURNS_LEFT = 8


class Intake:
    """Takes one request in each turn of the event loop.

    To parse and check a request takes a millisecond. A crowd that arrives at once, parsed in one
    turn, would hold up everything else for all of theirs together: health, refusals, answers.
    """

    def __init__(self) -> None:
        self._waiting: deque[Callable[[], None]] = deque()
        self._has_taken = False
        self._has_connection = False
        self._turns_left = 0

    def note_connection(self) -> None:
        """Note that a connection was made: more may be waiting for it."""
        self._has_connection = True

    def take(self, request: Callable[[], None]) -> None:
        """Have a request parsed: at once, if it is the first one of this turn.

        Args:
            request: Called on the event loop, to parse it.
        """
        if self._has_taken:
            self._waiting.append(request)
            return
        self._has_taken = True
        asyncio.get_running_loop().call_soon(self._next)
        request()

    def _next(self) -> None:
        if not self._waiting:
            self._has_taken = False
            return
        asyncio.get_running_loop().call_soon(self._next)
        leaves_turn = self._has_connection and self._turns_left < _MOST_TURNS_LEFT
        self._has_connection = False
        if leaves_turn:
            self._turns_left += 1
            return
        self._turns_left = 0
        self._waiting.popleft()()
