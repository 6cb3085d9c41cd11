"""Requests that arrive at the same time, parsed one after the other."""

import asyncio
from collections import deque
from collections.abc import Callable


class Intake:
    """Takes one request in each turn of the event loop.

    To parse and check a request takes a millisecond. A crowd that arrives at once, parsed in one
    turn, would hold up everything else for all of theirs together: health, refusals, answers.
    """

    def __init__(self) -> None:
        self._waiting: deque[Callable[[], None]] = deque()
        self._has_taken = False

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
        self._waiting.popleft()()
