"""Load of workers: who waits, requests in flight, durations of tasks, share of background jobs.

Many requests may arrive before the first of them waits for a worker. Whoever judges by the queue
alone lets all of them in, and spends on parsing them the time that the refusals were to save.
"""

import time
from collections import Counter, OrderedDict, deque
from collections.abc import Iterable, Iterator
from itertools import islice

from service.workers.process import Ticket


class FairQueue:
    """Tickets by the client that they belong to; clients take turns, each in its own order.

    A client with a hundred requests delays one with a single request by one, not by a hundred.

    Attributes:
        count: Number of tickets that wait.
    """

    def __init__(self) -> None:
        self.count = 0
        self._tickets: OrderedDict[str, deque[Ticket]] = OrderedDict()

    def append(self, ticket: Ticket) -> None:
        """Have a ticket wait behind all others of its client."""
        self._tickets.setdefault(ticket.client, deque()).append(ticket)
        self.count += 1

    def appendleft(self, ticket: Ticket) -> None:
        """Have a ticket wait in front of all others."""
        self._tickets.setdefault(ticket.client, deque()).appendleft(ticket)
        self.count += 1
        self._tickets.move_to_end(ticket.client, last=False)

    def popleft(self) -> Ticket:
        """The next ticket; its client comes after all others then.

        Raises:
            KeyError: There is none.
        """
        client, tickets = self._tickets.popitem(last=False)
        self.count -= 1
        ticket = tickets.popleft()
        if tickets:
            self._tickets[client] = tickets
        return ticket

    def remove(self, ticket: Ticket) -> None:
        """Take a ticket out.

        Raises:
            KeyError: Its client has none.
            ValueError: It is not among them.
        """
        tickets = self._tickets[ticket.client]
        tickets.remove(ticket)
        self.count -= 1
        if not tickets:
            del self._tickets[ticket.client]

    def ahead(self, client: str) -> Iterator[Ticket]:
        """The tickets that come before a new one of a client."""
        # The new one is the last of its client's; of the others each may have as many turns.
        turns = len(self._tickets.get(client, ())) + 1
        for tickets in self._tickets.values():
            yield from islice(tickets, turns)

    def __iter__(self) -> Iterator[Ticket]:
        for tickets in self._tickets.values():
            yield from tickets

    def __contains__(self, ticket: object) -> bool:
        return isinstance(ticket, Ticket) and ticket in self._tickets.get(ticket.client, ())


class InFlight:
    """Requests in flight, from their admission until they are answered, counted by client.

    Attributes:
        count: Number of requests.
    """

    def __init__(self) -> None:
        self.count = 0
        self._clients: Counter[str] = Counter()

    def enter(self, client: str) -> None:
        """Note that a request of a client was let in."""
        self._clients[client] += 1
        self.count += 1

    def leave(self, client: str) -> None:
        """Note that a request of a client was answered or given up."""
        self._clients[client] -= 1
        self.count -= 1
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


#: Weight of the newest job in the mean duration of its task.
_MEAN_WEIGHT = 0.1
#: Mean duration before any job of a task has run [s].
_FIRST_MEAN = 0.1
#: The share of the workers' time that background jobs have at least while they wait.
BACKGROUND_SHARE = 0.1
#: What background jobs are behind or ahead of their share is remembered up to this [s].
_MAX_BALANCE = 30.0


class Durations:
    """Mean durations of tasks by the size of the request; those of late count most.

    Requests of one size are those between a power of two of bytes and the next. Where none of a
    size has run those of the nearest size count, of larger ones in proportion to the size. Where
    no size is told those of all sizes do.
    """

    def __init__(self) -> None:
        # Mean and mean deviation by the bits of a size, those of all sizes at 0.
        self._known: dict[str, dict[int, tuple[float, float]]] = {}

    def note(self, task: str, seconds: float, size: int = 0) -> None:
        """Note how long a job of a task took [s], of a request of a size [byte]."""
        known = self._known.setdefault(task, {})
        for bits in {0, size.bit_length()}:
            mean, spread = known.get(bits, (seconds, 0.0))
            further = _MEAN_WEIGHT * (abs(seconds - mean) - spread)
            known[bits] = mean + _MEAN_WEIGHT * (seconds - mean), spread + further

    def mean(self, task: str, size: int = 0) -> float:
        """The mean duration of a task for requests of a size [byte] [s]."""
        return self._of_size(task, size)[0]

    def spread(self, task: str, size: int = 0) -> float:
        """The mean deviation of the duration of a task from its mean, likewise [s]."""
        return self._of_size(task, size)[1]

    def remaining(self, running: Iterable[Ticket], waiting: Iterable[Ticket]) -> float:
        """Time that jobs still need, all together [s]."""
        now = time.monotonic()
        rest = sum(max(self.mean(t.job.task, t.job.size) - (now - t.begun), 0.0) for t in running)
        return rest + sum(self.mean(ticket.job.task, ticket.job.size) for ticket in waiting)

    def _of_size(self, task: str, size: int) -> tuple[float, float]:
        """Mean and deviation of a size, or those of the nearest size that is known."""
        known, bits = self._known.get(task), size.bit_length()
        if not known:
            return _FIRST_MEAN, 0.0
        if bits in known:
            return known[bits]
        sizes = [bits for bits in known if bits] or [0]
        nearest = min(sizes, key=lambda other: abs(other - bits))
        mean, spread = known[nearest]
        share: float = 2.0 ** min(bits - nearest, 0)
        return mean * share, spread * share


class BackgroundShare:
    """Account of the time that jobs nobody waits for have had, against their share."""

    def __init__(self) -> None:
        self._balance = 0.0

    @property
    def is_due(self) -> bool:
        """Whether a background job that waits is to be next, though others wait too."""
        return self._balance > 0.0

    def note(self, seconds: float, *, background: bool) -> None:
        """Note the time of a worker while background jobs wait or run [s]."""
        earned = (BACKGROUND_SHARE - 1.0 if background else BACKGROUND_SHARE) * seconds
        self._balance = max(-_MAX_BALANCE, min(_MAX_BALANCE, self._balance + earned))
