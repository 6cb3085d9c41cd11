"""Glances: what is malformed is refused as if the server had validated it before all else."""

import json
from typing import Any

import httpx
import pytest
from fastapi import FastAPI, Request
from pydantic import BaseModel, ValidationError

from armwright_wire.plan import PlanRequest
from service.http.glance import glance_at
from service.http.job_context import DRY_RUN
from service.storage.cache_key import builtin_reference
from service.tasks.plan import plan
from service.tasks.result import TaskProblem
from service.validation import validate_as
from tests.service.robots import ASIDE, HOME, problem
from tests.service.schemas.bodies import FULL
from tests.service.schemas.changes import changed, refusals, values, without

BODY: dict[str, Any] = {"robot": "panda", "start": {"joints": HOME}, "goal": {"joints": ASIDE}}
PLANS = [body for model, body in FULL if model is PlanRequest]
WRONG: tuple[Any, ...] = (
    None, True, 7, -1.5, 1e300, "1", "text", [], ["text"], [1.0], {}, {"0": 1.0}, {"type": 1},
)  # fmt: skip


def malformed_plans() -> list[dict[str, Any]]:
    """Plans in which one value after the other is something else, or missing."""
    assert PLANS
    bodies = [
        changed(body, path, wrong) for body in PLANS for path, _ in values(body) for wrong in WRONG
    ]
    return bodies + [
        without(body, path)
        for body in PLANS
        for path, _ in values(body)
        if isinstance(path[-1], str)
    ]


def test_a_worker_refuses_the_bodies_that_the_server_refuses() -> None:
    """It reads JSON, the server parsed values: pydantic is stricter with the latter."""
    counts = [0, 0]
    for body in malformed_plans():
        refused = bool(refusals(PlanRequest, body))
        try:
            read: BaseModel | None = PlanRequest.model_validate_json(json.dumps(body))
        except ValidationError:
            read = None
        assert (read is None) == refused, body
        assert read is None or read == validate_as(PlanRequest, body)
        counts[refused] += 1
    assert min(counts) > 100


def test_a_task_says_that_its_request_is_malformed() -> None:
    found = plan(builtin_reference("panda"), None, json.dumps(BODY | {"seed": -1}).encode())
    assert isinstance(found, TaskProblem)
    assert (found.code, found.details) == ("VALIDATION_ERROR", {"stage": "request"})
    assert "seed" in found.message


@pytest.mark.parametrize(
    "change",
    [
        {"speed": 1},
        {"speed": 1, "robot": "nobody"},
        {"seed": -1, "scene": "nowhere"},
        {"seed": -1, "timeout": 1e4},
        {"seed": -1, "timeout": 1e-3},
        {"start": {"joints": []}, "goal": {}},
        {"start": {"state": "nowhere"}, "speed": 1},
        {"scene": {"obstacles": [{"id": "a"}]}},
        {"robot": "a/b"},
        {"robot": "panda\n"},
        {"robot": None},
        {"scene": 7},
        {"timeout": True},
        {"timeout": "1"},
        {"keep": 1},
    ],
)
def test_malformed_requests_are_refused_as_before(
    client: httpx.Client, change: dict[str, Any]
) -> None:
    body = BODY | change
    # A job is validated by the server before anybody works on it.
    header = {"Prefer": "respond-async"}
    expected = problem(client.post("/v1/plan", json=body, headers=header), 422, "VALIDATION_ERROR")
    before = client.get("/metrics").text
    found = problem(client.post("/v1/plan", json=body), 422, "VALIDATION_ERROR")
    assert found == expected
    assert found["details"]["errors"]
    after = client.get("/metrics").text
    assert plans_counted(after) == plans_counted(before), "it is no plan that failed"


def plans_counted(text: str) -> list[str]:
    return [line for line in text.splitlines() if line.startswith("armwright_plans_total")]


class _Supervisor:
    def __init__(self, *, is_ready: bool) -> None:
        self.is_ready_for_work = is_ready


def glanced(value: Any, *, is_ready: bool = True, **scope: Any) -> Any:
    app = FastAPI()
    app.state.supervisor = _Supervisor(is_ready=is_ready)
    request = Request({"type": "http", "app": app, "headers": [], **scope})
    return glance_at(request, value, lambda: None)


def test_a_glance_sees_what_the_server_reads() -> None:
    seen = glanced(BODY | {"timeout": 2, "scene": "table"})
    assert (seen.robot, seen.scene, seen.timeout) == ("panda", "table", 2)
    inline = glanced(BODY | {"scene": {"obstacles": []}})
    assert (inline.robot, inline.scene, inline.timeout) == ("panda", None, None)


def test_where_work_has_to_wait_requests_are_validated_first() -> None:
    assert glanced(BODY, is_ready=False) is None
    assert glanced(BODY, **{DRY_RUN: True}) is None
    for wrong in ({"robot": "a b"}, {"robot": "panda\n"}, {"scene": 7}, {"timeout": True}):
        assert glanced(BODY | wrong) is None
    others: tuple[Any, ...] = (None, [], "text", 1.0, {})
    for value in others:
        assert glanced(value) is None
