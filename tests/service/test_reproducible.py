"""The same request is answered alike, however busy the workers are and whichever takes it."""

import json
import re
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any, NamedTuple

import httpx
import pytest

from tests.service.repeatable_requests import PATIENT, Request

#: Enough that each worker answers several times with the other one busy.
_REPEATS = 8
#: Clients at a time, for two workers.
_CLIENTS = 4
#: Times, which no two answers share, and names of jobs.
_TIMES = {"milliseconds", "computed_milliseconds"}
_OF_A_JOB = {"id", "created", "started", "ended", "expires"}
_TIME = re.compile(r"\d+(\.\d+)? m?s\b")


class Told(NamedTuple):
    """One answer.

    Attributes:
        text: All of it but its times, in one order.
        code: SUCCESS, or that of the problem.
        flagged: Whether it says that time ended a search.
    """

    text: str
    code: str
    flagged: bool


def without_times(value: Any) -> Any:
    """An answer, or a part of it, without its times."""
    if isinstance(value, dict):
        left_out = _TIMES | (_OF_A_JOB if "expires" in value else set())
        return {name: without_times(part) for name, part in value.items() if name not in left_out}
    if isinstance(value, list):
        return [without_times(part) for part in value]
    return _TIME.sub("some time", value) if isinstance(value, str) else value


def flags(value: Any) -> Iterator[bool]:
    """Values of ``deterministic`` in an answer: false where time ended a search."""
    parts = value if isinstance(value, list) else []
    if isinstance(value, dict):
        if "deterministic" in value:
            yield bool(value["deterministic"])
        parts = list(value.values())
    for part in parts:
        yield from flags(part)


def ask(client: httpx.Client, request: Request) -> Told:
    """Ask once, and wait for the job where it is one."""
    path, body = request
    answer = client.post(path, json=body)
    while answer.status_code == 429:
        time.sleep(float(answer.headers["retry-after"]))
        answer = client.post(path, json=body)
    content = answer.json()
    if answer.status_code == 202:
        job = answer.headers["location"]
        while (content := client.get(job).json())["status"] in ("queued", "running"):
            time.sleep(0.05)
    problem = content.get("error") or content
    code = problem.get("code") or "SUCCESS"
    flagged = code == "TIMED_OUT" or not all(flags(content))
    return Told(json.dumps(without_times(content), sort_keys=True), code, flagged)


@pytest.mark.parametrize("kind", PATIENT)
def test_answers_under_load_are_one(client: httpx.Client, kind: str) -> None:
    with ThreadPoolExecutor(_CLIENTS) as pool:
        answers = set(pool.map(partial(ask, client), [PATIENT[kind]] * _REPEATS))
    assert len(answers) == 1
    (told,) = answers
    assert told.code == "SUCCESS"
    assert not told.flagged
