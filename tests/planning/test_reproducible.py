"""The same request is answered with the same bytes, here and in a process of its own."""

import time
from types import SimpleNamespace

import pytest

from kinematics.arrays import Array
from planning.options import Options
from planning.pipeline.pipeline import plan
from planning.problem import JointGoal, Problem
from planning.result import Plan
from planning.values import deadline
from planning.values.optimize_options import RefineOptions
from tests.planning.scenes import HOME, builtin, pillar

#: No deadline may cut a stage short: that is the one thing that time may change [s].
_TIMEOUT = 60.0


def turned(angle: float) -> Array:
    goal = HOME.copy()
    goal[0] += angle
    return goal


def around_the_post() -> Problem:
    """A problem whose straight motion is not free."""
    post = pillar(angle=0.0, distance=0.4)
    return Problem(builtin("panda"), post, turned(-0.9), (JointGoal(turned(0.9)),))


def test_a_search_that_time_ended_is_not_deterministic(monkeypatch: pytest.MonkeyPatch) -> None:
    # Whatever else the machine does: the proof has its share of the time.
    monkeypatch.setattr(deadline, "time", SimpleNamespace(monotonic=time.process_time))
    problem = around_the_post()
    # A search for ever shorter paths ends with the deadline; one with a budget does not.
    endless = plan(problem, Options(planner="bit_star", timeout=0.5))
    counted = plan(
        problem,
        Options(planner="bit_star", timeout=_TIMEOUT, planner_options={"max_edges": 500}),
    )
    assert isinstance(endless, Plan)
    assert isinstance(counted, Plan)
    assert not endless.deterministic
    assert counted.deterministic


def test_an_optimisation_that_time_ended_is_not_deterministic() -> None:
    problem = around_the_post()
    refine = RefineOptions(rounds=1)
    counted = plan(problem, Options(timeout=_TIMEOUT, refine=refine))
    hurried = plan(problem, Options(timeout=0.06, refine=refine))
    assert isinstance(counted, Plan)
    assert counted.deterministic
    assert not isinstance(hurried, Plan) or not hurried.deterministic
