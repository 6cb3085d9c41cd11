"""Use of limits by a tracked motion, from its bounds."""

import numpy as np
import pytest

from kinematics.model.chain import Limits
from tracking.tube.limit_use import limit_uses
from tracking.tube.motion_bounds import MotionBounds, bound_step, empty_bounds

LIMITS = Limits(
    lower=np.array([-1.0, -np.inf]),
    upper=np.array([3.0, np.inf]),
    velocity=np.array([2.0, 4.0]),
    acceleration=np.full(2, np.inf),
    jerk=np.full(2, np.inf),
    effort=np.array([10.0, np.inf]),
)


def moving() -> MotionBounds:
    """Joint 1 from 0 to 2.5 at 2.5/s, joint 2 from 0 to -6 at -6/s, in one second."""
    bounds = empty_bounds(1.0, 2)
    motion = np.zeros((4, 8))
    motion[:2, 1] = 2.5, -6.0
    motion[2:, 0] = 2.5, -6.0
    bound_step(bounds, np.zeros((2, 1)), 0.0, motion, 0.0, 1.0)
    bounds.peak_torque[:] = 4.0, 100.0
    return bounds


def test_ratios_are_of_the_worst_joint() -> None:
    uses = limit_uses(moving(), LIMITS)
    # |2.5 - 1| / 2; |-6| / 4 beats 2.5 / 2; no torque limit of joint 2 is known.
    ratios = {name: use.ratio for name, use in uses.items()}
    assert ratios == pytest.approx({"position": 0.75, "velocity": 1.5, "torque": 0.4})
    assert {name: use.joint for name, use in uses.items()} == {
        "position": 0, "velocity": 1, "torque": 0,
    }  # fmt: skip


def test_the_start_counts_as_well_as_the_end() -> None:
    bounds = moving()
    farther = bounds._replace(global_error=np.array([[1.25, 0.0], [0.5, 0.0]]))
    uses = limit_uses(farther, LIMITS)
    assert uses["position"].ratio == pytest.approx((2.5 + 1.25 - 1.0) / 2.0)
    # |-6| / 4 of the other joint is still the most.
    assert uses["velocity"].ratio == pytest.approx(1.5)


def test_unknown_limits_have_no_ratio() -> None:
    assert limit_uses(moving(), Limits.unlimited(2)) == {}
    assert limit_uses(empty_bounds(1.0, 2), LIMITS) == {}
