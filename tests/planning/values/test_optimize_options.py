"""Options of an optimisation: what is taken, what is refused and how it is told."""

from typing import Any

import pytest

from kinematics.errors import InvalidOption
from planning.values.optimize_options import CONTROL_POINTS, DEGREES, MAX_ROUNDS, RefineOptions


def test_by_default_time_counts_alone() -> None:
    options = RefineOptions()
    assert dict(options.weights) == {"time": 1.0}
    assert options.fastest
    assert options.least_degree == 3


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


def test_what_is_left_open_by_none_has_its_default() -> None:
    open_ended = RefineOptions.of({"duration": None, "degree": None, "rounds": None})
    assert (open_ended.duration, open_ended.degree, open_ended.rounds) == (None, None, 12)


def test_weights_can_not_be_changed_afterwards() -> None:
    given = {"time": 1.0}
    options = RefineOptions(given)  # type: ignore[arg-type]
    given["time"] = 5.0
    assert options.weights["time"] == 1.0
    with pytest.raises(TypeError):
        options.weights["time"] = 2.0  # type: ignore[index]


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
