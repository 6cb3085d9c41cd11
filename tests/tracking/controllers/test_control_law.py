"""Compiled control laws against pinocchio, and against the controllers in Python."""

from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from dynamics.model.body import scale_masses
from kinematics.arrays import Array
from kinematics.model.chain import Chain
from tests.dynamics.samples import pinocchio_model, random_chain
from tracking.controllers.adaptive import Adaptive
from tracking.controllers.computed_torque import ComputedTorque
from tracking.controllers.control_law import Kind, control_kernel, lyapunov_kernel, space
from tracking.controllers.controller import Controller, Reference
from tracking.controllers.independent_joint import IndependentJoint
from tracking.controllers.passivity import Passivity
from tracking.controllers.pd_gravity import PdGravity

MODEL = random_chain(11, 4, motors=True)
#: Heavier than the controller believes.
ROBOT = scale_masses(MODEL, [1.1, 0.9, 1.2, 1.3])
N = MODEL.n
B, J = MODEL.viscous_friction, MODEL.motor_inertia
LAMBDA = np.array([3.0, 3.0, 5.0, 7.0])
#: Couples the two joints whose Lambda is equal.
K = np.diag([4.0, 5.0, 6.0, 7.0]) + 0.5 * (np.eye(4)[[1, 0, 3, 2]] * [1, 1, 0, 0])
KP = np.diag([9.0, 8.0, 7.0, 6.0]) + 0.3
CONTROLLERS: dict[Kind, Any] = {
    Kind.INDEPENDENT_JOINT: IndependentJoint(MODEL, np.array(9.0), np.array(2.0), J),
    Kind.COMPUTED_TORQUE: ComputedTorque(MODEL, np.array([4.0, 5, 6, 7]), np.array(2.0)),
    Kind.PD_GRAVITY: PdGravity(MODEL, KP, K),
    Kind.PASSIVITY: Passivity(MODEL, LAMBDA, K),
    Kind.ADAPTIVE: Adaptive(MODEL, LAMBDA, K, np.array(0.3)),
}
kinds = pytest.mark.parametrize("kind", Kind)


def states(count: int = 10) -> Array:
    """Rows q, q_dot and the reference with its two derivatives, shape (count, 5, n)."""
    return np.random.default_rng(5).uniform(-2.0, 2.0, (count, 5, N))


def compiled(
    controller: Controller, state: Array, robot: Chain = ROBOT
) -> tuple[Array, Array, float]:
    """Torque, rate of the estimate and Lyapunov function of the compiled law."""
    law = controller.compiled_law(robot)
    assert law is not None
    room = space(N, law)
    estimate = np.array(getattr(controller, "estimate", np.zeros(0)))
    u, rate = np.zeros(N), np.zeros(len(estimate))
    control_kernel(law, room, state[:2].copy(), state[2:].copy(), estimate, u, rate)
    value = lyapunov_kernel(law, room, state[:2].copy(), state[2:].copy(), estimate)
    return u, rate, value


def reference(state: Array) -> Reference:
    return Reference(state[2], state[3], state[4])


class Arm:
    """The equations of motion of a chain by pinocchio, with motors."""

    def __init__(self, chain: Chain) -> None:
        self.model = pinocchio_model(chain)
        self.data = self.model.createData()

    def torque(self, q: Array, qd: Array, qdd: Array) -> Array:
        return np.asarray(pin.rnea(self.model, self.data, q, qd, qdd)) + B * qd

    def mass(self, q: Array) -> Array:
        M = np.triu(pin.crba(self.model, self.data, q))
        return np.asarray(M + np.triu(M, 1).T)

    def gravity(self, q: Array) -> Array:
        return np.asarray(pin.computeGeneralizedGravity(self.model, self.data, q))

    def coriolis(self, q: Array, qd: Array) -> Array:
        return np.asarray(pin.computeCoriolisMatrix(self.model, self.data, q, qd)).copy()


ARM, HEAVY = Arm(MODEL), Arm(ROBOT)


@pytest.mark.parametrize("state", states())
def test_torques_are_those_of_the_equations(state: Array) -> None:
    q, qd, qr, vr, ar = state
    e, e_dot = qr - q, vr - qd
    expected = {
        Kind.INDEPENDENT_JOINT: J * ar + B * vr + 9.0 * e + 2.0 * e_dot,
        Kind.COMPUTED_TORQUE: ARM.torque(q, qd, ar + 2.0 * e_dot + np.array([4.0, 5, 6, 7]) * e),
        Kind.PD_GRAVITY: KP @ e + K @ e_dot + ARM.gravity(q),
    }
    r, v, a = e_dot + LAMBDA * e, vr + LAMBDA * e, ar + LAMBDA * e_dot
    passive = ARM.mass(q) @ a + ARM.coriolis(q, qd) @ v + B * qd + ARM.gravity(q) + K @ r
    expected[Kind.PASSIVITY] = passive
    for kind, torque in expected.items():
        u, _, _ = compiled(CONTROLLERS[kind], state)
        np.testing.assert_allclose(u, torque, rtol=1e-9, atol=1e-9, err_msg=kind.name)


def test_an_exact_estimate_makes_adaptive_control_that_of_passivity() -> None:
    exact = CONTROLLERS[Kind.ADAPTIVE]
    for state in states():
        u, rate, _ = compiled(exact, state)
        q, qd, qr, vr, ar = state
        e, e_dot = qr - q, vr - qd
        r, v, a = e_dot + LAMBDA * e, vr + LAMBDA * e, ar + LAMBDA * e_dot
        torque = ARM.mass(q) @ a + ARM.coriolis(q, qd) @ v + B * qd + ARM.gravity(q) + K @ r
        np.testing.assert_allclose(u, torque, rtol=1e-8, atol=1e-8)
        Y = exact.regressor(q, qd, reference(state))
        np.testing.assert_allclose(rate, 0.3 * Y.T @ r, rtol=1e-9, atol=1e-9)


@kinds
def test_compiled_laws_equal_the_controllers_in_python(kind: Kind) -> None:
    controller = CONTROLLERS[kind]
    for state in states():
        u, rate, value = compiled(controller, state)
        q, qd = state[:2]
        at = reference(state)
        np.testing.assert_allclose(u, controller.torque(0.0, q, qd, at), rtol=1e-10, atol=1e-10)
        np.testing.assert_allclose(value, controller.lyapunov(q, qd, at, ROBOT), rtol=1e-9)
        if kind is Kind.ADAPTIVE:
            expected = controller.adaptation(0.0, q, qd, at)
            np.testing.assert_allclose(rate, expected, rtol=1e-10, atol=1e-10)


@kinds
def test_at_the_reference_the_lyapunov_function_is_least(kind: Kind) -> None:
    controller = CONTROLLERS[kind]
    for state in states():
        at_rest = state.copy()
        at_rest[3:] = 0.0
        at_rest[0], at_rest[1] = state[2], 0.0
        lowest = compiled(controller, at_rest, MODEL)[2]
        assert lowest == pytest.approx(0.0, abs=1e-12)
        assert compiled(controller, np.vstack([state[:3], np.zeros((2, N))]), MODEL)[2] > 1e-3


def test_energy_is_that_of_the_true_robot() -> None:
    for state in states(4):
        q, qd, qr, vr, _ = state
        r = vr - qd + LAMBDA * (qr - q)
        spring = (LAMBDA * (qr - q)) @ K @ (qr - q)
        for arm, robot in ((ARM, MODEL), (HEAVY, ROBOT)):
            value = compiled(CONTROLLERS[Kind.PASSIVITY], state, robot)[2]
            np.testing.assert_allclose(value, 0.5 * r @ arm.mass(q) @ r + spring, rtol=1e-9)


def test_passivity_decays_as_its_proof_says() -> None:
    """V_dot = -e_dot^T K e_dot - e^T Lambda K Lambda e along M r_dot + (C + K) r = 0."""
    controller = CONTROLLERS[Kind.PASSIVITY]
    for state in states(5):
        q, qd, qr, vr, ar = state
        u, _, _ = compiled(controller, state, MODEL)
        acceleration = np.linalg.solve(ARM.mass(q), u - ARM.torque(q, qd, np.zeros(N)))
        h = 1e-6

        def value(s: float) -> float:
            moved = np.array([q + s * qd, qd + s * acceleration, qr + s * vr, vr + s * ar, ar])  # noqa: B023
            return compiled(controller, moved, MODEL)[2]

        slope = (value(h) - value(-h)) / (2.0 * h)
        e, e_dot = qr - q, vr - qd
        expected = -e_dot @ K @ e_dot - (LAMBDA * e) @ K @ (LAMBDA * e)
        np.testing.assert_allclose(slope, expected, rtol=1e-4, atol=1e-3)
        assert slope < 0.0


@kinds
def test_laws_do_not_change_what_they_are_given(kind: Kind) -> None:
    controller = CONTROLLERS[kind]
    state = states(1)[0]
    first, second = compiled(controller, state), compiled(controller, state)
    for a, b in zip(first, second, strict=True):
        np.testing.assert_array_equal(a, b)
