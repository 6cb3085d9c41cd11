"""Lectures 3 to 9 and 12 to 17: rotations, tables, Jacobians, velocities."""

from math import pi, sqrt
from typing import Any

import httpx
import numpy as np
import pytest

from tests.course.example import ROUNDING, ask, dh_matrix, pose_matrix, rotation_matrix
from tests.course.robots import (
    ELBOW_A1,
    ELBOW_D1,
    ELBOW_D2,
    revolute,
)

ANGLE, SECOND, THIRD = 0.7, -0.4, 1.1
ABOUT = {"x": [1.0, 0.0, 0.0], "y": [0.0, 1.0, 0.0], "z": [0.0, 0.0, 1.0]}
ORIGIN = [0.0, 0.0, 0.0]


def composed(
    service: httpx.Client,
    base: dict[str, Any],
    tool: dict[str, Any] | None = None,
    joint: float = 0.0,
    orientation: str = "rotation_matrix",
) -> Any:
    """The pose base · Rot_z(joint) · tool, by forward kinematics of an arm of one joint."""
    robot = {"name": "notes_composition", "dh": {
        "convention": "standard", "rows": [revolute()], "base": base,
        "tool": tool or {"position": ORIGIN}}}  # fmt: skip
    assert service.post("/v1/robots", json=robot).status_code == 201
    try:
        body = {"joints": [joint], "orientation": orientation}
        return ask(service, "robots/notes_composition/fk", body)["pose"]
    finally:
        service.delete("/v1/robots/notes_composition")


def test_frame_of_the_figure(service: httpx.Client) -> None:
    h = sqrt(2.0) / 2.0
    R = np.array([[-h, 0.0, h], [h, 0.0, h], [0.0, 1.0, 0.0]])
    pose = composed(service, {"position": ORIGIN, "rotation_matrix": R.tolist()})
    np.testing.assert_allclose(pose["rotation_matrix"], R, atol=ROUNDING)
    np.testing.assert_allclose(np.array(pose["rotation_matrix"]).T @ R, np.eye(3), atol=ROUNDING)
    assert np.linalg.det(pose["rotation_matrix"]) == pytest.approx(1.0)


def test_a_left_handed_frame_is_refused(service: httpx.Client) -> None:
    mirror = {"position": ORIGIN, "rotation_matrix": [[1, 0, 0], [0, 1, 0], [0, 0, -1]]}
    robot = {"name": "notes_mirror", "dh": {
        "convention": "standard", "rows": [revolute()], "base": mirror}}  # fmt: skip
    refused = service.post("/v1/robots", json=robot)
    assert refused.status_code == 422
    assert "det R = -1" in refused.json()["detail"]


def test_rigid_motion_maps_points(service: httpx.Client) -> None:
    d, p1 = np.array([0.3, -0.2, 0.5]), np.array([0.1, 0.4, -0.3])
    base = {"position": d.tolist(), "axis_angle": [*ABOUT["y"], ANGLE]}
    pose = composed(service, base, {"position": p1.tolist()})
    expected = rotation_matrix("y", ANGLE) @ p1 + d
    np.testing.assert_allclose(pose["position"], expected, atol=ROUNDING)
    # Translation first, then rotation, is another motion.
    assert np.linalg.norm(rotation_matrix("y", ANGLE) @ (p1 + d) - expected) > 0.1


def test_a_change_of_basis_is_a_similarity_transform(service: httpx.Client) -> None:
    # R' = (R_1_0)^T R R_1_0 in frame 1: base (R_1_0)^T R, tool R_1_0.
    R10, R = rotation_matrix("x", ANGLE), rotation_matrix("z", SECOND)
    base = {"position": ORIGIN, "rotation_matrix": (R10.T @ R).tolist()}
    tool = {"position": ORIGIN, "rotation_matrix": R10.tolist()}
    changed = np.array(composed(service, base, tool)["rotation_matrix"])
    v1 = np.array([0.2, -0.7, 0.4])
    np.testing.assert_allclose(changed @ v1, R10.T @ (R @ (R10 @ v1)), atol=ROUNDING)
    assert np.trace(changed) == pytest.approx(np.trace(R))


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_a_row_is_the_matrix_of_lecture_9(service: httpx.Client, kind: str) -> None:
    theta, d, a, alpha, q = 0.7, 0.2, -0.3, 1.1, 0.4
    row = {"type": kind, "a": a, "alpha": alpha, "d": d, "theta": theta, "lower": -2, "upper": 2}
    robot = {"name": f"notes_{kind}", "dh": {"convention": "standard", "rows": [row]}}
    stored = service.post("/v1/robots", json=robot)
    assert stored.status_code == 201, stored.text
    turned = dh_matrix(theta + q, d, a, alpha)
    moved = dh_matrix(theta, d + q, a, alpha)
    body = {"joints": [q], "orientation": "rotation_matrix"}
    pose = ask(service, f"robots/notes_{kind}/fk", body)["pose"]
    expected = turned if kind == "revolute" else moved
    np.testing.assert_allclose(pose_matrix(pose), expected, atol=1e-12)


def test_the_table_is_answered_as_it_was_given(service: httpx.Client) -> None:
    rows = service.get("/v1/robots/notes_elbow").json()["dh"]["rows"]
    kept = [[row[name] for name in ("a", "alpha", "d", "theta")] for row in rows]
    table = [
        [ELBOW_A1, -pi / 2.0, ELBOW_D1, 0.0],
        [0.0, pi / 2.0, ELBOW_D2, 0.0],
        [0.0, 0.0, 0.0, 0.0],
    ]
    np.testing.assert_allclose(kept, table, atol=1e-12)
    assert [row["type"] for row in rows] == ["revolute", "revolute", "prismatic"]


T1, T2, T3, STROKE = 0.5, -0.8, 0.3, 0.45


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


def test_the_analytic_jacobian_is_the_rate_of_the_state(service: httpx.Client) -> None:
    joints, step = np.array([0.3, 0.4, 0.6, 0.2, 0.9, -0.4]), 1e-6
    body = {"joints": joints.tolist(), "kind": "analytic_zyz"}
    Ja = np.array(ask(service, "robots/elbow_wrist/jacobian", body)["jacobian"])
    rows = [(joints + k * step * e).tolist() for e in np.eye(6) for k in (1, -1)]
    pose = ask(service, "robots/elbow_wrist/fk", {"joints": rows, "orientation": "euler_zyz"})
    state = np.array([[*one["position"], *one["euler_zyz"]] for one in pose["pose"]])
    np.testing.assert_allclose(Ja.T, (state[::2] - state[1::2]) / (2.0 * step), atol=1e-8)
