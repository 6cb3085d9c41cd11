"""Configurations hardly outside their limits, and those that are too far outside."""

import numpy as np
import pytest

from planning.preflight.limits import (
    goal_onto_limits,
    moved_note,
    rates_onto_limits,
    snap_to_limits,
)
from tests.planning.scenes import HOME, builtin

CHAIN = builtin("panda").chain
LOWER, UPPER = CHAIN.limits.lower, CHAIN.limits.upper


def test_inside_nothing_is_moved() -> None:
    for q in (HOME, LOWER, UPPER):
        snapped, violation = snap_to_limits(CHAIN, q, 0.0)
        assert violation is None
        np.testing.assert_array_equal(snapped, q)


@pytest.mark.parametrize("joint", range(7))
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_hardly_outside_is_moved_onto_the_limit(joint: int, sign: float) -> None:
    limit = (LOWER if sign < 0.0 else UPPER)[joint]
    q = HOME.copy()
    q[joint] = limit + sign * 1e-7
    snapped, violation = snap_to_limits(CHAIN, q, 1e-6)
    assert violation is None
    assert snapped[joint] == limit
    np.testing.assert_array_equal(np.delete(snapped, joint), np.delete(HOME, joint))


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_farther_outside_is_left_and_the_worst_joint_is_named(sign: float) -> None:
    limits = LOWER if sign < 0.0 else UPPER
    q = HOME.copy()
    q[1], q[4] = limits[1] + sign * 1e-3, limits[4] + sign * 0.25
    left, violation = snap_to_limits(CHAIN, q, 1e-6)
    np.testing.assert_array_equal(left, q)
    assert violation is not None
    assert violation.joint == CHAIN.joint_names[4]
    assert violation.limit == limits[4]
    assert violation.value == q[4]
    assert violation.excess == pytest.approx(0.25)
    assert violation.details["excess"] == violation.excess


@pytest.mark.parametrize("seed", range(20))
def test_a_measured_start_may_miss_a_limit_by_a_ten_thousandth_of_it(seed: int) -> None:
    random = np.random.default_rng(seed)
    joint, limits = int(random.integers(7)), (LOWER, UPPER)[seed % 2]
    larger = max(abs(LOWER[joint]), abs(UPPER[joint]))
    for share, taken in ((1e-4, True), (1.2e-4, False)):
        q = HOME.copy()
        q[joint] = limits[joint] + (-1.0, 1.0)[seed % 2] * share * larger
        snapped, violation = snap_to_limits(CHAIN, q, None)
        assert (violation is None) == taken
        assert snapped[joint] == (limits[joint] if taken else q[joint])
        # Nobody measures a goal, and a tolerance that is given is kept.
        assert goal_onto_limits(CHAIN, q, None)[1] is not None
        assert snap_to_limits(CHAIN, q, 1e-6)[1] is not None


def test_measured_rates_may_miss_a_limit_by_a_ten_thousandth_of_it() -> None:
    limits = np.array([2.0, 1.0, np.inf, 0.5])
    rates = np.array([2.0002, -1.0001, 9.0, 0.501])
    moved = rates_onto_limits(rates, limits)
    assert moved.tolist() == [2.0, -1.0, 9.0, 0.501]
    assert moved_note("velocity", rates, moved) == (
        "The velocity was outside a limit by 0.0002 and was moved onto it.",
    )
    assert moved_note("velocity", moved, moved) == ()
