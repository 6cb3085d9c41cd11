"""Batches: how many plans a second one worker gives, and two.

    python -m benchmarks.batch [--count 1000] [--workers 1 2] [--rounds 3]

Each service runs on this machine and is asked nothing else. The scene is a table with a post and
two boxes on it and a shelf above; the built-in Panda moves between states at random that keep clear
of them. Two of five motions are straight lines, the others go round something. The processor time
of the server itself is told beside that of its workers: where there are no more cores than workers
they share them.
"""

import argparse
import statistics
import time
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import httpx
import numpy as np

from benchmarks.machines import local_server, processor_times, wait_until_idle

#: Around this state the hand is above the table, and below the shelf.
MIDDLE = np.array([0.0, 0.2, 0.0, -1.9, 0.0, 2.1, 0.785])
#: How far states are from it at most, joint by joint [rad].
SPREAD = np.array([1.2, 0.6, 0.4, 0.5, 0.4, 0.5, 1.0])
#: Least distance of starts and goals from obstacles [m].
CLEARANCE = 0.03
BOXES = {
    "table": ([0.9, 1.4, 0.04], [0.6, 0.0, 0.0]),
    "post": ([0.06, 0.06, 0.6], [0.5, 0.3, 0.32]),
    "crate": ([0.25, 0.35, 0.3], [0.6, -0.35, 0.17]),
    "parcel": ([0.2, 0.2, 0.2], [0.45, 0.0, 0.12]),
    "shelf": ([0.3, 0.8, 0.02], [0.75, 0.0, 0.62]),
}
SCENE: dict[str, Any] = {
    "name": "table",
    "obstacles": [
        {"id": name, "shape": {"type": "box", "size": size}, "pose": {"position": position}}
        for name, (size, position) in BOXES.items()
    ],
}


@dataclass(frozen=True)
class Round:
    """One batch.

    Args:
        seconds: From its request to its end [s].
        server: Processor time of the server [s].
        workers: Processor time of its workers [s].
        succeeded: Problems that were answered with a plan.
    """

    seconds: float
    server: float
    workers: float
    succeeded: int


def free_states(client: httpx.Client, count: int) -> list[list[float]]:
    """States that keep their distance from the scene."""
    random, found = np.random.default_rng(1), list[list[float]]()
    while len(found) < count:
        tried = MIDDLE + SPREAD * random.uniform(-1.0, 1.0, (min(3 * count, 500), 7))
        states = tried.round(6).tolist()
        body = {
            "robot": "panda",
            "scene": "table",
            "joints": states,
            "margin": CLEARANCE,
            "depth": False,
        }
        valid = client.post("/v1/check", json=body).raise_for_status().json()["valid"]
        found += [state for state, is_free in zip(states, valid, strict=True) if is_free]
    return found[:count]


def plan_batch(pid: int, client: httpx.Client, states: list[list[float]]) -> Round:
    """Plan from each state to the next one, as one batch."""
    problems = [
        {"start": {"joints": start}, "goal": {"joints": goal}} for start, goal in pairwise(states)
    ]
    before = processor_times(pid)
    began = time.perf_counter()
    body = {"robot": "panda", "scene": "table", "timeout": 5.0, "problems": problems}
    answered = client.post("/v1/plan/batch", json=body).raise_for_status()
    job = answered.headers["location"]
    with client.stream("GET", f"{job}/events") as events:
        for line in events.iter_lines():
            if line == "event: end":
                break
    seconds = time.perf_counter() - began
    spent = processor_times(pid).since(before)
    result = client.get(job).raise_for_status().json()["result"]
    return Round(seconds, spent.own, spent.below, result["succeeded"])


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--rounds", type=int, default=3)
    asked = parser.parse_args()
    rates = []
    for workers in asked.workers:
        settings = {"ARMWRIGHT_WORKERS": str(workers), "ARMWRIGHT_BATCH_LIMIT": str(asked.count)}
        with (
            local_server(settings) as (pid, url),
            httpx.Client(base_url=url, timeout=600.0) as client,
        ):
            wait_until_idle(pid)
            client.post("/v1/scenes", json=SCENE).raise_for_status()
            states = free_states(client, asked.count + 1)
            plan_batch(pid, client, states[: max(asked.count // 4, 2)])
            rounds = [plan_batch(pid, client, states) for _ in range(asked.rounds)]
        chosen = sorted(rounds, key=lambda one: one.seconds)[len(rounds) // 2]
        rates.append(asked.count / statistics.median(one.seconds for one in rounds))
        print(
            f"{workers} worker(s): {rates[-1]:6.1f} plans/s, {chosen.succeeded} of {asked.count}; "
            f"a plan costs {1e3 * chosen.workers / asked.count:.2f} ms of workers and "
            f"{1e3 * chosen.server / asked.count:.2f} ms of the server"
        )
    for workers, rate in zip(asked.workers[1:], rates[1:], strict=True):
        print(f"{workers} workers give {rate / rates[0]:.2f} times the plans of the first")


if __name__ == "__main__":
    main()
