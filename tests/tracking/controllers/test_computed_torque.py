"""Computed torque and independent joints: poles as placed, exact where their model is."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import cumulative_simpson

from kinematics.errors import InvalidOption
from tests.dynamics.samples import planar_rr, random_chain
from tests.tracking.samples import constant, linear_response, slider, smooth
from tracking.controllers.independent_joint import IndependentJoint
from tracking.controllers.model_based import ComputedTorque, PdGravity
from tracking.simulation.simulation import SimulationOptions, simulate

FINE = SimulationOptions(relative_tolerance=1e-10, absolute_tolerance=1e-12, saturate=False)


@pytest.mark.parametrize("seed", range(4))
def test_error_follows_the_placed_poles(seed: int) -> None:
    chain = random_chain(seed, 1 + seed, motors=True)
    rng = np.random.default_rng(seed)
    start, end, offset, push = rng.uniform(-1, 1, (4, chain.n))
    # From underdamped to overdamped, never exactly critical (that case is below).
    Kp, Kd = rng.uniform(20.0, 80.0, chain.n), rng.uniform(4.0, 30.0, chain.n)
    trajectory = smooth(chain, start, end)
    result = simulate(
        ComputedTorque(chain, Kp, Kd),
        trajectory,
        FINE,
        initial_position=start + 0.3 * offset,
        initial_velocity=push,
    )
    for j in range(chain.n):
        A = np.array([[0.0, 1.0], [-Kp[j], -Kd[j]]])
        x = np.array([-0.3 * offset[j], -push[j]])
        expected = linear_response(A, x, result.times)[:, 0]
        np.testing.assert_allclose(result.tracking_error[:, j], expected, atol=1e-8)


@pytest.mark.parametrize("tolerance", [1e-6, 1e-8, 1e-10])
def test_an_exact_model_tracks_to_the_tolerance(tolerance: float) -> None:
    chain = random_chain(5, 6)
    options = SimulationOptions(
        relative_tolerance=tolerance, absolute_tolerance=tolerance, saturate=False
    )
    trajectory = smooth(chain, np.zeros(6), np.linspace(-2.0, 2.0, 6))
    result = simulate(ComputedTorque(chain, np.array(100.0), np.array(20.0)), trajectory, options)
    assert result.max_tracking_error.max() < 10.0 * tolerance
    assert result.settled
    assert result.settling_time == 0.0


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


OPTIONS = SimulationOptions(duration=2.0, sample_period=2e-3, saturate=False)


@pytest.mark.parametrize("seed", range(4))
def test_lyapunov_function_never_grows(seed: int) -> None:
    chain = random_chain(seed, 2 + seed, motors=seed % 2 == 0)
    rng = np.random.default_rng(seed)
    A, B = rng.normal(size=(2, chain.n, chain.n))
    Kp = 20.0 * np.eye(chain.n) + A @ A.T
    Kd = 2.0 * np.eye(chain.n) + B @ B.T
    goal, offset = rng.uniform(-1, 1, (2, chain.n))
    result = simulate(
        PdGravity(chain, Kp, Kd), constant(chain, goal), OPTIONS, initial_position=goal + offset
    )
    V, qd = result.lyapunov, result.velocity
    assert V[-1] < 0.5 * V[0]
    assert (np.diff(V) <= 1e-9 * V[0]).all()
    # V_dot = -q_dot^T (B + K_d) q_dot
    spent = np.einsum("mi,ij,mj->m", qd, Kd + np.diag(chain.viscous_friction), qd)
    total = cumulative_simpson(spent, x=result.times, initial=0.0)
    np.testing.assert_allclose(V[0] - V, total, atol=1e-4 * V[0])


def test_arrives_at_a_constant_reference() -> None:
    chain, goal = random_chain(3, 4), np.array([0.3, -0.2, 0.5, 0.1])
    options = SimulationOptions(duration=20.0, sample_period=0.1, saturate=False)
    result = simulate(
        PdGravity(chain, np.array(100.0), np.array(40.0)),
        constant(chain, goal),
        options,
        initial_position=goal + 0.5,
    )
    assert result.settled
    assert np.abs(result.tracking_error[-1]).max() < 1e-3


def test_a_moving_reference_is_followed_with_a_lag() -> None:
    chain = random_chain(3, 4)
    trajectory = smooth(chain, np.zeros(4), np.ones(4))
    options = SimulationOptions(saturate=False)
    soft, stiff = (
        simulate(PdGravity(chain, np.array(k), np.array(0.2 * k)), trajectory, options)
        for k in (100.0, 1000.0)
    )
    assert stiff.max_tracking_error.max() < 0.2 * soft.max_tracking_error.max()
    assert stiff.max_tracking_error.max() > 1e-4
