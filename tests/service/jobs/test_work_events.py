"""Events of the jobs of tasks, tours and reach: their stages in order, shares that only rise."""

from typing import Any

import httpx
import pytest

from armwright_wire.plans.task import TaskRequest
from tests.service.jobs.requests import events, submit

_TASK: Any = TaskRequest.model_json_schema()["examples"][0]
_HOME = _TASK["start"]
_GOALS = [
    {"id": f"g{k}", "joints": [0.2 * (k + 1), *_HOME["joints"][1:]]} for k in range(3)
]  # fmt: skip
_POSES = [
    {"position": [0.3 + 0.02 * k, 0.1, 0.4], "quaternion_xyzw": [1.0, 0.0, 0.0, 0.0]}
    for k in range(20)
]


@pytest.mark.parametrize(
    ("path", "body", "stages"),
    [
        ("/v1/tasks", _TASK | {"stages": _TASK["stages"][:6], "improve": 0.0, "timeout": 30.0},
         ["stage 4 (attach)", "stage 0 (move)"]),
        ("/v1/tours", {"robot": "panda", "start": _HOME, "goals": _GOALS, "rounds": 0,
                       "timeout": 30.0}, ["configurations", "prove"]),
        ("/v1/robots/panda/reach", {"poses": _POSES}, ["reach"]),
    ],
)  # fmt: skip
def test_stages_are_told_in_order_with_shares_that_rise(
    client: httpx.Client, path: str, body: Any, stages: list[str]
) -> None:
    told = events(client, submit(client, body, path))
    assert [event["number"] for event in told] == list(range(1, len(told) + 1))
    assert told[0]["status"] == "queued"
    last = told[-1]
    assert (last["event"], last["status"], last["progress"]) == ("end", "succeeded", 1)
    shares = [event["progress"] for event in told]
    assert shares == sorted(shares)
    named = [event["stage"] for event in told if event["event"] == "stage"]
    places = [named.index(stage) for stage in stages]
    assert places == sorted(places)
