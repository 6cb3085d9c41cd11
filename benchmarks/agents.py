"""Jobs over machines: none lost and none done twice under faults, and what agents are worth.

``python -m benchmarks.agents faults`` starts PostgreSQL, servers that leave jobs to agents, and
agents, as processes of this machine; sends jobs; kills workers, agents and servers, restarts
PostgreSQL and freezes an agent meanwhile; and at last compares every job that was acknowledged
with the plan that it asked for. ``python -m benchmarks.agents speed`` times jobs and a batch with
one server alone, one agent and two, each with one worker.
"""

import argparse
import itertools
import json
import random
import signal
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass, field
from typing import Any

import httpx

from benchmarks.machines import ENDED, Process, Rows, processes, processor_times
from tests.service.postgresql import PostgreSQL, postgresql

_HOME = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]
#: Longest time in which nothing may come forward [s]: several times the lifetime of a silent agent.
_STANDSTILL = 180.0
#: Jobs that wait or run at most: more would say nothing more.
_WAITING = 100
#: How often the rows are looked at [s].
_LOOK = 0.5
#: The same where seconds are told.
_SHORT_LOOK = 0.02


def goal(number: int) -> list[float]:
    """Goal of a job: each job has another one, so that answers can be told apart."""
    return [0.2 + 5e-5 * number, -0.5, 0.1, -2.2, 0.0, 1.7, 0.785]


def body(number: int) -> dict[str, Any]:
    """A plan of some milliseconds."""
    return {
        "robot": "panda", "start": {"joints": _HOME}, "goal": {"joints": goal(number)},
        "timeout": 10.0,
    }  # fmt: skip


@dataclass
class Trial:
    """Jobs that are sent while faults happen.

    Args:
        jobs: How many.
        servers: That take them.
        acknowledged: Ids of jobs by their numbers.
        again: Requests that were sent again, since no answer came.
    """

    jobs: int
    servers: list[Process]
    acknowledged: dict[int, str] = field(default_factory=dict)
    again: int = 0

    def send(self, numbers: Iterator[int], allowed: Callable[[], int]) -> None:
        """Send jobs until there are no more, each with an idempotency key of its own.

        Args:
            numbers: Of the jobs.
            allowed: How many may have been sent by now.
        """
        with httpx.Client(timeout=20.0) as client:
            for number in numbers:
                while number >= allowed():
                    time.sleep(0.05)
                for server in itertools.cycle(self.servers):
                    try:
                        answer = client.post(
                            f"{server.url}/v1/plan",
                            json=body(number),
                            headers={
                                "Prefer": "respond-async",
                                "Idempotency-Key": f"trial-{number}",
                            },
                        )
                        if answer.status_code == 202:
                            self.acknowledged[number] = answer.json()["id"]
                            break
                    except httpx.HTTPError:
                        pass
                    self.again += 1
                    time.sleep(0.05)


@dataclass
class Faults:
    """Faults that are made, evenly over the jobs.

    Args:
        agents: Whose workers are killed, and which are killed and frozen.
        servers: That are killed.
        database: That is restarted.
        frozen: How long one agent is frozen [s].
        counts: Faults still to be made, by kind.
    """

    agents: list[Process]
    servers: list[Process]
    database: PostgreSQL
    frozen: float
    counts: dict[str, int]
    done: Counter[str] = field(default_factory=Counter)

    def make(self, jobs: int, ended: Callable[[], int]) -> None:
        """Make all faults, each when its part of the jobs has ended."""
        order = [
            ((number + 0.5) / count, kind)
            for kind, count in self.counts.items()
            for number in range(count)
        ]
        for part, kind in sorted(order):
            while ended() < part * jobs - _WAITING:
                time.sleep(0.05)
            getattr(self, kind)()
            self.done[kind] += 1

    def part(self) -> float:
        """The part of all faults that were made."""
        return sum(self.done.values()) / max(sum(self.counts.values()), 1)

    def worker(self) -> None:
        """Kill a worker while it works."""
        while not random.choice(self.agents).kill_worker():
            time.sleep(0.01)

    def agent(self) -> None:
        """Kill an agent, and start it again."""
        self._replace(self.agents[self.done["agent"] % len(self.agents)])

    def server(self) -> None:
        """Kill a server, and start it again."""
        self._replace(self.servers[self.done["server"] % len(self.servers)])

    def restart(self) -> None:
        """Restart PostgreSQL."""
        self.database.stop()
        time.sleep(1.0)
        self.database.start()

    def freeze(self) -> None:
        """Freeze an agent for a while, and let it go on in the end."""
        agent = self.agents[0]
        agent.freeze(signal.SIGSTOP)
        time.sleep(self.frozen)
        agent.freeze(signal.SIGCONT)

    def _replace(self, process: Process) -> None:
        process.wait()
        process.kill()
        process.start()


def verdict(trial: Trial, rows: Rows) -> Counter[str]:
    """Counts of jobs by what became of them: lost, doubled, wrong, of each status."""
    counts: Counter[str] = Counter()
    found = {
        row[0]: row[1:]
        for row in rows.ask("SELECT id, status, attempt, answer FROM jobs ORDER BY id")
    }
    counts["jobs stored"] = len(found)
    counts["doubled"] = len(found) - len(set(trial.acknowledged.values()))
    for number, job in trial.acknowledged.items():
        status, attempt, answer = found.get(job, ("lost", 1, None))
        counts[status if status in ENDED else "lost"] += 1
        counts["begun again by another agent"] += attempt > 1
        if status == "succeeded":
            end = json.loads(bytes(answer))["path"]["joints"][-1]
            counts["wrong"] += any(
                abs(a - b) > 1e-9 for a, b in zip(end, goal(number), strict=True)
            )
        elif status == "failed":
            counts[f"failed with {json.loads(bytes(answer))['code']}"] += 1
    counts["messages left"] = rows.messages()
    return counts


def faults(options: argparse.Namespace) -> Counter[str]:
    """Send jobs while faults happen, and say what became of them.

    Args:
        options: Numbers of jobs and of faults.
    """
    counts = {
        "worker": options.workers, "agent": options.agents, "server": options.servers,
        "restart": options.restarts, "freeze": int(options.freeze > 0.0),
    }  # fmt: skip
    with (
        postgresql() as database,
        processes(database, options.machines, options.machines) as (url, servers, agents),
        closing(Rows(url)) as rows,
    ):
        trial, ended = Trial(options.jobs, servers), 0

        chaos = Faults(agents, servers, database, options.freeze, counts)

        def allowed() -> int:
            # Jobs and faults keep step, so that each fault meets work.
            return min(ended, int(options.jobs * chaos.part())) + _WAITING

        numbers = iter(range(options.jobs))
        lock = threading.Lock()

        def shared() -> Iterator[int]:
            while True:
                with lock:
                    number = next(numbers, None)
                if number is None:
                    return
                yield number

        senders = [threading.Thread(target=trial.send, args=(shared(), allowed)) for _ in range(2)]
        maker = threading.Thread(target=chaos.make, args=(options.jobs, lambda: ended))
        began = changed = time.monotonic()
        for thread in (*senders, maker):
            thread.start()
        while ended < options.jobs or maker.is_alive():
            time.sleep(_LOOK)
            now = rows.ended()
            if now != ended or maker.is_alive():
                changed = time.monotonic()
            ended = now
            if options.verbose:
                print(f"{time.monotonic() - began:.0f} s: {ended} ended, {dict(chaos.done)}")
            if time.monotonic() - changed > _STANDSTILL:
                break
        for thread in (*senders, maker):
            thread.join()
        end = time.monotonic() + 30.0
        while rows.messages() and time.monotonic() < end:
            time.sleep(0.2)
        result = verdict(trial, rows)
        result["acknowledged"] = len(trial.acknowledged)
        result["requests sent again"] = trial.again
        result["seconds"] = round(time.monotonic() - began)
        result.update({f"faults: {kind}": count for kind, count in chaos.done.items()})
    return result


def speed(options: argparse.Namespace) -> dict[str, float]:
    """Seconds that jobs, and one batch, take with one server alone, one agent and two.

    Beside them stands the processor time that each of them cost the workers, the processes that
    hand them their work, the server and PostgreSQL [ms].

    Args:
        options: Numbers of jobs and of problems.
    """
    figures: dict[str, float] = {}
    kinds = {"batch": options.problems, "jobs": options.jobs}
    for name, agents in (("server alone", 0), ("one agent", 1), ("two agents", 2)):
        with (
            postgresql() as database,
            processes(database, 1, agents, "agents" if agents else "server") as started,
            closing(Rows(started[0])) as rows,
            httpx.Client(base_url=started[1][0].url, timeout=60.0) as client,
        ):
            for kind, count in kinds.items():
                _send(client, rows, kind, count if kind == "batch" else 8)
                before = _processor_times(database, *started[1:])
                began = time.monotonic()
                _send(client, rows, kind, count)
                figures[f"{name}, {kind}"] = time.monotonic() - began
                after = _processor_times(database, *started[1:])
                for part, spent in after.items():
                    each = 1e3 * (spent - before[part]) / count
                    figures[f"{name}, {kind}: {part}, ms each"] = each
    for kind, count in kinds.items():
        alone, one, two = (
            figures[f"{n}, {kind}"] for n in ("server alone", "one agent", "two agents")
        )
        figures[f"{kind}: two agents, times as fast as one"] = one / two
        figures[f"{kind}: one agent more than a server, ms each"] = 1e3 * (one - alone) / count
    return figures


def _send(client: httpx.Client, rows: Rows, kind: str, count: int) -> None:
    """Send a batch of so many problems, or so many jobs, and wait until all have ended."""
    before = rows.ended()
    path = "/v1/plan/batch" if kind == "batch" else "/v1/plan"
    bodies = [batch_body(count)] if kind == "batch" else [body(number) for number in range(count)]
    for content in bodies:
        answer = client.post(path, json=content, headers={"Prefer": "respond-async"})
        answer.raise_for_status()
    while rows.running():
        time.sleep(_SHORT_LOOK)
    assert rows.ended() >= before + len(bodies)


def _processor_times(
    database: PostgreSQL, servers: list[Process], agents: list[Process]
) -> dict[str, float]:
    """The processor time that each part has had [s]."""
    times = {"workers": 0.0, "agents": 0.0, "server": 0.0}
    for part, started in (("server", servers), ("agents", agents)):
        for process in started:
            spent = processor_times(process.process.pid)
            times[part] += spent.own
            times["workers"] += spent.below
    times["PostgreSQL"] = sum(processor_times(database.pid))
    return times


def batch_body(problems: int) -> dict[str, Any]:
    """A batch of plans among twenty boxes."""
    obstacles = [
        {
            "id": f"box{number}",
            "shape": {"type": "box", "size": [0.05, 0.05, 0.3]},
            "pose": {"position": [0.75, -0.6 + 0.06 * number, 0.3]},
        }
        for number in range(20)
    ]
    return {
        "robot": "panda",
        "scene": {"obstacles": obstacles},
        "problems": [
            {"start": {"joints": _HOME}, "goal": {"joints": goal(number)}}
            for number in range(problems)
        ],
        "timeout": 10.0,
    }


def main(arguments: list[str] | None = None) -> None:
    """Run a trial and print its figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    modes = parser.add_subparsers(dest="mode", required=True)
    trial = modes.add_parser("faults", help="jobs under faults")
    trial.add_argument("--jobs", type=int, default=10_000)
    trial.add_argument("--workers", type=int, default=200, help="kills of workers")
    trial.add_argument("--agents", type=int, default=50, help="kills of agents")
    trial.add_argument("--servers", type=int, default=20, help="kills of servers")
    trial.add_argument("--restarts", type=int, default=5, help="restarts of PostgreSQL")
    trial.add_argument("--freeze", type=float, default=60.0, help="an agent frozen [s]")
    trial.add_argument("--machines", type=int, default=2, help="servers, and agents")
    trial.add_argument("--verbose", action="store_true", help="progress")
    quick = modes.add_parser("speed", help="jobs and a batch, with and without agents")
    quick.add_argument("--jobs", type=int, default=300)
    quick.add_argument("--problems", type=int, default=1000)
    options = parser.parse_args(arguments)
    figures = faults(options) if options.mode == "faults" else speed(options)
    for name, figure in figures.items():
        print(f"{name:50} {figure:g}")


if __name__ == "__main__":
    main()
