"""More clients than a server can serve: goodput, refusals and health meanwhile.

``python -m benchmarks.overload --clients 200 --seconds 10`` starts a server of its own, reached
from this machine only. Each client asks again as soon as it has an answer, or after Retry-After
where it was refused; with ``--impatient`` at once too. Goodput is what was answered with 2xx, in
parts of what the same server answers to as many clients as it has workers.
"""

import argparse
import asyncio
import json
import re
import time
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

from benchmarks.machines import local_server

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


@dataclass
class Figures:
    """Answers of a run.

    Args:
        statuses: How often each status was answered.
        seconds: How long answers of each status took [s].
        health: How long ``/healthz`` took [s].
    """

    statuses: Counter[int] = field(default_factory=Counter)
    seconds: dict[int, list[float]] = field(default_factory=dict)
    health: list[float] = field(default_factory=list)


async def _ask(
    address: tuple[str, int], content: bytes, stop: float, note: Any, *, patient: bool = False
) -> None:
    reader, writer = await asyncio.open_connection(*address)
    try:
        while time.monotonic() < stop:
            began = time.monotonic()
            writer.write(content)
            head = await reader.readuntil(b"\r\n\r\n")
            length = re.search(rb"content-length: (\d+)", head, re.IGNORECASE)
            if length is not None:
                await reader.readexactly(int(length[1]))
            note(int(head[9:12]), time.monotonic() - began)
            after = re.search(rb"retry-after: (\d+)", head, re.IGNORECASE)
            if patient and after is not None:
                await asyncio.sleep(min(float(after[1]), max(stop - time.monotonic(), 0.0)))
    finally:
        writer.close()


def _content(path: str, body: dict[str, Any] | None) -> bytes:
    method, data = ("GET", b"") if body is None else ("POST", json.dumps(body).encode())
    head = f"{method} {path} HTTP/1.1\r\nHost: localhost\r\n"
    if data:
        head += f"Content-Type: application/json\r\nContent-Length: {len(data)}\r\n"
    return head.encode() + b"\r\n" + data


async def run(
    address: tuple[str, int], name: str, clients: int, seconds: float, *, patient: bool = True
) -> Figures:
    """Have clients ask for some seconds.

    Args:
        address: Of the server.
        name: One of `REQUESTS`.
        clients: How many ask at the same time.
        seconds: For how long [s].
        patient: Whether they wait as Retry-After says.
    """
    figures = Figures()

    def note(status: int, took: float) -> None:
        figures.statuses[status] += 1
        figures.seconds.setdefault(status, []).append(took)

    stop = time.monotonic() + seconds
    path, body = REQUESTS[name]
    content = _content(path, body)
    asking = [_ask(address, content, stop, note, patient=patient) for _ in range(clients)]
    healthy = _content("/healthz", None)

    async def look() -> None:
        while time.monotonic() < stop:
            await _ask(address, healthy, 0.0, None)
            began = time.monotonic()
            await _ask(address, healthy, began + 1e-3, lambda _, took: figures.health.append(took))
            await asyncio.sleep(0.05)

    await asyncio.gather(*asking, look())
    return figures


def percentile(values: list[float], part: float) -> float:
    """The value that a part of all values does not exceed [ms]."""
    return 1e3 * sorted(values)[min(int(part * len(values)), len(values) - 1)] if values else 0.0


def report(name: str, alone: Figures, crowd: Figures, seconds: float) -> str:
    """The figures of a run, in words."""
    best = max(alone.statuses[200], 1) / seconds
    good = crowd.statuses[200] / seconds
    refused = crowd.seconds.get(429, []) + crowd.seconds.get(503, [])
    return (
        f"{name}: goodput {100 * good / best:.0f} % ({good:.1f} of {best:.1f} a second), "
        f"answers {dict(sorted(crowd.statuses.items()))}, refusals p99 "
        f"{percentile(refused, 0.99):.0f} ms, /healthz p99 {percentile(crowd.health, 0.99):.0f} ms"
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
    with local_server({"ARMWRIGHT_WORKERS": "2"}) as (_, url):
        time.sleep(chosen.settle)
        host, port = url.removeprefix("http://").split(":")
        address = host, int(port)
        for name in chosen.requests:
            asyncio.run(run(address, name, 2, min(1.0, chosen.seconds)))
            alone = asyncio.run(run(address, name, 2, chosen.seconds))
            patient = not chosen.impatient
            crowd = asyncio.run(run(address, name, chosen.clients, chosen.seconds, patient=patient))
            print(report(name, alone, crowd, chosen.seconds))


if __name__ == "__main__":
    main()
