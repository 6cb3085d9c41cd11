"""A stored request reaches the application as one that just came."""

import asyncio
from typing import Any

from service.http.state import JOB_CONTEXT, JobContext
from service.jobs.replay import Replayed, replay
from service.storage.stores.job_store import StoredRequest

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
