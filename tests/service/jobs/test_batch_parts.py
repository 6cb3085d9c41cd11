"""Parts of a batch, and its answer: every problem once, joined in order."""

import json
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from service.jobs.batch import Parts, joined_answer
from service.storage.stores.queue_store import ChunkAnswer
from service.workers.result import BatchItem


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
