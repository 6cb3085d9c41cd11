"""Nothing acknowledged is lost or done twice, though servers are killed and databases locked."""

import resource
import sqlite3
import subprocess
import threading
import time
from pathlib import Path

import httpx

from tests.service.commands import serve, start_command
from tests.service.processes import wait_until
from tests.service.robots import HOME, answer, problem

CHECK = {"robot": "panda", "scene": {"obstacles": []}, "joints": HOME, "timeout": 60.0}
KEYS = [f"key-{number}" for number in range(40)]


def submit(client: httpx.Client, key: str) -> httpx.Response:
    headers = {"Prefer": "respond-async", "Idempotency-Key": key}
    return client.post("/v1/check", json=CHECK, headers=headers)


def every_job(client: httpx.Client) -> list[str]:
    return [job["id"] for job in answer(client.get("/v1/jobs?limit=1000"))["jobs"]]


def statuses(client: httpx.Client) -> list[str]:
    return [job["status"] for job in answer(client.get("/v1/jobs?limit=1000"))["jobs"]]


def test_each_key_makes_one_job_though_the_server_is_killed(tmp_path: Path) -> None:
    told: dict[str, set[str]] = {key: set() for key in KEYS}
    for delay in (0.02, 0.05, 0.09):
        with serve(tmp_path) as (process, client):
            killing = threading.Timer(delay, process.kill)
            killing.start()
            try:
                for key in KEYS:
                    response = submit(client, key)
                    if response.status_code == 202:
                        told[key].add(response.json()["id"])
            except httpx.HTTPError:
                pass
            killing.join()
    with serve(tmp_path) as (_, client):
        for key in KEYS:
            told[key].add(answer(submit(client, key), 202)["id"])
        assert all(len(ids) == 1 for ids in told.values()), "a key stands for one job"
        assert sorted(every_job(client)) == sorted(job for ids in told.values() for job in ids)
        assert wait_until(lambda: set(statuses(client)) <= {"succeeded", "failed"}, 60.0)


def test_a_locked_database_is_told_and_all_goes_on_when_it_is_free(tmp_path: Path) -> None:
    with serve(tmp_path) as (_, client):
        answer(submit(client, "before"), 202)
        # What is told is that of the first to write: the end of this job would be, were it open.
        assert wait_until(lambda: statuses(client) == ["succeeded"], 60.0)
        other = sqlite3.connect(tmp_path / "armwright.db", isolation_level=None)
        other.execute("BEGIN IMMEDIATE")
        refused = client.post("/v1/scenes", json={"name": "s", "obstacles": []})
        assert "locked" in problem(refused, 503, "STORAGE_UNAVAILABLE")["detail"]
        assert int(refused.headers["retry-after"]) >= 1
        problem(client.get("/readyz"), 503, "STORAGE_UNAVAILABLE")
        assert client.get("/healthz").status_code == 200
        answer(client.post("/v1/check", json=CHECK))
        other.execute("ROLLBACK")
        other.close()
        began = time.monotonic()
        assert wait_until(lambda: client.get("/readyz").status_code == 200, 10.0)
        assert time.monotonic() - began < 10.0
        answer(submit(client, "after"), 202)
        assert wait_until(lambda: statuses(client) == ["succeeded"] * 2, 60.0)


def test_a_full_disk_is_told_and_all_goes_on_when_there_is_room(tmp_path: Path) -> None:
    with serve(tmp_path) as (process, client):
        answer(submit(client, "before"), 202)
        # No file of the server may grow any more, as on a disk that is full.
        before = resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (0, resource.RLIM_INFINITY))
        scene = {"name": "s", "obstacles": []}
        for _ in range(3):
            refused = client.post("/v1/scenes", json=scene)
            problem(refused, 503, "STORAGE_UNAVAILABLE")
            assert int(refused.headers["retry-after"]) >= 1
            problem(submit(client, "meanwhile"), 503, "STORAGE_UNAVAILABLE")
        problem(client.get("/readyz"), 503, "STORAGE_UNAVAILABLE")
        assert client.get("/healthz").status_code == 200
        answer(client.post("/v1/check", json=CHECK))
        resource.prlimit(process.pid, resource.RLIMIT_FSIZE, before)
        assert wait_until(lambda: client.get("/readyz").status_code == 200, 10.0)
        answer(client.post("/v1/scenes", json=scene), 201)
        answer(submit(client, "meanwhile"), 202)
        answer(submit(client, "after"), 202)
        assert wait_until(lambda: statuses(client) == ["succeeded"] * 3, 60.0)


def test_a_second_server_on_one_folder_is_refused(tmp_path: Path) -> None:
    with serve(tmp_path, warm=False):
        arguments = ["serve", "--port", "0", "--data-dir", str(tmp_path)]
        with start_command(arguments, stderr=subprocess.PIPE) as second:
            try:
                _, errors = second.communicate(timeout=30.0)
            finally:
                second.kill()
    assert second.returncode == 1
    assert "another server uses the database" in errors
    assert "Traceback" not in errors
