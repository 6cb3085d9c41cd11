"""The answer to a batch, joined of those to its chunks."""

import json
from typing import Any

from service.jobs.batch import joined_answer
from service.storage.stores.queue_store import ChunkAnswer


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
