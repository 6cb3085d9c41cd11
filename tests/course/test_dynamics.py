"""Lectures 21 to 28 and 33: D, C, G and energies of the cart-pendulum and the planar arm."""

from collections.abc import Callable
from itertools import product
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


def kinetic_of_arm(q: Any, qd: Any) -> float:
    """T of lecture 27, written with the speeds of the centres of mass."""
    v1 = LC1**2 * qd[0] ** 2
    w2 = qd[0] + qd[1]
    v2 = L1**2 * qd[0] ** 2 + LC2**2 * w2**2 + 2 * L1 * LC2 * np.cos(q[1]) * qd[0] * w2
    return float(M1 * v1 + M2 * v2 + I1 * qd[0] ** 2 + I2 * w2**2) / 2.0


def kinetic_of_cart(q: Any, qd: Any) -> float:
    """T of lecture 26."""
    x, phi = qd
    coupled = BOB * ROD * np.cos(q[1]) * x * phi
    return float((CART + BOB) * x**2 / 2 + (I_BOB + BOB * ROD**2) * phi**2 / 2 - coupled)


def equations(name: str, robot: str, state: Any, pick: Any, expected: Any) -> Example:
    body = {"joints": state[0], "velocities": state[1], "accelerations": state[2]}
    return Example(name, f"robots/{robot}/dynamics", body, pick, expected)


def christoffel(model: Any, q: Any, i: int, j: int, k: int) -> float:
    """c_ijk by central differences of D: exact to step squared."""
    step = 1e-5

    def slope(row: int, column: int, along: int) -> float:
        e = step * np.eye(2)[along]
        ahead, behind = (model(np.array(q) + sign * e, [0, 0])[0] for sign in (1.0, -1.0))
        return float(ahead[row, column] - behind[row, column]) / (2.0 * step)

    return 0.5 * (slope(k, j, i) + slope(k, i, j) - slope(i, j, k))


def entry_of_c(row: int, column: int) -> Callable[[Any], float]:
    """Takes an entry of the Coriolis matrix from an answer."""
    return lambda found: float(found["coriolis_matrix"][row][column])


MODELS = {"notes_cart": (cart, CART_STATE), "notes_planar": (arm, ARM_STATE)}
q2 = ARM_STATE[0][1]
EXAMPLES = [
    *(
        equations(f"{robot}: {name}", robot, state, pick, expected)
        for robot, (model, state) in MODELS.items()
        for name, pick, expected in (
            ("D", lambda found: found["mass_matrix"], model(*state[:2])[0]),
            ("C", lambda found: found["coriolis_matrix"], model(*state[:2])[1]),
            ("G", lambda found: found["gravity"], model(*state[:2])[2]),
            ("torques", lambda found: found["torques"], torques(model, state)),
        )
    ),
    equations("26 T of the cart", "notes_cart", CART_STATE,
              lambda found: found["kinetic_energy"], kinetic_of_cart(*CART_STATE[:2])),
    equations("27 T of the arm", "notes_planar", ARM_STATE,
              lambda found: found["kinetic_energy"], kinetic_of_arm(*ARM_STATE[:2])),
    equations("26 U of the cart", "notes_cart", CART_STATE,
              lambda found: found["potential_energy"], BOB * G * ROD * np.cos(0.6)),
    equations("27 U of the arm", "notes_planar", ARM_STATE,
              lambda found: found["potential_energy"],
              M1 * G * LC1 * np.sin(0.5)
              + M2 * G * (L1 * np.sin(0.5) + LC2 * np.sin(0.5 - 0.8))),
    # C(q, e_i) has the entries c_ijk: a unit velocity of one joint tells its symbols.
    *(
        Example(
            f"25 {robot}: c_{i + 1}{j + 1}{k + 1}",
            f"robots/{robot}/dynamics",
            {"joints": MODELS[robot][1][0], "velocities": np.eye(2)[i].tolist()},
            entry_of_c(k, j),
            christoffel(MODELS[robot][0], MODELS[robot][1][0], i, j, k),
            1e-8,
        )
        for robot in MODELS
        for i, j, k in product(range(2), repeat=3)
    ),
    Example("27 c_121 = c_211 = c_221 = -c_112 of the notes", "robots/notes_planar/dynamics",
            {"joints": [ARM_STATE[0]] * 2, "velocities": np.eye(2).tolist()},
            lambda found: [found["coriolis_matrix"][0][0][1], found["coriolis_matrix"][1][0][0],
                           found["coriolis_matrix"][1][0][1], -found["coriolis_matrix"][0][1][0]],
            [-M2 * L1 * LC2 * np.sin(q2)] * 4),
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
EXAMPLES += [
    Example(
        f"25 all Christoffel symbols, {robot}",
        f"robots/{robot}/dynamics",
        {"joints": MODELS[robot][1][0], "christoffel_symbols": True},
        lambda found: found["christoffel_symbols"],
        [
            [[christoffel(model, state[0], i, j, k) for k in range(2)] for j in range(2)]
            for i in range(2)
        ],
        1e-8,
    )
    for robot, (model, state) in MODELS.items()
]
EXAMPLES += [
    Example(
        f"25 forward dynamics, {robot}",
        f"robots/{robot}/forward-dynamics",
        {"joints": state[0], "velocities": state[1], "torques": torques(model, state).tolist()},
        lambda found: found["accelerations"],
        state[2],
    )
    for robot, (model, state) in MODELS.items()
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


def test_built_in_robots_are_the_arms_of_the_notes(service: httpx.Client) -> None:
    # Lengths and masses of docs/robots.md in the formulas of lecture 27.
    q, qd = [0.4, 0.9], [0.5, -0.2]
    body = {"joints": q, "velocities": qd}
    found = ask(service, "robots/planar_rr/dynamics", body)
    inertia = 1.0 / 12.0  # m l² / 12
    d22, k = 0.25 + inertia, 0.5 * np.cos(0.9)
    D = [[0.25 + 1.25 + 2 * k + 2 * inertia, d22 + k], [d22 + k, d22]]
    np.testing.assert_allclose(found["mass_matrix"], D, atol=1e-9)
    h = -0.5 * np.sin(0.9)
    C = h * np.array([[qd[1], qd[0] + qd[1]], [-qd[0], 0.0]])
    np.testing.assert_allclose(found["coriolis_matrix"], C, atol=1e-9)
    g2 = 0.5 * G * np.cos(1.3)
    np.testing.assert_allclose(found["gravity"], [1.5 * G * np.cos(0.4) + g2, g2], atol=1e-9)


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
