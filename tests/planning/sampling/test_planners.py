"""Names and options of OMPL's planners: OMPL's own defaults, and what is refused."""

import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ompl import base, geometric

from kinematics.errors import InvalidOption
from planning.sampling.planners import (
    DEFAULT_RANGE,
    PLANNERS,
    Parameter,
    complete_options,
    describe_options,
    planner_by_name,
)
from planning.sampling.search import problem, sample
from planning.values.deadline import Deadline
from tests.planning.sampling.world import GOAL, START, WALL, plane

ROOT = Path(__file__).parents[3]


def solver(planner: str) -> tuple[Any, Any]:
    information, definition, _ = problem(plane(), WALL, START, [GOAL], Deadline.after(9.0))
    made = getattr(geometric, planner_by_name(planner).ompl)(information)
    made.setProblemDefinition(definition)
    if planner == "aorrtc":
        made.setup()  # before that it can't even be thrown away
    return made, (information, definition)


def test_every_geometric_planner_of_ompl_has_a_name() -> None:
    there = {
        name
        for name in dir(geometric)
        if isinstance(getattr(geometric, name), type)
        and issubclass(getattr(geometric, name), base.Planner)
    }
    assert {planner_by_name(name).ompl for name in PLANNERS} == there


@pytest.mark.parametrize("planner", PLANNERS)
def test_defaults_are_those_of_ompl(planner: str) -> None:
    made, _kept = solver(planner)
    for parameter in planner_by_name(planner).parameters:
        setter = parameter.setter(made).__name__
        default = getattr(made, setter.replace("set", "get", 1))()
        if parameter.name == "range":
            assert parameter.default == DEFAULT_RANGE
        elif parameter.default is not None:
            assert default == parameter.default, parameter.name


@pytest.mark.parametrize("planner", PLANNERS)
def test_every_option_is_set(planner: str) -> None:
    for parameter in planner_by_name(planner).parameters:
        made, _kept = solver(planner)
        value: float | bool = not parameter.default
        if parameter.kind != "switch":
            middle = 0.5 * (parameter.least + min(parameter.most, parameter.least + 40.0))
            value = int(middle) if parameter.kind == "whole" else middle
        parameter.setter(made)(value)
        getter = parameter.setter(made).__name__.replace("set", "get", 1)
        if parameter.name != "max_nearest_neighbors":
            assert getattr(made, getter)() == pytest.approx(value), parameter.name


@pytest.mark.parametrize("planner", PLANNERS)
def test_wrong_options_are_refused_with_the_right_ones(planner: str) -> None:
    with pytest.raises(InvalidOption, match="no option 'rage'") as caught:
        complete_options(planner, {"rage": 1.0})
    for name in planner_by_name(planner).options:
        assert name in str(caught.value.hint)
        wrongs: tuple[object, ...] = ("much", [1.0], {}, None, np.nan, -1.0, 1e300)
        for wrong in wrongs:
            with pytest.raises(InvalidOption, match=name) as told:
                complete_options(planner, {name: wrong})
            assert told.value.hint
            assert told.value.details["options"]
    assert describe_options(planner)


def test_options_that_ompl_does_not_survive_together_are_refused() -> None:
    complete_options("rrt_star", {"ordered_sampling": True, "informed_sampling": True})
    for options in (
        {"ordered_sampling": True},
        {"pruned_measure": True},
        {"informed_sampling": True, "sample_rejection": True},
    ):
        with pytest.raises(InvalidOption, match="sampling"):
            complete_options("rrt_star", options)


#: In a process of its own: what OMPL does not survive is to be seen, and told from other tests.
FUZZ = """
import sys
import numpy as np
from kinematics.errors import InvalidOption
from planning.values.deadline import Deadline
from planning.sampling.planners import PLANNERS, planner_by_name
from planning.sampling.search import sample
from tests.planning.sampling.world import ENCLOSED, GOAL, START, WALL, plane

random = np.random.default_rng(0)
ran = refused = 0
for _ in range(int(sys.argv[1])):
    for planner in PLANNERS:
        options = {}
        for parameter in planner_by_name(planner).options.values():
            if parameter.name in ("max_iterations", "max_edges") or random.random() < 0.5:
                continue
            low = max(parameter.least, 1e-3)
            if parameter.kind == "switch":
                options[parameter.name] = bool(random.integers(2))
            elif random.random() < 0.3:
                ends = int(np.ceil(low)), int(parameter.most)
                options[parameter.name] = ends[random.integers(2)]
            else:
                drawn = float(low * (min(parameter.most, 1e3 * low) / low) ** random.random())
                options[parameter.name] = int(drawn) + 1 if parameter.kind == "whole" else drawn
        goals = [[GOAL], [ENCLOSED, GOAL], [GOAL, ENCLOSED]][random.integers(3)]
        print(planner, options, file=sys.stderr, flush=True)
        try:
            found = sample(planner, plane(), WALL, START, goals, options, 0, Deadline.after(0.05))
            ran += 1
        except InvalidOption:
            refused += 1
        else:
            assert found.waypoints is None or WALL.polyline(found.waypoints)[0].free
print(ran, refused)
"""


def test_no_allowed_options_bring_a_planner_down() -> None:
    ran = subprocess.run(
        [sys.executable, "-c", FUZZ, "4"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert ran.returncode == 0, ran.stderr[-2000:]
    runs, refused = map(int, ran.stdout.split()[-2:])
    assert runs > 3 * refused


def test_a_checker_that_fails_is_told_as_it_is() -> None:
    class Broken:
        def valid(self, q: np.ndarray) -> bool:
            return True

        def free(self, a: np.ndarray, b: np.ndarray) -> bool:
            raise ZeroDivisionError("inside the checker")

    for planner in ("rrt_connect", "rrt_star", "prm"):
        with pytest.raises(ZeroDivisionError, match="inside the checker"):
            sample(
                planner, plane(), Broken(), START, [GOAL], {}, 0,  # type: ignore[arg-type]
                Deadline.after(1.0),
            )  # fmt: skip


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
