"""Conversion and composition of poses over HTTP, against scipy."""

from typing import Any

import httpx
import numpy as np
from scipy.spatial.transform import Rotation


def converted(client: httpx.Client, **body: Any) -> dict[str, Any]:
    response = client.post("/v1/poses/convert", json=body)
    assert response.status_code == 200, response.text
    answer: dict[str, Any] = response.json()
    return answer


def test_every_form_is_converted_to_every_other(client: httpx.Client) -> None:
    turn = Rotation.from_euler("ZYZ", [0.3, 0.7, -1.1])
    expected = np.eye(4)
    expected[:3, :3], expected[:3, 3] = turn.as_matrix(), [1.0, 2.0, 3.0]
    forms = converted(client, pose={"position": [1.0, 2.0, 3.0], "euler_zyz": [0.3, 0.7, -1.1]})[
        "pose"
    ]
    np.testing.assert_allclose(forms["transform"], expected, atol=1e-15)
    np.testing.assert_allclose(forms["quaternion_xyzw"], turn.as_quat(canonical=True), atol=1e-15)
    np.testing.assert_allclose(forms["rpy"], turn.as_euler("xyz"), atol=1e-14)
    *axis, angle = forms["axis_angle"]
    np.testing.assert_allclose(np.multiply(axis, angle), turn.as_rotvec(), atol=1e-14)
    for name in ("quaternion_xyzw", "rotation_matrix", "rpy", "axis_angle"):
        again = converted(client, pose={"position": [1.0, 2.0, 3.0], name: forms[name]})
        np.testing.assert_allclose(again["pose"]["transform"], expected, atol=1e-14)
    again = converted(client, pose={"transform": forms["transform"]}, inverse=True)
    np.testing.assert_allclose(again["pose"]["transform"], np.linalg.inv(expected), atol=1e-14)
    np.testing.assert_allclose(again["inverse"]["transform"], expected, atol=1e-14)


def test_a_singular_orientation_is_told(client: httpx.Client) -> None:
    answer = converted(client, pose={"euler_zyz": [0.3, 0.0, 0.4]})
    assert answer["singular"] == [
        {"form": "euler_zyz", "determined": "theta = 0: only phi + psi is determined",
         "choice": "psi = 0"}
    ]  # fmt: skip
    np.testing.assert_allclose(answer["pose"]["euler_zyz_branches"], [[0.7, 0.0, 0.0]], atol=1e-15)
    assert len(answer["pose"]["rpy_branches"]) == 2
