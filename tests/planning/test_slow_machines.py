"""Tasks and tours of a slow machine: the answer of a fast one, or one that says what time did."""

import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from planning.options import Options
from planning.sequence.result import SequencePlan, TaskOptions
from planning.sequence.stage import Stage
from planning.sequence.task import Task
from planning.tours.planner import plan_tour
from planning.tours.problem import TourOptions, TourProblem
from planning.tours.result import Tour
from planning.values import deadline
from tests.planning.sequence import crate
from tests.planning.tours.test_planner import problem as problem  # noqa: PLC0414

#: How often slower the other machine is. Deadlines of parts of a second would end work there.
_SLOWER = 100.0
#: Of whole tasks and tours, and of single motions at most [s].
_TIMEOUT, _OF_A_MOTION = 6000.0, 600.0


def slow_down(monkeypatch: pytest.MonkeyPatch, factor: float) -> None:
    """Let the clock of deadlines run so many times as fast."""
    clock = SimpleNamespace(monotonic=lambda: factor * time.monotonic())
    monkeypatch.setattr(deadline, "time", clock)


def moved(plan: SequencePlan) -> list[bytes]:
    return [stage.trajectory.coefficients.tobytes() for stage in plan.stages]


def patient(stage: Stage) -> Stage:
    """A stage whose motions may take as long as any."""
    options = replace(stage.settings.options, timeout=_OF_A_MOTION)
    return replace(stage, settings=replace(stage.settings, options=options))


def task(timeout: float, improve: float = 0.0) -> SequencePlan:
    stages = tuple(map(patient, crate.stages()))
    return crate.planned_task(
        Task(crate.world(), crate.HOME, stages), TaskOptions(timeout, improve)
    )


def tour(problem: TourProblem, timeout: float) -> Tour:
    found = plan_tour(
        problem, TourOptions(Options(timeout=timeout, seed=1), rounds=2, leg_timeout=_OF_A_MOTION)
    )
    assert isinstance(found, Tour)
    return found


def test_a_slow_machine_finds_the_same_motions_of_a_task(monkeypatch: pytest.MonkeyPatch) -> None:
    fast = task(_TIMEOUT)
    slow_down(monkeypatch, _SLOWER)
    slow = task(_TIMEOUT)
    assert slow.deterministic
    assert fast.deterministic
    assert moved(slow) == moved(fast)
    assert slow.trials == fast.trials


def test_a_task_whose_improving_was_ended_by_time_says_so() -> None:
    plan = task(_TIMEOUT, improve=0.05)
    assert plan.deterministic is plan.exhausted


def test_a_slow_machine_finds_the_same_tour(
    problem: TourProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    fast = tour(problem, _OF_A_MOTION)
    slow_down(monkeypatch, _SLOWER)
    slow = tour(problem, _OF_A_MOTION)
    assert slow.deterministic
    assert fast.deterministic
    assert slow.order == fast.order
    for ours, theirs in zip(slow.legs, fast.legs, strict=True):
        np.testing.assert_array_equal(ours.trajectory.coefficients, theirs.trajectory.coefficients)
    assert slow.lower_bound == fast.lower_bound


def test_a_tour_whose_search_was_ended_by_time_says_so(problem: TourProblem) -> None:
    options = TourOptions(Options(timeout=1.0, seed=1), rounds=1000)
    found = plan_tour(problem, options)
    assert isinstance(found, Tour)
    assert found.deterministic is (found.search.stopped != "deadline")
