"""Lectures 7 to 9: Denavit-Hartenberg tables and forward kinematics."""

from math import pi

import httpx
import numpy as np
import pytest

from tests.course.example import ask, dh_matrix, pose_matrix
from tests.course.robots import (
    ELBOW_A1,
    ELBOW_D1,
    ELBOW_D2,
)


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


@pytest.mark.parametrize("name", ["notes_elbow", "notes_rrr", "notes_planar", "notes_cart"])
def test_an_answered_table_makes_the_same_robot(service: httpx.Client, name: str) -> None:
    table = service.get(f"/v1/robots/{name}").json()["dh"]
    copy = {"name": f"{name}_copy", "dh": table}
    stored = service.post("/v1/robots", json=copy)
    assert stored.status_code == 201, stored.text
    n = len(table["rows"])
    joints = [0.4, -0.7, 0.3][:n]
    body = {"joints": joints, "orientation": "rotation_matrix"}
    poses = [ask(service, f"robots/{robot}/fk", body)["pose"] for robot in (name, copy["name"])]
    np.testing.assert_allclose(pose_matrix(poses[1]), pose_matrix(poses[0]), atol=1e-12)
    if "mass" in table["rows"][0] and table["rows"][0]["mass"]:
        state = {"joints": joints, "velocities": [0.5] * n, "accelerations": [0.2] * n}
        first, second = (ask(service, f"robots/{robot}/dynamics", state)["torques"]
                         for robot in (name, copy["name"]))  # fmt: skip
        np.testing.assert_allclose(second, first, atol=1e-12)
