"""Agents with real workers: batches in chunks answer as they do whole, and the command works."""

import os
import signal
import subprocess
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest

from service.app import create_app
from service.cli import main
from service.settings import Settings
from service.storage.stores.job_store import Chunk, JobRecord
from service.task_references import plan, plan_part
from tests.service.commands import start_command
from tests.service.conftest import Served
from tests.service.jobs.requests import EASY, STUCK, batch, ended, submit
from tests.service.postgresql import PostgreSQL
from tests.service.processes import alive, descendants, kill_in_work, wait_until
from tests.service.robots import DETOUR, FLOOR, answer, bench, scene
from tests.service.server import CONNECTIONS, serving


@pytest.fixture(scope="module")
def both(
    postgresql: PostgreSQL, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[tuple[Served, str]]:
    """A server that is an agent too, and the URL of its database."""
    data, url = tmp_path_factory.mktemp("both"), postgresql.database()
    app = create_app(Settings(data_dir=data, workers=2, database_url=url, jobs="both"))
    with serving(app) as client:
        yield Served(app, client, data), url


def without_times(value: Any) -> Any:
    """An answer without what a clock has measured."""
    if isinstance(value, dict):
        timed = ("milliseconds", "seconds", "timings", "stages")
        return {name: without_times(inner) for name, inner in value.items() if name not in timed}
    return [without_times(inner) for inner in value] if isinstance(value, list) else value


def test_a_batch_in_chunks_answers_as_it_does_whole(
    both: tuple[Served, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    served, _ = both
    queue = served.app.state.store.queue
    sizes: list[int] = []
    cut = queue.cut

    def note(record: JobRecord, chunks: Sequence[Chunk]) -> bool:
        sizes.extend(size for _, size, _ in chunks)
        return bool(cut(record, chunks))

    monkeypatch.setattr(queue, "cut", note)
    goals = [[0.2 * n, 0.1] for n in range(5)]
    problems: list[dict[str, Any]] = [{"goal": {"joints": q}, "seed": 3} for q in goals]
    problems[1]["scene"] = scene()
    problems[3]["goal"] = {"joints": [99.0, 0.0]}
    request = {
        "robot": "planar_rr", "scene": scene(FLOOR), "start": {"joints": [0.9, 0.9]},
        "collisions": "ignore", "timeout": 60.0, "problems": problems,
    }  # fmt: skip
    whole = batch(served.client, request)
    assert sizes == []
    for _ in range(60):  # as if plans took a second each
        served.supervisor.durations.note(plan.name, 1.0)
    job = batch(served.client, request)
    assert job["status"] == "succeeded", job
    assert sizes == [3, 2]
    assert without_times(job["result"]) == without_times(whole["result"])
    assert job["result"]["results"][3]["instance"] == "/v1/plan/batch#/problems/3"


def test_jobs_of_any_kind_go_through_the_queue(both: tuple[Served, str]) -> None:
    served, _ = both
    job = ended(served.client, submit(served.client, EASY))
    assert job["status"] == "succeeded"
    assert job["result"]["certificate"]["verified"]
    empty = "armwright_agent_queue_length 0.0\n"
    assert wait_until(lambda: empty in served.client.get("/metrics").text, 20.0)


def test_a_job_that_kills_two_workers_of_an_agent_tells_both_causes(
    both: tuple[Served, str],
) -> None:
    served, _ = both
    answer(served.client.post("/v1/robots", json=bench("stuck")), 201)
    job = submit(served.client, STUCK)
    kill_in_work(served.supervisor, signal.SIGKILL, signal.SIGSEGV)
    failed = ended(served.client, job)
    assert failed["error"]["code"] == "CRASH"
    first, second = failed["error"]["details"]["causes"]
    assert ("SIGKILL" in first, "SIGSEGV" in second) == (True, True)
    assert first in failed["error"]["detail"]
    assert ended(served.client, submit(served.client, EASY))["status"] == "succeeded"


def planning_pids(served: Served) -> set[int]:
    """The process numbers of the workers that plan a problem of a batch."""
    return {
        worker.process.pid
        for worker in served.supervisor._pool.workers
        if worker.ticket is not None and worker.ticket.job.task == plan_part.name
    }


def test_a_batch_whose_workers_are_killed_answers_each_problem_once(
    both: tuple[Served, str],
) -> None:
    served, _ = both
    for _ in range(60):  # so that it is cut into chunks
        served.supervisor.durations.note(plan.name, 1.0)
    goals = [[1.2, -0.3 - 0.01 * n, 0.0, -2.0, 0.0, 1.8, 0.785] for n in range(12)]
    request = {key: DETOUR[key] for key in ("robot", "scene", "start", "timeout")}
    request["problems"] = [{"goal": {"joints": goal}} for goal in goals]
    response = served.client.post("/v1/plan/batch", json=request)
    answer(response, 202)
    # Both workers die while problems wait, so that the third has some left to do.
    job, killed = response.headers["location"], set[int]()
    while len(killed) < 3 and answer(served.client.get(job))["status"] in ("queued", "running"):
        for pid in planning_pids(served) - killed:
            os.kill(pid, signal.SIGKILL)
            killed.add(pid)
        time.sleep(0.002)
    assert len(killed) >= 3
    results = ended(served.client, job, 60.0)["result"]["results"]
    assert len(results) == len(goals)
    crashed = 0
    for goal, found in zip(goals, results, strict=True):
        if found.get("code") == "CRASH":
            crashed += 1
            assert len(found["details"]["causes"]) == 2
        else:
            np.testing.assert_allclose(found["path"]["joints"][-1], goal, atol=1e-6)
    assert crashed <= len(killed) // 2, "two kills may have met the same problem"


def test_an_agent_answers_for_its_health_and_ends_at_once(
    both: tuple[Served, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    served, url = both
    monkeypatch.setenv("ARMWRIGHT_DATABASE_URL", url)
    monkeypatch.setenv("ARMWRIGHT_PUBLIC_METRICS", "true")
    command = ["agent", "--port", "0", "--workers", "1", "--data-dir", str(tmp_path)]
    with start_command(command, stdout=subprocess.PIPE) as process:
        try:
            assert process.stdout is not None
            greeting = process.stdout.readline()
            assert greeting.startswith("Armwright works on jobs; its health and metrics are on ")
            url = greeting.split()[-1]
            with httpx.Client(base_url=url, timeout=20.0, limits=CONNECTIONS) as agent:
                assert wait_until(lambda: agent.get("/readyz").status_code == 200, 60.0)
                assert "armwright_agent_queue_length" in agent.get("/metrics").text
                assert answer(agent.post("/v1/plan", json=EASY), 404)["code"] == "NOT_FOUND"
            job = ended(served.client, submit(served.client, EASY))
            assert job["status"] == "succeeded"
            below = descendants(process.pid)
            process.send_signal(signal.SIGTERM)
            assert process.wait(15.0) == 0
            assert wait_until(lambda: not any(alive(pid) for pid in below), 10.0)
        finally:
            process.kill()


def test_an_agent_without_postgresql_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["agent", "--data-dir", str(tmp_path), "--port", "0"]) == 1
    assert "agents need a PostgreSQL database" in capsys.readouterr().err
