"""Requests that were let in and have not reached the queue yet: they are parsed and checked.

Many may arrive before the first of them waits for a worker. Whoever judges by the queue alone lets
all of them in, and spends on parsing them the time that the refusals were to save.
"""

from collections import Counter
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Coming:
    """A request that is on its way.

    Args:
        task: What it asks for.
        client: Whom it is from.
    """

    task: str
    client: str


class ComingRequests:
    """Requests from their admission until they are answered, by whatever carries them.

    Attributes:
        changes: counts what came and what went.
    """

    def __init__(self) -> None:
        self.changes = 0
        self._requests: dict[object, Coming] = {}
        self._clients: Counter[str] = Counter()

    def note(self, carrier: object, task: str, client: str) -> None:
        """Note that a request was let in."""
        self.forget(carrier)
        self._requests[carrier] = Coming(task, client)
        self._clients[client] += 1
        self.changes += 1

    def forget(self, carrier: object) -> None:
        """Note that the request of a carrier, if there is one, was answered or given up."""
        request = self._requests.pop(carrier, None)
        if request is not None:
            self.changes += 1
            self._clients[request.client] -= 1
            if not self._clients[request.client]:
                del self._clients[request.client]

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
        return len(self._requests)
