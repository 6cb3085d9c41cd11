"""Jobs over HTTP: accepted, watched, cancelled, lost and found again."""

import json
import os
import signal
import sqlite3
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest
from prometheus_client.parser import text_string_to_metric_families

from service.app import create_app
from service.settings import Settings
from tests.service.conftest import Served
from tests.service.processes import wait_until
from tests.service.robots import (
    ASIDE,
    DETOUR,
    FLOOR,
    HOME,
    POST,
    answer,
    bench,
    problem,
    scene,
    stuck,
)
from tests.service.server import serving

ASYNC = {"Prefer": "respond-async"}
PLAN = DETOUR
#: Nothing is in the way, so it takes milliseconds.
EASY: dict[str, Any] = {
    "robot": "planar_rr",
    "start": {"joints": [0.0, 0.0]},
    "goal": {"joints": [0.5, 0.5]},
    "timeout": 20.0,
}
#: No way exists, so it is worked on until the time is up.
STUCK = stuck("stuck", 60.0)


@pytest.fixture(scope="module")
def jobs(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """A service of its own, since these tests kill its workers."""
    data = tmp_path_factory.mktemp("jobs")
    settings = Settings(data_dir=data, workers=2, batch_limit=40, keep_alive=0.2, queue_limit=8)
    app = create_app(settings)
    with serving(app) as client:
        answer(client.post("/v1/robots", json=bench("stuck")), 201)
        yield Served(app, client, data)


@pytest.fixture
def client(jobs: Served) -> httpx.Client:
    return jobs.client


def submit(client: httpx.Client, body: Any, path: str = "/v1/plan", **headers: str) -> str:
    """Have a request answered later; gives the path of its job."""
    response = client.post(path, json=body, headers=ASYNC | headers)
    job = answer(response, 202)
    assert response.headers["location"] == f"/v1/jobs/{job['id']}"
    return response.headers["location"]


def ended(client: httpx.Client, job: str, seconds: float = 20.0) -> dict[str, Any]:
    """A job once it has ended."""
    done = {"succeeded", "failed", "cancelled"}
    assert wait_until(lambda: answer(client.get(job))["status"] in done, seconds)
    return answer(client.get(job))


def began(client: httpx.Client, job: str, stage: str | None = None) -> None:
    """Wait until a job runs, and perhaps has come to a stage."""

    def there() -> bool:
        found = answer(client.get(job))
        return found["status"] == "running" and stage in (None, found["stage"])

    assert wait_until(there, 10.0), answer(client.get(job))


def events(client: httpx.Client, job: str, last: str = "") -> list[dict[str, Any]]:
    """All events of a job until the stream ends."""
    headers = {"Last-Event-ID": last} if last else {}
    with client.stream("GET", f"{job}/events", headers=headers) as response:
        assert response.headers["content-type"].startswith("text/event-stream")
        text = "".join(response.iter_text())
    return parsed(text)


def parsed(text: str) -> list[dict[str, Any]]:
    found = []
    for block in text.split("\n\n"):
        lines = [line.split(": ", 1) for line in block.split("\n") if line and line[0] != ":"]
        if lines:
            fields = dict(lines)
            assert set(fields) == {"id", "event", "data"}
            found.append(
                {
                    "number": int(fields["id"]),
                    "event": fields["event"],
                    **json.loads(fields["data"]),
                }
            )
    return found


# ---------------------------------------------------------------------------- respond-async


def test_a_plan_as_a_job_is_the_same_plan(client: httpx.Client) -> None:
    at_once = answer(client.post("/v1/plan", json=PLAN))
    job = ended(client, submit(client, PLAN))
    assert (job["status"], job["progress"], job["error"]) == ("succeeded", 1.0, None)
    assert job["operation"] == "POST /v1/plan"
    for part in ("trajectory", "certificate", "reproducibility", "planner"):
        assert job["result"][part] == at_once[part]
    assert job["created"] <= job["started"] <= job["ended"] < job["expires"]


def test_every_computing_endpoint_can_answer_later(client: httpx.Client) -> None:
    cases: list[tuple[str, dict[str, Any], str]] = [
        ("/v1/robots/panda/fk", {"joints": HOME}, "links"),
        ("/v1/robots/panda/fk", {"joints": [HOME] * 100}, "links"),
        ("/v1/robots/panda/jacobian", {"joints": HOME}, "jacobian"),
        ("/v1/robots/panda/ik", {"pose": {"position": [0.4, 0.0, 0.4]}}, "solutions"),
        ("/v1/robots/panda/dynamics", {"joints": HOME}, "mass_matrix"),
        ("/v1/check", {"robot": "panda", "joints": HOME}, "valid"),
        ("/v1/retime", {"robot": "panda", "path": {"joints": [HOME, ASIDE]}}, "trajectory"),
    ]
    for path, body, field in cases:
        plain = answer(client.post(path, json=body))
        job = ended(client, submit(client, body, path))
        assert job["status"] == "succeeded", (path, job)
        assert job["result"].keys() == plain.keys()
        assert field in job["result"]


def test_what_is_not_json_is_told_as_text(client: httpx.Client) -> None:
    segment = {"t0": 0, "t1": 1, "coefficients": [[0, 1]]}
    motion = {"joint_names": ["a"], "segments": [segment]}
    body = {"trajectory": motion, "sample_period": 0.5, "format": "csv"}
    job = ended(client, submit(client, body, "/v1/convert"))
    assert job["result"] == client.post("/v1/convert", json=body).text


@pytest.mark.parametrize(
    ("value", "status"),
    [
        ("respond-async", 202),
        ("Respond-Async, wait=10", 202),
        ("return=minimal, respond-async; x=1", 202),
        ("respond-asynchronously", 200),
        ("wait=100", 200),
    ],
)
def test_the_preference_is_read_as_its_standard_has_it(
    client: httpx.Client, value: str, status: int
) -> None:
    body = {"joints": [0.1, 0.2]}
    response = client.post("/v1/robots/planar_rr/fk", json=body, headers={"Prefer": value})
    answer(response, status)
    assert response.headers.get("preference-applied") == (
        "respond-async" if status == 202 else None
    )
    assert client.get("/v1/robots/planar_rr", headers={"Prefer": value}).status_code == 200


def test_what_is_wrong_with_a_request_is_told_at_once(client: httpx.Client) -> None:
    def refused(body: Any, status: int, code: str) -> dict[str, Any]:
        return problem(client.post("/v1/plan", json=body, headers=ASYNC), status, code)

    refused({}, 422, "VALIDATION_ERROR")
    refused(PLAN | {"robot": "nobody"}, 404, "NOT_FOUND")
    refused(PLAN | {"scene": "nowhere"}, 404, "NOT_FOUND")
    refused(PLAN | {"timeout": 1e4}, 422, "VALIDATION_ERROR")
    text = json.dumps(PLAN).replace("-0.785", "NaN", 1)
    response = client.post(
        "/v1/plan", content=text, headers=ASYNC | {"Content-Type": "application/json"}
    )
    document = problem(response, 422, "VALIDATION_ERROR")
    assert document["details"]["errors"][0]["path"] == "start.joints[1]"


def test_a_job_that_finds_no_answer_has_failed(client: httpx.Client) -> None:
    inside = scene(POST | {"pose": {"position": [0.3, 0.0, 0.5]}})
    job = ended(client, submit(client, PLAN | {"scene": inside}))
    assert (job["status"], job["result"]) == ("failed", None)
    assert job["error"]["code"] == "START_STATE_IN_COLLISION"
    assert job["error"]["instance"] == "/v1/plan"
    assert job["error"]["details"]["pair"]
    late = ended(client, submit(client, STUCK | {"timeout": 0.3}))
    assert (late["status"], late["error"]["code"]) == ("failed", "TIMED_OUT")


def test_a_robot_can_be_stored_by_a_job(client: httpx.Client) -> None:
    job = ended(client, submit(client, bench("later"), "/v1/robots"))
    assert (job["status"], job["location"]) == ("succeeded", "/v1/robots/later")
    assert job["result"] == answer(client.get("/v1/robots/later"))
    problem(client.post("/v1/robots", json=bench("later"), headers=ASYNC), 409, "CONFLICT")
    stored = ended(client, submit(client, {"name": "s", **scene(FLOOR)}, "/v1/scenes"))
    assert stored["location"] == "/v1/scenes/s"
    response = client.put("/v1/scenes/s", json=scene(POST), headers=ASYNC)
    assert ended(client, response.headers["location"])["result"]["version"] == 2


def test_the_same_key_gives_the_same_job(client: httpx.Client) -> None:
    key = {"Idempotency-Key": "one job"}
    first = client.post("/v1/plan", json=EASY, headers=ASYNC | key)
    job = ended(client, first.headers["location"])
    again = client.post("/v1/plan", json=EASY, headers=ASYNC | key)
    assert (again.status_code, again.json()["id"]) == (202, job["id"])
    assert again.headers["location"] == first.headers["location"]
    assert again.headers["preference-applied"] == "respond-async"
    other = client.post("/v1/plan", json=EASY | {"seed": 2}, headers=ASYNC | key)
    problem(other, 422, "IDEMPOTENCY_KEY_REUSED")


@pytest.mark.parametrize("name", ["x", "..", "%00", "%2e%2e", "é", "0" * 32, "A" * 32, "1" * 999])
def test_jobs_that_are_not_there(client: httpx.Client, name: str) -> None:
    for method, path in (("GET", ""), ("DELETE", ""), ("GET", "/events")):
        response = client.request(method, f"/v1/jobs/{name}{path}")
        problem(response, response.status_code, response.json()["code"])
        assert response.status_code in (404, 405)


def test_jobs_are_listed_newest_first(client: httpx.Client) -> None:
    made = [ended(client, submit(client, EASY))["id"] for _ in range(3)]
    assert made == sorted(made)
    first = answer(client.get("/v1/jobs", params={"limit": 2}))
    assert [job["id"] for job in first["jobs"]] == [made[2], made[1]]
    assert "result" not in first["jobs"][0]
    second = answer(client.get("/v1/jobs", params={"limit": 1, "after": first["next"]}))
    assert second["jobs"][0]["id"] == made[0]
    failed = answer(client.get("/v1/jobs", params={"status": "failed"}))
    assert {job["status"] for job in failed["jobs"]} <= {"failed"}
    problem(client.get("/v1/jobs", params={"status": "odd"}), 422, "VALIDATION_ERROR")


# -------------------------------------------------------------------------------- in the way


def test_a_running_job_is_cancelled_within_a_second(jobs: Served) -> None:
    client = jobs.client
    job = submit(client, STUCK)
    began(client, job, "rrt_connect")
    start = time.monotonic()
    assert answer(client.delete(job))["status"] == "cancelled"
    assert wait_until(lambda: jobs.supervisor.busy == 0, 1.0)
    assert time.monotonic() - start < 1.0
    found = answer(client.get(job))
    assert (found["status"], found["result"], found["error"]) == ("cancelled", None, None)
    assert answer(client.delete(job))["status"] == "cancelled"  # once more changes nothing
    assert events(client, job)[-1]["status"] == "cancelled"


def test_a_queued_job_is_cancelled_at_once(jobs: Served) -> None:
    client = jobs.client
    running = [submit(client, STUCK) for _ in range(2)]
    for job in running:
        began(client, job)
    queued = submit(client, EASY)
    assert answer(client.get(queued))["status"] == "queued"
    pids = set(jobs.supervisor.pids)
    assert answer(client.delete(queued))["status"] == "cancelled"
    assert set(jobs.supervisor.pids) == pids, "no worker had it"
    for job in running:
        answer(client.delete(job))
    assert answer(client.get(queued))["started"] is None


def test_what_has_ended_cannot_be_cancelled(client: httpx.Client) -> None:
    job = submit(client, EASY)
    ended(client, job)
    document = problem(client.delete(job), 409, "CONFLICT")
    assert document["details"] == {"status_of_job": "succeeded"}
    assert answer(client.get(job))["status"] == "succeeded"


def test_a_killed_worker_fails_its_job_alone(jobs: Served) -> None:
    client, supervisor = jobs.client, jobs.supervisor
    job = submit(client, STUCK)
    began(client, job, "rrt_connect")
    (victim,) = supervisor.busy_pids
    os.kill(victim, signal.SIGKILL)
    failed = ended(client, job)
    assert failed["error"]["code"] == "CRASH"
    assert "SIGKILL" in failed["error"]["detail"]
    assert ended(client, submit(client, EASY))["status"] == "succeeded"


def test_what_was_deleted_meanwhile_is_missed(client: httpx.Client) -> None:
    answer(client.post("/v1/robots", json=bench("fleeting")), 201)
    blocking = [submit(client, STUCK) for _ in range(2)]
    for job in blocking:
        began(client, job)
    waiting = submit(client, STUCK | {"robot": "fleeting"})
    assert client.delete("/v1/robots/fleeting").status_code == 204
    for job in blocking:
        client.delete(job)
    assert ended(client, waiting)["error"]["code"] == "NOT_FOUND"


def test_who_waits_goes_before_jobs(jobs: Served) -> None:
    """Jobs hold all workers for a minute; a request is answered within a second all the same."""
    client, before = jobs.client, jobs.supervisor.counters.yielded
    stuck = [submit(client, STUCK) for _ in range(4)]
    for job in stuck[:2]:
        began(client, job, "rrt_connect")
    start = time.monotonic()
    answer(client.post("/v1/plan", json=EASY))
    assert time.monotonic() - start < 3.0
    assert jobs.supervisor.counters.yielded == before + 1
    states = [answer(client.get(job))["status"] for job in stuck]
    assert states == ["running", "running", "queued", "queued"]
    assert wait_until(lambda: jobs.supervisor.busy == 2, 5.0), "what gave way begins anew"
    for job in stuck:
        assert answer(client.delete(job))["status"] == "cancelled"


def test_fifty_jobs_at_once_are_all_answered(client: httpx.Client) -> None:
    body = {"joints": [[0.1, 0.2]] * 500}
    locations: list[str] = []
    kinds = [("/v1/robots/planar_rr/fk", body), ("/v1/plan", EASY)]

    def send(index: int) -> None:
        path, content = kinds[index % 2]
        locations.append(submit(client, content, path))

    threads = [threading.Thread(target=send, args=(index,)) for index in range(50)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(set(locations)) == 50
    for location in locations:
        assert ended(client, location, 60.0)["status"] == "succeeded"


# ------------------------------------------------------------------------------------ events


def test_events_tell_the_stages_in_order(client: httpx.Client) -> None:
    told = events(client, submit(client, PLAN))
    assert [event["number"] for event in told] == list(range(1, len(told) + 1))
    assert (told[0]["event"], told[0]["status"]) == ("status", "queued")
    assert (told[-1]["event"], told[-1]["status"], told[-1]["progress"]) == ("end", "succeeded", 1)
    shares = [event["progress"] for event in told]
    assert shares == sorted(shares)
    stages = [event["stage"] for event in told if event["event"] == "stage"]
    assert stages[0] == "preflight"
    assert stages.index("straight_line") < stages.index("timing") < stages.index("certificate")


def test_events_go_on_where_they_were_broken_off(client: httpx.Client) -> None:
    job = submit(client, PLAN)
    everything = events(client, job)
    assert events(client, job)[-1] == everything[-1], "after the end the end is told"
    last = everything[-1]["number"]
    assert events(client, job, str(last - 1)) == everything[-1:]
    assert events(client, job, "nonsense")[-1] == everything[-1]
    over = client.get(f"{job}/events", headers={"Last-Event-ID": str(last)})
    assert over.status_code == 204, "which tells a browser not to come back"
    running = submit(client, STUCK)
    began(client, running, "rrt_connect")
    with client.stream("GET", f"{running}/events") as response:
        first = parsed(next(text for text in response.iter_text() if text.strip()))
    answer(client.delete(running))
    rest = events(client, running, str(first[-1]["number"]))
    assert rest[-1]["event"] == "end"
    assert min(event["number"] for event in rest) > first[-1]["number"]


def test_silent_streams_are_kept_alive(client: httpx.Client) -> None:
    job = submit(client, STUCK)
    began(client, job, "rrt_connect")
    with client.stream("GET", f"{job}/events") as response:
        assert response.headers["cache-control"] == "no-store"
        seen = ""
        for text in response.iter_text():
            seen += text
            if seen.count(": keep-alive") >= 2:
                break
    answer(client.delete(job))


def test_a_failure_ends_the_events_with_its_problem(client: httpx.Client) -> None:
    job = submit(client, STUCK | {"timeout": 0.3})
    end = events(client, job)[-1]
    assert (end["event"], end["status"]) == ("end", "failed")
    assert end["error"] == answer(client.get(job))["error"]
    assert events(client, job)[-1] == end, "and when it is asked for later"


# ------------------------------------------------------------------------------------- batch


def batch(client: httpx.Client, body: Any, seconds: float = 60.0) -> dict[str, Any]:
    response = client.post("/v1/plan/batch", json=body)
    answer(response, 202)
    return ended(client, response.headers["location"], seconds)


def test_a_batch_answers_each_problem_in_order(client: httpx.Client) -> None:
    start = {"joints": [0.0, 0.0]}
    goals = [0.1 * (k + 1) for k in range(10)]
    problems: list[dict[str, Any]] = [{"goal": {"joints": [q, q]}} for q in goals]
    problems[2]["goal"] = {"joints": [99.0, 0.0]}
    problems[4]["planner"] = "straight_line"
    problems[5]["seed"] = 7
    problems[6]["timeout"] = 1e-6
    problems[7]["start"] = {"joints": [0.3, 0.3]}
    problems[8]["robot"] = "planar_rr"
    job = batch(client, {"robot": "planar_rr", "start": start, "timeout": 20, "problems": problems})
    assert (job["status"], job["progress"]) == ("succeeded", 1.0)
    assert job["stage"] == "10 of 10 problems"
    results = job["result"]["results"]
    assert (job["result"]["succeeded"], job["result"]["failed"]) == (8, 2)
    assert results[2]["code"] == "GOAL_STATE_INVALID"
    assert results[2]["instance"] == "/v1/plan/batch#/problems/2"
    assert results[6]["code"] == "TIMED_OUT"
    for index, (q, result) in enumerate(zip(goals, results, strict=True)):
        if index in (2, 6):
            continue
        assert result["status"] == "success"
        assert result["path"]["joints"][-1] == pytest.approx([q, q])
        assert result["certificate"]["verified"]
    assert results[7]["path"]["joints"][0] == [0.3, 0.3]
    assert results[5]["reproducibility"]["seed"] == 7


def test_a_batch_shares_its_scene(jobs: Served) -> None:
    client = jobs.client
    body = {k: v for k, v in PLAN.items() if k != "goal"}
    problems = [
        {"goal": {"joints": ASIDE}},
        {"goal": {"joints": ASIDE}, "scene": scene()},
        {"goal": {"joints": HOME}, "start": {"joints": ASIDE}},
    ]
    results = batch(client, body | {"problems": problems})["result"]["results"]
    single = answer(client.post("/v1/plan", json=PLAN))
    assert results[0]["trajectory"] == single["trajectory"]
    assert results[0]["reproducibility"]["scene_hash"] == single["reproducibility"]["scene_hash"]
    assert results[1]["planner"] == "straight_line"
    assert results[2]["path"]["joints"][-1] == pytest.approx(HOME)
    prepared = jobs.data / "prepared"
    assert wait_until(lambda: not list(prepared.glob("*.scene.part")), 1.0)
    bad = {"scene": scene(POST | {"shape": {"type": "mesh", "stl_base64": "bm8gc3Rs"}})}
    job = batch(client, body | bad | {"problems": problems})
    assert (job["status"], job["error"]["code"]) == ("failed", "INVALID_SCENE")


def test_a_crash_in_a_batch_costs_one_problem(jobs: Served) -> None:
    client, supervisor = jobs.client, jobs.supervisor
    easy = {k: v for k, v in EASY.items() if k != "robot"}
    stuck = {k: v for k, v in STUCK.items() if k != "robot"} | {"robot": "stuck"}
    body = {"robot": "planar_rr", "problems": [easy, stuck, *[easy] * 6]}
    response = client.post("/v1/plan/batch", json=body)
    job = response.headers["location"]
    assert wait_until(lambda: "7 of 8" in (answer(client.get(job))["stage"] or ""), 20.0)
    (victim,) = supervisor.busy_pids
    os.kill(victim, signal.SIGKILL)
    found = ended(client, job)
    results = found["result"]["results"]
    assert (found["status"], found["result"]["failed"]) == ("succeeded", 1)
    assert (results[1]["code"], results[1]["status"]) == ("CRASH", 500)
    assert all(result["status"] == "success" for result in (results[0], *results[2:]))


def test_a_batch_is_cancelled_as_a_whole(jobs: Served) -> None:
    client = jobs.client
    body = {"problems": [STUCK] * 5}
    job = client.post("/v1/plan/batch", json=body).headers["location"]
    began(client, job)
    assert wait_until(lambda: jobs.supervisor.busy == 2, 5.0), "it uses all workers"
    answer(client.delete(job))
    assert wait_until(lambda: jobs.supervisor.busy == 0, 1.0)
    assert jobs.supervisor.background_waiting == 0


def test_batches_that_are_refused(client: httpx.Client) -> None:
    def refused(body: Any, status: int, code: str) -> str:
        detail: str = problem(client.post("/v1/plan/batch", json=body), status, code)["detail"]
        return detail

    assert "problems" in refused({"robot": "panda"}, 422, "VALIDATION_ERROR")
    refused({"robot": "panda", "problems": []}, 422, "VALIDATION_ERROR")
    refused({"problems": [EASY | {"extra": 1}]}, 422, "VALIDATION_ERROR")
    lacking = {"robot": "panda", "problems": [{"goal": {"joints": HOME}}]}
    assert "problems[0] has no start" in refused(lacking, 422, "VALIDATION_ERROR")
    refused({"problems": [EASY] * 41}, 413, "PAYLOAD_TOO_LARGE")
    refused({"problems": [EASY, EASY | {"robot": "nobody"}]}, 404, "NOT_FOUND")
    refused({"problems": [EASY | {"scene": "nowhere"}]}, 404, "NOT_FOUND")
    refused({"problems": [EASY | {"timeout": 1e4}]}, 422, "VALIDATION_ERROR")
    text = json.dumps({"problems": [EASY]}).replace("[0.5, 0.5]", "[0.5, NaN]")
    response = client.post(
        "/v1/plan/batch", content=text, headers={"Content-Type": "application/json"}
    )
    problem(response, 422, "VALIDATION_ERROR")


# ------------------------------------------------------------------------------------ limits


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


def test_so_many_answers_are_kept(jobs: Served) -> None:
    client = jobs.client
    with limits(jobs, job_count=2):
        done = []
        for _ in range(3):
            done.append(submit(client, EASY))
            ended(client, done[-1])
        assert wait_until(lambda: client.get(done[0]).status_code == 404, 2.0)
        assert len(answer(client.get("/v1/jobs"))["jobs"]) == 2


def test_a_job_must_end_in_time(jobs: Served) -> None:
    client = jobs.client
    with limits(jobs, job_deadline=1.0):
        body = {"problems": [EASY, STUCK, STUCK, EASY]}
        results = batch(client, body)["result"]["results"]
        assert [result.get("code") for result in results] == [None, *["TIMED_OUT"] * 3]
        alone = ended(client, submit(client, STUCK))
        assert (alone["status"], alone["error"]["code"]) == ("failed", "TIMED_OUT")


# ---------------------------------------------------------------------------------- restarts


@contextmanager
def started(data: Path) -> Iterator[tuple[subprocess.Popen[str], httpx.Client]]:
    """The service as people start it, a process of its own."""
    command = [sys.executable, "-m", "service.cli", "serve", "--port", "0", "--workers", "1"]
    with subprocess.Popen(
        [*command, "--data-dir", str(data), "--log-level", "error"],
        stdout=subprocess.PIPE,
        cwd=Path(__file__).parents[3],
        text=True,
    ) as process:
        try:
            assert process.stdout is not None
            url = process.stdout.readline().split()[-1]
            with httpx.Client(base_url=url, timeout=20.0) as client:
                assert wait_until(lambda: client.get("/readyz").status_code == 200, 90.0)
                yield process, client
        finally:
            process.kill()


def test_jobs_outlive_the_service(tmp_path: Path) -> None:
    with started(tmp_path) as (process, client):
        answer(client.post("/v1/robots", json=bench("stuck")), 201)
        key = {"Idempotency-Key": "before"}
        done = submit(client, EASY, **key)
        kept = ended(client, done)
        lost, queued = submit(client, STUCK), submit(client, STUCK)
        began(client, lost, "rrt_connect")
        process.kill()
        process.wait()
    with started(tmp_path) as (process, client):
        assert answer(client.get(done)) == kept
        assert submit(client, EASY, **key) == done, "the same key gives the same job as before"
        failed = ended(client, lost)
        assert (failed["status"], failed["error"]["code"]) == ("failed", "CRASH")
        assert "again" in failed["error"]["hint"]
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


# ----------------------------------------------------------------------------------- metrics


def test_metrics_count_by_what_is_ours(client: httpx.Client) -> None:
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
