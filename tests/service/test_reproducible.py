"""The same request is answered alike, however busy the workers are and whichever takes it."""

import json
import re
import time
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any, NamedTuple, TypeAlias

import httpx
import pytest

from tests.service.robots import ASIDE, DETOUR, FLOOR, POST, scene
from tests.service.test_cartesian import seam
from tests.service.test_tasks import TASK
from tests.service.test_tours import body as tour

#: Path and body.
Request: TypeAlias = "tuple[str, dict[str, Any]]"
#: Of all patient requests [s]: many times what they take on a machine that is busy.
_TIMEOUT = 280.0

_PLACE = scene(POST, FLOOR)
_TURN = [1.0, 0.0, 0.0, 0.0]
_ABOVE = {"position": [0.5, -0.2, 0.5], "quaternion_xyzw": _TURN}
_ACROSS = {"position": [0.4, -0.3, 0.3], "quaternion_xyzw": _TURN}
_UPRIGHT = {
    "type": "orientation", "axis": [0, 0, 1], "direction": [0, 0, -1], "cone_angle": 0.3,
}  # fmt: skip
_PLAN = DETOUR | {"timeout": _TIMEOUT, "seed": 5}
#: Back past the post to a pose.
_POSE_PLAN = _PLAN | {"start": {"joints": ASIDE}, "goal": {"pose": _ABOVE}}


def _planned_by(planner: str, **options: Any) -> Request:
    return "/v1/plan", _PLAN | {"planner": planner, "planner_options": options}


def _ik(**changes: Any) -> Request:
    body = {"pose": _ACROSS, "timeout": _TIMEOUT}
    return "/v1/robots/panda/ik", body | changes


_HELD = {
    "pose": {"position": [0.45, 0.1, 0.5]}, "method": "constrained", "axes": ["x", "y", "z"],
    "constraints": [_UPRIGHT, {"type": "clearance", "margin": 0.02}], "scene": _PLACE,
}  # fmt: skip
_HARD_PLAN = _POSE_PLAN | {"constraints": [_UPRIGHT]}

PATIENT: Mapping[str, Request] = {
    "auto": ("/v1/plan", _PLAN),
    "potential_field": _planned_by("potential_field"),
    "bit_star": _planned_by("bit_star", max_edges=300),
    "constrained": ("/v1/plan", _HARD_PLAN),
    "refine": ("/v1/plan", _PLAN | {"refine": {}}),
    "seam": ("/v1/plan", seam(tolerance={"tilt": 0.1}) | {"timeout": _TIMEOUT}),
    "batch": (
        "/v1/plan/batch",
        {name: _PLAN[name] for name in ("robot", "scene", "start", "timeout")}
        | {"problems": [{"goal": {"joints": ASIDE}, "seed": n} for n in range(4)]},
    ),
    "task": ("/v1/tasks", TASK | {"timeout": _TIMEOUT}),
    "tour": ("/v1/tours", tour(rounds=3, leg_timeout=_TIMEOUT, timeout=_TIMEOUT, seed=2)),
    "bases": (
        "/v1/robots/ur5e/reach",
        {
            "poses": [_ABOVE, _ACROSS],
            "bases": [{"position": [0.0, 0.1 * n, 0.0]} for n in range(5)],
        },
    ),
    "ik numeric": _ik(method="numeric", all_solutions=True, scene=_PLACE),
    "ik constrained": _ik(**_HELD),
}  # fmt: skip

#: Enough that each worker answers several times with the other one busy.
_REPEATS = 5
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
