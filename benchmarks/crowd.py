"""A crowd of clients in one thread, on sockets and epoll: little beside the server it asks.

Whoever measures a server under overload on the machine that it runs on takes part of the machine
away from it. A client here costs two system calls and a few comparisons for each answer.
"""

import heapq
import select
import socket
import time
from collections import Counter
from contextlib import ExitStack
from dataclasses import dataclass, field

#: Bytes that are read at a time: nearly all answers are shorter.
_READ = 1 << 16
#: Between two looks at ``/healthz`` [s].
_LOOK = 0.05
_HEALTH = b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n"


@dataclass
class Figures:
    """Answers of a run.

    Args:
        statuses: How often each status was answered.
        seconds: How long answers of each status took [s].
        health: How long ``/healthz`` took [s].
        late: How many were answered well after the end: they were asked for before.
        own: Time of a processor that the crowd itself took [s].
    """

    statuses: Counter[int] = field(default_factory=Counter)
    seconds: dict[int, list[float]] = field(default_factory=dict)
    health: list[float] = field(default_factory=list)
    late: int = 0
    own: float = 0.0


class _Client:
    """A connection on which one request after the other is made."""

    __slots__ = ("begun", "content", "held", "is_probe", "missing", "socket", "status")

    def __init__(self, address: tuple[str, int], content: bytes, *, is_probe: bool) -> None:
        self.socket = socket.create_connection(address)
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.content = content
        self.is_probe = is_probe
        self.begun = 0.0
        self.held = b""
        self.missing = 0
        self.status = 0

    def ask(self) -> None:
        self.begun = time.monotonic()
        self.socket.sendall(self.content)

    def read(self) -> bytes | None:
        """The head of an answer that is complete now; None while something is missing.

        Raises:
            ConnectionError: The server has closed the connection.
        """
        data = self.socket.recv(_READ)
        if not data:
            raise ConnectionError("the server has closed a connection")
        if self.missing:
            self.missing -= len(data)
            return None if self.missing else self.held
        self.held += data
        end = self.held.find(b"\r\n\r\n")
        if end < 0:
            return None
        head, size = self.held[: end + 2].lower(), len(self.held) - end - 4
        self.held = head
        self.missing = int(_header(head, b"content-length") or 0) - size
        return None if self.missing else head


def _header(head: bytes, name: bytes) -> bytes | None:
    begin = head.find(b"\r\n" + name + b":")
    if begin < 0:
        return None
    begin += len(name) + 3
    return head[begin : head.find(b"\r\n", begin)].strip()


def crowd(
    address: tuple[str, int], content: bytes, clients: int, seconds: float, *, patient: bool
) -> Figures:
    """Have clients ask for some seconds, each again as soon as it has an answer.

    Args:
        address: Of the server.
        content: The request of each.
        clients: How many ask at the same time.
        seconds: For how long [s].
        patient: Whether those that were refused wait as Retry-After says.
    """
    figures = Figures()
    own = time.process_time()
    stop = time.monotonic() + seconds
    with ExitStack() as stack:
        poll = stack.enter_context(select.epoll())
        members: dict[int, _Client] = {}
        #: When clients that wait ask again [s].
        waking: list[tuple[float, int]] = []
        for number in range(clients + 1):
            is_probe = number == clients
            one = _Client(address, _HEALTH if is_probe else content, is_probe=is_probe)
            stack.callback(one.socket.close)
            members[one.socket.fileno()] = one
            poll.register(one.socket, select.EPOLLIN)
            one.ask()
        waiting = clients + 1
        # Whoever waits for an answer at the end gets it: a client that leaves costs a worker.
        while (now := time.monotonic()) < stop or waiting:
            while waking and waking[0][0] <= now < stop:
                members[heapq.heappop(waking)[1]].ask()
                waiting += 1
            until = min(stop, waking[0][0]) if waking else stop
            for number, _ in poll.poll(max(until - now, 0.0) if now < stop else -1, clients + 1):
                one = members[number]
                head = one.read()
                if head is None:
                    continue
                waiting -= 1
                if time.monotonic() > stop:
                    figures.late += not one.is_probe and head[9:12] == b"200"
                    continue
                pause = _note(one, head, figures, patient=patient)
                if pause:
                    heapq.heappush(waking, (time.monotonic() + pause, number))
                else:
                    one.ask()
                    waiting += 1
    figures.own = time.process_time() - own
    return figures


def _note(one: _Client, head: bytes, figures: Figures, *, patient: bool) -> float:
    """Note an answer, and say how long its client waits before it asks again [s]."""
    took, one.held, one.missing = time.monotonic() - one.begun, b"", 0
    if one.is_probe:
        figures.health.append(took)
        return _LOOK
    status = int(head[9:12])
    figures.statuses[status] += 1
    figures.seconds.setdefault(status, []).append(took)
    after = _header(head, b"retry-after") if patient and status != 200 else None
    return 0.0 if after is None else float(after)
