"""Lectures 12 to 14, 16 and 17: Jacobians, velocities, the helicopter, static torques."""

from math import pi

import httpx
import numpy as np
import pytest

from tests.course.example import ROUNDING, ask, dh_matrix
from tests.course.robots import (
    A1,
    A2,
    ELBOW_A1,
    ELBOW_D1,
    ELBOW_D2,
    RRR_A2,
    RRR_A3,
    RRR_D1,
)

T1, T2, T3, STROKE = 0.5, -0.8, 0.3, 0.45
WEIGHT = 10.0


RRR = [
    dh_matrix(T1, RRR_D1, 0.0, pi / 2.0),
    dh_matrix(T2, 0.0, RRR_A2, 0.0),
    dh_matrix(T3, 0.0, RRR_A3, 0.0),
]
ELBOW = [
    dh_matrix(T1, ELBOW_D1, ELBOW_A1, -pi / 2.0),
    dh_matrix(T2, ELBOW_D2, 0.0, pi / 2.0),
    dh_matrix(0.0, STROKE, 0.0, 0.0),
]


def test_the_helicopter_looks_forward(service: httpx.Client) -> None:
    t = 1.7
    body = {"joints": [t / 3.0], "orientation": "rotation_matrix"}
    pose = ask(service, "robots/notes_helicopter/fk", body)["pose"]
    c, s = np.cos(t / 3.0), np.sin(t / 3.0)
    np.testing.assert_allclose(pose["position"], [30.0 * c, 30.0 * s, 100.0], atol=ROUNDING)
    # Frame 1 of the notes looks along the flight; that of the table outwards, a quarter turn less.
    R = np.array(pose["rotation_matrix"]) @ [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    np.testing.assert_allclose(R, [[-s, -c, 0], [c, -s, 0], [0, 0, 1]], atol=ROUNDING)


def test_the_rate_of_a_rotation_is_the_angular_velocity(service: httpx.Client) -> None:
    # R' = S(w) R, by central differences of forward kinematics: errors of about step^2.
    joints, rates, step = np.array([T1, T2, T3]), np.array([0.4, -0.7, 0.9]), 1e-5
    body = {"joints": joints.tolist(), "joint_velocities": rates.tolist()}
    w = np.array(ask(service, "robots/notes_rrr/velocity", body)["twist"][3:])
    rows = [(joints + k * step * rates).tolist() for k in (-1, 0, 1)]
    pose = ask(service, "robots/notes_rrr/fk", {"joints": rows, "orientation": "rotation_matrix"})
    before, now, after = (np.array(one["rotation_matrix"]) for one in pose["pose"])
    S = (after - before) / (2.0 * step) @ now.T
    cross = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
    np.testing.assert_allclose(S, cross, atol=1e-9)
    np.testing.assert_allclose(now @ cross @ now.T,
                               np.cross(np.eye(3), now @ w), atol=ROUNDING)  # fmt: skip


def test_angular_velocities_add_up(service: httpx.Client) -> None:
    joints, rates = [T1, T2, T3], np.array([0.4, -0.7, 0.9])
    body = {"joints": joints, "joint_velocities": rates.tolist()}
    w = ask(service, "robots/notes_rrr/velocity", body)["twist"][3:]
    z1 = [np.sin(T1), -np.cos(T1), 0.0]
    expected = rates[0] * np.array([0.0, 0.0, 1.0]) + (rates[1] + rates[2]) * np.array(z1)
    np.testing.assert_allclose(w, expected, atol=ROUNDING)


REDUNDANT = [0.1, -0.6, 0.2, -2.0, 0.3, 1.7, 0.5]
TWIST = [0.1, -0.05, 0.08, 0.2, -0.1, 0.15]


def test_the_pseudo_inverse_gives_the_least_norm(service: httpx.Client) -> None:
    body = {"joints": REDUNDANT, "twist": TWIST}
    found = ask(service, "robots/panda/velocity", body)
    J = np.array(ask(service, "robots/panda/jacobian", {"joints": REDUNDANT})["jacobian"])
    pinv = J.T @ np.linalg.inv(J @ J.T)
    np.testing.assert_allclose(J @ pinv, np.eye(6), atol=1e-9)
    np.testing.assert_allclose(found["joint_velocities"], pinv @ TWIST, atol=1e-8)
    np.testing.assert_allclose(found["residual"], np.zeros(6), atol=1e-9)
    b = np.array([0.3, -0.2, 0.1, 0.4, 0.0, -0.5, 0.2])
    moved = ask(service, "robots/panda/velocity", body | {"nullspace": b.tolist()})
    expected = pinv @ TWIST + (np.eye(7) - pinv @ J) @ b
    np.testing.assert_allclose(moved["joint_velocities"], expected, atol=1e-8)
    np.testing.assert_allclose(J @ moved["joint_velocities"], TWIST, atol=1e-8)


def test_six_joints_have_one_solution(service: httpx.Client) -> None:
    joints = [0.3, 0.4, 0.6, 0.2, 0.9, -0.4]
    J = np.array(ask(service, "robots/elbow_wrist/jacobian", {"joints": joints})["jacobian"])
    found = ask(service, "robots/elbow_wrist/velocity", {"joints": joints, "twist": TWIST})
    assert found["rank"] == 6
    np.testing.assert_allclose(found["joint_velocities"], np.linalg.solve(J, TWIST), atol=1e-8)


def test_fewer_than_six_joints_leave_a_residual(service: httpx.Client) -> None:
    body = {"joints": [T1, T2], "twist": TWIST, "damped_below": 0.0}
    found = ask(service, "robots/notes_two_link/velocity", body)
    J = np.array(ask(service, "robots/notes_two_link/jacobian", {"joints": [T1, T2]})["jacobian"])
    solution, *_ = np.linalg.lstsq(J, TWIST)
    np.testing.assert_allclose(found["joint_velocities"], solution, atol=1e-8)
    np.testing.assert_allclose(found["residual"], np.array(TWIST) - J @ solution, atol=1e-8)
    assert np.linalg.norm(found["residual"]) > 0.1


@pytest.mark.parametrize(("t2", "rank"), [(0.0, 1), (0.7, 2), (pi, 1)])
def test_a_stretched_arm_is_singular(service: httpx.Client, t2: float, rank: int) -> None:
    found = ask(service, "robots/notes_two_link/jacobian", {"joints": [T1, t2]})
    J = np.array(found["jacobian"])
    assert np.linalg.matrix_rank(J[:2], tol=1e-9) == rank
    assert abs(np.linalg.det(J[:2])) == pytest.approx(A1 * A2 * abs(np.sin(t2)), abs=1e-12)


def test_the_analytic_jacobian_is_the_rate_of_the_state(service: httpx.Client) -> None:
    joints, step = np.array([0.3, 0.4, 0.6, 0.2, 0.9, -0.4]), 1e-6
    body = {"joints": joints.tolist(), "kind": "analytic_zyz"}
    Ja = np.array(ask(service, "robots/elbow_wrist/jacobian", body)["jacobian"])
    rows = [(joints + k * step * e).tolist() for e in np.eye(6) for k in (1, -1)]
    pose = ask(service, "robots/elbow_wrist/fk", {"joints": rows, "orientation": "euler_zyz"})
    state = np.array([[*one["position"], *one["euler_zyz"]] for one in pose["pose"]])
    np.testing.assert_allclose(Ja.T, (state[::2] - state[1::2]) / (2.0 * step), atol=1e-8)
