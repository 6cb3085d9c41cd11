"""More clients than a server can serve: goodput, refusals and health meanwhile.

``python -m benchmarks.server.overload --clients 200 --seconds 10`` starts a server of its own,
reached from this machine only. Each client asks again as soon as it has an answer, or after
Retry-After where it was refused; with ``--impatient`` at once too. Goodput is what was answered
with 2xx, in parts of what the same server answers to as many clients as it has workers.

The clients take part of the same machine, and so does whatever else runs: the goodput is told also
by the time of processors that the server and its workers took for a good answer.
"""

import argparse
import asyncio
import json
import os
import re
import time
from collections import defaultdict
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import uvloop

from benchmarks.server.machines import local_server, processor_times, wait_until_idle
from tests.service.robots import HOME

#: Between two looks at ``/healthz`` [s].
_LOOK = 0.05
_HEALTH = b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n"
_AWAY = [0.6, -0.3, 0.0, -2.0, 0.0, 1.8, 0.785]
#: Requests by name: path and body.
REQUESTS: dict[str, tuple[str, dict[str, Any]]] = {
    "plan": (
        "/v1/plan",
        {"robot": "panda", "start": {"joints": HOME}, "goal": {"joints": _AWAY}, "timeout": 2.0},
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


@dataclass
class Run:
    """Answers of a run and their cost.

    Args:
        seconds: Length of the run [s].
        answers: Times of the answers of each status [s].
        health: Times of the answers of ``/healthz`` [s].
        late: Number of good answers after the end: they were asked for before.
        spent: Processor time of clients, server and workers [s].
    """

    seconds: float
    answers: defaultdict[int, list[float]] = field(default_factory=lambda: defaultdict(list))
    health: list[float] = field(default_factory=list)
    late: int = 0
    spent: dict[str, float] = field(default_factory=dict)

    @property
    def goodput(self) -> float:
        """Good answers in a second [1/s]."""
        return len(self.answers[200]) / self.seconds

    @property
    def cost(self) -> float:
        """Time of a processor that a good answer took, with all that was refused meanwhile [s]."""
        count = len(self.answers[200]) + self.late
        return (self.spent["server"] + self.spent["workers"]) / max(count, 1)

    def costs(self) -> str:
        """Processors in use by each, in words."""
        shown = ", ".join(f"{name} {took / self.seconds:.2f}" for name, took in self.spent.items())
        return f"{shown} of {len(os.sched_getaffinity(0))} processors"


def content(path: str, body: dict[str, Any]) -> bytes:
    """A request as it is sent."""
    data = json.dumps(body).encode()
    head = f"POST {path} HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
    return head.encode() + f"Content-Length: {len(data)}\r\n\r\n".encode() + data


async def client(
    address: list[str], request: bytes, stop: float, found: Run, patient: bool
) -> None:
    """Ask on one connection, again after each answer.

    Whoever waits for an answer at the end gets it: a client that leaves costs a worker.

    Args:
        address: Host and port of the server.
        request: Request as it is sent.
        stop: End of the run, on the clock of `time.monotonic` [s].
        found: Run that answers are noted in.
        patient: Whether a client that was refused waits as Retry-After says.
    """
    reader, writer = await asyncio.open_connection(*address)
    while (began := time.monotonic()) < stop:
        writer.write(request)
        head = (await reader.readuntil(b"\r\n\r\n")).lower()
        await reader.readexactly(int(_header(head, b"content-length") or 0))
        now, status, pause = time.monotonic(), int(head[9:12]), 0.0
        if now > stop:
            found.late += request is not _HEALTH and status == 200
        elif request is _HEALTH:
            found.health.append(now - began)
            pause = _LOOK
        else:
            found.answers[status].append(now - began)
            pause = float(_header(head, b"retry-after") or 0) if patient else 0.0
        if pause:
            await asyncio.sleep(min(pause, max(stop - now, 0.0)))
    writer.close()


def _header(head: bytes, name: bytes) -> bytes | None:
    found = re.search(rb"\r\n" + name + rb": *([0-9.]+)", head)
    return found and found[1]


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
    found, requests = Run(seconds), [content(*REQUESTS[name])] * clients + [_HEALTH]
    address, stop = url.removeprefix("http://").split(":"), time.monotonic() + seconds

    async def crowd() -> None:
        await asyncio.gather(*(client(address, one, stop, found, patient) for one in requests))

    before, own = processor_times(pid), time.process_time()
    uvloop.run(crowd())
    own, spent = time.process_time() - own, processor_times(pid).since(before)
    found.spent = {"clients": own, "server": spent.own, "workers": spent.below}
    return found


def percentile(values: list[float]) -> float:
    """99th percentile of times [ms]."""
    return 1e3 * float(np.percentile(values or [0.0], 99))


def report(name: str, alone: Run, many: Run) -> str:
    """The figures of a run, in words."""
    refused = many.answers[429] + many.answers[503]
    counts = {status: len(times) for status, times in sorted(many.answers.items()) if times}
    return (
        f"{name}: goodput {100 * many.goodput / max(alone.goodput, 1e-9):.0f} % "
        f"({many.goodput:.1f} of {alone.goodput:.1f} a second), "
        f"{100 * alone.cost / max(many.cost, 1e-9):.0f} % by the server's time of processors; "
        f"answers {counts}, refusals p99 {percentile(refused):.0f} ms, "
        f"/healthz p99 {percentile(many.health):.0f} ms\n"
        f"  alone: {alone.costs()}; crowd: {many.costs()}"
    )


def main() -> None:
    """Start a server, and measure it alone and in a crowd."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--clients", type=int, default=200)
    parser.add_argument("--seconds", type=float, default=8.0)
    parser.add_argument("--impatient", action="store_true", help="do not mind Retry-After")
    chosen = parser.parse_args()
    with local_server({"ARMWRIGHT_WORKERS": str(_WORKERS)}) as server:
        wait_until_idle(server[0])
        for name in REQUESTS:
            run(*server, name, _WORKERS, min(1.0, chosen.seconds), patient=False)
            alone = run(*server, name, _WORKERS, chosen.seconds, patient=False)
            patient = not chosen.impatient
            many = run(*server, name, chosen.clients, chosen.seconds, patient=patient)
            print(report(name, alone, many), flush=True)


if __name__ == "__main__":
    main()
