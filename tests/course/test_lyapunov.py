"""Lectures 29 and 30 and the review: the damped mass on a spring and the pendulum."""

from typing import Any

import httpx
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.course.example import ask, second_order_error
from tests.course.robots import prismatic, revolute

#: Reference that stands still at zero for six seconds.
REST = {"segments": [{"t0": 0.0, "t1": 6.0, "coefficients": [[0.0]]}]}
TIGHT = {"relative_tolerance": 1e-11, "absolute_tolerance": 1e-13, "saturate": False}
#: Gains of a controller that does nothing: its torques are below 1e-11 [N m].
IDLE = {"type": "pd_gravity", "Kp": 1e-12, "Kd": 1e-12}
MASS, LENGTH, FRICTION, G = 0.7, 0.9, 0.25, 9.81


@pytest.fixture(scope="module")
def spring(service: httpx.Client) -> dict[str, Any]:
    """k = m = b = 1: a unit mass that slides; PD control is the spring, friction the damper."""
    row = prismatic(mass=1.0, center_of_mass=[0, 0, 0], viscous_friction=0.75,
                    inertia=[[1e-3, 0, 0], [0, 1e-3, 0], [0, 0, 1e-3]])  # fmt: skip
    robot = {"name": "notes_spring", "dh": {
        "convention": "standard", "rows": [row], "gravity": [0.0, 0.0, 0.0]}}  # fmt: skip
    assert service.post("/v1/robots", json=robot).status_code == 201
    body = {"robot": "notes_spring", "trajectory": REST, "initial_state": {"offset": [0.5]},
            "controller": {"type": "pd_gravity", "Kp": 1.0, "Kd": 0.25}} | TIGHT  # fmt: skip
    found: dict[str, Any] = ask(service, "simulate", body)
    return found


def test_the_spring_has_the_motion_of_its_poles(spring: dict[str, Any]) -> None:
    t = np.array(spring["time"])
    expected = second_order_error(0.5, 0.0, 1.0, 1.0, t)
    np.testing.assert_allclose(np.array(spring["position"])[:, 0], expected, atol=1e-9)


def test_the_quadratic_form_falls_as_its_own_negative(spring: dict[str, Any]) -> None:
    # V = (x1² + x1 x2 + x2²)/2 has V' = -V.
    x1, x2 = (np.array(spring[key])[:, 0] for key in ("position", "velocity"))
    V = 0.5 * (x1**2 + x1 * x2 + x2**2)
    np.testing.assert_allclose(V, V[0] * np.exp(-np.array(spring["time"])), atol=1e-9)


def test_the_energy_falls_though_its_rate_vanishes_at_turning_points(
    spring: dict[str, Any],
) -> None:
    # V = (k x1² + m x2²)/2 has V' = -b x2²: never positive, zero at rest.
    x1, x2 = (np.array(spring[key])[:, 0] for key in ("position", "velocity"))
    np.testing.assert_allclose(spring["lyapunov"], 0.5 * (x1**2 + x2**2), atol=1e-9)
    rate = np.gradient(spring["lyapunov"], spring["time"], edge_order=2)
    np.testing.assert_allclose(rate[1:-1], -(x2[1:-1] ** 2), atol=1e-4)
    # LaSalle: it ends at the equilibrium though.
    assert abs(x1[-1]) < 0.05
    assert spring["lyapunov"][-1] < 0.01 * spring["lyapunov"][0]


@pytest.fixture(scope="module")
def pendulum(service: httpx.Client) -> dict[str, Any]:
    """A point mass on a rod with friction, hanging at 0."""
    tiny = [[1e-9, 0, 0], [0, 1e-9, 0], [0, 0, 1e-9]]
    row = revolute(LENGTH, mass=MASS, center_of_mass=[0, 0, 0], inertia=tiny,
                   viscous_friction=FRICTION)  # fmt: skip
    robot = {"name": "notes_pendulum", "dh": {
        "convention": "standard", "rows": [row], "gravity": [G, 0.0, 0.0]}}  # fmt: skip
    assert service.post("/v1/robots", json=robot).status_code == 201
    body = {"robot": "notes_pendulum", "trajectory": REST, "controller": IDLE,
            "model_error": {"gravity": [0, 0, 0]}, "initial_state": {"offset": [2.5]}}  # fmt: skip
    found: dict[str, Any] = ask(service, "simulate", body | TIGHT)
    assert found["outcome"] == "completed"
    return found


def test_the_pendulum_swings_as_its_equation_says(pendulum: dict[str, Any]) -> None:
    # m r² theta'' + k theta' + m g r sin(theta) = 0, by scipy.
    def slope(_t: float, x: Any) -> list[float]:
        drag = FRICTION / (MASS * LENGTH**2)
        return [x[1], -drag * x[1] - G / LENGTH * np.sin(x[0])]

    t = np.array(pendulum["time"])
    exact = solve_ivp(slope, (0.0, t[-1]), [2.5, 0.0], "DOP853", t, rtol=1e-12, atol=1e-13)
    # The 1e-9 kg m² of the bob change the motion by as much.
    np.testing.assert_allclose(np.array(pendulum["position"])[:, 0], exact.y[0], atol=1e-7)
    np.testing.assert_allclose(np.array(pendulum["velocity"])[:, 0], exact.y[1], atol=1e-7)


def test_the_energy_of_the_pendulum_falls_by_its_friction(pendulum: dict[str, Any]) -> None:
    x1, x2 = (np.array(pendulum[key])[:, 0] for key in ("position", "velocity"))
    t = np.array(pendulum["time"])
    V = 0.5 * x2**2 + G / LENGTH * (1.0 - np.cos(x1))
    drag = FRICTION / (MASS * LENGTH**2)
    rate = -drag * x2**2
    fallen = np.concatenate([[0.0], np.cumsum((rate[1:] + rate[:-1]) / 2.0 * np.diff(t))])
    # The trapezoidal rule at steps of 0.01 s.
    np.testing.assert_allclose(V - V[0], fallen, atol=1e-3)
    assert (np.diff(V) <= 1e-9).all()
    assert (V > 0.0).all()
