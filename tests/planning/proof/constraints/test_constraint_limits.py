"""Limits that constraints themselves put on a motion."""

from dataclasses import replace

import numpy as np
import pytest

from kinematics.errors import MissingLimit
from kinematics.robots import builtin_chain
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.kinds.constraint import (
    ClearanceConstraint,
    ToolSpeedConstraint,
    TorqueConstraint,
)
from planning.proof.constraints.constraint_limits import constrained_efforts, constrained_margin
from planning.values.limits import EffortLimits

PANDA = builtin_chain("panda")


def given(
    *constraints: ClearanceConstraint | ToolSpeedConstraint | TorqueConstraint,
) -> ConstraintSet:
    """Constraints on the Panda."""
    return ConstraintSet(PANDA, constraints)


def test_the_largest_clearance_counts() -> None:
    both = given(ClearanceConstraint(0.01), ClearanceConstraint(0.03))
    assert constrained_margin(0.02, both) == 0.03
    assert constrained_margin(0.05, both) == 0.05
    assert constrained_margin(0.02, None) == 0.02


def test_the_strictest_limit_of_each_kind_counts() -> None:
    first, second = [80.0, 10.0, 90.0, 90.0, 10.0, 10.0, 10.0], [20.0] * 7
    asked = given(
        ToolSpeedConstraint(0.5), ToolSpeedConstraint(0.2),
        TorqueConstraint(first), TorqueConstraint(second),
    )  # fmt: skip
    limits = constrained_efforts(None, asked, PANDA)
    assert limits is not None
    assert limits.tool_speed == 0.2
    assert limits.effort is not None
    assert np.array_equal(limits.effort, np.minimum(first, second))
    stricter = EffortLimits(PANDA, np.full(7, 15.0), 0.1)
    limits = constrained_efforts(stricter, asked, PANDA)
    assert limits is not None
    assert limits.tool_speed == 0.1
    assert limits.effort is not None
    assert np.array_equal(limits.effort, np.minimum(np.minimum(first, second), 15.0))


def test_torques_without_numbers_are_the_robots() -> None:
    limits = constrained_efforts(None, given(TorqueConstraint()), PANDA)
    assert limits is not None
    assert limits.effort is not None
    assert np.array_equal(limits.effort, PANDA.limits.effort)
    assert limits.tool_speed is None


def test_limits_are_as_given_where_no_constraint_says_more() -> None:
    loads = EffortLimits(PANDA, np.full(7, 15.0), 0.1)
    assert constrained_efforts(loads, None, PANDA) is loads
    assert constrained_efforts(loads, given(ClearanceConstraint(0.1)), PANDA) is loads
    assert constrained_efforts(None, None, PANDA) is None


def test_a_torque_limit_that_is_not_known_is_named() -> None:
    unknown = replace(PANDA, limits=replace(PANDA.limits, effort=np.full(7, np.nan)))
    with pytest.raises(MissingLimit):
        constrained_efforts(None, ConstraintSet(unknown, (TorqueConstraint(),)), unknown)
