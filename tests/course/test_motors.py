"""Lectures 20 and 28: direct current motors with gears and dry friction under all five controllers.

The closed loops are integrated once more by scipy's DOP853, with the formulas of the notes:
M = D + J, J = r² J_m, B = r² (B_m + k_m k_b / R), V = R u / (r k_m).
"""

from typing import Any

import httpx
import numpy as np
import pytest
from numpy.polynomial import polynomial
from scipy.integrate import solve_ivp

from tests.course.exam.arms import GRAVITY
from tests.course.exam.dynamics import planar_by_hand
from tests.course.example import ask
from tests.course.robots import I1, I2, L1, LC1, LC2, M1, M2

MOTORS: list[dict[str, float]] = [
    {"inertia": 1.2e-4, "friction": 2e-5, "torque_constant": 0.05, "back_emf": 0.002,
     "resistance": 0.5, "gear_ratio": 50.0},
    {"inertia": 2e-4, "friction": 1e-4, "torque_constant": 0.04, "back_emf": 0.003,
     "resistance": 0.8, "gear_ratio": 30.0},
]  # fmt: skip
#: Dry friction F [N m] and the speed v of F tanh(q' / v) [rad/s].
DRY, SMOOTH = np.array([0.4, 0.2]), 0.01
KP, KD = np.array([90.0, 60.0]), np.array([25.0, 12.0])
LAMBDA, K = np.array([5.0, 5.0]), np.diag([9.0, 6.0])
GAMMA = 2.0
J = np.array([m["gear_ratio"] ** 2 * m["inertia"] for m in MOTORS])
B = np.array([
    m["gear_ratio"] ** 2
    * (m["friction"] + m["torque_constant"] * m["back_emf"] / m["resistance"])
    for m in MOTORS
])  # fmt: skip
VOLTS = np.array([m["resistance"] / (m["gear_ratio"] * m["torque_constant"]) for m in MOTORS])
START = np.array([0.3, -0.2])
CONTROLLERS: dict[str, dict[str, Any]] = {
    "independent_joint": {"Kp": KP.tolist(), "Kd": KD.tolist()},
    "computed_torque": {"Kp": KP.tolist(), "Kd": KD.tolist()},
    "pd_gravity": {"Kp": KP.tolist(), "Kd": KD.tolist()},
    "passivity": {"Lambda": LAMBDA.tolist(), "K": K.tolist()},
    "adaptive": {"Lambda": LAMBDA.tolist(), "K": K.tolist(), "Gamma": GAMMA, "known_zeros": True,
                 "estimate": "zero"},
}  # fmt: skip
#: q_r = [0.5 - 0.4 t², -0.6 + 0.9 t² - 0.3 t³].
CUBIC = [[0.5, 0.0, -0.4, 0.0], [-0.6, 0.0, 0.9, -0.3]]
DURATION = 1.0


def arm(q: Any, qd: Any) -> list[Any]:
    """D, C and G of lecture 27."""
    parts = planar_by_hand((M1, M2), (L1,), (LC1, LC2), (I1, I2), q, qd)
    return [np.array(part) for part in parts]


def simulate(service: httpx.Client, kind: str, **more: Any) -> dict[str, Any]:
    body = {
        "robot": "notes_planar",
        "trajectory": {"segments": [{"t0": 0.0, "t1": DURATION, "coefficients": CUBIC}]},
        "controller": {"type": kind} | CONTROLLERS[kind],
        "motors": MOTORS,
        "coulomb_friction": DRY.tolist(),
        "initial_state": {"joints": START.tolist()},
        "saturate": False,
        "relative_tolerance": 1e-13,
        "absolute_tolerance": 1e-13,
        "sample_period": 0.05,
    }
    found: dict[str, Any] = ask(service, "simulate", body | more)
    assert found["outcome"] == "completed"
    return found


#: Coefficients of the cubics and of their first two derivatives, a column for each joint.
RATES = [polynomial.polyder(np.array(CUBIC).T, k) for k in range(3)]


def reference(t: float) -> tuple[Any, Any, Any]:
    q, qd, qdd = (polynomial.polyval(t, rate) for rate in RATES)
    return q, qd, qdd


def column(leader: str, q: Any, qd: Any, v: Any, a: Any) -> Any:
    """A column of the regressor Y(q, q', v, a) of the planar arm, lectures 27 and 33."""
    c2, s2 = np.cos(q[1]), np.sin(q[1])
    c1, c12 = np.cos(q[0]), np.cos(q[0] + q[1])
    joint = int(leader[-1]) - 1
    alone = np.eye(2)[joint]
    simple = {"J": alone * a, "B": alone * qd, "F": alone * np.tanh(qd / SMOOTH)}
    if leader[0] in simple:
        return simple[leader[0]]
    if leader == "Izz1":
        return np.array([a[0], 0.0])
    if leader == "mx1":
        return np.array([GRAVITY * c1, 0.0])
    if leader == "Izz2":
        return np.full(2, a[0] + a[1])
    assert leader == "mx2"
    coriolis = -L1 * s2 * np.array([qd[1] * v[0] + (qd[0] + qd[1]) * v[1], -qd[0] * v[0]])
    inertial = L1 * c2 * np.array([2.0 * a[0] + a[1], a[0]])
    return inertial + coriolis + GRAVITY * c12


def torque(kind: str, t: float, q: Any, qd: Any, estimate: Any, leaders: Any) -> tuple[Any, Any]:
    """U of a controller by its formula, and the rate of the estimate."""
    qr, vr, ar = reference(t)
    e, ed = qr - q, vr - qd
    D, C, gravity = arm(q, qd)
    M, dry = D + np.diag(J), DRY * np.tanh(qd / SMOOTH)
    rest = np.zeros(len(estimate))
    if kind == "independent_joint":
        return J * ar + B * vr + KP * e + KD * ed, rest
    if kind == "computed_torque":
        return M @ (ar + KP * e + KD * ed) + C @ qd + B * qd + dry + gravity, rest
    if kind == "pd_gravity":
        return KP * e + KD * ed + gravity, rest
    r, v, a = ed + LAMBDA * e, vr + LAMBDA * e, ar + LAMBDA * ed
    if kind == "passivity":
        return M @ a + C @ v + B * qd + dry + gravity + K @ r, rest
    Y = np.column_stack([column(leader, q, qd, v, a) for leader in leaders])
    return Y @ estimate + K @ r, GAMMA * Y.T @ r


def integrate(kind: str, times: Any, leaders: Any, limit: Any = np.inf) -> Any:
    """The state [q, q', estimate] at times, by scipy."""

    def rate(t: float, x: Any) -> Any:
        q, qd = x[:2], x[2:4]
        u, change = torque(kind, t, q, qd, x[4:], leaders)
        D, C, gravity = arm(q, qd)
        force = np.clip(u, -limit, limit) - C @ qd - B * qd - DRY * np.tanh(qd / SMOOTH) - gravity
        return np.concatenate([qd, np.linalg.solve(D + np.diag(J), force), change])

    x = np.concatenate([START, np.zeros(2 + len(leaders))])
    solution = solve_ivp(rate, (0.0, times[-1]), x, "DOP853", times, rtol=1e-13, atol=1e-13)
    return solution.y.T


def leaders_of(found: dict[str, Any]) -> list[str]:
    return [name.split()[0] for name in found["controller"]["parameter_names"] or []]


@pytest.mark.parametrize("kind", CONTROLLERS)
def test_every_closed_loop_is_that_of_scipy(service: httpx.Client, kind: str) -> None:
    found = simulate(service, kind)
    exact = integrate(kind, np.array(found["time"]), leaders_of(found))
    np.testing.assert_allclose(found["position"], exact[:, :2], rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(found["velocity"], exact[:, 2:4], rtol=0.0, atol=1e-9)
    if kind == "adaptive":
        np.testing.assert_allclose(found["estimate"], exact[:, 4:], rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(found["voltage"], np.array(found["torque"]) * VOLTS, rtol=1e-12)
    assert found["motor_inertia"] == pytest.approx(J.tolist())
    assert found["viscous_friction"] == pytest.approx(B.tolist())
    assert found["coulomb_friction"] == DRY.tolist()


def test_voltages_are_cut_off_at_the_motors_limits(service: httpx.Client) -> None:
    limits = [5.0, 2.5]
    motors = [m | {"voltage_limit": v} for m, v in zip(MOTORS, limits, strict=True)]
    found = simulate(service, "computed_torque", motors=motors, saturate=True)
    assert np.abs(found["voltage"]).max(axis=0) == pytest.approx(limits)
    assert any(found["saturated"])
    exact = integrate("computed_torque", np.array(found["time"]), [], limits / VOLTS)
    np.testing.assert_allclose(found["position"], exact[:, :2], rtol=0.0, atol=1e-9)
    # The same limits in newton metres.
    cut = simulate(service, "computed_torque", effort_limits=(limits / VOLTS).tolist(),
                   saturate=True)  # fmt: skip
    np.testing.assert_allclose(cut["torque"], found["torque"], atol=1e-8)


def test_one_motor_may_stand_for_all_joints(service: httpx.Client) -> None:
    one = simulate(service, "passivity", motors=MOTORS[0])
    two = simulate(service, "passivity", motors=[MOTORS[0]] * 2)
    assert one == two


@pytest.mark.parametrize(
    ("more", "text"),
    [
        ({"motor_inertia": 0.1}, "motors have an inertia and a friction"),
        ({"motors": MOTORS[:1]}, "1 motor(s) for the 2 joints"),
        ({"effort_limits": 5.0}, "no effect without saturation"),
        ({"controller": {"type": "independent_joint", "Kp": 1.0, "Kd": 1.0, "motors": MOTORS}},
         "given beside the controller's own motors"),
        ({"saturate": True}, "no effort limit is known"),
    ],
)  # fmt: skip
def test_contradictions_are_refused(service: httpx.Client, more: dict[str, Any], text: str) -> None:
    body = {
        "robot": "notes_planar",
        "reference": {"type": "hold", "joints": [0.1, 0.2], "duration": 1.0},
        "controller": {"type": "passivity", "Lambda": 1.0, "K": 1.0},
        "motors": MOTORS,
        "saturate": False,
    }
    response = service.post("/v1/simulate", json=body | more)
    assert response.status_code == 422, response.text
    assert text in response.text
