"""Jobs as answers: times, results and errors of any type; requests that are answered again."""

import asyncio
import json
from typing import Any

import pytest

from armwright_wire.plans.job import JobAnswer as Schema
from service.http.state import JOB_CONTEXT, JobContext
from service.jobs.answer import job_document, job_summary
from service.jobs.replay import Replayed, replay
from service.storage.stores.job_store import JobAnswer, Status, StoredRequest
from tests.service.jobs.stored import record

PROBLEM = {
    "type": "/v1/problems/CRASH", "title": "t", "status": 500, "detail": "d", "instance": "/x",
    "code": "CRASH", "stage": None, "hint": None, "details": {},
}  # fmt: skip


def document(
    status: Status, answer: JobAnswer | None, lifetime: float = 60.0, **changes: Any
) -> dict[str, Any]:
    content = job_document(record(status=status, **changes), answer, lifetime)
    parsed: dict[str, Any] = json.loads(content)
    Schema.model_validate(parsed)
    return parsed


def answer_of(value: object, content_type: str = "application/json") -> JobAnswer:
    return JobAnswer(content_type, json.dumps(value).encode())


def test_times_are_told_in_utc() -> None:
    summary = job_summary(record(created=0.0, started=1.5, ended=3600.0), 60.0).model_dump()
    assert summary["created"] == "1970-01-01T00:00:00+00:00"
    assert summary["started"] == "1970-01-01T00:00:01.500000+00:00"
    assert summary["ended"] == "1970-01-01T01:00:00+00:00"
    assert summary["expires"] == "1970-01-01T01:01:00+00:00"


def test_a_job_that_has_not_ended_does_not_expire() -> None:
    assert job_summary(record(), 60.0).expires is None
    assert job_summary(record(ended=10.0)).expires is None


def test_a_result_is_there_once_the_job_has_succeeded() -> None:
    result = {"a": [1, 2.5, None]}
    assert document("succeeded", answer_of(result))["result"] == result
    assert document("succeeded", answer_of(result))["error"] is None
    for status in ("queued", "running", "cancelled"):
        found = document(status, answer_of(result))
        assert (found["result"], found["error"]) == (None, None)
    assert document("succeeded", None)["result"] is None


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
