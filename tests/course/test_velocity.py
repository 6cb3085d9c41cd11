"""Lectures 12 to 14, 16 and 17: Jacobians, velocities, the helicopter, static torques."""

from math import pi

import httpx
import numpy as np

from tests.course.example import ROUNDING, ask, dh_matrix
from tests.course.robots import (
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


def test_angular_velocities_add_up(service: httpx.Client) -> None:
    joints, rates = [T1, T2, T3], np.array([0.4, -0.7, 0.9])
    body = {"joints": joints, "joint_velocities": rates.tolist()}
    w = ask(service, "robots/notes_rrr/velocity", body)["twist"][3:]
    z1 = [np.sin(T1), -np.cos(T1), 0.0]
    expected = rates[0] * np.array([0.0, 0.0, 1.0]) + (rates[1] + rates[2]) * np.array(z1)
    np.testing.assert_allclose(w, expected, atol=ROUNDING)


REDUNDANT = [0.1, -0.6, 0.2, -2.0, 0.3, 1.7, 0.5]
TWIST = [0.1, -0.05, 0.08, 0.2, -0.1, 0.15]


def test_the_analytic_jacobian_is_the_rate_of_the_state(service: httpx.Client) -> None:
    joints, step = np.array([0.3, 0.4, 0.6, 0.2, 0.9, -0.4]), 1e-6
    body = {"joints": joints.tolist(), "kind": "analytic_zyz"}
    Ja = np.array(ask(service, "robots/elbow_wrist/jacobian", body)["jacobian"])
    rows = [(joints + k * step * e).tolist() for e in np.eye(6) for k in (1, -1)]
    pose = ask(service, "robots/elbow_wrist/fk", {"joints": rows, "orientation": "euler_zyz"})
    state = np.array([[*one["position"], *one["euler_zyz"]] for one in pose["pose"]])
    np.testing.assert_allclose(Ja.T, (state[::2] - state[1::2]) / (2.0 * step), atol=1e-8)
