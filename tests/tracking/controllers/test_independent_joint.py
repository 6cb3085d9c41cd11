"""Independent joint control: exact for the motors alone, with the arm as its disturbance."""

from dataclasses import replace

import numpy as np
import pytest

from kinematics.errors import InvalidOption
from tests.dynamics.samples import planar_rr
from tests.tracking.samples import linear_response, slider, smooth
from tracking.controllers.independent_joint import IndependentJoint
from tracking.simulation.simulation import SimulationOptions, simulate

FREE = SimulationOptions(relative_tolerance=1e-10, absolute_tolerance=1e-12, saturate=False)


def test_error_of_one_joint_has_the_placed_poles() -> None:
    mass, b, Kp, Kd = 2.0, 0.7, 50.0, 6.0
    chain = slider(mass, b)
    controller = IndependentJoint(chain, np.array(Kp), np.array(Kd), np.array([mass]))
    result = simulate(
        controller, smooth(chain, np.zeros(1), np.ones(1)), FREE, initial_position=[0.2]
    )
    A = np.array([[0.0, 1.0], [-Kp / mass, -(b + Kd) / mass]])
    expected = linear_response(A, np.array([-0.2, 0.0]), result.times)[:, 0]
    np.testing.assert_allclose(result.tracking_error[:, 0], expected, atol=1e-9)
    assert (np.diff(result.lyapunov) <= 0.0).all()


def test_strong_gears_make_the_arm_a_small_disturbance() -> None:
    arm = planar_rr()
    errors = []
    for motor in (1.0, 100.0):
        geared = replace(
            arm, motor_inertia=np.full(2, motor), viscous_friction=np.full(2, 0.1 * motor)
        )
        controller = IndependentJoint(geared, np.array(100.0 * motor), np.array(20.0 * motor))
        trajectory = smooth(geared, np.zeros(2), np.ones(2))
        errors.append(simulate(controller, trajectory, FREE).max_tracking_error.max())
    assert errors[1] < 0.02 * errors[0]


def test_steady_state_error_is_the_load_over_the_stiffness() -> None:
    arm = replace(planar_rr(), viscous_friction=np.array([1.0, 1.0]))
    Kp = np.array([2000.0, 1000.0])
    goal = np.array([0.3, 0.4])
    result = simulate(
        IndependentJoint(arm, Kp, np.array([60.0, 20.0])),
        smooth(arm, goal - 0.1, goal),
        replace(FREE, duration=3.0, sample_period=0.1),
    )
    q1, q12 = result.position[-1, 0], result.position[-1].sum()
    g2 = 1.5 * 0.2 * 9.81 * np.cos(q12)
    G = np.array([(2.0 * 0.3 + 1.5 * 0.7) * 9.81 * np.cos(q1) + g2, g2])
    np.testing.assert_allclose(result.tracking_error[-1], G / Kp, rtol=1e-6)
    assert not result.settled


@pytest.mark.parametrize("inertia", [[1.0], [1.0, -1.0], [1.0, np.nan]])
def test_wrong_inertias_are_refused(inertia: list[float]) -> None:
    with pytest.raises(InvalidOption, match="2 numbers"):
        IndependentJoint(planar_rr(), np.array(1.0), np.array(1.0), np.array(inertia))
