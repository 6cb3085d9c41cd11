"""Controllers, adaptive ones too: formulas, poles, Lyapunov functions, refusals."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike

from dynamics.model.body import scale_masses
from dynamics.parameters.regressor import reference_regressor
from dynamics.terms import augmented_mass_matrix, coriolis_matrix, gravity_vector
from kinematics.arrays import Array
from kinematics.errors import InvalidOption, InvalidRobotState
from kinematics.model.chain import Chain
from kinematics.robots import builtin_chain
from kinematics.trajectory.trajectory import Trajectory, interpolate
from tests.dynamics.samples import cart_pendulum, planar_rr, random_chain
from tests.tracking.samples import constant, linear_response, smooth
from tracking.controllers.control_law import Kind
from tracking.controllers.controller import Controller, Flow, LawController, Reference
from tracking.controllers.gain import commute, gain_matrix, gain_vector
from tracking.controllers.model_based import (
    Adaptive,
    ComputedTorque,
    IndependentJoint,
    Passivity,
    PdGravity,
)
from tracking.simulation import callback
from tracking.simulation.references import sine
from tracking.simulation.result import SimulationResult
from tracking.simulation.setup import prepare
from tracking.simulation.simulation import Disturbance, SimulationOptions, simulate

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


@pytest.mark.parametrize("inertia", [[1.0], [1.0, -1.0], [1.0, np.nan]])
def test_wrong_inertias_are_refused(inertia: list[float]) -> None:
    with pytest.raises(InvalidOption, match="2 numbers"):
        IndependentJoint(planar_rr(), np.array(1.0), np.array(1.0), np.array(inertia))


ARM = random_chain(11, 3, motors=True)
HEAVY = scale_masses(ARM, [1.3, 0.8, 1.1])
RNG = np.random.default_rng(3)
LAMBDA, KP, KD = RNG.uniform(1.0, 5.0, (3, 3))
K = np.diag([6.0, 5.0, 7.0]) + 2.0
LEARNING = Adaptive(ARM, LAMBDA, K, np.array(2.0), learned=("mx3", "Izz3"))
OFF = 0.3
STATES = RNG.uniform(-2.0, 2.0, (5, 6, 3))


def energy_rate(q: Array, qd: Array, r: Array, r_dot: Array) -> float:
    """Rate of r^T M r / 2 of the true robot."""
    M, C = augmented_mass_matrix(HEAVY, q), coriolis_matrix(HEAVY, q, qd)
    return float(r @ (M @ r_dot + C @ r))


@pytest.mark.parametrize(("q", "qd", "qr", "vr", "ar", "qdd"), STATES)
def test_torques_and_functions_are_those_of_the_formulas(
    q: Array, qd: Array, qr: Array, vr: Array, ar: Array, qdd: Array
) -> None:
    at, M, B = Reference(qr, vr, ar), augmented_mass_matrix(ARM, q), ARM.viscous_friction
    C, G, true = (
        coriolis_matrix(ARM, q, qd),
        gravity_vector(ARM, q),
        augmented_mass_matrix(HEAVY, q),
    )
    e, e1, e2, J = qr - q, vr - qd, ar - qdd, ARM.motor_inertia
    r, r1 = e1 + LAMBDA * e, e2 + LAMBDA * e1
    v, a = vr + LAMBDA * e, ar + LAMBDA * e1
    learning = LEARNING.with_estimate(LEARNING.estimate + OFF)
    Y = learning.parameters.regressor(reference_regressor(ARM, q, qd, v, a))
    passive = M @ a + C @ v + B * qd + G + K @ r
    spring, bend = (LAMBDA * e) @ K @ e, (LAMBDA * e) @ K @ e1 + e @ K @ (LAMBDA * e1)
    off = learning.estimate - learning.parameters.of(HEAVY)
    learned = 2.0 * Y.T @ r
    V = 0.5 * r @ true @ r + spring
    V1 = energy_rate(q, qd, r, r1) + bend
    linear = KP + 0.5 * KD**2
    expected: list[tuple[LawController, Array, float, float]] = [
        (IndependentJoint(ARM, KP, KD), J * ar + B * vr + KP * e + KD * e1,
         0.5 * (e1 @ (J * e1) + e @ (KP * e)), e1 @ (J * e2 + KP * e)),
        (ComputedTorque(ARM, KP, KD), M @ (ar + KD * e1 + KP * e) + C @ qd + B * qd + G,
         0.5 * np.sum(e1**2 + linear * e**2 + KD * e * e1),
         np.sum(e1 * (e2 + linear * e) + 0.5 * KD * (e1**2 + e * e2))),
        (PdGravity(ARM, KP, KD), KP * e + KD * e1 + G, 0.5 * (qd @ true @ qd + e @ (KP * e)),
         energy_rate(q, qd, qd, qdd) + e1 @ (KP * e)),
        (Passivity(ARM, LAMBDA, K), passive, V, V1),
        (learning, passive + Y @ np.full(2, OFF), V + 0.25 * off @ off, V1 + 0.5 * off @ learned),
    ]  # fmt: skip
    for used, torque, value, rate in expected:
        flow = Flow(q, qd, qdd, learned if used is learning else np.zeros(0))
        np.testing.assert_allclose(used.torque(0.0, q, qd, at), torque, rtol=1e-9, atol=1e-9)
        assert used.lyapunov(q, qd, at, HEAVY) == pytest.approx(value, rel=1e-9)
        assert used.lyapunov_rate(flow, at, HEAVY) == pytest.approx(rate, rel=1e-9, abs=1e-9)
    np.testing.assert_allclose(learning.adaptation(0.0, q, qd, at), learned, rtol=1e-9)


def test_states_of_another_length_are_refused() -> None:
    at = Reference(*np.zeros((3, 3)))
    with pytest.raises(InvalidRobotState):
        Passivity(ARM, LAMBDA, K).torque(0.0, np.zeros(2), np.zeros(3), at)


def test_k_commutes_with_lambda_where_it_couples_joints_of_equal_lambda() -> None:
    K = np.array([[3.0, 1.0, 0.0], [1.0, 3.0, 0.0], [0.0, 0.0, 2.0]])
    assert commute(np.array([2.0, 2.0, 5.0]), K)
    assert not commute(np.array([2.0, 3.0, 5.0]), K)


CHAIN = random_chain(0, 3)


def test_one_number_serves_all_joints() -> None:
    np.testing.assert_array_equal(gain_vector(CHAIN, "Kp", 4.0), [4.0, 4.0, 4.0])
    np.testing.assert_array_equal(gain_matrix(CHAIN, "Kp", 4.0), 4.0 * np.eye(3))
    np.testing.assert_array_equal(gain_matrix(CHAIN, "Kp", [1, 2, 3]), np.diag([1.0, 2.0, 3.0]))


def test_a_positive_definite_matrix_is_kept() -> None:
    K = np.array([[2.0, 1.0, 0.0], [1.0, 2.0, 0.0], [0.0, 0.0, 1.0]])
    kept = gain_matrix(CHAIN, "K", K)
    np.testing.assert_array_equal(kept, K)
    assert not kept.flags.writeable


@pytest.mark.parametrize(
    ("value", "reason"),
    [
        ([1.0, 2.0], r"shape \(2,\).*3 joints"),
        ([1.0, 0.0, 2.0], "0 at joint 'joint1'"),
        (-1.0, "-1 at joint 'joint0'"),
        (np.nan, "not finite"),
        (["a", "b", "c"], "no array of numbers"),
        ([[1.0, 2.0], [3.0]], "no array of numbers"),
    ],
)
def test_wrong_gains_are_refused(value: ArrayLike, reason: str) -> None:
    for check in (gain_vector, gain_matrix):
        with pytest.raises(InvalidOption, match=reason):
            check(CHAIN, "Kd", value)


def test_wrong_matrices_are_refused() -> None:
    with pytest.raises(InvalidOption, match="not symmetric"):
        gain_matrix(CHAIN, "K", np.eye(3) + np.eye(3, k=1))
    with pytest.raises(InvalidOption, match=r"not positive definite.*-1"):
        gain_matrix(CHAIN, "K", np.diag([1.0, -1.0, 2.0]))
    with pytest.raises(InvalidOption, match=r"shape \(3, 3\)"):
        gain_vector(CHAIN, "Kp", np.eye(3))


N, B = ARM.n, ARM.viscous_friction
RATE_LAMBDA, RATE_K, RATE_KP, RATE_KD = (
    np.array(4.0),
    np.array(6.0),
    np.array(30.0),
    np.array(9.0),
)
TIGHT = SimulationOptions(
    saturate=False, relative_tolerance=1e-12, absolute_tolerance=1e-13, sample_period=1e-3
)
START, END = np.zeros(N), np.array([0.5, -0.4, 0.3])
#: Fourth-order weights of a difference over five samples.
WEIGHTS = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / 12.0
kinds = pytest.mark.parametrize("kind", Kind)


def controller(kind: Kind, model: Chain = ARM) -> Any:
    if kind is Kind.INDEPENDENT_JOINT:
        return IndependentJoint(model, RATE_KP, RATE_KD)
    if kind is Kind.COMPUTED_TORQUE:
        return ComputedTorque(model, RATE_KP, RATE_KD)
    if kind is Kind.PD_GRAVITY:
        return PdGravity(model, RATE_KP, RATE_KD)
    if kind is Kind.PASSIVITY:
        return Passivity(model, RATE_LAMBDA, RATE_K)
    return Adaptive(model, RATE_LAMBDA, RATE_K, np.array(2.0))


#: A K that does not commute with Lambda: no proof covers the controllers that have it.
RATES, COUPLED = np.array([2.0, 5.0, 3.0]), np.diag([6.0, 5.0, 7.0]) + 2.0
coupled = pytest.mark.parametrize(
    "used",
    [Passivity(ARM, RATES, COUPLED), Adaptive(ARM, RATES, COUPLED, np.array(2.0))],
    ids=["passivity", "adaptive"],
)


def run(used: Controller, motion: Any, **options: Any) -> SimulationResult:
    offset = motion.start + np.array([0.2, -0.1, 0.15])
    return simulate(used, motion, TIGHT, robot=ARM, initial_position=offset, **options)


@kinds
@pytest.mark.parametrize("is_disturbed", [False, True])
def test_the_rate_is_the_slope_of_the_function(kind: Kind, is_disturbed: bool) -> None:
    # A moving reference, a wrong model and a disturbance: no proof applies, the rate does.
    used = controller(kind, scale_masses(ARM, 1.3) if is_disturbed else ARM)
    push = Disturbance([1.0, -2.0, 0.5], 0.7, 1.5) if is_disturbed else None
    found = run(used, smooth(ARM, START, END, 0.4), disturbance=push)
    slope = np.convolve(found.lyapunov, WEIGHTS[::-1], "valid") / TIGHT.sample_period
    size = np.abs(found.lyapunov_rate).max()
    assert size > 0.1
    np.testing.assert_allclose(found.lyapunov_rate[2:-2], slope, rtol=0.0, atol=1e-6 * size)


def test_where_the_assumptions_hold_the_rates_are_those_of_the_proofs() -> None:
    motion = smooth(ARM, START, END, 0.4)
    for kind in (Kind.COMPUTED_TORQUE, Kind.PASSIVITY, Kind.ADAPTIVE):
        found = run(controller(kind), motion)
        e, e_dot = found.tracking_error, found.reference_velocity - found.velocity
        expected = {
            Kind.COMPUTED_TORQUE: -0.5
            * float(RATE_KD)
            * (e_dot**2 + float(RATE_KP) * e**2).sum(axis=1),
            Kind.PASSIVITY: -float(RATE_K)
            * (e_dot**2 + float(RATE_LAMBDA) ** 2 * e**2).sum(axis=1),
        }
        expected[Kind.ADAPTIVE] = expected[Kind.PASSIVITY]
        np.testing.assert_allclose(found.lyapunov_rate, expected[kind], atol=1e-8)
    still = run(controller(Kind.PD_GRAVITY), constant(ARM, END, 0.5))
    energy = -((B + float(RATE_KD)) * still.velocity**2).sum(axis=1)
    np.testing.assert_allclose(still.lyapunov_rate, energy, atol=1e-8)


@coupled
def test_gains_that_do_not_commute_leave_a_term_without_sign(used: Any) -> None:
    found = run(used, smooth(ARM, START, END, 0.4))
    e, e_dot = found.tracking_error, found.reference_velocity - found.velocity
    proved = np.einsum("ti,ij,tj->t", e_dot, COUPLED, e_dot)
    proved += np.einsum("ti,ij,tj->t", RATES * e, COUPLED, RATES * e)
    odd = COUPLED * RATES - (COUPLED * RATES).T
    expected = np.einsum("ti,ij,tj->t", e, odd, e_dot) - proved
    np.testing.assert_allclose(found.lyapunov_rate, expected, atol=1e-8)
    assert np.abs(expected + proved).max() > 0.01 * np.abs(expected).max()
    slope = np.convolve(found.lyapunov, WEIGHTS[::-1], "valid") / TIGHT.sample_period
    size = np.abs(found.lyapunov_rate).max()
    np.testing.assert_allclose(found.lyapunov_rate[2:-2], slope, rtol=0.0, atol=1e-6 * size)
    motion, few = smooth(ARM, START, END, 0.2), replace(TIGHT, sample_period=0.05)
    slow = callback.run(prepare(used, motion, few, ARM, (START + 0.1, None), None, None))
    fast = simulate(used, motion, few, robot=ARM, initial_position=START + 0.1)
    for name in ("position", "velocity", "torque", "estimate", "lyapunov", "lyapunov_rate"):
        np.testing.assert_allclose(getattr(fast, name), getattr(slow, name), atol=1e-8)


def test_dry_friction_adds_to_the_fall() -> None:
    rough = replace(ARM, coulomb_friction=np.array([0.5, 0.2, 0.1]))
    motion = constant(ARM, END, 0.5)
    found = simulate(
        PdGravity(rough, RATE_KP, RATE_KD),
        motion,
        TIGHT,
        initial_position=END + 0.2,
    )
    dry = rough.coulomb_friction * np.tanh(found.velocity / 0.01)
    expected = -((B + float(RATE_KD)) * found.velocity**2 + dry * found.velocity).sum(axis=1)
    np.testing.assert_allclose(found.lyapunov_rate, expected, atol=1e-7)


def test_a_controller_without_a_rate_has_none() -> None:
    class Idle(Controller):
        chain = ARM

        def torque(self, _t: float, _q: Array, _qd: Array, _reference: Reference, /) -> Array:
            return np.zeros(N)

        def lyapunov(
            self, q: Array, qd: Array, reference: Reference, robot: Chain | None = None
        ) -> float:
            return 0.0

    found = simulate(Idle(), constant(ARM, START, 0.01), TIGHT)
    assert np.isnan(found.lyapunov_rate).all()


ADAPTIVE_FREE = SimulationOptions(saturate=False, sample_period=5e-3)


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


def test_error_vanishes_while_parameters_need_not_converge() -> None:
    controller, true = arm(Gamma=10.0)
    # Only the second joint moves: nothing tells the parameters of the first.
    trajectory = wave(true, np.array([[0.0, 0.5]]), 200.0, 0.05)
    options = replace(ADAPTIVE_FREE, sample_period=0.05)
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
    options = replace(ADAPTIVE_FREE, sample_period=0.05, relative_tolerance=1e-7)
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
    result = simulate(blank, trajectory, replace(ADAPTIVE_FREE, sample_period=0.05))
    e = np.abs(result.tracking_error).max(axis=1)
    assert e[-40:].max() < 0.05 * e.max()
    assert (np.diff(result.lyapunov) <= 1e-9 * result.lyapunov[0]).all()


def test_motors_are_learned_where_there_are_any() -> None:
    chain = builtin_chain("planar_rr")
    assert Adaptive(chain, np.array(1.0), np.array(1.0), np.array(1.0)).parameters.count == 6
    driven = replace(chain, viscous_friction=np.array([0.1, 0.1]))
    controller = Adaptive(driven, np.array(1.0), np.array(1.0), np.array(1.0))
    assert controller.parameters.count == 9
    names = " ".join(controller.parameters.names)
    assert "B1" in names
    assert "J2" in names


ADAPTIVE_ARM = planar_rr()
ONE = np.array(1.0)
ADAPTIVE_OPTIONS = SimulationOptions(
    saturate=False, relative_tolerance=1e-11, absolute_tolerance=1e-12, sample_period=0.01
)


def chosen(*names: str, Gamma: float = 3.0) -> Adaptive:
    return Adaptive(
        ADAPTIVE_ARM, np.array(5.0), np.array(8.0), np.array(Gamma), known_zeros=True, learned=names
    )


def test_the_lecture_s_models_have_four_and_three_parameters() -> None:
    assert Adaptive(ADAPTIVE_ARM, ONE, ONE, ONE, known_zeros=True).parameters.count == 4
    cart = replace(cart_pendulum(), viscous_friction=np.zeros(2))
    assert Adaptive(cart, ONE, ONE, ONE, known_zeros=True, motors=False).parameters.count == 3


def test_only_what_is_chosen_is_learned_and_its_v_falls() -> None:
    controller = chosen("mx2", "Izz2")
    assert [name.split()[0] for name in controller.parameters.names] == ["mx2", "Izz2"]
    start = replace(controller, estimate=1.5 * controller.estimate)
    motion = sine(ADAPTIVE_ARM, [0.3, -0.2], 0.4, [0.6, 0.9], 0.0, 3.0)
    result = simulate(start, motion, ADAPTIVE_OPTIONS)
    assert result.estimate.shape[1] == 2
    e = result.tracking_error
    e_dot = result.reference_velocity - result.velocity
    # The proof of lecture 34 holds, as what is not learned is exact.
    expected = -8.0 * (e_dot**2 + 25.0 * e**2).sum(axis=1)
    np.testing.assert_allclose(result.lyapunov_rate, expected, atol=1e-7)
    assert (np.diff(result.lyapunov) < 1e-9).all()
    assert np.abs(e[-50:]).max() < 0.3 * np.abs(e).max()


def test_unknown_and_missing_names_are_refused() -> None:
    with pytest.raises(InvalidOption, match="'mx7' is unknown"):
        chosen("mx7")
    with pytest.raises(InvalidOption, match="no base parameter is learned"):
        Adaptive(ADAPTIVE_ARM, ONE, ONE, ONE, learned=())
