"""Half an hour of mixed work with kills: memory, and whether anything is lost or done twice.

``python -m benchmarks.server.soak --minutes 30`` starts a server of its own with two workers,
reached from this machine only. Clients ask at a fixed rate for whatever workers keep caches of;
meanwhile busy workers are killed, and now and then the fork server. Every job has an idempotency
key and is asked for twice. At last each job that was acknowledged is looked for and its plan is
compared with what was asked. Memory is fitted by a line: that of the server, that of workers within
their lives, and the largest in each life over all lives. A kill costs a request its first attempt,
never its answer: all deadlines leave time for a second one, so no answer may be a fault of the
server.
"""

import argparse
import itertools
import json
import os
import random
import signal
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import httpx
import numpy as np
from scipy.stats import linregress

from benchmarks.server.machines import local_server
from tests.service.processes import alive, children
from tests.service.robots import ASIDE, FLOOR, HOME, POST, bench, scene

_PAGE = os.sysconf("SC_PAGE_SIZE")
_MEBIBYTE = 2.0**20
#: Parts of the time whose means are taken for independent, and looks that these need.
_PARTS, _LEAST = 10, 20


class Growth(NamedTuple):
    """Slope of memory over time.

    Attributes:
        rate: [MiB/h].
        error: its standard error [MiB/h]; infinite where there is too little to tell.
        samples: looks, or lives, that it is of.
    """

    rate: float
    error: float
    samples: int

    def __str__(self) -> str:
        """The growth for people."""
        if not np.isfinite(self.error):
            return "too little to tell its growth"
        return f"{self.rate:+.1f} +- {self.error:.1f} MiB/h"


_UNKNOWN = Growth(0.0, float("inf"), 0)


def resident(pid: int) -> float:
    """Memory of a process [MiB]; 0 where it has ended."""
    with suppress(OSError, IndexError):
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * _PAGE / _MEBIBYTE
    return 0.0


def growth(times: Sequence[float], values: Sequence[float]) -> Growth:
    """Slope of a line through values, and its standard error from ten parts of the time.

    Neighbouring looks tell the same, so that the error of a common fit would be far too small:
    means of parts are taken for independent.

    Args:
        times: Increasing [s].
        values: Of each [MiB].
    """
    if len(times) < _LEAST:
        return _UNKNOWN
    x, y = np.array(times) / 3600.0, np.array(values)
    parts = zip(np.array_split(x, _PARTS), np.array_split(y, _PARTS), strict=True)
    at, mean = np.array([(a.mean(), b.mean()) for a, b in parts]).T
    line = linregress(at, mean)
    return Growth(float(line.slope), float(line.stderr), len(times))


@dataclass(slots=True)
class Lives:
    """Memory of processes that come and go.

    Args:
        looks: Times [s] and memory [MiB] of each process.
    """

    looks: dict[int, list[tuple[float, float]]] = field(default_factory=dict)

    def look(self, time: float, memory: Mapping[int, float]) -> None:
        """Write down the memory of all processes that there are.

        Args:
            time: Now [s].
            memory: Of each process by number [MiB]; 0 for one that has just ended.
        """
        for pid, value in memory.items():
            if value > 0.0:
                self.looks.setdefault(pid, []).append((time, value))

    @property
    def largest(self) -> float:
        """The largest memory of any [MiB]."""
        return max((value for life in self.looks.values() for _, value in life), default=0.0)

    def within(self, warm_up: float) -> Growth:
        """Growth within lives: the mean of those that last long, each by its certainty.

        Args:
            warm_up: Seconds of each life that do not count: caches fill.
        """
        rates = []
        for life in self.looks.values():
            late = [look for look in life if look[0] >= life[0][0] + warm_up]
            rate = growth([time for time, _ in late], [value for _, value in late])
            if np.isfinite(rate.error):
                rates.append(rate)
        if not rates:
            return _UNKNOWN
        # A life of one constant value has no error; that of a page an hour is as good as none.
        weights = np.array([max(rate.error, _PAGE / _MEBIBYTE) for rate in rates]) ** -2.0
        mean = float(weights @ [rate.rate for rate in rates] / weights.sum())
        return Growth(mean, float(weights.sum() ** -0.5), len(rates))

    def over(self, begin: float) -> Growth:
        """Growth of the largest memory in a life, over the lives that end after ``begin`` [s]."""
        ends = sorted(
            (life[-1][0], max(value for _, value in life))
            for life in self.looks.values()
            if life[-1][0] >= begin
        )
        return growth([time for time, _ in ends], [value for _, value in ends])


#: The part of a run in which caches may fill: memory is judged after it.
_WARM_UP = 1.0 / 3.0
#: Between two looks at the memory [s].
_LOOK = 1.0
#: Between two looks at whether all clients have their answers [s].
_GLANCE = 0.05
#: Deadline of all requests [s]: beyond two attempts and the wait of both on a busy machine.
_TIMEOUT = 30.0
#: Place of its start behind a process's name in ``/proc/<pid>/stat``.
_STARTED = 19
#: Settings of the server; all jobs are kept, to be compared at the end.
_ENVIRONMENT = {
    "ARMWRIGHT_WORKERS": "2",
    "ARMWRIGHT_JOB_COUNT": "1000000",
    "ARMWRIGHT_JOB_LIMIT": "64",
    "ARMWRIGHT_LOG_LEVEL": "error",
    "ARMWRIGHT_DEFAULT_TIMEOUT": str(_TIMEOUT),
}


def _goal(number: int) -> list[float]:
    return [0.2 + 5e-5 * (number % 10_000), -0.5, 0.1, -2.2, 0.0, 1.7, 0.785]


def _plan(number: int) -> dict[str, Any]:
    start = {"joints": HOME}
    return {
        "robot": "panda",
        "start": start,
        "goal": {"joints": _goal(number)},
        "timeout": _TIMEOUT,
    }


def _box(number: int) -> dict[str, Any]:
    place = [0.6, -0.4 + 1e-4 * (number % 1000), 0.2]
    shape = {"type": "box", "size": [0.1, 0.1, 0.1 + 1e-5 * (number % 1000)]}
    return {"id": "box", "shape": shape, "pose": {"position": place}}


def _detour(number: int) -> dict[str, Any]:
    goal = {"joints": ASIDE}
    return _plan(number) | {"goal": goal, "scene": scene(POST, FLOOR, _box(number)), "seed": number}


def _upright(number: int) -> dict[str, Any]:
    """A cone of another angle each time: another program."""
    return {
        "type": "orientation", "axis": [0, 0, 1], "direction": [0, 0, -1],
        "cone_angle": 0.2 + 1e-4 * (number % 1000),
    }  # fmt: skip


def _constrained(number: int) -> dict[str, Any]:
    pose = {"position": [0.45, 0.1 + 1e-4 * (number % 100), 0.5]}
    return {
        "pose": pose, "method": "constrained", "axes": ["x", "y", "z"],
        "constraints": [_upright(number)], "scene": scene(FLOOR, _box(number)), "timeout": _TIMEOUT,
    }  # fmt: skip


def _simulation(number: int) -> dict[str, Any]:
    hold = {"type": "hold", "joints": [0.3, -0.4 + 1e-4 * (number % 1000)], "duration": 0.3}
    control = {"type": "computed_torque", "natural_frequency": 10.0}
    return {"robot": "planar_rr", "saturate": False, "reference": hold, "controller": control}


#: Requests by name: path, and the body of each number.
REQUESTS: dict[str, tuple[str, Callable[[int], dict[str, Any]]]] = {
    "plan": ("/v1/plan", _plan),
    "detour": ("/v1/plan", _detour),
    "constrained": ("/v1/robots/panda/ik", _constrained),
    "simulate": ("/v1/simulate", _simulation),
    "check": (
        "/v1/check",
        lambda n: {"robot": "ur5e", "joints": [[0.1] * 6], "scene": scene(FLOOR, _box(n))},
    ),
    "dynamics": ("/v1/robots/panda/dynamics", lambda n: {"joints": _goal(n)}),
}


@dataclass
class Soak:
    """What has happened so far.

    Args:
        url: Of the server.
        stop: When clients end, on the clock of `time.monotonic` [s].
        answers: How often each status was answered, and each code of a failure, by request.
        faults: Answers that should not have been, in words.
        jobs: Ids of acknowledged jobs by their numbers.
        twice: Jobs whose key gave another job the second time.
        turns: How many of its requests each client has behind it.
    """

    url: str
    stop: float
    answers: Counter[tuple[str, int, str]] = field(default_factory=Counter)
    faults: list[str] = field(default_factory=list)
    jobs: dict[int, str] = field(default_factory=dict)
    twice: int = 0
    turns: Counter[int] = field(default_factory=Counter)

    def ask(self, me: int, numbers: Iterator[int], pause: float) -> None:
        """Ask one thing after the other.

        Args:
            me: Number of the client.
            numbers: Of requests, shared by all clients.
            pause: Between two of them [s].
        """
        names = [*REQUESTS, "robot", "job"]
        self.turns[me] = 0
        with httpx.Client(base_url=self.url, timeout=60.0) as client:
            for number in numbers:
                if time.monotonic() > self.stop:
                    return
                name = names[number % len(names)]
                try:
                    if name == "robot":
                        self._upload(client, number)
                    elif name == "job":
                        self._job(client, number)
                    else:
                        path, body = REQUESTS[name]
                        self.note(name, client.post(path, json=body(number)))
                except httpx.HTTPError as error:
                    self.faults.append(f"{name} {number}: {error!r}")
                self.turns[me] += 1
                time.sleep(pause)

    def _upload(self, client: httpx.Client, number: int) -> None:
        """A robot that nobody has seen, asked for once and deleted."""
        name = f"arm{number}"
        limits = {joint: {"acceleration": 5.0 + 1e-4 * number} for joint in ("shoulder", "elbow")}
        self.note("robot", client.post("/v1/robots", json=bench(name, joint_limits=limits)))
        body = {"robot": name, "start": {"joints": [0.1, 0.2]}, "goal": {"joints": [0.5, 0.4]}}
        self.note("robot", client.post("/v1/plan", json=body))
        self.note("robot", client.delete(f"/v1/robots/{name}"))

    def _job(self, client: httpx.Client, number: int) -> None:
        """A job, asked for twice with one key."""
        headers = {"Prefer": "respond-async", "Idempotency-Key": f"soak-{number}"}
        for _ in range(2):
            answer = client.post("/v1/plan", json=_plan(number), headers=headers)
            self.note("job", answer)
            if answer.status_code == 202:
                job = answer.json()["id"]
                self.twice += self.jobs.setdefault(number, job) != job

    def note(self, name: str, answer: httpx.Response) -> None:
        """Count an answer; what is neither good nor by design is a fault."""
        code = "" if answer.is_success else answer.json()["code"]
        self.answers[name, answer.status_code, code] += 1
        # Refusals are the answer to too much work; a robot is missing whose upload was refused.
        by_design = answer.status_code == 429
        missing = name == "robot" and code == "NOT_FOUND"
        if not (answer.is_success or by_design or missing):
            self.faults.append(f"{name}: {answer.status_code} {answer.text[:300]}")

    def judge(self) -> str:
        """Compare all acknowledged jobs with what was asked for, and say what was found."""
        lost = wrong = crashed = 0
        with httpx.Client(base_url=self.url, timeout=60.0) as client:
            for number, job in self.jobs.items():
                answer = client.get(f"/v1/jobs/{job}")
                while answer.is_success and answer.json()["status"] in ("queued", "running"):
                    time.sleep(0.2)
                    answer = client.get(f"/v1/jobs/{job}")
                found = answer.json()
                if not answer.is_success:
                    lost += 1
                elif found["status"] == "succeeded":
                    end = found["result"]["path"]["joints"][-1]
                    wrong += not np.allclose(end, _goal(number), rtol=0.0, atol=1e-6)
                elif found["error"]["code"] == "CRASH":
                    crashed += 1
                else:
                    wrong += 1
        ids = len(set(self.jobs.values()))
        return (
            f"jobs {len(self.jobs)}: lost {lost}, wrong {wrong}, "
            f"doubled {self.twice + len(self.jobs) - ids}, CRASH after two kills {crashed}"
        )


def kill(pid: int, soak: Soak, every: float, done: Counter[str]) -> None:
    """Kill workers, and in place of every twentieth the fork server.

    The oldest worker is spared: a leak shows in those that live for long. Requests that were there
    at a kill have been answered before the next one: two kills of one are CRASH by design.

    Args:
        pid: Of the server.
        soak: What is asked of it, and until when.
        every: Least time between two kills [s].
        done: Counts them.
    """
    while time.monotonic() + every < soak.stop:
        before = dict(soak.turns)
        time.sleep(every)
        while any(soak.turns[me] == turn for me, turn in before.items()):
            if time.monotonic() > soak.stop:
                return
            time.sleep(_GLANCE)
        parents = {one: bool(children(one)) for one in family(pid)}
        kind = "fork server" if (done.total() + 1) % 20 == 0 else "worker"
        victims = [one for one, parent in parents.items() if parent == (kind == "fork server")]
        if kind == "worker":
            victims = sorted(victims, key=birth)[1:]
        if victims:
            with suppress(OSError):
                os.kill(random.choice(victims), signal.SIGKILL)
                done[kind] += 1


def family(pid: int) -> list[int]:
    """The processes of a server, also those whose fork server was killed.

    Args:
        pid: Of the server; all have its mark in their environment.
    """
    mark = f"ARMWRIGHT_MARK={os.getpid()}\0".encode()
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit() and int(entry.name) != pid and alive(int(entry.name)):
            with suppress(OSError):
                if mark in (entry / "environ").read_bytes() + b"\0":
                    found.append(int(entry.name))
    return found


def birth(pid: int) -> int:
    """When a process was started [ticks since the machine was]; 0 if it has ended."""
    with suppress(OSError, IndexError):
        return int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[_STARTED])
    return 0


def main() -> None:
    """Soak a server, and say how it has taken it; ends with 1 where something was wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--rate", type=float, default=8.0, help="requests a second at most")
    parser.add_argument("--clients", type=int, default=4)
    parser.add_argument(
        "--kill-every", type=float, default=5.0, help="least seconds between two kills"
    )
    chosen = parser.parse_args()
    with local_server(_ENVIRONMENT | {"ARMWRIGHT_MARK": str(os.getpid())}) as (pid, url):
        began = time.monotonic()
        soak = Soak(url, began + 60.0 * chosen.minutes)
        numbers = itertools.count()
        kills: Counter[str] = Counter()
        pause = chosen.clients / chosen.rate
        threads = [
            threading.Thread(target=soak.ask, args=(me, numbers, pause))
            for me in range(chosen.clients)
        ]
        threads.append(threading.Thread(target=kill, args=(pid, soak, chosen.kill_every, kills)))
        for thread in threads:
            thread.start()
        times: list[float] = []
        own: list[float] = []
        workers, warm_up = Lives(), _WARM_UP * 60.0 * chosen.minutes
        while any(thread.is_alive() for thread in threads):
            time.sleep(_LOOK)
            now = time.monotonic() - began
            workers.look(now, {one: resident(one) for one in family(pid) if not children(one)})
            if now > warm_up:
                times.append(now)
                own.append(resident(pid))
        verdict = soak.judge()
        counts = {" ".join(map(str, key)).strip(): n for key, n in sorted(soak.answers.items())}
        print(json.dumps(counts))
        print(f"kills {dict(kills)}")
        print(verdict)
        print(
            f"server {own[-1] if own else resident(pid):.0f} MiB, {growth(times, own)} after the "
            f"warm-up of {warm_up:.0f} s"
        )
        within, over = workers.within(warm_up), workers.over(warm_up)
        print(
            f"workers: largest {workers.largest:.0f} MiB; within the {within.samples} lives longer "
            f"than the warm-up {within}; of the largest in {over.samples} lives {over}"
        )
        failed = sum(n for (_, status, _), n in soak.answers.items() if status >= 500)
        print(f"answers of 500 and above {failed}, faults {len(soak.faults)}")
        for fault in soak.faults[:20]:
            print(f"  {fault}")
    sys.exit(bool(soak.faults or soak.twice or "lost 0, wrong 0, doubled 0" not in verdict))


if __name__ == "__main__":
    main()
