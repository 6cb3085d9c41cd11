"""Requests for which somebody waits, beside jobs that hold all workers.

``python -m benchmarks.interactive`` starts a server of its own, reached from this machine only,
and asks it for one short plan after the other: first alone, then while jobs wait that would keep
all workers busy for as long as they may.
"""

import argparse
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import httpx

from benchmarks.machines import local_server
from benchmarks.overload import REQUESTS, percentile
from tests.service.processes import wait_until
from tests.service.robots import bench, stuck

#: Time in which a job begins once there are free workers [s].
_BEGIN = 20.0


def ask(client: httpx.Client, count: int, pause: float) -> list[float]:
    """How long plans take, asked for one after the other [s].

    Args:
        client: Of the server.
        count: How many.
        pause: Between two of them [s].
    """
    path, body = REQUESTS["plan"]
    body = body | {"timeout": 30.0}
    times = []
    for _ in range(count):
        began = time.monotonic()
        client.post(path, json=body).raise_for_status()
        times.append(time.monotonic() - began)
        time.sleep(pause)
    return times


@contextmanager
def busy(client: httpx.Client, jobs: int) -> Iterator[None]:
    """Jobs that have work for an hour, of which some run when this begins; cancelled at the end.

    Args:
        client: Of the server.
        jobs: How many.
    """
    body = stuck("busy", 120.0)
    ids = []
    for _ in range(jobs):
        answer = client.post("/v1/plan", json=body, headers={"Prefer": "respond-async"})
        ids.append(answer.raise_for_status().json()["id"])

    def run() -> bool:
        jobs: list[dict[str, Any]] = [client.get(f"/v1/jobs/{one}").json() for one in ids]
        return any(job["status"] == "running" for job in jobs)

    if not wait_until(run, _BEGIN):
        raise RuntimeError("no job has begun")
    try:
        yield
    finally:
        for one in ids:
            client.delete(f"/v1/jobs/{one}")


def shown(times: list[float]) -> str:
    """The median and the largest of a hundred, in words."""
    return f"p50 {percentile(times, 0.5):.1f} ms, p99 {percentile(times, 0.99):.1f} ms"


def main() -> None:
    """Start a server, and measure plans alone and beside jobs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--jobs", type=int, default=30)
    parser.add_argument("--requests", type=int, default=300)
    parser.add_argument("--pause", type=float, default=0.05, help="between two requests [s]")
    parser.add_argument("--settle", type=float, default=15.0, help="workers are renewed meanwhile")
    chosen = parser.parse_args()
    with (
        local_server({"ARMWRIGHT_WORKERS": "2"}) as (_, url),
        httpx.Client(base_url=url, timeout=60.0) as client,
    ):
        time.sleep(chosen.settle)
        client.post("/v1/robots", json=bench("busy")).raise_for_status()
        ask(client, min(20, chosen.requests), 0.0)
        alone = ask(client, chosen.requests, chosen.pause)
        with busy(client, chosen.jobs):
            beside = ask(client, chosen.requests, chosen.pause)
        above = percentile(beside, 0.99) - percentile(alone, 0.99)
        print(f"alone: {shown(alone)}")
        print(f"beside {chosen.jobs} jobs: {shown(beside)}; p99 {above:+.1f} ms")


if __name__ == "__main__":
    main()
