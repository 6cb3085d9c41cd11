"""Timings that options choose: limits that count or are missed, methods, and the account of one."""

from dataclasses import replace

import numpy as np
import pytest

from kinematics.errors import InvalidOption, MissingLimit
from kinematics.model.chain import Limits
from kinematics.robots import builtin_chain
from kinematics.trajectory.trajectory import Trajectory
from planning.retiming.retime import retime
from planning.retiming.retimed import PathToTime
from planning.timing.choice import (
    JERK_RULE,
    chosen_parametrization,
    require_limits,
    required_limits,
)
from planning.timing.method import timing_method
from planning.timing.options import METHODS, Method, Payload, Solver, TimingOptions
from planning.timing.parametrization import TimeParametrization, timing_report
from planning.timing.path.blend import blend
from planning.timing.time_scaling import ScaledTime

NAMES = ("a", "b")
CHAIN = builtin_chain("panda")
GIVEN = {"velocity": np.array([1.0, 2.0]), "acceleration": np.array([3.0, 4.0])}
JERK = {"jerk": np.array([5.0, 6.0])}


def test_limits_given_come_before_the_robots_and_are_scaled() -> None:
    timing = TimingOptions("jerk_limited", 0.5, 0.25, 0.1)
    chosen = chosen_parametrization(timing, NAMES, Limits.unlimited(2), GIVEN | JERK)
    np.testing.assert_array_equal(chosen.velocity, [0.5, 1.0])
    np.testing.assert_array_equal(chosen.acceleration, [0.75, 1.0])
    assert chosen.jerk is not None
    np.testing.assert_allclose(chosen.jerk, [0.5, 0.6])
    robot = chosen_parametrization(
        TimingOptions(), CHAIN.joint_names, CHAIN.limits, {"velocity": np.full(7, 0.1)}
    )
    np.testing.assert_array_equal(robot.velocity, np.full(7, 0.1))
    np.testing.assert_array_equal(robot.acceleration, CHAIN.limits.acceleration)


def test_a_robots_own_limits_are_worked_out_once() -> None:
    def ask(timing: TimingOptions) -> TimeParametrization:
        return chosen_parametrization(timing, CHAIN.joint_names, CHAIN.limits, None, CHAIN)

    half = TimingOptions(velocity_scaling=0.5)
    assert ask(half).velocity is ask(TimingOptions(velocity_scaling=0.5)).velocity
    apart = chosen_parametrization(half, CHAIN.joint_names, CHAIN.limits)
    for name, values in ask(half).bounds.items():
        np.testing.assert_array_equal(values, apart.bounds[name])
    assert ask(half).ruled == apart.ruled
    assert (ask(TimingOptions()).velocity == CHAIN.limits.velocity).all()
    moving = ask(TimingOptions("toppra", start_velocity=(0.1,) * 7))
    assert moving.start_velocity is not None
    assert ask(TimingOptions("toppra")).start_velocity is None
    assert ask(TimingOptions(tool_speed=0.1)).loads is not None
    assert ask(TimingOptions()).loads is None


@pytest.mark.parametrize(
    ("method", "given", "robot"),
    [("toppra", False, False), ("spline", True, True), ("jerk_limited", True, True)],
)
def test_jerk_counts_where_the_method_bounds_it(method: Method, given: bool, robot: bool) -> None:
    timing = TimingOptions(method)
    own = chosen_parametrization(timing, NAMES, Limits.unlimited(2), GIVEN | JERK)
    assert (own.jerk is not None) == given
    assert ("jerk" in own.bounds) == given
    known = chosen_parametrization(timing, CHAIN.joint_names, CHAIN.limits)
    assert (known.jerk is not None) == robot


def test_missing_limits_are_named() -> None:
    for method, names in (
        ("toppra", ("velocity", "acceleration")),
        ("spline", ("velocity", "acceleration")),
        ("jerk_limited", ("velocity", "acceleration", "jerk")),
    ):
        chosen = timing_method(method)  # type: ignore[arg-type]
        assert required_limits(chosen) == names
        for name in names:
            given = {key: value for key, value in (GIVEN | JERK).items() if key != name}
            with pytest.raises(MissingLimit, match=name):
                chosen_parametrization(
                    TimingOptions(method),  # type: ignore[arg-type]
                    NAMES, Limits.unlimited(2), given,
                )  # fmt: skip
            with pytest.raises(MissingLimit, match=rf"{name}.*a, b"):
                require_limits(names, NAMES, given)
    require_limits(("velocity",), NAMES, GIVEN)


def test_torque_and_tool_speed_limits_need_a_robot_and_count_its_payload() -> None:
    for timing in (TimingOptions(torque_limits=True), TimingOptions(tool_speed=0.5)):
        with pytest.raises(InvalidOption, match="need a robot"):
            chosen_parametrization(timing, NAMES, Limits.unlimited(2), GIVEN)
    plain = chosen_parametrization(TimingOptions(), CHAIN.joint_names, CHAIN.limits, {}, CHAIN)
    assert plain.loads is None
    timing = TimingOptions(torque_limits=True, tool_speed=0.5, payload=Payload(2.0))
    chosen = chosen_parametrization(timing, CHAIN.joint_names, CHAIN.limits, {}, CHAIN)
    assert chosen.loads is not None
    assert chosen.loads.tool_speed == 0.5
    assert chosen.loads.effort is not None
    np.testing.assert_array_equal(chosen.loads.effort, CHAIN.limits.effort)
    assert chosen.loads.chain != CHAIN
    lower = {"effort": np.full(7, 5.0)}
    own = chosen_parametrization(timing, CHAIN.joint_names, CHAIN.limits, lower, CHAIN)
    assert own.loads is not None
    assert own.loads.effort is not None
    np.testing.assert_array_equal(own.loads.effort, 5.0)


def test_boundary_velocities_of_the_wrong_form_are_refused() -> None:
    for values in ([1.0], [1.0, np.nan]):
        with pytest.raises(InvalidOption, match=r"timing\.end_velocity must be 2"):
            chosen_parametrization(
                TimingOptions(end_velocity=values), NAMES, Limits.unlimited(2), GIVEN
            )


def test_jerk_limits_that_are_not_known_follow_the_rule_where_no_method_is_named() -> None:
    some = replace(Limits.unlimited(2), jerk=np.array([7.0, np.nan]))
    chosen = chosen_parametrization(TimingOptions(jerk_scaling=0.5), NAMES, some, GIVEN)
    assert chosen.method.name == "jerk_limited"
    assert JERK_RULE == "25 x acceleration"
    np.testing.assert_allclose(chosen.bounds["jerk"], [3.5, 50.0])
    assert chosen.ruled == ("b",)
    given = chosen_parametrization(TimingOptions(), NAMES, some, GIVEN | JERK)
    np.testing.assert_array_equal(given.bounds["jerk"], JERK["jerk"])
    assert given.ruled == ()
    with pytest.raises(MissingLimit, match="jerk"):
        chosen_parametrization(TimingOptions("jerk_limited"), NAMES, some, GIVEN)


def test_a_solver_without_a_method_names_its_method() -> None:
    for solver, name, near in (
        ("toppra", "toppra", False),
        ("interior_point", "jerk_limited", False),
        ("double_s", "jerk_limited", False),
        ("quintic_spline", "jerk_limited", True),
    ):
        timing = TimingOptions(solver=solver)  # type: ignore[arg-type]
        chosen = chosen_parametrization(timing, NAMES, Limits.unlimited(2), GIVEN)
        assert (chosen.method.name, chosen.near_path) == (name, near)
    with pytest.raises(InvalidOption, match="belongs to the method toppra"):
        TimingOptions("jerk_limited", solver="reachability")
    with pytest.raises(InvalidOption, match="belongs to the method jerk_limited"):
        TimingOptions("toppra", solver="double_s")


PATH = blend([[0.0, 0.0], [1.0, 0.5]], [])


def still(duration: float, factor: float) -> ScaledTime:
    return ScaledTime(Trajectory(("a",), np.array([0.0, duration]), np.zeros((1, 1, 2))), factor)


def test_a_spline_does_not_follow_a_path() -> None:
    law = TimeParametrization(timing_method("spline"), np.ones(2), np.full(2, 4.0))
    with pytest.raises(InvalidOption, match="does not follow paths"):
        law.time(PATH, ("a", "b"))


def test_only_the_package_tells_what_its_answer_cost() -> None:
    parts = (still(1.1, 1.1), still(2.0, 1.0))
    for name in METHODS:
        assert timing_method(name).notes(parts) == ()
    package = timing_method("toppra", "toppra")
    (note,) = package.notes(parts)
    # 3.1 s in place of 3.0 s.
    assert note == (
        "toppra's answer was slowed down by 3.33 % (0.1 s) to bring it inside the limits between "
        "its grid points."
    )
    (note,) = package.notes((still(1.0, 1.0),))
    assert note == "toppra's answer keeps all limits between its grid points too."
    assert package.notes(()) == ()


@pytest.mark.parametrize(
    ("options", "told", "expected"),
    [
        (TimingOptions(), "quintic_spline", ("jerk_limited", "quintic_spline")),
        (TimingOptions(), None, ("jerk_limited", "interior_point")),
        (TimingOptions(solver="interior_point"), None, ("jerk_limited", "interior_point")),
        (TimingOptions(solver="double_s"), None, ("jerk_limited", "interior_point")),
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
    assert (given.timing.solver, given.timing.ruled_jerk) == ("interior_point", ())
    asked = retime(path, TimingOptions(solver="interior_point"), GIVEN)
    assert asked.timing is not None
    assert (asked.timing.solver, asked.timing.ruled_jerk) == ("interior_point", NAMES)
    limits = replace(Limits.unlimited(2), **GIVEN)
    assert np.isnan(limits.jerk).all()


@pytest.mark.parametrize("solver", ["quintic_spline", "double_s", "interior_point"])
@pytest.mark.parametrize("method", [None, "jerk_limited"])
def test_a_named_solver_takes_the_rule(method: Method | None, solver: Solver) -> None:
    timing = TimingOptions(method, solver=solver)
    chosen = chosen_parametrization(timing, NAMES, Limits.unlimited(2), GIVEN)
    np.testing.assert_array_equal(chosen.bounds["jerk"], 25.0 * GIVEN["acceleration"])
    assert chosen.ruled == NAMES
