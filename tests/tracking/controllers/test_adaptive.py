"""Adaptive control: the error vanishes, V never grows, and excitation decides what is learned."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import cumulative_simpson

from dynamics.model.body import scale_masses
from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from kinematics.model.chain import Chain
from kinematics.robots import builtin_chain
from kinematics.trajectory.trajectory import Trajectory, interpolate
from tests.dynamics.samples import cart_pendulum, planar_rr, random_chain
from tracking.controllers.controller import Reference
from tracking.controllers.model_based import Adaptive, Passivity
from tracking.simulation.references import sine
from tracking.simulation.simulation import SimulationOptions, simulate

FREE = SimulationOptions(saturate=False, sample_period=5e-3)


def wave(chain: Chain, frequencies: Array, duration: float, step: float = 0.02) -> Trajectory:
    """Sums of sines of their own for each joint, as quintics through samples of them."""
    t = np.arange(0.0, duration + step / 2, step)
    w = 2.0 * np.pi * frequencies[:, None, :]
    phase = np.linspace(0.0, 1.0, w.size).reshape(w.shape)
    angle = w * t[:, None] + phase
    parts = [np.sin(angle), w * np.cos(angle), -(w**2) * np.sin(angle)]
    q, qd, qdd = (0.4 * part.sum(axis=0) for part in parts)
    return interpolate(chain.joint_names, t, q, "quintic", qd, qdd)


def arm(Gamma: float = 2.0, *, error: float = 1.3) -> tuple[Adaptive, Chain]:
    """The notes' planar arm, of which the model has the masses wrong; and the true one."""
    true = planar_rr()
    wrong = scale_masses(true, error)
    return Adaptive(wrong, np.array(8.0), np.array(6.0), np.array(Gamma)), true


@pytest.mark.parametrize("seed", range(4))
def test_lyapunov_function_never_grows(seed: int) -> None:
    true = random_chain(seed, 2 + seed % 3, motors=seed % 2 == 0)
    rng = np.random.default_rng(seed)
    wrong = scale_masses(true, rng.uniform(0.6, 1.5, true.n))
    A = rng.normal(size=(true.n, true.n))
    Lambda, K = 5.0, 4.0 * np.eye(true.n) + A @ A.T
    controller = Adaptive(wrong, np.array(Lambda), K, np.array(0.5))
    trajectory = wave(true, rng.uniform(0.2, 0.6, (1, true.n)), 3.0)
    start = trajectory.start + 0.2
    result = simulate(controller, trajectory, FREE, robot=true, initial_position=start)
    V, e = result.lyapunov, result.tracking_error
    assert V[0] > 0.0
    assert (np.diff(V) <= 1e-9 * V[0]).all()
    # V_dot = -e_dot^T K e_dot - e^T Lambda K Lambda e
    e_dot = result.reference_velocity - result.velocity
    spent = np.einsum("mi,ij,mj->m", e_dot, K, e_dot)
    spent += Lambda**2 * np.einsum("mi,ij,mj->m", e, K, e)
    total = cumulative_simpson(spent, x=result.times, initial=0.0)
    np.testing.assert_allclose(V[0] - V, total, atol=2e-4 * V[0])


def test_error_vanishes_while_parameters_need_not_converge() -> None:
    controller, true = arm(Gamma=10.0)
    # Only the second joint moves: nothing tells the parameters of the first.
    trajectory = wave(true, np.array([[0.0, 0.5]]), 200.0, 0.05)
    options = replace(FREE, sample_period=0.05)
    result = simulate(controller, trajectory, options, robot=true)
    e = np.abs(result.tracking_error).max(axis=1)
    assert e[: len(e) // 6].max() > 5e-3
    assert e[-len(e) // 6 :].max() < 0.02 * e.max()
    beta = controller.parameters.of(true)
    first = controller.parameters.names.index("Izz1 + 0.49 m2")
    off = np.abs(result.estimate[-1] - beta)
    assert off[first] > 0.5 * abs(controller.estimate[first] - beta[first])


def test_parameters_converge_under_persistent_excitation() -> None:
    controller, true = arm(Gamma=10.0)
    frequencies = np.array([[0.31, 0.47], [0.83, 0.59], [1.27, 1.51]])
    trajectory = wave(true, frequencies, 40.0)
    options = replace(FREE, sample_period=0.05, relative_tolerance=1e-7)
    result = simulate(controller, trajectory, options, robot=true)
    beta = controller.parameters.of(true)
    off = np.linalg.norm(result.estimate - beta, axis=1)
    assert off[-1] < 0.01 * off[0]
    assert np.abs(result.tracking_error[-100:]).max() < 0.02 * result.max_tracking_error.max()


def test_learns_from_nothing() -> None:
    true = cart_pendulum()
    controller = Adaptive(true, np.array(5.0), np.array(8.0), np.array(2.0))
    blank = controller.with_estimate(np.zeros(controller.parameters.count))
    trajectory = wave(true, np.array([[0.3, 0.4]]), 40.0)
    result = simulate(blank, trajectory, replace(FREE, sample_period=0.05))
    e = np.abs(result.tracking_error).max(axis=1)
    assert e[-40:].max() < 0.05 * e.max()
    assert (np.diff(result.lyapunov) <= 1e-9 * result.lyapunov[0]).all()


def test_without_learning_it_is_passivity_based_control() -> None:
    chain = random_chain(4, 4, motors=True)
    adaptive = Adaptive(chain, np.array(3.0), np.array(2.0), np.array(1e-12))
    passive = Passivity(chain, np.array(3.0), np.array(2.0))
    rng = np.random.default_rng(0)
    for _ in range(20):
        q, qd, a, b, c = rng.uniform(-2, 2, (5, 4))
        reference = Reference(a, b, c)
        np.testing.assert_allclose(
            adaptive.torque(0.0, q, qd, reference),
            passive.torque(0.0, q, qd, reference),
            rtol=1e-9,
            atol=1e-9,
        )
        assert adaptive.lyapunov(q, qd, reference) == pytest.approx(
            passive.lyapunov(q, qd, reference)
        )


def test_motors_are_learned_where_there_are_any() -> None:
    chain = builtin_chain("planar_rr")
    assert Adaptive(chain, np.array(1.0), np.array(1.0), np.array(1.0)).parameters.count == 6
    driven = replace(chain, viscous_friction=np.array([0.1, 0.1]))
    controller = Adaptive(driven, np.array(1.0), np.array(1.0), np.array(1.0))
    assert controller.parameters.count == 9
    names = " ".join(controller.parameters.names)
    assert "B1" in names
    assert "J2" in names


ARM = planar_rr()
ONE = np.array(1.0)
OPTIONS = SimulationOptions(
    saturate=False, relative_tolerance=1e-11, absolute_tolerance=1e-12, sample_period=0.01
)


def chosen(*names: str, Gamma: float = 3.0) -> Adaptive:
    return Adaptive(
        ARM, np.array(5.0), np.array(8.0), np.array(Gamma), known_zeros=True, learned=names
    )


def test_the_lecture_s_models_have_four_and_three_parameters() -> None:
    assert Adaptive(ARM, ONE, ONE, ONE, known_zeros=True).parameters.count == 4
    cart = replace(cart_pendulum(), viscous_friction=np.zeros(2))
    assert Adaptive(cart, ONE, ONE, ONE, known_zeros=True, motors=False).parameters.count == 3


def test_only_what_is_chosen_is_learned_and_its_v_falls() -> None:
    controller = chosen("mx2", "Izz2")
    assert [name.split()[0] for name in controller.parameters.names] == ["mx2", "Izz2"]
    start = replace(controller, estimate=1.5 * controller.estimate)
    motion = sine(ARM, [0.3, -0.2], 0.4, [0.6, 0.9], 0.0, 3.0)
    result = simulate(start, motion, OPTIONS)
    assert result.estimate.shape[1] == 2
    e = result.tracking_error
    e_dot = result.reference_velocity - result.velocity
    # The proof of lecture 34 holds, as what is not learned is exact.
    expected = -8.0 * (e_dot**2 + 25.0 * e**2).sum(axis=1)
    np.testing.assert_allclose(result.lyapunov_rate, expected, atol=1e-7)
    assert (np.diff(result.lyapunov) < 1e-9).all()
    assert np.abs(e[-50:]).max() < 0.3 * np.abs(e).max()


def test_with_all_parameters_at_the_model_s_it_learns_them_all() -> None:
    rng, whole = np.random.default_rng(0), Adaptive(ARM, np.array(5.0), np.array(8.0), ONE)
    q, qd = rng.uniform(-1.0, 1.0, (2, 2))
    at = Reference(*rng.uniform(-1.0, 1.0, (3, 2)))
    expected = whole.torque(0.0, q, qd, at)
    np.testing.assert_allclose(chosen("mx2").torque(0.0, q, qd, at), expected, rtol=1e-9)


def test_unknown_and_missing_names_are_refused() -> None:
    with pytest.raises(InvalidOption, match="'mx7' is unknown"):
        chosen("mx7")
    with pytest.raises(InvalidOption, match="no base parameter is learned"):
        Adaptive(ARM, ONE, ONE, ONE, learned=())
