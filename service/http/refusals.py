"""Refusals that wait a moment before they are sent, many at a time."""

import asyncio
from collections import deque
from collections.abc import Callable

#: Pause before a request is refused that would be too late [s]. Whoever asks again at once is
#: slowed down: refusals must not use up what workers need.
_PAUSE = 0.034
#: Refusals that are due within this are sent with the first one [s]: the event loop wakes up once
#: for all of them, and so do clients on this machine.
_BUNCH = 0.01


class Refusals:
    """Refusals in the order in which they were made; all of them have the same pause."""

    def __init__(self) -> None:
        self._waiting: deque[tuple[float, Callable[[], None]]] = deque()

    def add(self, send: Callable[[], None]) -> None:
        """Have a refusal sent after its pause.

        Args:
            send: Called on the event loop then.
        """
        loop = asyncio.get_running_loop()
        due = loop.time() + _PAUSE
        if not self._waiting:
            loop.call_at(due, self._send)
        self._waiting.append((due, send))

    def _send(self) -> None:
        loop = asyncio.get_running_loop()
        end = loop.time() + _BUNCH
        try:
            while self._waiting and self._waiting[0][0] <= end:
                self._waiting.popleft()[1]()
        finally:
            if self._waiting:
                loop.call_at(self._waiting[0][0], self._send)
