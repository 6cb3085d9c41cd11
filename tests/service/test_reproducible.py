"""The same request is answered alike, however busy the workers are and whichever takes it."""

import json
import re
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import httpx
import pytest

from tests.service.jobs.requests import EASY
from tests.service.planning import BODY
from tests.service.robots import ASIDE, HOME, answer

#: Times, which no two answers share.
_TIMES = {"milliseconds", "computed_milliseconds"}
_REPEATS = 20
#: Clients at a time, for two workers.
_CLIENTS = 4

PLAN = BODY | {"seed": 5}
PLACE = {"scene": BODY["scene"]}
ABOVE = {"position": [0.5, -0.2, 0.5], "quaternion_xyzw": [1.0, 0.0, 0.0, 0.0]}
REQUESTS: dict[str, tuple[str, dict[str, Any]]] = {
    "plan": ("/v1/plan", PLAN),
    "rrt_connect": ("/v1/plan", PLAN | {"planner": "rrt_connect"}),
    "potential_field": ("/v1/plan", PLAN | {"planner": "potential_field"}),
    "refine": ("/v1/plan", EASY | {"refine": {"rounds": 1}}),
    "bit_star": (
        "/v1/plan",
        PLAN | {"planner": "bit_star", "planner_options": {"max_edges": 50}},
    ),
    "toppra": ("/v1/plan", PLAN | {"scene": None, "timing": {"method": "toppra"}}),
    "ik": (
        "/v1/robots/panda/ik",
        {"pose": {"position": [0.5, 0.1, 0.4], "quaternion_xyzw": [1, 0, 0, 0]}},
    ),
    "check": (
        "/v1/check",
        {"robot": "panda", "scene": BODY["scene"], "joints": [HOME, ASIDE]},
    ),
    "simulate": (
        "/v1/simulate",
        {
            "robot": "planar_rr",
            "reference": {"type": "hold", "joints": [0.3, -0.4], "duration": 0.1},
            "controller": {"type": "computed_torque", "natural_frequency": 10.0},
            "model_error": {"mass_scale": 1.2},
        },
    ),
    "task": (
        "/v1/tasks",
        PLACE
        | {
            "robot": "panda",
            "start": {"joints": HOME},
            "stages": [
                {"kind": "move", "name": "there", "goal": {"joints": ASIDE}},
                {
                    "kind": "move",
                    "name": "back",
                    "goal": {"pose": ABOVE, "position_tolerance": 1e-3},
                },
            ],
            "improve": 0.0,
            "timeout": 60.0,
        },
    ),
    "tour": (
        "/v1/tours",
        PLACE
        | {
            "robot": "panda",
            "start": {"joints": HOME},
            "rounds": 1,
            "goals": [
                {"joints": ASIDE},
                {"pose": ABOVE, "tolerance": {"free": ["rz"], "samples": 2}},
            ],
            "timeout": 60.0,
        },
    ),
    "reach": (
        "/v1/robots/panda/reach",
        PLACE | {"poses": [ABOVE, ABOVE | {"position": [0.4, 0.2, 0.3]}]},
    ),
    "velocity": ("/v1/robots/panda/velocity", {"joints": HOME, "twist": [0.1, 0, 0, 0, 0, 0.2]}),
}


def without_times(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: without_times(part) for name, part in value.items() if name not in _TIMES}
    if isinstance(value, list):
        return [without_times(part) for part in value]
    return re.sub(r"\d+ ms", "some ms", value) if isinstance(value, str) else value


@pytest.mark.parametrize("kind", REQUESTS)
def test_twenty_answers_under_load_are_one(client: httpx.Client, kind: str) -> None:
    path, body = REQUESTS[kind]

    def ask(_: int) -> str:
        found = answer(client.post(path, json=body))
        assert found.get("reproducibility", {}).get("deterministic", True)
        return json.dumps(without_times(found), sort_keys=True)

    with ThreadPoolExecutor(_CLIENTS) as pool:
        assert len(set(pool.map(ask, range(_REPEATS)))) == 1
