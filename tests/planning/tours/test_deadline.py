"""Deadlines of tours: tables and bounds that stop, and the tour that is known when time is up."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from planning.options import Options
from planning.result import Failure
from planning.timing.choice import chosen_parametrization
from planning.tours.legs import least_times
from planning.tours.lower_bound import lower_bound
from planning.tours.planner import plan_tour
from planning.tours.problem import TourOptions, TourProblem
from planning.tours.result import Tour
from planning.tours.search import TourSearch
from planning.values import deadline
from planning.values.deadline import Deadline
from service.endpoints.tours.translation import tour_answer
from tests.planning.tours.test_planner import problem as problem  # noqa: PLC0414
from tests.planning.tours.test_search_kernels import instance

PASSED = Deadline(-np.inf)


def test_a_table_stops_when_time_is_up(problem: TourProblem) -> None:
    chain = problem.robot.chain
    limits = chosen_parametrization(
        Options().timing, chain.joint_names, chain.limits, Options().limits, chain
    )
    low, high = chain.sampling_bounds()
    joints = np.random.default_rng(0).uniform(low, high, (100, chain.n))
    real = np.ones(100)
    assert least_times(limits, joints, real, PASSED, straight=True) is None
    whole = least_times(limits, joints, real, Deadline.after(60.0), straight=True)
    assert whole is not None
    assert (whole == whole.T).all()
    assert (whole[~np.eye(100, dtype=bool)] > 0.0).all()
    bound = least_times(limits, joints, real, Deadline.after(60.0), straight=False)
    assert bound is not None
    assert (bound <= whole + 1e-6).all()


def test_a_bound_that_is_stopped_is_a_bound() -> None:
    times, first = instance(0, goals=40, branches=1)
    assert lower_bound(times, first, 10.0, PASSED) == 0.0
    whole = lower_bound(times, first, 10.0)
    assert lower_bound(times, first, 10.0, Deadline.after(60.0)) == whole > 0.0


@pytest.mark.parametrize("recorded", [False, True])
def test_the_first_proved_tour_is_answered_when_time_is_up(
    problem: TourProblem, monkeypatch: pytest.MonkeyPatch, recorded: bool
) -> None:
    """The clock jumps when the first tour is proved, or just before."""
    now = [0.0]
    monkeypatch.setattr(deadline, "time", SimpleNamespace(monotonic=lambda: now[0]))
    keep = TourSearch._record

    def record(self: TourSearch, round_number: int) -> bool:
        shorter = keep(self, round_number) if recorded else False
        now[0] = 1e6
        return shorter

    monkeypatch.setattr(TourSearch, "_record", record)
    answer: Any = plan_tour(problem, TourOptions(Options(timeout=60.0)))
    if recorded:
        assert isinstance(answer, Tour)
        assert len(answer.visits) == 12
        assert answer.search.stopped == "deadline"
        assert (answer.lower_bound, answer.gap) == (0.0, 0.0)
    else:
        assert isinstance(answer, Failure)
        assert answer.code == "TIMED_OUT"
        assert answer.details["proved_legs"] == 13


@pytest.mark.parametrize("end", ["start", np.array([0.9, -1.44, 2.5, 0.0, -1.07, 0.0])])
def test_a_tour_without_the_way_to_its_end_is_partial_and_says_so(
    problem: TourProblem, monkeypatch: pytest.MonkeyPatch, end: Any
) -> None:
    """The clock jumps when all legs but the last are proved."""
    now = [0.0]
    monkeypatch.setattr(deadline, "time", SimpleNamespace(monotonic=lambda: now[0]))

    def record(self: TourSearch, _: int) -> bool:
        del self.legs.legs[self._pairs()[-1]]
        now[0] = 1e6
        return False

    monkeypatch.setattr(TourSearch, "_record", record)
    asked = replace(problem, goals=problem.goals[:3], end=end)
    answer = plan_tour(asked, TourOptions(Options(timeout=60.0), allow_partial=True))
    assert isinstance(answer, Tour)
    assert (len(answer.visits), len(answer.legs), answer.unvisited) == (3, 3, ())
    assert not answer.reaches_end
    assert answer.lower_bound == 0.0
    (note,) = answer.notes
    assert repr(asked.goals[answer.order[-1]].id) in note
    assert ("back to the start" in note) == isinstance(end, str)
    assert tour_answer(answer, asked, None)["status"] == "partial"
