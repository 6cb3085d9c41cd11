"""Batches in workers: taken apart, cut, and planned in parts as each problem is alone."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from armwright_wire.plans.batch import BatchRequest
from planning.values.deadline import Deadline
from service.endpoints.batch import task
from service.endpoints.batch.task import cut, plan_part, split
from service.endpoints.plan.task import plan
from service.storage.caches.cache_key import Reference
from service.workers import current
from service.workers.chunk_sizes import Pace
from service.workers.result import PlannedPart, PlanOutcome, TaskProblem
from tests.service.endpoints.ask import PLANAR
from tests.service.robots import solid

HOME = {"joints": [0.0, 0.0]}
GOALS: list[dict[str, Any]] = [{"goal": {"joints": [0.1 * n, 0.2]}, "seed": n} for n in range(5)]
BALL = solid("ball", "sphere", [5.0, 0.0, 0.0], radius=0.1)
COMMON: dict[str, Any] = {"robot": "planar_rr", "start": HOME, "collisions": "ignore"}


@pytest.fixture(autouse=True)
def reports() -> Iterator[list[float]]:
    """The progress that a task reports, as the current job of this process."""
    made: list[float] = []
    current.begin(Deadline.after(60.0), lambda progress, _stage: made.append(progress))
    yield made
    current.end()


def encoded(body: dict[str, Any]) -> bytes:
    return json.dumps(body).encode()


def planned(body: dict[str, Any], timeout: float = 20.0) -> PlannedPart:
    part = plan_part(PLANAR, None, encoded(body), timeout)
    assert isinstance(part, PlannedPart)
    return part


def without_times(content: bytes) -> Any:
    answer = json.loads(content)
    del answer["stages"]
    return answer


def test_a_part_answers_as_its_problems_do_alone(
    reports: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(task, "TURN", 60.0)
    frame = {"frame": "tool", "goal": {"pose": {"position": [-0.2, 0.1, 0.0]}}}
    problems = [*GOALS, {"goal": HOME, "start": {"joints": [0.3, -0.3]}, "margin": 0.01}, frame]
    part = planned(COMMON | {"problems": problems})
    assert part.seconds > 0.0
    for problem, outcome in zip(problems, part.outcomes, strict=True):
        alone = plan(PLANAR, None, encoded(COMMON | problem))
        if isinstance(alone, PlanOutcome):
            assert isinstance(outcome, PlanOutcome)
            assert without_times(outcome.content) == without_times(alone.content)
            assert outcome.planner == alone.planner
        else:
            assert isinstance(outcome, TaskProblem)
            assert isinstance(alone, TaskProblem)
            assert (outcome.code, outcome.message) == (alone.code, alone.message)
    # Progress counts the problems that are done.
    assert reports[0] < 1.0
    assert 4.0 <= max(reports) <= len(problems)


def test_a_fault_of_a_problem_is_not_that_of_its_part(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(task, "TURN", 60.0)
    wrong = [
        {"goal": {"joints": [1.0]}},
        {"goal": HOME, "planner": "cartesian", "planner_options": {"nonsense": 1}},
    ]
    part = planned(COMMON | {"problems": [GOALS[1], *wrong, GOALS[2]]})
    first, length, options, last = part.outcomes
    assert isinstance(first, PlanOutcome)
    assert isinstance(last, PlanOutcome)
    assert isinstance(length, TaskProblem)
    assert length.code == "INVALID_ROBOT_STATE"
    assert isinstance(options, TaskProblem)
    assert options.code == "VALIDATION_ERROR"
    assert "nonsense" in options.message
    assert options.details["stage"] == "request"


def test_a_part_ends_with_the_turn_of_its_worker(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(task, "TURN", 0.0)
    assert len(planned(COMMON | {"problems": GOALS}).outcomes) == 1


def test_each_problem_of_a_part_has_its_own_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(task, "TURN", 60.0)
    current.begin(Deadline.after(0.0), None)  # that of the part is over
    assert all(
        isinstance(one, PlanOutcome) for one in planned(COMMON | {"problems": GOALS}).outcomes
    )
    late = planned(COMMON | {"problems": GOALS}, 1e-9).outcomes
    assert {one.code for one in late if isinstance(one, TaskProblem)} == {"TIMED_OUT"}
    assert len(late) == len(GOALS)


def test_a_batch_is_taken_apart(tmp_path: Path) -> None:
    problems = [
        GOALS[0],
        GOALS[1] | {"scene": {"obstacles": [BALL]}},
        GOALS[2] | {"scene": "table", "robot": "panda", "timeout": 3.0},
        GOALS[3] | {"scene": None, "robot": None, "timeout": None},
    ]
    body = COMMON | {"scene": {"obstacles": [BALL]}, "timeout": 7, "limits": None}
    found = split(encoded(body | {"problems": problems}), str(tmp_path), "batch-1")
    assert [(i.robot, i.scene, i.shared, i.timeout) for i in found.items] == [
        ("planar_rr", None, True, 7), ("planar_rr", None, False, 7),
        ("panda", "table", False, 3.0), ("planar_rr", None, True, 7),
    ]  # fmt: skip
    assert [json.loads(item.content) for item in found.items] == problems
    assert json.loads(b"{" + found.head[:-1] + b"}") == COMMON | {"timeout": 7}
    assert found.scene_hash is not None
    reference = Reference("scene", "batch-1", found.scene_hash, str(tmp_path))
    part = plan_part(PLANAR, reference, encoded(COMMON | {"problems": [GOALS[1]]}), 20.0)
    assert isinstance(part, PlannedPart)
    alone = plan(PLANAR, None, encoded(COMMON | GOALS[1] | {"scene": {"obstacles": [BALL]}}))
    assert isinstance(alone, PlanOutcome)
    (outcome,) = part.outcomes
    assert isinstance(outcome, PlanOutcome)
    hashes = [json.loads(one.content)["reproducibility"]["scene_hash"] for one in (outcome, alone)]
    assert hashes[0] == hashes[1]
    plain = split(encoded(COMMON | {"scene": "table", "problems": GOALS}), str(tmp_path), "batch-2")
    assert plain.scene_hash is None
    assert {item.scene for item in plain.items} == {"table"}


def test_the_parts_of_a_batch_mean_what_it_means() -> None:
    body = COMMON | {"scene": {"obstacles": [BALL]}, "frame": "base_link", "problems": GOALS}
    parts = cut(encoded(body), Pace(1.0, 1, 1))
    assert [(part.first, part.size) for part in parts] == [(0, 3), (3, 1), (4, 1)]
    whole = BatchRequest.model_validate_json(encoded(body))
    for part in parts:
        own = BatchRequest.model_validate_json(part.content)
        for index in range(part.size):
            assert own.plan_request(index) == whole.plan_request(part.first + index)
