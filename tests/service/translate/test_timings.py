"""Timing options, limits and paths from the wire: what goes through, and what is refused."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from armwright_wire.motions.retime import RetimePath, RetimeTiming
from armwright_wire.motions.timing import Timing
from armwright_wire.motions.trajectory import LimitsBody
from armwright_wire.plans.plan import ValidateRequest
from dynamics.terms import gravity_vector
from kinematics.errors import InvalidOption, MissingLimit
from kinematics.forward import forward
from kinematics.robots import builtin_chain
from planning.timing.options import TimingOptions
from service.translate.timings import (
    effort_loads,
    given_limit,
    given_limits,
    limits,
    path_to_time,
    timing_options,
)

CHAIN = builtin_chain("planar_rr")
NAMES = CHAIN.joint_names
SEGMENT = {"t0": 0.0, "t1": 1.0, "coefficients": [[0.0], [0.0]]}


def validate(**fields: Any) -> ValidateRequest:
    least = {"robot": "r", "trajectory": {"segments": [SEGMENT]}}
    return ValidateRequest.model_validate(least | fields)


def body(**fields: Any) -> LimitsBody:
    return LimitsBody.model_validate(fields)


# ---------------------------------------------------------------------------------- options


def test_what_is_left_out_is_as_planning_has_it() -> None:
    left_out = timing_options(Timing())
    plain = TimingOptions()
    for name in TimingOptions.__slots__:
        assert getattr(left_out, name) == getattr(plain, name), name


def test_what_is_given_reaches_planning() -> None:
    load = {"mass": 2.0, "center_of_mass": [0.0, 0.0, 0.1], "link": "tip",
            "inertia": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]}  # fmt: skip
    fields = {
        "method": "spline", "velocity_scaling": 0.5, "acceleration_scaling": 0.25,
        "jerk_scaling": 0.125, "times": [0.0, 1.0], "scale_times": True,
        "interpolation": "clamped_spline", "blend_tolerance": 0.01, "torque_limits": True,
        "tool_speed": 0.4, "start_velocity": [0.1, 0.2], "end_velocity": [0.3, 0.4],
    }  # fmt: skip
    made = timing_options(RetimeTiming.model_validate(fields | {"payload": load}))
    assert {name: getattr(made, name) for name in fields} == fields
    assert made.payload is not None
    given = {name: getattr(made.payload, name) for name in load}
    assert given == load


# ----------------------------------------------------------------------------------- limits


def test_a_limit_is_a_positive_number_for_each_joint() -> None:
    np.testing.assert_array_equal(given_limit([1.0, 2.0], "velocity", NAMES), [1.0, 2.0])
    for wrong in ([], [1.0], [1.0, 2.0, 3.0], [1.0, 0.0], [1.0, -1.0], [float("nan"), 1.0]):
        with pytest.raises(InvalidOption, match=r"limits\.jerk must be 2 positive numbers") as no:
            given_limit(wrong, "jerk", NAMES)
        assert no.value.hint == f"The order is: {', '.join(NAMES)}."


def test_only_limits_that_are_given_are_taken() -> None:
    assert given_limits(None, NAMES) == {}
    assert given_limits(body(), NAMES) == {}
    made = given_limits(body(jerk=[1.0, 2.0], effort=[3.0, 4.0]), NAMES)
    assert set(made) == {"jerk", "effort"}
    np.testing.assert_array_equal(made["effort"], [3.0, 4.0])


def test_a_motion_is_held_to_the_request_first_and_then_to_the_robot() -> None:
    bounds = limits(None, CHAIN)
    assert set(bounds) == {"velocity", "acceleration"}
    np.testing.assert_array_equal(bounds["velocity"], CHAIN.limits.velocity)
    bounds = limits(body(acceleration=[1.0, 2.0], jerk=[3.0, 4.0], effort=[5.0, 6.0]), CHAIN)
    assert set(bounds) == {"velocity", "acceleration", "jerk"}
    np.testing.assert_array_equal(bounds["acceleration"], [1.0, 2.0])
    np.testing.assert_array_equal(bounds["jerk"], [3.0, 4.0])


@pytest.mark.parametrize("quantity", ["velocity", "acceleration"])
def test_a_limit_that_nobody_knows_is_missed_unless_it_is_given(quantity: str) -> None:
    unknown = replace(CHAIN.limits, **{quantity: np.array([1.0, np.nan])})
    chain = replace(CHAIN, limits=unknown)
    with pytest.raises(MissingLimit, match=f"{quantity}.*{NAMES[1]}|{NAMES[1]}.*{quantity}"):
        limits(None, chain)
    bounds = limits(body(**{quantity: [1.0, 2.0]}), chain)
    np.testing.assert_array_equal(bounds[quantity], [1.0, 2.0])


# ------------------------------------------------------------------------------------ loads


def test_torques_are_not_looked_at_unless_somebody_asks() -> None:
    assert effort_loads(validate(), CHAIN) is None
    assert effort_loads(validate(torque_limits=False), CHAIN) is None


def test_torques_are_held_to_the_request_or_to_the_robot() -> None:
    chain = replace(CHAIN, limits=replace(CHAIN.limits, effort=np.array([8.0, 9.0])))
    own = effort_loads(validate(torque_limits=True), chain)
    assert own is not None
    np.testing.assert_array_equal(own.effort, [8.0, 9.0])
    given = effort_loads(validate(torque_limits=True, limits={"effort": [1.0, 2.0]}), chain)
    assert given is not None
    np.testing.assert_array_equal(given.effort, [1.0, 2.0])
    alone = effort_loads(validate(limits={"effort": [1.0, 2.0]}), chain)
    assert alone is not None
    np.testing.assert_array_equal(alone.effort, [1.0, 2.0])
    with pytest.raises(InvalidOption, match=r"limits\.effort"):
        effort_loads(validate(limits={"effort": [1.0]}), chain)
    nobody = replace(chain, limits=replace(chain.limits, effort=np.array([8.0, np.nan])))
    with pytest.raises(MissingLimit):
        effort_loads(validate(torque_limits=True), nobody)


def test_a_tool_speed_alone_limits_no_torque() -> None:
    made = effort_loads(validate(tool_speed=0.5), CHAIN)
    assert made is not None
    assert made.effort is None
    assert made.tool_speed == 0.5
    assert made.chain is CHAIN


def test_a_payload_is_part_of_the_robot_whose_torques_are_limited() -> None:
    load = {"mass": 3.0, "center_of_mass": [0.0, 0.0, 0.0]}
    made = effort_loads(validate(payload=load, limits={"effort": [1.0, 2.0]}), CHAIN)
    assert made is not None
    q, pull = np.array([0.3, 0.7]), -3.0 * CHAIN.gravity
    more = gravity_vector(made.chain, q) - gravity_vector(CHAIN, q)
    # A point mass at the tip: the derivative of -m g . p, by central differences.
    step = 1e-6 * np.eye(2)
    slopes = [
        pull @ (forward(CHAIN, q + h)[:3, 3] - forward(CHAIN, q - h)[:3, 3]) / 2e-6 for h in step
    ]
    assert np.abs(slopes).max() > 1.0
    np.testing.assert_allclose(more, slopes, rtol=1e-6, atol=1e-7)
    assert effort_loads(validate(payload=load), CHAIN) is not None


# ------------------------------------------------------------------------------------ paths


def path(**fields: Any) -> RetimePath:
    return RetimePath.model_validate({"joints": [[0.0, 0.1], [1.0, 1.1]]} | fields)


def test_a_path_takes_the_names_of_the_robot_or_its_own_or_numbers() -> None:
    assert path_to_time(path(), CHAIN).joint_names == NAMES
    assert path_to_time(path(joint_names=list(NAMES)), CHAIN).joint_names == NAMES
    assert path_to_time(path(joint_names=["b", "a"]), None).joint_names == ("b", "a")
    assert path_to_time(path(), None).joint_names == ("joint1", "joint2")
