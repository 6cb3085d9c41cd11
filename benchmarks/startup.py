"""Start of the service: how long until it answers, what its processes take, and what a death costs.

    python -m benchmarks.startup [--runs 5] [--workers 2]

Machine code is on disk before the first run that counts. Memory is looked at after all that is
prepared for first requests is there: RSS counts shared pages in each process, PSS divides them
among those that share them. Processor time does not hang on what else the machine does.
"""

import argparse
import os
import re
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import httpx

_HOME = {"joints": [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]}
_CHECK = _HOME | {"robot": "panda", "scene": {"obstacles": []}}
_TICKS = os.sysconf("SC_CLK_TCK")
#: Starts that do not count, after which byte code and machine code are on disk.
_WARM_UPS = 1
#: Longest wait for a service to become ready [s]: with a cold cache it compiles everything.
_PATIENCE = 900.0
#: How long nothing may change in the number of workers before they count as settled [s].
_SETTLED = 3.0
#: Requests whose median is told.
_REQUESTS = 100


class Memory(NamedTuple):
    """Memory of a process [MB].

    Attributes:
        resident: all that it has, shared or not (RSS).
        share: shared pages divided among those that share them (PSS).
    """

    resident: float
    share: float


class Start(NamedTuple):
    """One start of the service.

    Attributes:
        listening: until `/healthz` answers [s].
        ready: until `/readyz` says so [s].
        server_time: processor time of the server until then [s].
        fork_server_time: that of the fork server [s].
        server: memory of the server.
        fork_server: that of the fork server.
        worker: that of the largest worker.
        total: PSS of all together [MB].
        request: median time of a forward kinematics request [ms].
        check: median time of a collision check [ms].
        one_killed: the same, sent at the moment that the busiest worker was killed [ms].
        all_killed: the same after all workers were killed, so that one has to be forked [ms].
    """

    listening: float
    ready: float
    server_time: float
    fork_server_time: float
    server: Memory
    fork_server: Memory
    worker: Memory
    total: float
    request: float
    check: float
    one_killed: float
    all_killed: float


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description="How the service starts.")
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--workers", type=int, default=2)
    chosen = parser.parse_args()
    for _ in range(_WARM_UPS):
        start(chosen.workers)
    runs = [start(chosen.workers) for _ in range(chosen.runs)]
    print(f"medians of {chosen.runs}, {chosen.workers} workers and a spare one")
    print("\n".join(report(runs)))


def start(workers: int) -> Start:
    """Start the service, measure it, and end it."""
    with tempfile.TemporaryDirectory() as folder:
        began = time.perf_counter()
        with (
            _service(Path(folder), workers) as (pid, address),
            httpx.Client(base_url=address, timeout=60.0) as client,
        ):
            _wait(client, "/healthz")
            listening = time.perf_counter() - began
            _wait(client, "/readyz")
            ready = time.perf_counter() - began
            (fork_server,) = _children(pid)
            times = _processor_time(pid), _processor_time(fork_server)
            _settle(fork_server)
            below = [_memory(worker) for worker in _children(fork_server)]
            own, above = _memory(pid), _memory(fork_server)
            total = sum(memory.share for memory in (own, above, *below))
            request = _median(client, "/v1/robots/panda/fk", _HOME)
            check = _median(client, "/v1/check", _CHECK)
            one = _after_killing(client, _children(fork_server)[:1])
            _settle(fork_server)
            every = _after_killing(client, _children(fork_server))
    return Start(
        listening, ready, *times, own, above, max(below), total, request, check, one, every
    )


def report(runs: list[Start]) -> Iterator[str]:
    """Lines that tell the medians."""
    for name, unit in (
        ("listening", "s"), ("ready", "s"), ("server_time", "s"), ("fork_server_time", "s"),
        ("total", "MB PSS"), ("request", "ms"), ("check", "ms"), ("one_killed", "ms"),
        ("all_killed", "ms"),
    ):  # fmt: skip
        value = statistics.median(getattr(run, name) for run in runs)
        yield f"{name:17}{value:8.2f} {unit}"
    for name in ("server", "fork_server", "worker"):
        memories = [getattr(run, name) for run in runs]
        resident = statistics.median(memory.resident for memory in memories)
        share = statistics.median(memory.share for memory in memories)
        yield f"{name:17}{resident:8.0f} MB RSS {share:6.0f} MB PSS"


@contextmanager
def _service(folder: Path, workers: int) -> Iterator[tuple[int, str]]:
    command = [sys.executable, "-m", "service.cli", "serve", "--port", "0"]
    options = ["--workers", str(workers), "--data-dir", str(folder), "--log-level", "warning"]
    running = subprocess.Popen([*command, *options], stdout=subprocess.PIPE, text=True)
    try:
        assert running.stdout is not None
        address = re.search(r"http://\S+", running.stdout.readline())
        assert address is not None
        yield running.pid, address[0]
    finally:
        running.terminate()
        running.communicate(timeout=20.0)


def _wait(client: httpx.Client, path: str) -> None:
    end = time.perf_counter() + _PATIENCE
    while client.get(path).status_code != 200:
        if time.perf_counter() > end:
            raise SystemExit("the service did not become ready")
        time.sleep(0.01)


def _settle(fork_server: int) -> None:
    """Wait until the workers stay the same."""
    before, since = _children(fork_server), time.perf_counter()
    while time.perf_counter() - since < _SETTLED:
        time.sleep(0.1)
        now = _children(fork_server)
        if now != before or _is_running(fork_server):
            before, since = now, time.perf_counter()


def _median(client: httpx.Client, path: str, body: object) -> float:
    return statistics.median(_milliseconds(client, path, body) for _ in range(_REQUESTS))


def _after_killing(client: httpx.Client, pids: list[int]) -> float:
    for pid in pids:
        os.kill(pid, signal.SIGKILL)
    began = time.perf_counter()
    # One that has a signal pending may still take a job, which then fails with it.
    while client.post("/v1/check", json=_CHECK).status_code != 200:
        pass
    return 1e3 * (time.perf_counter() - began)


def _milliseconds(client: httpx.Client, path: str, body: object) -> float:
    began = time.perf_counter()
    response = client.post(path, json=body)
    assert response.status_code == 200, response.text
    return 1e3 * (time.perf_counter() - began)


def _stat(pid: int) -> list[str]:
    return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()


def _is_running(pid: int) -> bool:
    return _stat(pid)[0] == "R"


def _processor_time(pid: int) -> float:
    """User and system time of a process and of its children that were waited for [s]."""
    return sum(map(int, _stat(pid)[11:15])) / _TICKS


def _children(pid: int) -> list[int]:
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                state, parent = _stat(int(entry.name))[:2]
            except OSError:
                continue
            if int(parent) == pid and state not in "ZX":
                found.append(int(entry.name))
    return sorted(found)


def _memory(pid: int) -> Memory:
    text = Path(f"/proc/{pid}/smaps_rollup").read_text()
    sizes = dict(re.findall(r"^(Rss|Pss):\s+(\d+) kB", text, re.MULTILINE))
    return Memory(int(sizes["Rss"]) / 1024, int(sizes["Pss"]) / 1024)


if __name__ == "__main__":
    main()
