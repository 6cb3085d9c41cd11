"""Lectures 20, 28, 31, 32, 34: five controllers, torques, errors and Lyapunov functions."""

from typing import Any

import httpx
import numpy as np

from tests.course.example import ask, second_order_error
from tests.course.robots import FRICTION, MOTOR_INERTIA, revolute

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


def test_adaptation_tracks_with_wrong_masses(service: httpx.Client) -> None:
    wrong = {"model_error": {"mass_scale": 1.5}, "duration": 8.0, "sample_period": 0.05}
    adaptive = simulate(service, "adaptive", RESTING, **wrong)
    fixed = simulate(service, "passivity", RESTING, **wrong)
    assert np.abs(adaptive["tracking_error"][-1]).max() < 0.02
    assert np.abs(fixed["tracking_error"][-1]).max() > 0.02
    # A reference that stands still does not excite all parameters: they need not converge.
    off = np.array(adaptive["estimate"][-1]) - adaptive["true_parameters"]
    assert np.abs(off).max() > 1e-3
