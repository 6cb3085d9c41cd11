"""The closed loop as one equation: reference, saturation, disturbance and rates of the state."""

from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from kinematics.arrays import Array
from kinematics.jacobian import geometric
from kinematics.model.chain import Chain
from kinematics.trajectory.trajectory import Trajectory
from tests.dynamics.samples import pinocchio_model, random_chain
from tests.tracking.samples import slider
from tracking.controllers.adaptive import Adaptive
from tracking.controllers.computed_torque import ComputedTorque
from tracking.simulation.compiled import _loop
from tracking.simulation.disturbance import Disturbance
from tracking.simulation.loop import (
    DISTURBED,
    EVALUATIONS,
    FAILED,
    HELD,
    HOPELESS,
    PIECE,
    Loop,
    add_disturbance,
    command_kernel,
    lyapunov_at,
    rate_kernel,
    reference_kernel,
)
from tracking.simulation.options import SimulationOptions
from tracking.simulation.setup import prepare

CHAIN = random_chain(3, 4, motors=True)
N = CHAIN.n
MOTION = Trajectory(
    CHAIN.joint_names,
    np.array([0.0, 0.4, 1.0]),
    np.random.default_rng(1).uniform(-1.0, 1.0, (2, N, 4)),
)
#: At t = 0.7, in the second piece.
T, SECOND = 0.7, 1


def loop(
    chain: Chain = CHAIN, effort: float = np.inf, controller: Any = None, **fields: Any
) -> Loop:
    chain = replace(chain, limits=replace(chain.limits, effort=np.full(chain.n, effort)))
    own = controller or ComputedTorque(chain, np.array(25.0), np.array(10.0))
    acting = Disturbance(**fields) if fields else None
    options = SimulationOptions(saturate=True)
    setup = prepare(own, MOTION, options, chain, (None, None), acting, None)
    law = own.compiled_law(chain)
    assert law is not None
    made = _loop(setup, law)
    made.flags[PIECE] = SECOND
    made.flags[DISTURBED] = int(acting is not None)
    return made


def state(seed: int = 0) -> Array:
    return np.random.default_rng(seed).uniform(-1.0, 1.0, 2 * N)


def acceleration(x: Array, torque: Array) -> Array:
    """What pinocchio says of the arm with its motors."""
    model = pinocchio_model(CHAIN)
    data = model.createData()
    q, qd = x[:N], x[N:]
    M = np.triu(pin.crba(model, data, q))
    M = M + np.triu(M, 1).T
    bias = pin.rnea(model, data, q, qd, np.zeros(N)) + CHAIN.viscous_friction * qd
    return np.asarray(np.linalg.solve(M, torque - bias))


def test_the_reference_is_the_trajectory_and_its_derivatives() -> None:
    made, out = loop(), np.zeros((3, N))
    for t, piece in ((0.0, 0), (0.2, 0), (0.4, 0), (0.4, 1), (0.9, 1)):
        reference_kernel(made.breaks, made.coefficients, piece, t, out)
        u = t - MOTION.breaks[piece]
        for j in range(N):
            p = np.polynomial.Polynomial(MOTION.coefficients[piece, j])
            expected = [p(u), p.deriv()(u), p.deriv(2)(u)]
            np.testing.assert_allclose(out[:, j], expected, rtol=1e-12, atol=1e-12)


def test_after_the_end_the_reference_rests() -> None:
    made, out = loop(), np.zeros((3, N))
    reference_kernel(made.breaks, made.coefficients, 2, 7.0, out)
    np.testing.assert_allclose(out[0], MOTION.end)
    np.testing.assert_array_equal(out[1:], 0.0)


def test_torques_are_cut_off_at_the_effort_limit_on_both_sides() -> None:
    free, x, command = loop(), state(), np.zeros(N)
    command_kernel(free, T, x, command)
    np.testing.assert_array_equal(command, free.asked)
    assert command.min() < -1.0 < 1.0 < command.max()
    cut = loop(effort=1.0)
    command_kernel(cut, T, x, command)
    np.testing.assert_allclose(command, np.clip(free.asked, -1.0, 1.0))
    np.testing.assert_allclose(cut.asked, free.asked)


def test_noise_is_seen_by_the_controller_alone() -> None:
    noisy, clean, x = loop(), loop(), state()
    noisy.noise[:] = np.random.default_rng(2).normal(size=(2, N))
    seen, command = np.zeros(N), np.zeros(N)
    command_kernel(noisy, T, x, seen)
    shifted = x + noisy.noise.ravel()
    command_kernel(clean, T, shifted, command)
    np.testing.assert_array_equal(seen, command)
    rate = np.zeros(2 * N)
    assert lyapunov_at(noisy, T, x, rate)[0] == lyapunov_at(clean, T, x, rate)[0]


def test_a_wrench_pushes_the_joints_by_the_transposed_jacobian() -> None:
    F = np.array([1.0, -2.0, 3.0, 0.4, 0.5, -0.6])
    made, q, torque = loop(wrench=F), state()[:N], np.zeros(N)
    add_disturbance(made, T, q, torque)
    np.testing.assert_allclose(torque, geometric(CHAIN, q).T @ F, rtol=1e-9, atol=1e-9)
    for part in range(6):
        single, torque = np.eye(6)[part], np.zeros(N)
        add_disturbance(loop(wrench=single), T, q, torque)
        np.testing.assert_allclose(torque, geometric(CHAIN, q)[part], rtol=1e-9, atol=1e-9)


def test_a_disturbance_is_added_to_what_is_there() -> None:
    made, torque = loop(torque=np.arange(4.0), amplitude=2.0, frequency=3.0), np.full(N, 10.0)
    add_disturbance(made, T, state()[:N], torque)
    np.testing.assert_allclose(torque, 10.0 + np.arange(4.0) + 2.0 * np.sin(6.0 * np.pi * T))


@pytest.mark.parametrize("seed", range(5))
def test_the_robot_accelerates_as_pinocchio_says(seed: int) -> None:
    made, x, rate = loop(torque=1.5), state(seed), np.zeros(2 * N)
    rate_kernel(made, T, x, rate)
    np.testing.assert_array_equal(rate[:N], x[N:])
    np.testing.assert_allclose(rate[N:], acceleration(x, made.command + 1.5), rtol=1e-7, atol=1e-7)
    made.flags[DISTURBED] = 0
    rate_kernel(made, T, x, rate)
    np.testing.assert_allclose(rate[N:], acceleration(x, made.command), rtol=1e-7, atol=1e-7)


def test_a_held_torque_is_not_asked_for_again() -> None:
    made, x, rate = loop(), state(), np.zeros(2 * N)
    made.flags[HELD] = 1
    made.command[:] = [0.5, -0.5, 0.25, 0.0]
    rate_kernel(made, T, x, rate)
    np.testing.assert_array_equal(made.command, [0.5, -0.5, 0.25, 0.0])
    np.testing.assert_allclose(rate[N:], acceleration(x, made.command), rtol=1e-7, atol=1e-7)


def test_the_estimate_is_part_of_the_state() -> None:
    adaptive = Adaptive(CHAIN, np.array(2.0), np.array(3.0), np.array(0.4))
    made = loop(controller=adaptive)
    count = adaptive.parameters.count
    x = np.concatenate([state(), adaptive.estimate + 0.1])
    rate = np.zeros(len(x))
    rate_kernel(made, T, x, rate)
    np.testing.assert_array_equal(rate[2 * N :], made.command[N:])
    assert rate[2 * N :].shape == (count,)
    assert np.abs(rate[2 * N :]).max() > 1e-3


def test_every_evaluation_is_counted() -> None:
    made, rate = loop(), np.zeros(2 * N)
    for count in range(1, 4):
        rate_kernel(made, T, state(), rate)
        assert made.flags[EVALUATIONS] == count


@pytest.mark.parametrize("value", [HOPELESS, -HOPELESS, np.inf, np.nan])
@pytest.mark.parametrize("place", [0, N, 2 * N - 1])
def test_a_hopeless_state_has_no_rate(value: float, place: int) -> None:
    made, x, rate = loop(), state(), np.zeros(2 * N)
    x[place] = value
    rate_kernel(made, T, x, rate)
    assert np.isnan(rate).all()
    assert made.flags[FAILED] == 0
    x[place] = 0.999 * HOPELESS if place >= N else 0.5
    rate_kernel(made, T, x, rate)
    assert not np.isnan(rate[:N]).any()


def test_a_joint_without_mass_is_named() -> None:
    chain = slider(mass=0.0, effort=5.0)
    own = ComputedTorque(slider(), np.array(1.0), np.array(1.0))
    still = Trajectory(chain.joint_names, np.array([0.0, 1.0]), np.zeros((1, 1, 1)))
    setup = prepare(own, still, SimulationOptions(), chain, (None, None), None, None)
    law = own.compiled_law(chain)
    assert law is not None
    made, rate = _loop(setup, law), np.zeros(2)
    rate_kernel(made, 0.0, np.zeros(2), rate)
    assert made.flags[FAILED] == 1
    assert np.isnan(rate).all()
