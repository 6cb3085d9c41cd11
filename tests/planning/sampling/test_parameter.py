"""Options of OMPL's planners: which values they take, and which methods set them."""

import math
from typing import Any

import pytest

from planning.sampling.parameter import Parameter

NUMBER = Parameter("range", "number", 0.5, 0.0, 10.0, above=True)
SHARE = Parameter("goal_bias", "number", 0.05)
WHOLE = Parameter("batch_size", "whole", 1, 1, 100)
SWITCH = Parameter("delay_cc", "switch", True)


@pytest.mark.parametrize(
    ("parameter", "values", "refused"),
    [
        (NUMBER, [1e-9, 1, 10.0], [0, 0.0, -1.0, 10.1, math.nan, math.inf, True, "1", None]),
        (SHARE, [0, 0.0, 0.5, 1], [-1e-9, 1.1, False]),
        (WHOLE, [1, 100], [0, 101, 1.0, 50.0, True, "1"]),
        (SWITCH, [True, False], [0, 1, "true", None]),
    ],
)
def test_values(parameter: Parameter, values: list[Any], refused: list[Any]) -> None:
    assert all(parameter.takes(value) for value in values)
    assert not any(parameter.takes(value) for value in refused)


def test_ranges_are_told() -> None:
    assert NUMBER.requirement == "a number above 0 to 10"
    assert SHARE.requirement == "a number from 0 to 1"
    assert WHOLE.requirement == "a whole number from 1 to 100"
    assert SWITCH.requirement == "true or false"


def test_names_are_spelled_as_ompl_spells_its_methods() -> None:
    class Solver:
        def __init__(self) -> None:
            self.calls: list[tuple[str, Any]] = []

        def __getattr__(self, name: str) -> Any:
            return lambda value: self.calls.append((name, value))

    solver = Solver()
    for parameter in (NUMBER, SHARE, SWITCH, Parameter("extended_fmt", "switch", True)):
        parameter.setter(solver)(parameter.default)
    assert solver.calls == [
        ("setRange", 0.5), ("setGoalBias", 0.05), ("setDelayCC", True), ("setExtendedFMT", True),
    ]  # fmt: skip
