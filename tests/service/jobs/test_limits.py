"""Bounds of jobs: how many, how long, how much is kept, restarts and metrics."""

import signal
import sqlite3
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from prometheus_client.parser import text_string_to_metric_families

from tests.service.commands import serve
from tests.service.conftest import Served
from tests.service.jobs.requests import ASYNC, EASY, STUCK, batch, began, ended, submit
from tests.service.processes import kill_in_work
from tests.service.robots import (
    answer,
    bench,
    problem,
)


@contextmanager
def limits(served: Served, **changes: Any) -> Iterator[None]:
    """The service with other limits for a while."""
    held = served.app.state.jobs
    before = held._settings
    held._settings = before.model_copy(update=changes)
    try:
        yield
    finally:
        held._settings = before


def test_too_many_jobs_are_refused(jobs: Served) -> None:
    client = jobs.client
    with limits(jobs, job_limit=2):
        held = [submit(client, STUCK) for _ in range(2)]
        response = client.post("/v1/plan", json=EASY, headers=ASYNC)
        problem(response, 429, "OVERLOADED")
        assert int(response.headers["retry-after"]) >= 1
        problem(client.post("/v1/plan/batch", json={"problems": [EASY]}), 429, "OVERLOADED")
        answer(client.post("/v1/plan", json=EASY))  # who waits is not concerned
        for job in held:
            answer(client.delete(job))
        assert ended(client, submit(client, EASY))["status"] == "succeeded"


def test_a_job_must_end_in_time(jobs: Served) -> None:
    client = jobs.client
    with limits(jobs, job_deadline=1.0):
        body = {"problems": [EASY, STUCK, STUCK, EASY]}
        results = batch(client, body)["result"]["results"]
        assert [result.get("code") for result in results] == [None, *["TIMED_OUT"] * 3]
        alone = ended(client, submit(client, STUCK))
        error = alone["error"]
        assert (alone["status"], error["code"], error["stage"]) == ("failed", "TIMED_OUT", "job")
        assert "within 1 s" in error["detail"]


SINGLE = {"ARMWRIGHT_WORKERS": "1", "ARMWRIGHT_LOG_LEVEL": "error"}


def test_jobs_outlive_the_service(tmp_path: Path) -> None:
    with serve(tmp_path, environment=SINGLE) as (process, client):
        answer(client.post("/v1/robots", json=bench("stuck")), 201)
        key = {"Idempotency-Key": "before"}
        done = submit(client, EASY, **key)
        kept = ended(client, done)
        lost, queued = submit(client, STUCK), submit(client, STUCK)
        began(client, lost, "rrt_connect")
        process.kill()
        process.wait()
    with serve(tmp_path, environment=SINGLE) as (process, client):
        assert answer(client.get(done)) == kept
        assert submit(client, EASY, **key) == done, "the same key gives the same job as before"
        began(client, lost, "rrt_connect")  # which ran, and runs once more
        answer(client.delete(lost))
        began(client, queued, "rrt_connect")
        with client.stream("GET", f"{queued}/events") as response:
            told = response.iter_text()
            next(told)
            start = time.monotonic()
            process.terminate()
            list(told)
            assert time.monotonic() - start < 10.0, "open streams end with the service"
        assert process.wait(10.0) == 0
    with sqlite3.connect(tmp_path / "armwright.db") as database:
        (status,) = database.execute(
            "SELECT status FROM jobs WHERE id = ?", (queued.rpartition("/")[2],)
        ).fetchone()
    database.close()
    assert status == "queued", "it will be taken up again"


def test_metrics_count_by_what_is_ours(jobs: Served) -> None:
    client = jobs.client
    stuck = submit(client, STUCK)
    began(client, stuck, "rrt_connect")
    kill_in_work(jobs.supervisor, signal.SIGKILL, signal.SIGKILL)  # it is begun twice
    assert ended(client, stuck)["error"]["code"] == "CRASH"
    for _ in range(6):
        answer(client.post("/v1/plan", json=EASY))
    assert ended(client, submit(client, EASY))["status"] == "succeeded"
    client.get("/v1/nothing/like/this")
    client.get("/v1/robots/nobody-of-this-name")
    client.request("BREW", "/v1/robots")
    answer(client.post("/v1/plan", json=EASY))
    response = client.get("/metrics")
    assert response.headers["content-type"].startswith("text/plain; version=0.0.4")
    families = {family.name: family for family in text_string_to_metric_families(response.text)}
    requests = families["armwright_requests"].samples
    counted = {
        tuple(sample.labels[name] for name in ("route", "method", "status"))
        for sample in requests
        if sample.name.endswith("_total")
    }
    assert ("/v1/robots/{name}", "GET", "404") in counted
    assert ("unmatched", "GET", "404") in counted
    assert ("/v1/plan", "POST", "200") in counted
    assert ("/v1/plan", "POST", "202") in counted
    assert "nobody-of-this-name" not in response.text
    assert "BREW" not in response.text
    assert len(counted) < 60

    def value(name: str, sample_name: str = "", **labels: str) -> float:
        return sum(
            sample.value
            for sample in families[name].samples
            if sample.name == (sample_name or name) and labels.items() <= sample.labels.items()
        )

    assert value("armwright_plans", "armwright_plans_total", code="SUCCESS") > 5
    assert value("armwright_plans", "armwright_plans_total", planner="straight_line") > 5
    assert value("armwright_plans", "armwright_plans_total", code="CRASH") >= 1
    assert value("armwright_stage_seconds", "armwright_stage_seconds_count", stage="timing") > 5
    assert value("armwright_workers", state="wanted") == 2
    assert value("armwright_queue_length") == 0
    assert value("armwright_jobs", status="succeeded") >= 1
    assert value("armwright_worker_starts", "armwright_worker_starts_total") > 2
    assert value("armwright_work", "armwright_work_total", outcome="crashed") >= 1
