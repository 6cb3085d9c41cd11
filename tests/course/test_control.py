"""Lectures 20, 28, 31, 32, 34: five controllers, torques, errors and Lyapunov functions."""

from typing import Any

import httpx
import numpy as np
import pytest
from scipy.integrate import simpson

from tests.course.example import ask, second_order_error
from tests.course.robots import FRICTION, MOTOR_INERTIA, revolute
from tests.course.test_dynamics import arm

KP, KD, LAMBDA, K = [60.0, 40.0], [16.0, 9.0], [5.0, 4.0], [9.0, 6.0]
OFFSET = [0.2, -0.15]
J, B = np.diag(MOTOR_INERTIA), np.diag(FRICTION)
GAINS: dict[str, dict[str, Any]] = {
    "computed_torque": {"Kp": KP, "Kd": KD},
    "pd_gravity": {"Kp": KP, "Kd": KD},
    "passivity": {"Lambda": LAMBDA, "K": K},
    "adaptive": {"Lambda": LAMBDA, "K": K, "Gamma": 2.0},
    "independent_joint": {"Kp": KP, "Kd": KD},
}
#: Two seconds of q1 = t^3 and of q2 standing still, and a constant reference.
MOVING = {"segments": [{"t0": 0.0, "t1": 2.0, "coefficients": [[0.1, 0, 0, 0.2], [0.4, 0, 0, 0]]}]}
RESTING = {"segments": [{"t0": 0.0, "t1": 2.0, "coefficients": [[0.1, 0, 0, 0], [0.4, 0, 0, 0]]}]}


def simulate(service: httpx.Client, kind: str, trajectory: Any, **more: Any) -> dict[str, Any]:
    body = {
        "robot": "notes_motors",
        "trajectory": trajectory,
        "controller": {"type": kind} | GAINS[kind],
        "initial_state": {"offset": OFFSET},
        "saturate": False,
        "sample_period": 0.01,
        "relative_tolerance": 1e-10,
        "absolute_tolerance": 1e-12,
    }
    found: dict[str, Any] = ask(service, "simulate", body | more)
    assert found["outcome"] == "completed"
    return found


def errors(found: dict[str, Any]) -> tuple[Any, Any]:
    """q~ = q_r - q and its rate at each sample."""
    reference = found["reference"]
    return (
        np.array(reference["position"]) - found["position"],
        np.array(reference["velocity"]) - found["velocity"],
    )


def reference_acceleration(found: dict[str, Any]) -> Any:
    t = np.array(found["time"])
    moving = np.ptp(found["reference"]["position"]) > 0.5
    return np.column_stack([1.2 * t if moving else 0.0 * t, 0.0 * t])


def law(kind: str, q: Any, qd: Any, ref: Any, e: Any, ed: Any) -> Any:
    """The torque of a controller by its formula in the notes; ref is (q_r', q_r'')."""
    D, C, gravity = arm(q, qd)
    M, rate, acceleration = D + J, ref[0], ref[1]
    Kp, Kd = np.diag(KP), np.diag(KD)
    if kind == "computed_torque":
        v = acceleration + Kp @ e + Kd @ ed
        return M @ v + C @ qd + B @ qd + gravity
    if kind == "pd_gravity":
        return Kp @ e + Kd @ ed + gravity
    if kind == "independent_joint":
        return J @ acceleration + B @ rate + Kp @ e + Kd @ ed
    v, a = rate + np.diag(LAMBDA) @ e, acceleration + np.diag(LAMBDA) @ ed
    return M @ a + C @ v + B @ qd + gravity + np.diag(K) @ (ed + np.diag(LAMBDA) @ e)


@pytest.mark.parametrize("kind", ["computed_torque", "pd_gravity", "passivity"])
@pytest.mark.parametrize("trajectory", [MOVING, RESTING], ids=["moving", "resting"])
def test_the_torque_is_that_of_the_formula(
    service: httpx.Client, kind: str, trajectory: Any
) -> None:
    found = simulate(service, kind, trajectory)
    e, ed = errors(found)
    for i in range(0, len(found["time"]), 17):
        ref = found["reference"]["velocity"][i], reference_acceleration(found)[i]
        expected = law(kind, found["position"][i], found["velocity"][i], ref, e[i], ed[i])
        np.testing.assert_allclose(found["torque"][i], expected, atol=1e-6)


def test_independent_joint_control_feeds_the_motors_forward(service: httpx.Client) -> None:
    found = simulate(service, "independent_joint", MOVING)
    e, ed = errors(found)
    for i in range(0, len(found["time"]), 17):
        ref = np.array(found["reference"]["velocity"][i]), reference_acceleration(found)[i]
        q, qd = found["position"][i], found["velocity"][i]
        expected = law("independent_joint", q, qd, ref, e[i], ed[i])
        np.testing.assert_allclose(found["torque"][i], expected, atol=1e-6)


@pytest.mark.parametrize("joint", [0, 1])
def test_feedback_linearisation_leaves_linear_errors(service: httpx.Client, joint: int) -> None:
    # e'' + kd e' + kp e = 0 for each joint by itself, lecture 28.
    found = simulate(service, "computed_torque", MOVING)
    e, _ = errors(found)
    t = np.array(found["time"])
    expected = second_order_error(-OFFSET[joint], 0.0, KP[joint], KD[joint], t)
    np.testing.assert_allclose(e[:, joint], expected, atol=1e-8)


def test_a_motor_alone_has_the_poles_of_lecture_20(service: httpx.Client) -> None:
    # e'' + (B + Kd)/J e' + Kp/J e = 0 of one joint whose axis is along gravity.
    inertia, friction, kp, kd = 0.8, 0.4, 12.0, 3.0
    tensor = [[0.5, 0, 0], [0, 0.5, 0], [0, 0, 0.5]]
    row = revolute(mass=1.0, center_of_mass=[0, 0, 0], inertia=tensor,
                   motor_inertia=0.3, viscous_friction=friction)  # fmt: skip
    robot = {"name": "notes_motor", "dh": {
        "convention": "standard", "rows": [row], "gravity": [0.0, 0.0, -9.81]}}  # fmt: skip
    assert service.post("/v1/robots", json=robot).status_code == 201
    cubic = {"segments": [{"t0": 0.0, "t1": 2.0, "coefficients": [[0, 0.3, 0.2, 0.1]]}]}
    body = {
        "robot": "notes_motor", "trajectory": cubic, "saturate": False,
        "controller": {"type": "independent_joint", "Kp": kp, "Kd": kd, "inertia": inertia},
        "initial_state": {"offset": [0.25], "velocity_offset": [-0.1]},
        "relative_tolerance": 1e-10, "absolute_tolerance": 1e-12,
    }  # fmt: skip
    found = ask(service, "simulate", body)
    t = np.array(found["time"])
    expected = second_order_error(-0.25, 0.1, kp / inertia, (friction + kd) / inertia, t)
    np.testing.assert_allclose(np.array(found["tracking_error"])[:, 0], expected, atol=1e-8)


def decrease(found: dict[str, Any], rate: Any) -> None:
    """V(t) - V(0) is the integral of the rate of the proof."""
    V, t = np.array(found["lyapunov"]), np.array(found["time"])
    for i in range(10, len(t), 40):
        fallen = simpson(rate[: i + 1], x=t[: i + 1])
        assert V[i] - V[0] == pytest.approx(fallen, abs=2e-4 * V[0])
    assert (np.diff(V) <= 1e-9 * V[0]).all()
    assert V[-1] < 0.05 * V[0] or found["estimate"] is not None


def test_the_energy_of_pd_control_falls_by_its_friction(service: httpx.Client) -> None:
    # V' = -q'^T (B + Kd) q', lecture 31.
    found = simulate(service, "pd_gravity", RESTING)
    e, ed = errors(found)
    for i in (0, 50, 120):
        M = arm(found["position"][i], found["velocity"][i])[0] + J
        V = 0.5 * ed[i] @ M @ ed[i] + 0.5 * e[i] @ np.diag(KP) @ e[i]
        assert found["lyapunov"][i] == pytest.approx(V, abs=1e-9)
    decrease(found, -np.einsum("ti,ij,tj->t", ed, B + np.diag(KD), ed))


@pytest.mark.parametrize("kind", ["passivity", "adaptive"])
@pytest.mark.parametrize("trajectory", [MOVING, RESTING], ids=["moving", "resting"])
def test_passivity_falls_by_both_errors(service: httpx.Client, kind: str, trajectory: Any) -> None:
    # V' = -(e' K e' + e Lambda K Lambda e), lectures 32 and 34, with wrong parameters too.
    wrong = {"model_error": {"mass_scale": 1.3}} if kind == "adaptive" else {}
    found = simulate(service, kind, trajectory, **wrong)
    e, ed = errors(found)
    L, gain = np.diag(LAMBDA), np.diag(K)
    rate = -np.einsum("ti,ij,tj->t", ed, gain, ed) - np.einsum("ti,ij,tj->t", e, L @ gain @ L, e)
    decrease(found, rate)
    M = arm(found["position"][0], found["velocity"][0])[0] + J
    r = ed[0] + L @ e[0]
    V = 0.5 * r @ M @ r + e[0] @ L @ gain @ e[0]
    if kind == "adaptive":
        off = np.array(found["estimate"][0]) - found["true_parameters"]
        V += 0.5 * off @ off / GAINS["adaptive"]["Gamma"]
    assert found["lyapunov"][0] == pytest.approx(V, rel=1e-8)


def test_adaptation_tracks_with_wrong_masses(service: httpx.Client) -> None:
    wrong = {"model_error": {"mass_scale": 1.5}, "duration": 8.0, "sample_period": 0.05}
    adaptive = simulate(service, "adaptive", RESTING, **wrong)
    fixed = simulate(service, "passivity", RESTING, **wrong)
    assert np.abs(adaptive["tracking_error"][-1]).max() < 0.02
    assert np.abs(fixed["tracking_error"][-1]).max() > 0.02
    # A reference that stands still does not excite all parameters: they need not converge.
    off = np.array(adaptive["estimate"][-1]) - adaptive["true_parameters"]
    assert np.abs(off).max() > 1e-3
