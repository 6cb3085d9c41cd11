"""Torques and tool speed along motions against pinocchio."""

import numpy as np
import pytest

from planning.optimize.iterate import Iterate
from planning.optimize.response import tool_speed, torques
from tests.planning.optimize.motions import PANDA, SPACE, iterate
from tests.planning.pinocchio_panda import PinocchioPanda

ORACLE = PinocchioPanda()
U = np.linspace(0.0, 1.0, 7)


@pytest.mark.parametrize("duration", [0.4, 1.3, 6.0])
def test_values_are_pinocchios_in_time(duration: float) -> None:
    at = Iterate(SPACE, iterate(2).points, duration)
    tau, speed = torques(PANDA, at, U), tool_speed(PANDA, at, U)
    assert tau.values.shape == (len(U), 7)
    assert speed.values.shape == (len(U), 1)
    for k, u in enumerate(U):
        q, qd, qdd = (at.sample(np.array([u]), r)[0] / duration**r for r in range(3))
        wanted = ORACLE.torque(q, qd, qdd) + PANDA.viscous_friction * qd
        np.testing.assert_allclose(tau.values[k], wanted, atol=1e-9 * np.abs(wanted).max())
        fastest = float(np.linalg.norm(ORACLE.tip_velocity(q, qd)))
        assert speed.values[k, 0] == pytest.approx(fastest, abs=1e-4)


def test_at_rest_the_tool_stands_and_its_speed_still_has_a_slope() -> None:
    at = Iterate(SPACE, np.tile(iterate(3).points[:1], (SPACE.count, 1)), 1.0)
    found = tool_speed(PANDA, at, U)
    assert found.values.max() < 1e-4
    assert all(np.isfinite(gradient).all() for gradient in found.gradients)
    assert np.isfinite(found.in_time).all()
    held = torques(PANDA, at, U)
    still = ORACLE.torque(at.points[0], np.zeros(7), np.zeros(7))
    np.testing.assert_allclose(held.values, np.tile(still, (len(U), 1)), atol=1e-9)
    np.testing.assert_allclose(held.in_time, 0.0, atol=1e-9)


def test_a_motion_twice_as_slow_has_half_the_tool_speed() -> None:
    at = iterate(4)
    slow = Iterate(SPACE, at.points, 2.0 * at.duration)
    np.testing.assert_allclose(
        tool_speed(PANDA, at, U).values, 2.0 * tool_speed(PANDA, slow, U).values, atol=1e-4
    )
