"""Batches over HTTP, their parts and their answers."""

import json
import signal
from typing import Any

import httpx
import pytest
from hypothesis import given
from hypothesis import strategies as st

from service.jobs.batch import Parts, joined_answer
from service.storage.stores.job_store import ChunkAnswer
from service.workers.result import BatchItem
from tests.service.conftest import Served
from tests.service.jobs.requests import (
    EASY,
    PLAN,
    STUCK,
    batch,
    began,
    ended,
)
from tests.service.processes import kill_in_work, wait_until
from tests.service.robots import (
    ASIDE,
    HOME,
    POST,
    answer,
    problem,
    scene,
)


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
