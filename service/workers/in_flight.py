"""Requests that were let in and not answered yet: most of them have not reached the queue.

Many may arrive before the first of them waits for a worker. Whoever judges by the queue alone lets
all of them in, and spends on parsing them the time that the refusals were to save.
"""

from collections import Counter


class InFlight:
    """Requests from their admission until they are answered, counted by client.

    Attributes:
        changes: counts what came and what went.
    """

    def __init__(self) -> None:
        self.changes = 0
        self._clients: Counter[str] = Counter()

    def enter(self, client: str) -> None:
        """Note that a request of a client was let in."""
        self._clients[client] += 1
        self.changes += 1

    def leave(self, client: str) -> None:
        """Note that a request of a client was answered or given up."""
        self.changes += 1
        self._clients[client] -= 1
        if not self._clients[client]:
            del self._clients[client]

    def ahead(self, client: str, queued: int) -> int:
        """Number of those before a new one of a client, those that reached the queue left out.

        Args:
            client: Whom it is from; clients take turns.
            queued: Requests that wait or run: they are on their way no more.
        """
        turns = self._clients[client] + 1
        # Counted first by client: each of the others has as many turns.
        return max(sum(min(count, turns) for count in self._clients.values()) - queued, 0)

    def __len__(self) -> int:
        return self._clients.total()
