"""Lectures 3 to 6: rotations, zyz angles, rigid motions, homogeneous transformations.

A robot whose table has a base pose and a tool pose answers their composition at q = 0.
"""

from math import acos, atan2, pi, sqrt
from typing import Any

import httpx
import numpy as np
import pytest

from tests.course.example import ROUNDING, ask, pose_matrix, rotation_matrix
from tests.course.robots import revolute

ANGLE, SECOND, THIRD = 0.7, -0.4, 1.1
ABOUT = {"x": [1.0, 0.0, 0.0], "y": [0.0, 1.0, 0.0], "z": [0.0, 0.0, 1.0]}
ORIGIN = [0.0, 0.0, 0.0]


def turn(axis: str, angle: float) -> dict[str, Any]:
    return {"position": ORIGIN, "axis_angle": [*ABOUT[axis], angle]}


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


@pytest.mark.parametrize("axis", "xyz")
def test_elementary_rotations(service: httpx.Client, axis: str) -> None:
    R = composed(service, turn(axis, ANGLE))["rotation_matrix"]
    np.testing.assert_allclose(R, rotation_matrix(axis, ANGLE), atol=ROUNDING)


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


def test_rotation_about_the_current_axis_multiplies_from_the_right(service: httpx.Client) -> None:
    R = composed(service, turn("x", ANGLE), turn("z", SECOND))["rotation_matrix"]
    expected = rotation_matrix("x", ANGLE) @ rotation_matrix("z", SECOND)
    np.testing.assert_allclose(R, expected, atol=ROUNDING)


def test_rotation_about_a_fixed_axis_multiplies_from_the_left(service: httpx.Client) -> None:
    # theta about x0, phi about z0, psi about z2: R = Rz(phi) Rx(theta) Rz(psi), lecture 4.
    inner = rotation_matrix("x", ANGLE) @ rotation_matrix("z", THIRD)
    tool = {"position": ORIGIN, "rotation_matrix": inner.tolist()}
    R = composed(service, turn("z", SECOND), tool)["rotation_matrix"]
    Rx, Rz, Rpsi = (
        rotation_matrix("x", ANGLE),
        rotation_matrix("z", SECOND),
        rotation_matrix("z", THIRD),
    )
    np.testing.assert_allclose(R, Rx @ (Rx.T @ Rz @ Rx) @ Rpsi, atol=ROUNDING)


def test_three_rotations_in_given_frames(service: httpx.Client) -> None:
    M1, M2, M3 = (rotation_matrix(a, t) for a, t in (("x", ANGLE), ("y", SECOND), ("z", THIRD)))
    R2_1 = M1.T @ M2 @ M1
    R3_2 = R2_1.T @ M3 @ R2_1
    base = {"position": ORIGIN, "rotation_matrix": (M1 @ R2_1).tolist()}
    tool = {"position": ORIGIN, "rotation_matrix": R3_2.tolist()}
    R = composed(service, base, tool)["rotation_matrix"]
    np.testing.assert_allclose(R, M1 @ M3 @ M1.T @ M2 @ M1, atol=ROUNDING)


@pytest.mark.parametrize("theta", [0.4, 1.9, -0.4, -1.9])
def test_zyz_angles(service: httpx.Client, theta: float) -> None:
    phi, psi = 0.8, -1.3
    base = {"position": ORIGIN, "euler_zyz": [phi, theta, psi]}
    R = np.array(composed(service, base)["rotation_matrix"])
    expected = rotation_matrix("z", phi) @ rotation_matrix("y", theta) @ rotation_matrix("z", psi)
    np.testing.assert_allclose(R, expected, atol=ROUNDING)
    # The branch sin theta > 0 of lecture 5; the service answers that one.
    by_notes = [atan2(R[1, 2], R[0, 2]), acos(R[2, 2]), atan2(R[2, 1], -R[2, 0])]
    angles = composed(service, base, orientation="euler_zyz")["euler_zyz"]
    assert angles == pytest.approx(by_notes, abs=ROUNDING)
    # The other branch of the notes is the same rotation.
    other = [atan2(-R[1, 2], -R[0, 2]), -acos(R[2, 2]), atan2(-R[2, 1], R[2, 0])]
    same = composed(service, {"position": ORIGIN, "euler_zyz": other})["rotation_matrix"]
    np.testing.assert_allclose(same, R, atol=ROUNDING)


@pytest.mark.parametrize("theta", [0.0, pi])
def test_zyz_angles_are_singular_where_sin_theta_vanishes(
    service: httpx.Client, theta: float
) -> None:
    phi, psi = 0.8, -1.3
    base = {"position": ORIGIN, "euler_zyz": [phi, theta, psi]}
    angles = composed(service, base, orientation="euler_zyz")["euler_zyz"]
    determined = phi + psi if theta == 0.0 else phi - psi
    assert angles == pytest.approx([determined, theta, 0.0], abs=1e-7)


def test_rigid_motion_maps_points(service: httpx.Client) -> None:
    d, p1 = np.array([0.3, -0.2, 0.5]), np.array([0.1, 0.4, -0.3])
    base = {"position": d.tolist(), "axis_angle": [*ABOUT["y"], ANGLE]}
    pose = composed(service, base, {"position": p1.tolist()})
    expected = rotation_matrix("y", ANGLE) @ p1 + d
    np.testing.assert_allclose(pose["position"], expected, atol=ROUNDING)
    # Translation first, then rotation, is another motion.
    assert np.linalg.norm(rotation_matrix("y", ANGLE) @ (p1 + d) - expected) > 0.1


def test_homogeneous_transformations_compose(service: httpx.Client) -> None:
    d1, d2 = [0.3, -0.2, 0.5], [-0.1, 0.6, 0.2]
    base = {"position": d1, "axis_angle": [*ABOUT["x"], ANGLE]}
    tool = {"position": d2, "axis_angle": [*ABOUT["y"], SECOND]}
    H1, H2 = np.eye(4), np.eye(4)
    H1[:3, :3], H1[:3, 3] = rotation_matrix("x", ANGLE), d1
    H2[:3, :3], H2[:3, 3] = rotation_matrix("y", SECOND), d2
    T = pose_matrix(composed(service, base, tool))
    np.testing.assert_allclose(T, H1 @ H2, atol=ROUNDING)
    p0 = H1[:3, :3] @ (H2[:3, :3] @ [1, 2, 3] + H2[:3, 3]) + H1[:3, 3]
    np.testing.assert_allclose((T @ [1.0, 2.0, 3.0, 1.0])[:3], p0, atol=ROUNDING)


@pytest.mark.parametrize("axis", "xyz")
def test_elementary_translations(service: httpx.Client, axis: str) -> None:
    step = 0.35 * np.array(ABOUT[axis])
    T = pose_matrix(composed(service, {"position": step.tolist()}))
    np.testing.assert_allclose(T, np.block([[np.eye(3), step[:, None]], [0, 0, 0, 1]]))


def test_a_change_of_basis_is_a_similarity_transform(service: httpx.Client) -> None:
    # R' = (R_1_0)^T R R_1_0 in frame 1: base (R_1_0)^T R, tool R_1_0.
    R10, R = rotation_matrix("x", ANGLE), rotation_matrix("z", SECOND)
    base = {"position": ORIGIN, "rotation_matrix": (R10.T @ R).tolist()}
    tool = {"position": ORIGIN, "rotation_matrix": R10.tolist()}
    changed = np.array(composed(service, base, tool)["rotation_matrix"])
    v1 = np.array([0.2, -0.7, 0.4])
    np.testing.assert_allclose(changed @ v1, R10.T @ (R @ (R10 @ v1)), atol=ROUNDING)
    assert np.trace(changed) == pytest.approx(np.trace(R))


def turned(axis: str, angle: float, about: str = "current") -> dict[str, Any]:
    return {"axis_angle": [*ABOUT[axis], angle], "about": about}


@pytest.mark.parametrize("order", ["current", "fixed", "mixed"])
def test_a_list_of_rotations_is_composed(service: httpx.Client, order: str) -> None:
    abouts = {"current": ("current",) * 3, "fixed": ("fixed",) * 3,
              "mixed": ("current", "fixed", "current")}[order]  # fmt: skip
    steps = (("x", ANGLE), ("z", SECOND), ("z", THIRD))
    body = {"motions": [turned(*step, about) for step, about in zip(steps, abouts, strict=True)]}
    R = np.eye(3)
    for step, about in zip(steps, abouts, strict=True):
        M = rotation_matrix(*step)
        R = R @ M if about == "current" else M @ R
    answer = ask(service, "poses/convert", body)
    np.testing.assert_allclose(answer["pose"]["rotation_matrix"], R, atol=ROUNDING)
    np.testing.assert_allclose(answer["inverse"]["rotation_matrix"], R.T, atol=ROUNDING)
    if order == "mixed":  # lecture 4: R = Rz(phi) Rx(theta) Rz(psi)
        Rx, Rz, Rpsi = (rotation_matrix(*step) for step in steps)
        np.testing.assert_allclose(R, Rz @ Rx @ Rpsi, atol=ROUNDING)


def test_both_branches_of_zyz_angles_are_answered(service: httpx.Client) -> None:
    body = {"pose": {"euler_zyz": [0.8, 1.9, -1.3]}}
    answer = ask(service, "poses/convert", body)["pose"]
    R = np.array(answer["rotation_matrix"])
    upper = [atan2(R[1, 2], R[0, 2]), acos(R[2, 2]), atan2(R[2, 1], -R[2, 0])]
    lower = [atan2(-R[1, 2], -R[0, 2]), -acos(R[2, 2]), atan2(-R[2, 1], R[2, 0])]
    np.testing.assert_allclose(answer["euler_zyz_branches"], [upper, lower], atol=ROUNDING)


def test_the_skew_matrix_is_the_cross_product(service: httpx.Client) -> None:
    w, v = np.array([0.3, -0.7, 0.4]), np.array([1.0, 2.0, -0.5])
    body = {"pose": {"euler_zyz": [0.8, 1.9, -1.3]}, "angular_velocity": w.tolist()}
    answer = ask(service, "poses/convert", body)
    S, R = np.array(answer["skew"]), np.array(answer["pose"]["rotation_matrix"])
    np.testing.assert_allclose(S @ v, np.cross(w, v), atol=ROUNDING)
    np.testing.assert_allclose(S + S.T, np.zeros((3, 3)), atol=ROUNDING)
    np.testing.assert_allclose(answer["rotation_rate"], S @ R, atol=ROUNDING)
    # R S(w) R^T = S(R w), lecture 12.
    np.testing.assert_allclose(R @ S @ R.T @ v, np.cross(R @ w, v), atol=ROUNDING)


def test_a_homogeneous_transformation_has_its_closed_inverse(service: httpx.Client) -> None:
    d = np.array([0.3, -0.2, 0.5])
    body = {"pose": {"position": d.tolist(), "axis_angle": [*ABOUT["y"], ANGLE]}}
    answer = ask(service, "poses/convert", body)
    R = rotation_matrix("y", ANGLE)
    H = np.block([[R, d[:, None]], [np.zeros((1, 3)), np.ones((1, 1))]])
    inverse = np.block([[R.T, -(R.T @ d)[:, None]], [np.zeros((1, 3)), np.ones((1, 1))]])
    np.testing.assert_allclose(answer["pose"]["transform"], H, atol=ROUNDING)
    np.testing.assert_allclose(answer["inverse"]["transform"], inverse, atol=ROUNDING)
