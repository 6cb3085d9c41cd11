"""Logs: JSON with ids, and no floods."""

import json
import logging
import time
from pathlib import Path

import httpx
import pytest

from service import logs
from tests.service.commands import serve


def record(message: str, at: float = 0.0, level: int = logging.INFO) -> logging.LogRecord:
    made = logging.LogRecord("service.x", level, "file", 1, message, None, None)
    made.created = at
    return made


def test_a_line_is_one_json_object_with_the_ids_that_are_known() -> None:
    token = logs.request_id.set("abc")
    try:
        line = logs.JsonFormatter().format(record('two\nlines "quoted"'))
    finally:
        logs.request_id.reset(token)
    assert "\n" not in line
    fields = json.loads(line)
    assert fields["message"] == 'two\nlines "quoted"'
    assert (fields["request"], fields["level"]) == ("abc", "info")
    assert "job" not in fields


def test_a_flood_is_cut_and_counted() -> None:
    gate = logs.FloodGate(limit=3, period=10.0)
    passed = [gate.filter(record("fault", at=0.01 * i)) for i in range(100)]
    assert passed == [True] * 3 + [False] * 97
    assert gate.filter(record("another", at=1.0))
    later = record("fault", at=11.0)
    assert gate.filter(later)
    assert later.getMessage() == "fault (97 more of these were not written)"
    assert gate.filter(record("fault", at=11.1, level=logging.CRITICAL))


@pytest.mark.parametrize("proposed", [None, "", "a b", "x\r\ny", "é", "y" * 65])
def test_ids_that_could_do_harm_are_replaced(proposed: str | None) -> None:
    assert logs.new_request_id(proposed) != proposed
    assert logs.new_request_id("trace-1.a_B") == "trace-1.a_B"


def test_answers_carry_the_id_of_their_request(client: httpx.Client) -> None:
    answer = client.get("/v1/robots/none", headers={"X-Request-Id": "mine-7"})
    assert answer.headers["x-request-id"] == "mine-7"
    first, second = (client.get("/healthz").headers["x-request-id"] for _ in range(2))
    assert first != second


def test_a_server_logs_json(tmp_path: Path) -> None:
    settings = {
        "ARMWRIGHT_WORKERS": "1",
        "ARMWRIGHT_LOG_FORMAT": "json",
        "ARMWRIGHT_LOG_REQUESTS": "true",
    }
    with serve(tmp_path, warm=False, environment=settings) as (process, client):
        client.get("/v1/robots/none", headers={"X-Request-Id": "mine-8"})
        time.sleep(0.1)
        process.terminate()
        assert process.stderr is not None
        lines = [json.loads(line) for line in process.stderr.read().splitlines()]
    (mine,) = [line for line in lines if line.get("request") == "mine-8"]
    assert (mine["method"], mine["route"], mine["status"]) == ("GET", "/v1/robots/{name}", 404)
    assert mine["milliseconds"] > 0.0
