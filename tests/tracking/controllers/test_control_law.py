"""The laws' kernels against their formulas, in terms that pinocchio confirms."""

import numpy as np
import pytest

from dynamics.model.body import scale_masses
from dynamics.parameters.regressor import reference_regressor
from dynamics.terms import augmented_mass_matrix, coriolis_matrix, gravity_vector
from kinematics.arrays import Array
from kinematics.errors import InvalidRobotState
from tests.dynamics.samples import random_chain
from tracking.controllers.adaptive import Adaptive
from tracking.controllers.controller import Flow, LawController, Reference
from tracking.controllers.independent_joint import IndependentJoint
from tracking.controllers.model_based import ComputedTorque, Passivity, PdGravity

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
