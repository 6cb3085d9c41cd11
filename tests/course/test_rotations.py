"""Lectures 3 to 6: rotations, zyz angles, rigid motions, homogeneous transformations.

A robot whose table has a base pose and a tool pose answers their composition at q = 0.
"""

from math import sqrt
from typing import Any

import httpx
import numpy as np
import pytest

from tests.course.example import ROUNDING, ask, rotation_matrix
from tests.course.robots import revolute

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
