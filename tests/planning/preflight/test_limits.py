"""Configurations hardly outside their limits, and those that are too far outside."""

import numpy as np
import pytest

from planning.preflight.limits import snap_to_limits
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
