"""Braking as hard as limits allow, against motions of the least time by ruckig."""

import numpy as np
import pytest
import ruckig

from obstacles.collision.checker import Checker
from obstacles.scenes.scene import Scene
from planning.pipeline.optimize_stage import _braking, first_touch
from tests.planning.scenes import builtin

VELOCITY = np.array([2.0, -0.3, 0.0])
ACCELERATION = np.array([4.0, 2.0, 1.0])


@pytest.mark.parametrize("jerk", [40.0, 5.0, np.inf])
def test_joints_stop_as_ruckig_stops_them(jerk: float) -> None:
    times, states = _braking(np.zeros(3), VELOCITY, ACCELERATION, np.full(3, jerk))
    for joint in range(2):
        asked = ruckig.InputParameter(1)
        asked.control_interface = ruckig.ControlInterface.Velocity
        asked.current_velocity = [float(VELOCITY[joint])]
        asked.max_acceleration = [float(ACCELERATION[joint])]
        asked.max_jerk = [jerk]
        motion = ruckig.Trajectory(1)
        ruckig.Ruckig(1).calculate(asked, motion)
        for time, state in zip(times, states[:, joint], strict=True):
            (place,), _, _ = motion.at_time(min(float(time), motion.duration))
            assert state == pytest.approx(place, abs=1e-9)
    assert not states[:, 2].any()


def test_nothing_is_met_where_nothing_is() -> None:
    robot = builtin("planar_rr")
    checker = Checker.of(robot, Scene())
    assert first_touch(checker, np.zeros(2), np.ones(2), np.ones(2)) is None
