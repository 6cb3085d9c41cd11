"""Plans and validations in process: what is answered, what is refused, and what is reported."""

from collections.abc import Iterator
from typing import Any

import pytest

from armwright_wire.plans.plan import PlanAnswer
from planning.values.deadline import Deadline
from service.endpoints.plan.task import plan, validate
from service.workers import current
from tests.service.endpoints.ask import PLANAR, answer_of, problem_of
from tests.service.robots import solid

START, GOAL = [0.1, 0.2], [0.6, 0.5]
BALL = solid("ball", "sphere", [5.0, 0.0, 0.0], radius=0.1)
EASY: dict[str, Any] = {"robot": "planar_rr", "start": {"joints": START}, "goal": {"joints": GOAL}}
#: One second at half a radian a second.
SEGMENT = {"t0": 10.0, "t1": 11.0, "coefficients": [[0.1, 0.0, 0.03, -0.02], [0.2]]}
MOTION: dict[str, Any] = {"robot": "planar_rr", "trajectory": {"segments": [SEGMENT]}}
SLOW = {"velocity": [1.0, 1.0], "acceleration": [1.0, 1.0]}


@pytest.fixture(autouse=True)
def reports() -> Iterator[list[tuple[float, str]]]:
    """What a task reports while it works, as the current job of this process."""
    made: list[tuple[float, str]] = []
    current.begin(Deadline.after(30.0), lambda progress, stage: made.append((progress, stage)))
    yield made
    current.end()


def test_progress_goes_on_from_stage_to_stage(reports: list[tuple[float, str]]) -> None:
    answer = answer_of(plan, PLANAR, EASY, PlanAnswer)
    stages = [stage for _, stage in reports]
    assert stages[0] == "preflight"
    assert stages[-1] == "certificate"
    assert set(stages) <= {stage["name"] for stage in answer["stages"]} | {"timing", "certificate"}
    progress = [share for share, _ in reports]
    assert progress == sorted(progress)
    assert 0.0 <= progress[0] <= progress[-1] < 1.0


def test_a_deadline_that_has_passed_is_told_before_any_work() -> None:
    current.begin(Deadline.after(-1.0), None)
    try:
        problem = problem_of(plan, PLANAR, EASY)
        assert (problem.code, problem.details["stage"]) == ("TIMED_OUT", "certificate")
        late = problem_of(
            validate, PLANAR, MOTION | {"limits": SLOW, "scene": {"obstacles": [BALL]}}
        )
        assert late.code == "TIMED_OUT"
    finally:
        current.end()


def test_limits_of_the_request_hold() -> None:
    fast, slow = (
        answer_of(plan, PLANAR, EASY | {"limits": limits}, PlanAnswer)["trajectory"]["duration"]
        for limits in ({"velocity": [2.0, 2.0]}, {"velocity": [0.1, 0.1]})
    )
    assert slow > fast
    assert slow >= 0.5 / 0.1


def test_a_method_that_does_not_limit_jerk_says_that_it_is_not_proved() -> None:
    def proved(timing: dict[str, Any]) -> Any:
        answer = answer_of(plan, PLANAR, EASY | {"timing": timing}, PlanAnswer)["certificate"]
        assert answer["verified"]
        return answer["proved"]

    assert proved({"method": "jerk_limited"})["limits"]
    fastest = proved({"method": "toppra"})
    assert not fastest["limits"]
    assert "limits are proved but for jerk" in fastest["reasons"][0]
