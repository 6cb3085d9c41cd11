"""Jobs and batches over HTTP: accepted, watched, cancelled, lost, found again, answered."""

import asyncio
import json
import signal
import time
from typing import Any

import httpx
import pytest
from hypothesis import given
from hypothesis import strategies as st

from armwright_wire.plans.job import JobAnswer as Schema
from armwright_wire.plans.task import TaskRequest
from service.http.state import JOB_CONTEXT, JobContext
from service.jobs.answer import job_document, job_summary
from service.jobs.batch import Parts, joined_answer
from service.jobs.replay import Replayed, replay
from service.storage.stores.job_store import ChunkAnswer, JobAnswer, Status, StoredRequest
from service.workers.result import BatchItem
from tests.service.conftest import Served
from tests.service.jobs.requests import (
    ASYNC,
    EASY,
    PLAN,
    STUCK,
    batch,
    began,
    ended,
    events,
    parsed,
    submit,
)
from tests.service.jobs.stored import record
from tests.service.processes import kill_in_work, wait_until
from tests.service.robots import (
    ASIDE,
    FLOOR,
    HOME,
    POST,
    answer,
    bench,
    problem,
    scene,
)
from tests.times import quickest


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
        assert job["result"].keys() - {"plan_id"} == plain.keys()
        assert field in job["result"]


def test_what_is_wrong_with_a_request_is_told_at_once(client: httpx.Client) -> None:
    def refused(body: Any, status: int, code: str) -> dict[str, Any]:
        return problem(client.post("/v1/plan", json=body, headers=ASYNC), status, code)

    refused({}, 422, "VALIDATION_ERROR")
    refused(PLAN | {"robot": "nobody"}, 404, "NOT_FOUND")
    refused(PLAN | {"scene": "nowhere"}, 404, "NOT_FOUND")
    refused(PLAN | {"timeout": 1e4}, 422, "VALIDATION_ERROR")


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


@pytest.mark.parametrize(
    "name", ["x", "..", "%00", "%2e%2e", "é", "0" * 31, "0" * 32, "0" * 33, "G" * 32, "1" * 999]
)
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


def test_a_running_job_is_cancelled_within_a_second(jobs: Served) -> None:
    client = jobs.client
    made: list[str] = []

    def attempt() -> float:
        made.append(submit(client, STUCK))
        began(client, made[-1], "rrt_connect")
        start = time.monotonic()
        assert answer(client.delete(made[-1]))["status"] == "cancelled"
        assert wait_until(lambda: jobs.supervisor.busy == 0, 10.0)
        return time.monotonic() - start

    assert quickest(attempt, 1.0) < 1.0
    job = made[-1]
    found = answer(client.get(job))
    assert (found["status"], found["result"], found["error"]) == ("cancelled", None, None)
    assert answer(client.delete(job))["status"] == "cancelled"  # once more changes nothing
    assert events(client, job)[-1]["status"] == "cancelled"


def test_what_has_ended_cannot_be_cancelled(client: httpx.Client) -> None:
    job = submit(client, EASY)
    ended(client, job)
    document = problem(client.delete(job), 409, "CONFLICT")
    assert document["details"] == {"status_of_job": "succeeded"}
    assert answer(client.get(job))["status"] == "succeeded"


def test_a_killed_worker_costs_one_of_two_attempts_of_its_job(jobs: Served) -> None:
    client, supervisor = jobs.client, jobs.supervisor
    job = submit(client, STUCK)
    kill_in_work(supervisor, signal.SIGKILL, signal.SIGSEGV)  # the second attempt in another one
    failed = ended(client, job)
    assert failed["error"]["code"] == "CRASH"
    causes = failed["error"]["details"]["causes"]
    assert len(causes) == 2
    for cause in causes:
        assert cause in failed["error"]["detail"]
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
    asked: list[float] = []

    def attempt() -> float:
        asked.append(time.monotonic())
        answer(client.post("/v1/plan", json=EASY))
        return time.monotonic() - asked[-1]

    assert quickest(attempt, 1.0) < 1.0
    yielded = jobs.supervisor.counters.yielded - before
    assert yielded <= len(asked), "the spare worker may have done it"
    states = [answer(client.get(job))["status"] for job in stuck]
    assert states == ["running", "running", "queued", "queued"]
    assert wait_until(lambda: jobs.supervisor.busy == 2, 20.0), "what gave way begins anew"
    for job in stuck:
        assert answer(client.delete(job))["status"] == "cancelled"


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


def test_a_failure_ends_the_events_with_its_problem(client: httpx.Client) -> None:
    job = submit(client, STUCK | {"timeout": 0.3})
    end = events(client, job)[-1]
    assert (end["event"], end["status"]) == ("end", "failed")
    assert end["error"] == answer(client.get(job))["error"]
    assert events(client, job)[-1] == end, "and when it is asked for later"


_TASK: Any = TaskRequest.model_json_schema()["examples"][0]
_HOME = _TASK["start"]
_GOALS = [
    {"id": f"g{k}", "joints": [0.2 * (k + 1), *_HOME["joints"][1:]]} for k in range(3)
]  # fmt: skip
_POSES = [
    {"position": [0.3 + 0.02 * k, 0.1, 0.4], "quaternion_xyzw": [1.0, 0.0, 0.0, 0.0]}
    for k in range(20)
]


@pytest.mark.parametrize(
    ("path", "body", "stages"),
    [
        ("/v1/tasks", _TASK | {"stages": _TASK["stages"][:6], "improve": 0.0, "timeout": 30.0},
         ["stage 4 (attach)", "stage 0 (move)"]),
        ("/v1/tours", {"robot": "panda", "start": _HOME, "goals": _GOALS, "rounds": 0,
                       "timeout": 30.0}, ["configurations", "prove"]),
        ("/v1/robots/panda/reach", {"poses": _POSES}, ["reach"]),
    ],
)  # fmt: skip
def test_stages_are_told_in_order_with_shares_that_rise(
    client: httpx.Client, path: str, body: Any, stages: list[str]
) -> None:
    told = events(client, submit(client, body, path))
    assert [event["number"] for event in told] == list(range(1, len(told) + 1))
    assert told[0]["status"] == "queued"
    last = told[-1]
    assert (last["event"], last["status"], last["progress"]) == ("end", "succeeded", 1)
    shares = [event["progress"] for event in told]
    assert shares == sorted(shares)
    named = [event["stage"] for event in told if event["event"] == "stage"]
    places = [named.index(stage) for stage in stages]
    assert places == sorted(places)


def document(
    status: Status, answer: JobAnswer | None, lifetime: float = 60.0, **changes: Any
) -> dict[str, Any]:
    content = job_document(record(status=status, **changes), answer, lifetime)
    parsed: dict[str, Any] = json.loads(content)
    Schema.model_validate(parsed)
    return parsed


def test_times_are_told_in_utc() -> None:
    summary = job_summary(record(created=0.0, started=1.5, ended=3600.0), 60.0).model_dump()
    assert summary["created"] == "1970-01-01T00:00:00+00:00"
    assert summary["started"] == "1970-01-01T00:00:01.500000+00:00"
    assert summary["ended"] == "1970-01-01T01:00:00+00:00"
    assert summary["expires"] == "1970-01-01T01:01:00+00:00"


@pytest.mark.parametrize(
    ("answer", "result"),
    [
        (JobAnswer("application/json; charset=utf-8", b"[1]"), [1]),
        (JobAnswer("application/geo+json", b"[1]"), [1]),
        (JobAnswer("application/json", b""), None),
        (JobAnswer("text/csv", b"time,a\n0,1\n"), "time,a\n0,1\n"),
        (JobAnswer("text/csv", b'a"b\\\n'), 'a"b\\\n'),
        (JobAnswer("image/svg+xml", b"<svg/>"), "<svg/>"),
        (JobAnswer("application/octet-stream", b"\xff"), "/w=="),
    ],
)
def test_a_result_that_is_no_json_is_text_or_base64(answer: JobAnswer, result: object) -> None:
    assert document("succeeded", answer)["result"] == result


CONTEXT = JobContext("id", 1.0, lambda: None, lambda share, stage: None)
REQUEST = StoredRequest("POST", "/v1/plan", "application/json; charset=utf-8", b'{"a": 1}')


def run(app: Any) -> Replayed:
    return asyncio.run(replay(app, REQUEST, CONTEXT))


def test_the_request_arrives_whole_and_nobody_leaves() -> None:
    seen: dict[str, Any] = {}

    async def app(scope: Any, receive: Any, send: Any) -> None:
        seen.update(scope)
        seen["message"] = await receive()
        waiting = asyncio.ensure_future(receive())
        await asyncio.sleep(0.01)
        seen["left"] = waiting.done()
        waiting.cancel()
        headers = [(b"content-type", b"application/json"), (b"location", b"/v1/robots/x")]
        await send({"type": "http.response.start", "status": 201, "headers": headers})
        await send({"type": "http.response.body", "body": b'{"b":', "more_body": True})
        await send({"type": "http.response.body", "body": b"2}"})

    replayed = run(app)
    assert (seen["method"], seen["path"]) == ("POST", "/v1/plan")
    assert dict(seen["headers"])[b"content-type"] == REQUEST.content_type.encode()
    assert dict(seen["headers"])[b"content-length"] == b"8"
    assert seen["message"] == {"type": "http.request", "body": REQUEST.body, "more_body": False}
    assert seen["left"] is False
    assert seen[JOB_CONTEXT] is CONTEXT
    assert replayed.status == 201
    assert replayed.headers["location"] == "/v1/robots/x"
    assert (replayed.answer.content_type, replayed.answer.content) == (
        "application/json",
        b'{"b":2}',
    )


def test_an_application_that_answers_nothing_has_failed() -> None:
    async def app(scope: Any, receive: Any, send: Any) -> None:
        pass

    replayed = run(app)
    assert replayed.status == 500
    assert replayed.answer.content_type == "application/octet-stream"


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
    assert wait_until(lambda: not list(prepared.glob("*.scene.part")), 20.0)
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
    assert wait_until(lambda: "7 of 8" in (answer(client.get(job))["stage"] or ""), 60.0)
    # The first death may have had another cause, so the problem is tried once more.
    kill_in_work(supervisor, signal.SIGKILL, signal.SIGKILL)
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
    assert wait_until(lambda: jobs.supervisor.busy == 2, 20.0), "it uses all workers"
    answer(client.delete(job))
    assert wait_until(lambda: jobs.supervisor.busy == 0, 20.0)
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


def items(kinds: list[int]) -> list[BatchItem]:
    """Problems with the robots of some numbers."""
    return [BatchItem(f"robot{n}", None, False, 1.0, b"[%d]" % i) for i, n in enumerate(kinds)]


@given(
    kinds=st.lists(st.integers(0, 1), max_size=300),
    workers=st.integers(1, 4),
    planned=st.lists(st.integers(1, 70), min_size=1, max_size=20),
)
def test_every_problem_is_planned_once_however_far_workers_come(
    kinds: list[int], workers: int, planned: list[int]
) -> None:
    parts, done, turn = Parts(items(kinds)), list[int](), 0
    while part := parts.take(workers):
        assert len({kinds[index] for index in part.indices}) == 1
        assert list(part.indices) == list(range(part.indices[0], part.indices[-1] + 1))
        left = len(kinds) - len(done)
        assert len(part.indices) <= max(1, -(-left // (2 * workers)))
        count = planned[turn % len(planned)]
        turn += 1
        done += part.indices[:count]
        parts.put_back(part.indices[count:])
    assert done == list(range(len(kinds)))


def test_a_part_is_what_a_worker_plans_in_its_turn_and_half_as_much() -> None:
    for mean, size in ((0.004, 15), (0.0004, 64), (0.02, 3), (0.06, 1), (60.0, 1), (0.0, 64)):
        part = Parts(items([0] * 1000)).take(1, mean)
        assert part is not None
        assert len(part.indices) == size


def test_problems_that_are_put_back_alone_stay_alone() -> None:
    parts = Parts(items([0] * 20))
    part = parts.take(1)
    assert part is not None
    assert list(part.indices) == list(range(10))
    parts.put_back(part.indices, alone=True)
    taken = [parts.take(1) for _ in range(11)]
    assert [list(part.indices) for part in taken if part][:10] == [[n] for n in range(10)]
    last = taken[-1]
    assert last is not None
    assert list(last.indices) == list(range(10, 15))


def test_a_part_is_a_batch_of_its_own_and_not_larger_than_is_sent_at_once() -> None:
    small = [BatchItem("panda", None, False, None, b'{"seed":%d}' % n) for n in range(8)]
    part = Parts(small).take(1)
    assert part is not None
    request = b'{"robot":"panda","problems":[{"seed":0},{"seed":1},{"seed":2},{"seed":3}]}'
    assert part.request(b'"robot":"panda",') == request
    large = [BatchItem("panda", None, False, None, b"x" * 100_000) for _ in range(8)]
    part = Parts(large).take(1)
    assert part is not None
    assert list(part.indices) == [0, 1]
    huge = [BatchItem("panda", None, False, None, b"x" * 1_000_000) for _ in range(8)]
    part = Parts(huge).take(1)
    assert part is not None
    assert list(part.indices) == [0]
    assert Parts(()).take(1) is None


def answered(first: int, results: list[Any], failed: int = 0) -> ChunkAnswer:
    counts = {"succeeded": len(results) - failed, "failed": failed}
    text = json.dumps({"results": results} | counts, separators=(",", ":"))
    return ChunkAnswer(first, len(results), True, text.encode())


def test_results_go_in_as_they_are_and_in_order() -> None:
    # A result may itself end like an answer.
    nested = {"results": [1], "succeeded": 7, "failed": 9}
    chunks = [answered(0, [{"a": 1}, nested], 1), answered(2, [[nested]]), answered(3, ["x"], 1)]
    answer = joined_answer(chunks)
    assert answer.content_type == "application/json"
    assert answer.content == answered(0, [{"a": 1}, nested, [nested], "x"], 2).content


def test_a_chunk_that_failed_fails_for_each_of_its_problems() -> None:
    problem = {"code": "CRASH", "status": 500, "instance": "/v1/plan/batch"}
    chunks = [answered(0, ["x"]), ChunkAnswer(1, 2, False, json.dumps(problem).encode())]
    body = json.loads(joined_answer(chunks).content)
    assert (body["succeeded"], body["failed"]) == (1, 2)
    assert body["results"][1:] == [
        problem | {"instance": "/v1/plan/batch#/problems/1"},
        problem | {"instance": "/v1/plan/batch#/problems/2"},
    ]
