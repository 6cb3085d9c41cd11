"""The queue of jobs for which somebody waits: one of each client in turn."""

from collections import OrderedDict, deque
from collections.abc import Iterator
from itertools import islice

from service.workers.process import Ticket


class FairQueue:
    """Tickets by the client that they belong to; clients take turns, each in its own order.

    A client with a hundred requests delays one with a single request by one, not by a hundred.

    Attributes:
        changes: counts what came and what went.
    """

    def __init__(self) -> None:
        self.changes = 0
        self._tickets: OrderedDict[str, deque[Ticket]] = OrderedDict()
        self._count = 0

    def append(self, ticket: Ticket) -> None:
        """Have a ticket wait behind all others of its client."""
        self._tickets.setdefault(ticket.client, deque()).append(ticket)
        self.changes += 1
        self._count += 1

    def appendleft(self, ticket: Ticket) -> None:
        """Have a ticket wait in front of all others."""
        self._tickets.setdefault(ticket.client, deque()).appendleft(ticket)
        self.changes += 1
        self._count += 1
        self._tickets.move_to_end(ticket.client, last=False)

    def popleft(self) -> Ticket:
        """The next ticket; its client comes after all others then.

        Raises:
            KeyError: There is none.
        """
        client, tickets = self._tickets.popitem(last=False)
        self.changes += 1
        self._count -= 1
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
        self.changes += 1
        self._count -= 1
        if not tickets:
            del self._tickets[ticket.client]

    def ahead(self, client: str) -> Iterator[Ticket]:
        """The tickets that come before a new one of a client."""
        # The new one is the last of its client's; of the others each may have as many turns.
        turns = len(self._tickets.get(client, ())) + 1
        for tickets in self._tickets.values():
            yield from islice(tickets, turns)

    def __len__(self) -> int:
        return self._count

    def __iter__(self) -> Iterator[Ticket]:
        for tickets in self._tickets.values():
            yield from tickets

    def __contains__(self, ticket: object) -> bool:
        return isinstance(ticket, Ticket) and ticket in self._tickets.get(ticket.client, ())
