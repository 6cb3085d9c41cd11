"""The account of a timing: the solver that found the speeds, the limits, and what a rule made."""

from dataclasses import replace

import numpy as np
import pytest

from kinematics.model.chain import Limits
from planning.retiming.retime import PathToTime, retime
from planning.timing.choice import chosen_parametrization
from planning.timing.options import TimingOptions
from planning.timing.parametrization import timing_report

NAMES = ("a", "b")
GIVEN = {"velocity": np.array([1.0, 2.0]), "acceleration": np.array([3.0, 4.0])}


@pytest.mark.parametrize(
    ("options", "told", "expected"),
    [
        (TimingOptions(), "quintic_spline", ("jerk_limited", "quintic_spline")),
        (TimingOptions(), None, ("jerk_limited", "interior_point")),
        (TimingOptions(solver="interior_point"), None, ("jerk_limited", "interior_point")),
        (TimingOptions("toppra"), None, ("toppra", "reachability")),
        (TimingOptions(solver="toppra"), None, ("toppra", "toppra")),
        (TimingOptions("spline"), None, ("spline", None)),
    ],
)
def test_the_solver_is_the_one_that_found_the_speeds(
    options: TimingOptions, told: str | None, expected: tuple[str, str | None]
) -> None:
    parametrization = chosen_parametrization(options, NAMES, Limits.unlimited(2), GIVEN)
    report = timing_report(parametrization, told)  # type: ignore[arg-type]
    assert (report.method, report.solver) == expected
    np.testing.assert_array_equal(report.limits["velocity"], GIVEN["velocity"])
    ruled = NAMES if expected[0] == "jerk_limited" else ()
    assert report.ruled_jerk == ruled
    assert ("jerk" in report.limits) == bool(ruled)


def test_retimed_paths_have_bounded_jerk_unless_all_limits_are_the_callers() -> None:
    path = PathToTime(NAMES, np.array([[0.0, 0.0], [1.0, 0.5], [1.0, 2.0]]))
    bare = retime(path, TimingOptions(), GIVEN)
    assert bare.timing is not None
    assert bare.timing.method == "toppra"
    given = retime(path, TimingOptions(), GIVEN | {"jerk": np.array([40.0, 40.0])})
    assert given.timing is not None
    assert (given.timing.solver, given.timing.ruled_jerk) == ("double_s", ())
    asked = retime(path, TimingOptions(solver="interior_point"), GIVEN)
    assert asked.timing is not None
    assert (asked.timing.solver, asked.timing.ruled_jerk) == ("interior_point", NAMES)
    limits = replace(Limits.unlimited(2), **GIVEN)
    assert np.isnan(limits.jerk).all()
