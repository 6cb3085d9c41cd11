"""Options of an optimisation, weights, preferred distances and deadlines."""

import time
from typing import Any

import numpy as np
import pytest

from kinematics.errors import InvalidOption
from planning.values.deadline import Deadline
from planning.values.optimize_options import CONTROL_POINTS, DEGREES, MAX_ROUNDS, RefineOptions
from planning.values.preferences import GoalCosts, PreferredClearance


@pytest.mark.parametrize(
    ("weights", "degree", "least", "fastest"),
    [
        ({"time": 2.0}, None, 3, True),
        ({"time": 1.0, "path_length": 1.0}, None, 3, False),
        ({"jerk": 1.0}, None, 5, False),
        ({"time": 1.0, "jerk": 0.1}, None, 5, False),
        ({"jerk": 1.0}, 7, 7, False),
        ({"time": 1.0, "jerk": 0.0}, None, 3, True),
    ],
)
def test_degree_and_haste_follow_from_the_weights(
    weights: Any, degree: int | None, least: int, fastest: bool
) -> None:
    options = RefineOptions(weights, degree=degree)
    assert options.least_degree == least
    assert options.fastest is fastest


def test_an_objective_is_a_name_or_weights_by_name() -> None:
    assert dict(RefineOptions.of({"objective": "energy"}).weights) == {"energy": 1.0}
    given = {"time": 1, "energy": 0.5, "jerk": 0}
    assert dict(RefineOptions.of({"objective": given}).weights) == {"time": 1.0, "energy": 0.5}
    assert RefineOptions.of({}).fastest


@pytest.mark.parametrize("name", ["degree", "control_points", "rounds"])
def test_the_ends_of_every_range_are_inside(name: str) -> None:
    ranges = {"degree": DEGREES, "control_points": CONTROL_POINTS, "rounds": (1, MAX_ROUNDS)}
    least, most = ranges[name]
    for value in (least, most):
        assert getattr(RefineOptions.of({name: value}), name) == value
    outside: tuple[Any, ...] = (least - 1, most + 1, float(least), True, "8")
    for other in outside:
        with pytest.raises(InvalidOption, match=f"refine.{name} must be an integer"):
            RefineOptions.of({name: other})


@pytest.mark.parametrize("duration", [0.0, -1.0, float("inf"), float("nan")])
def test_a_duration_is_positive_and_finite(duration: float) -> None:
    with pytest.raises(InvalidOption, match="duration"):
        RefineOptions(duration=duration)
    assert RefineOptions(duration=1e-3).duration == 1e-3


@pytest.mark.parametrize(
    ("objective", "message"),
    [
        ("speed", "no objective 'speed'"),
        ({"time": 1.0, "beauty": 1.0}, "no objective 'beauty'"),
        ({}, "no positive weight"),
        ({"time": 0.0}, "no positive weight"),
        ({"time": -1.0}, "weight of time"),
        ({"time": float("nan")}, "weight of time"),
        ({"time": float("inf")}, "weight of time"),
        ({"time": True}, "weight of time"),
        ({"time": "1"}, "weight of time"),
        (["time"], "a name or weights by name"),
        (3.0, "a name or weights by name"),
    ],
)
def test_objectives_that_are_none_are_refused(objective: Any, message: str) -> None:
    with pytest.raises(InvalidOption, match=message):
        RefineOptions.of({"objective": objective})


def test_unknown_options_and_solvers_are_named_with_those_there_are() -> None:
    with pytest.raises(InvalidOption, match="no option 'iterations'") as refused:
        RefineOptions.of({"iterations": 3, "rounds": 3})
    assert "rounds" in str(refused.value.hint)
    with pytest.raises(InvalidOption, match="no solver 'simplex'") as refused:
        RefineOptions.of({"solver": "simplex"})
    assert "piqp, ipopt" in str(refused.value.hint)


@pytest.mark.parametrize("value", [-1.0, np.inf, np.nan])
def test_an_odd_weight_is_refused(value: float) -> None:
    with pytest.raises(InvalidOption, match="turns"):
        GoalCosts(turns=value)


@pytest.mark.parametrize("distance", [-1e-9, 1.1, np.nan])
def test_a_distance_out_of_range_is_refused(distance: float) -> None:
    with pytest.raises(InvalidOption, match="preferred"):
        PreferredClearance(distance)


def test_time_that_remains_ends_nothing() -> None:
    deadline = Deadline.after(60.0)
    assert not deadline.passed
    assert not deadline.sooner_than(1.0)
    assert 59.0 < deadline.remaining <= 60.0
    assert not deadline.interruptions.occurred


def test_a_look_at_a_deadline_that_passed_is_recorded() -> None:
    deadline = Deadline(time.monotonic() - 1.0)
    assert deadline.remaining == 0.0
    assert not deadline.interruptions.occurred  # nobody asked whether to stop
    assert deadline.passed
    assert deadline.interruptions.occurred


def test_too_little_time_is_recorded() -> None:
    deadline = Deadline.after(60.0)
    assert deadline.sooner_than(120.0)
    assert deadline.interruptions.occurred


@pytest.mark.parametrize("seconds", [0.0, -1.0])
def test_a_part_shares_the_record_of_the_whole(seconds: float) -> None:
    whole = Deadline.after(60.0)
    part = whole.within(seconds)
    assert part.passed
    assert whole.interruptions.occurred
    assert not whole.passed
