"""Events of jobs: order, resumption, silence and failure."""

import httpx

from tests.service.jobs.requests import PLAN, STUCK, began, events, parsed, submit
from tests.service.robots import (
    answer,
)


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
