"""Lectures 21 to 28 and 33: D, C, G and energies of the cart-pendulum and the planar arm."""

from typing import Any

import httpx
import numpy as np
import pytest

from tests.course.example import Example, ask, check, each
from tests.course.robots import (
    BOB,
    CART,
    FRICTION,
    I1,
    I2,
    I_BOB,
    L1,
    LC1,
    LC2,
    M1,
    M2,
    MOTOR_INERTIA,
    ROD,
)

G = 9.81
#: Position, velocity and acceleration of each robot at which numbers are compared.
CART_STATE = ([0.3, 0.6], [0.7, -1.1], [0.4, 0.9])
ARM_STATE = ([0.5, -0.8], [1.2, -0.7], [0.3, 2.0])


def cart(q: Any, qd: Any) -> tuple[Any, Any, Any]:
    """D, C and G of lecture 26; G = dU/dphi of U = m2 g l cos(phi), whose sine the scan lost."""
    c, s, m2l = np.cos(q[1]), np.sin(q[1]), BOB * ROD
    D = np.array([[CART + BOB, -m2l * c], [-m2l * c, I_BOB + m2l * ROD]])
    C = np.array([[0.0, m2l * s * qd[1]], [0.0, 0.0]])
    return D, C, np.array([0.0, -m2l * G * s])


def arm(q: Any, qd: Any) -> tuple[Any, Any, Any]:
    """D, C and G of lecture 27."""
    k, h = M2 * L1 * LC2 * np.cos(q[1]), -M2 * L1 * LC2 * np.sin(q[1])
    d12 = M2 * LC2**2 + k + I2
    d11 = M1 * LC1**2 + M2 * (L1**2 + LC2**2) + 2.0 * k + I1 + I2
    D = np.array([[d11, d12], [d12, I2 + M2 * LC2**2]])
    C = h * np.array([[qd[1], qd[0] + qd[1]], [-qd[0], 0.0]])
    g2 = M2 * LC2 * G * np.cos(q[0] + q[1])
    return D, C, np.array([(M1 * LC1 + M2 * L1) * G * np.cos(q[0]) + g2, g2])


def torques(model: Any, state: Any) -> Any:
    q, qd, qdd = state
    D, C, gravity = model(q, qd)
    return D @ qdd + C @ qd + gravity


def equations(name: str, robot: str, state: Any, pick: Any, expected: Any) -> Example:
    body = {"joints": state[0], "velocities": state[1], "accelerations": state[2]}
    return Example(name, f"robots/{robot}/dynamics", body, pick, expected)


MODELS = {"notes_cart": (cart, CART_STATE), "notes_planar": (arm, ARM_STATE)}
EXAMPLES = [
    equations("28 M q'' + C q' + B q' + G = u with motors", "notes_motors", ARM_STATE,
              lambda found: found["torques"],
              torques(arm, ARM_STATE) + np.array(MOTOR_INERTIA) * ARM_STATE[2]
              + np.array(FRICTION) * ARM_STATE[1]),
    equations("28 J of the motors", "notes_motors", ARM_STATE,
              lambda found: found["motor_inertia"], MOTOR_INERTIA),
    equations("28 B of the motors", "notes_motors", ARM_STATE,
              lambda found: found["viscous_friction"], FRICTION),
]  # fmt: skip


#: Partial Jacobians of lecture 27 at CART_STATE and ARM_STATE: J_v1, J_w1, J_v2, J_w2.
CART_PARTIAL = [
    ([[0, 0], [0, 0], [1, 0]], [[0, 0], [0, 0], [0, 0]]),
    (
        [[0, -ROD * np.sin(0.6)], [0, 0], [1, -ROD * np.cos(0.6)]],
        [[0, 0], [0, 1], [0, 0]],
    ),
]
S1, C1, S12, C12 = np.sin(0.5), np.cos(0.5), np.sin(-0.3), np.cos(-0.3)
ARM_PARTIAL = [
    ([[-LC1 * S1, 0], [LC1 * C1, 0], [0, 0]], [[0, 0], [0, 0], [1, 0]]),
    (
        [[-L1 * S1 - LC2 * S12, -LC2 * S12], [L1 * C1 + LC2 * C12, LC2 * C12], [0, 0]],
        [[0, 0], [0, 0], [1, 1]],
    ),
]
EXAMPLES += [
    Example(
        f"27 partial Jacobians, {robot}",
        f"robots/{robot}/dynamics",
        {"joints": MODELS[robot][1][0], "partial_jacobians": True},
        lambda found: [[one["linear"], one["angular"]] for one in found["partial_jacobians"]],
        expected,
    )
    for robot, expected in (("notes_cart", CART_PARTIAL), ("notes_planar", ARM_PARTIAL))
]


@each(EXAMPLES)
def test_example(service: httpx.Client, example: Example) -> None:
    check(service, example)


@pytest.mark.parametrize("robot", MODELS)
def test_the_mass_matrix_is_symmetric_and_positive_definite(
    service: httpx.Client, robot: str
) -> None:
    rows = np.random.default_rng(1).uniform(-3.0, 3.0, (40, 2)).tolist()
    found = ask(service, f"robots/{robot}/dynamics", {"joints": rows})["mass_matrix"]
    for D in map(np.array, found):
        np.testing.assert_array_equal(D, D.T)
        assert np.linalg.eigvalsh(D)[0] > 1e-3


@pytest.mark.parametrize("robot", MODELS)
def test_the_rate_of_d_minus_2c_is_skew_symmetric(service: httpx.Client, robot: str) -> None:
    q, qd, _ = map(np.array, MODELS[robot][1])
    step = 1e-6
    rows = [(q + k * step * qd).tolist() for k in (-1, 0, 1)]
    body = {"joints": rows, "velocities": [qd.tolist()] * 3}
    found = ask(service, f"robots/{robot}/dynamics", body)
    D, C = np.array(found["mass_matrix"]), np.array(found["coriolis_matrix"][1])
    N = (D[2] - D[0]) / (2.0 * step) - 2.0 * C
    np.testing.assert_allclose(N + N.T, np.zeros((2, 2)), atol=1e-8)


def test_the_regressor_of_the_cart(service: httpx.Client) -> None:
    q, qd, qdd = CART_STATE
    body = {"joints": q, "velocities": qd, "accelerations": qdd, "known_zeros": True}
    found = ask(service, "robots/notes_cart/regressor", body)
    values = sorted(abs(one["value"]) for one in found["base_parameters"])
    # M, m2 l and I + m2 l^2 of lecture 33, the fewest there are.
    expected = sorted([CART + BOB, BOB * ROD, I_BOB + BOB * ROD**2])
    assert values == pytest.approx(expected, abs=1e-9)
    c, s = np.cos(q[1]), np.sin(q[1])
    Y = np.array([
        [qdd[0], -c * qdd[1] + s * qd[1] ** 2, 0.0],
        [0.0, -c * qdd[0] - G * s, qdd[1]],
    ])  # fmt: skip
    Theta = np.array([CART + BOB, BOB * ROD, I_BOB + BOB * ROD**2])
    np.testing.assert_allclose(found["torques"], Y @ Theta, atol=1e-9)
    answered = np.array(found["base_regressor"])
    for column, value in zip(Y.T, Theta, strict=True):
        match = [one for one in zip(answered.T, found["base_parameters"], strict=True)
                 if abs(abs(one[1]["value"]) - value) < 1e-9]  # fmt: skip
        ((own, parameter),) = match
        np.testing.assert_allclose(own * np.sign(parameter["value"]), column, atol=1e-8)
