"""Limits of tool speed and torque that constraints put on motions."""

import numpy as np
import pytest

from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.kinds.limit import ToolSpeedConstraint, TorqueConstraint
from planning.options import Options, with_limits
from planning.proof.constraints.constraint_limits import constrained_efforts
from planning.timing.options import TimingOptions
from tests.planning.scenes import builtin

CHAIN = builtin("panda").chain
EFFORT = np.array(CHAIN.limits.effort)


def constraints(*items: ToolSpeedConstraint | TorqueConstraint) -> ConstraintSet:
    return ConstraintSet(CHAIN, items)


@pytest.mark.parametrize(("asked", "least"), [(None, 0.3), (0.2, 0.2), (0.5, 0.3)])
def test_the_lower_tool_speed_counts(asked: float | None, least: float) -> None:
    options = Options(timing=TimingOptions(tool_speed=asked))
    limited = with_limits(options, constraints(ToolSpeedConstraint(0.3)))
    assert limited.timing.tool_speed == least
    assert not limited.timing.torque_limits
    assert with_limits(options, None) is options


def test_torque_constraints_turn_torque_limits_on_and_only_lower_them() -> None:
    plain = with_limits(Options(), constraints(TorqueConstraint()))
    assert plain.timing.torque_limits
    assert "effort" not in plain.limits
    lower = 0.5 * EFFORT
    lower[0] = 2.0 * EFFORT[0]
    options = Options(limits={"effort": EFFORT})
    limited = with_limits(options, constraints(TorqueConstraint(tuple(lower))))
    np.testing.assert_array_equal(limited.limits["effort"], np.minimum(lower, EFFORT))


def test_foreign_motions_are_held_to_the_same_limits() -> None:
    assert constrained_efforts(None, None, CHAIN) is None
    assert constrained_efforts(None, constraints(), CHAIN) is None
    both = constrained_efforts(
        None, constraints(ToolSpeedConstraint(0.3), TorqueConstraint()), CHAIN
    )
    assert both is not None
    assert both.tool_speed == 0.3
    assert both.effort is not None
    np.testing.assert_array_equal(both.effort, EFFORT)
    lower = tuple(0.5 * EFFORT)
    again = constrained_efforts(
        both, constraints(ToolSpeedConstraint(0.4), TorqueConstraint(lower)), CHAIN
    )
    assert again is not None
    assert again.tool_speed == 0.3
    assert again.effort is not None
    np.testing.assert_array_equal(again.effort, lower)
