"""Requests about jobs, as tests send them."""

import json
from typing import Any

import httpx

from tests.service.processes import wait_until
from tests.service.robots import (
    DETOUR,
    answer,
    stuck,
)

ASYNC = {"Prefer": "respond-async"}


PLAN = DETOUR


#: Nothing is in the way, so it takes milliseconds.
EASY: dict[str, Any] = {
    "robot": "planar_rr",
    "start": {"joints": [0.0, 0.0]},
    "goal": {"joints": [0.5, 0.5]},
    "timeout": 60.0,
}


#: No way exists, so it is worked on until the time is up.
STUCK = stuck("stuck", 60.0)


def submit(client: httpx.Client, body: Any, path: str = "/v1/plan", **headers: str) -> str:
    """Have a request answered later; gives the path of its job."""
    response = client.post(path, json=body, headers=ASYNC | headers)
    job = answer(response, 202)
    assert response.headers["location"] == f"/v1/jobs/{job['id']}"
    return response.headers["location"]


def ended(client: httpx.Client, job: str, seconds: float = 60.0) -> dict[str, Any]:
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


def batch(client: httpx.Client, body: Any, seconds: float = 60.0) -> dict[str, Any]:
    response = client.post("/v1/plan/batch", json=body)
    answer(response, 202)
    return ended(client, response.headers["location"], seconds)
