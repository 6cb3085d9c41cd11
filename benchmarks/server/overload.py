"""More clients than a server can serve: goodput, refusals and health meanwhile.

``python -m benchmarks.server.overload --clients 200 --seconds 10`` starts a server of its own,
reached from this machine only. Each client asks again as soon as it has an answer, or after
Retry-After where it was refused; with ``--impatient`` at once too. Goodput is what was answered
with 2xx, in parts of what the same server answers to as many clients as it has workers.

The clients take part of the same machine, and so does whatever else runs: the goodput is told also
by the time of processors that the server and its workers took for a good answer.
"""

import argparse
import heapq
import json
import os
import select
import socket
import time
from collections import Counter
from collections.abc import Iterable
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.server.machines import local_server
from tests.service.processes import descendants

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


_HOME = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]
_AWAY = [0.6, -0.3, 0.0, -2.0, 0.0, 1.8, 0.785]
#: Requests by name: path and body.
REQUESTS: dict[str, tuple[str, dict[str, Any]]] = {
    "plan": (
        "/v1/plan",
        {"robot": "panda", "start": {"joints": _HOME}, "goal": {"joints": _AWAY}, "timeout": 2.0},
    ),
    "ik": (
        "/v1/robots/panda/ik",
        {
            "poses": [{"position": [0.3 + 0.0002 * i, 0.1, 0.5]} for i in range(300)],
            "method": "numeric",
            "timeout": 5.0,
        },
    ),
}
#: Clients whose goodput is the measure: as many as workers.
_WORKERS = 2
_TICK = os.sysconf("SC_CLK_TCK")
#: Places of times behind a process's name in ``/proc/<pid>/stat``: in user and in kernel mode, its
#: own and those of its children that have ended.
_TIMES = slice(11, 15)


class Run(NamedTuple):
    """A run and what it has cost.

    Attributes:
        figures: of the clients.
        seconds: how long it took [s].
        server: time of a processor that the server's own process took [s].
        workers: time of a processor that its workers took [s].
    """

    figures: Figures
    seconds: float
    server: float
    workers: float

    @property
    def goodput(self) -> float:
        """Good answers in a second [1/s]."""
        return self.figures.statuses[200] / self.seconds

    @property
    def cost(self) -> float:
        """Time of a processor that a good answer took, with all that was refused meanwhile [s]."""
        answers = self.figures.statuses[200] + self.figures.late
        return (self.server + self.workers) / max(answers, 1)

    def costs(self) -> str:
        """Processors in use by each, in words."""
        parts = {"clients": self.figures.own, "server": self.server, "workers": self.workers}
        shown = ", ".join(f"{name} {took / self.seconds:.2f}" for name, took in parts.items())
        return f"{shown} of {_processors()} processors"


def _processors() -> int:
    return len(os.sched_getaffinity(0))


def spent(pids: Iterable[int]) -> float:
    """Time of a processor that processes and children of theirs have taken so far [s]."""
    ticks = 0
    for pid in pids:
        with suppress(OSError):
            fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
            ticks += sum(map(int, fields[_TIMES]))
    return ticks / _TICK


def content(path: str, body: dict[str, Any]) -> bytes:
    """A request as it is sent."""
    data = json.dumps(body).encode()
    head = f"POST {path} HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
    return head.encode() + f"Content-Length: {len(data)}\r\n\r\n".encode() + data


def run(pid: int, url: str, name: str, clients: int, seconds: float, *, patient: bool) -> Run:
    """Have clients ask for some seconds.

    Args:
        pid: Of the server.
        url: Of the server.
        name: One of `REQUESTS`.
        clients: How many ask at the same time.
        seconds: For how long [s].
        patient: Whether they wait as Retry-After says.
    """
    host, port = url.removeprefix("http://").split(":")
    server, working = spent([pid]), spent(descendants(pid))
    asked = content(*REQUESTS[name])
    figures = crowd((host, int(port)), asked, clients, seconds, patient=patient)
    return Run(figures, seconds, spent([pid]) - server, spent(descendants(pid)) - working)


def percentile(values: list[float], part: float) -> float:
    """The value that a part of all values does not exceed [ms]."""
    return 1e3 * sorted(values)[min(int(part * len(values)), len(values) - 1)] if values else 0.0


def report(name: str, alone: Run, many: Run) -> str:
    """The figures of a run, in words."""
    best, good, crowded = max(alone.goodput, 1e-9), many.goodput, many.figures
    refused = crowded.seconds.get(429, []) + crowded.seconds.get(503, [])
    return (
        f"{name}: goodput {100 * good / best:.0f} % ({good:.1f} of {best:.1f} a second), "
        f"{100 * alone.cost / max(many.cost, 1e-9):.0f} % by the server's time of processors; "
        f"answers {dict(sorted(crowded.statuses.items()))}, "
        f"refusals p99 {percentile(refused, 0.99):.0f} ms, "
        f"/healthz p99 {percentile(crowded.health, 0.99):.0f} ms\n"
        f"  alone: {alone.costs()}; crowd: {many.costs()}"
    )


def main() -> None:
    """Start a server, and measure it alone and in a crowd."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--clients", type=int, default=200)
    parser.add_argument("--seconds", type=float, default=8.0)
    parser.add_argument("--settle", type=float, default=15.0, help="workers are renewed meanwhile")
    parser.add_argument("--impatient", action="store_true", help="do not mind Retry-After")
    parser.add_argument("--requests", nargs="*", default=list(REQUESTS))
    chosen = parser.parse_args()
    with local_server({"ARMWRIGHT_WORKERS": str(_WORKERS)}) as server:
        time.sleep(chosen.settle)
        for name in chosen.requests:
            run(*server, name, _WORKERS, min(1.0, chosen.seconds), patient=False)
            alone = run(*server, name, _WORKERS, chosen.seconds, patient=False)
            patient = not chosen.impatient
            many = run(*server, name, chosen.clients, chosen.seconds, patient=patient)
            print(report(name, alone, many), flush=True)


if __name__ == "__main__":
    main()
