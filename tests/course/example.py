"""Requests of the course notes to the service, and poses of its answers."""

from typing import Any

import httpx
import numpy as np

#: Rounding of a few hundred operations on numbers of the size of one.
ROUNDING = 1e-9


def ask(service: httpx.Client, path: str, body: dict[str, Any]) -> Any:
    """The answer to a request, which must succeed."""
    response = service.post(f"/v1/{path}", json=body)
    assert response.status_code == 200, response.text
    return response.json()


def pose_matrix(pose: dict[str, Any]) -> Any:
    """The homogeneous transformation of an answered pose with a rotation matrix."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = pose["rotation_matrix"], pose["position"]
    return T
