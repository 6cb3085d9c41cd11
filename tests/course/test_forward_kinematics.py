"""Lectures 7 to 9: Denavit-Hartenberg tables and forward kinematics."""

from math import pi

import httpx
import numpy as np
import pytest

from tests.course.example import Example, ask, check, dh_matrix, each, pose_matrix
from tests.course.robots import (
    A1,
    A2,
    ELBOW_A1,
    ELBOW_D1,
    ELBOW_D2,
    ROD,
    RRR_A2,
    RRR_A3,
    RRR_D1,
)

T1, T2, T3 = 0.5, -0.8, 0.3
C1, S1, C12, S12 = np.cos(T1), np.sin(T1), np.cos(T1 + T2), np.sin(T1 + T2)
STROKE = 0.45
#: Rows (theta, d, a, alpha) of the RRP arm with an elbow, the RRR arm and the cart.
ELBOW = [
    dh_matrix(T1, ELBOW_D1, ELBOW_A1, -pi / 2.0),
    dh_matrix(T2, ELBOW_D2, 0.0, pi / 2.0),
    dh_matrix(0.0, STROKE, 0.0, 0.0),
]
RRR = [
    dh_matrix(T1, RRR_D1, 0.0, pi / 2.0),
    dh_matrix(T2, 0.0, RRR_A2, 0.0),
    dh_matrix(T3, 0.0, RRR_A3, 0.0),
]
CART_X, CART_PHI = 0.3, 0.6


def fk(name: str, robot: str, joints: list[float], link: str, expected: np.ndarray) -> Example:
    body = {"joints": joints, "orientation": "rotation_matrix"}
    return Example(
        name, f"robots/{robot}/fk", body, lambda found: pose_matrix(found["links"][link]), expected
    )


EXAMPLES = [
    fk("9 two links, H_1_0", "notes_two_link", [T1, T2], "link_1", dh_matrix(T1, 0.0, A1, 0.0)),
    fk(
        "9 two links, closed form of H_2_0",
        "notes_two_link",
        [T1, T2],
        "tool",
        np.array(
            [
                [C12, -S12, 0.0, A1 * C1 + A2 * C12],
                [S12, C12, 0.0, A1 * S1 + A2 * S12],
                [0.0, 0.0, 1.0, 0.0],
                [0.0, 0.0, 0.0, 1.0],
            ]
        ),
    ),
    *(
        fk(
            f"9 elbow, H_{i}_0",
            "notes_elbow",
            [T1, T2, STROKE],
            f"link_{i}",
            np.linalg.multi_dot([np.eye(4), *ELBOW[:i]]),
        )
        for i in (1, 2, 3)
    ),
    fk(
        "9 elbow, O_2 by geometry",
        "notes_elbow",
        [T1, T2, STROKE],
        "link_2",
        np.block(
            [
                [
                    (ELBOW[0] @ ELBOW[1])[:3, :3],
                    np.array(
                        [
                            [ELBOW_A1 * C1 - ELBOW_D2 * S1],
                            [ELBOW_A1 * S1 + ELBOW_D2 * C1],
                            [ELBOW_D1],
                        ]
                    ),
                ],
                [np.array([[0.0, 0.0, 0.0, 1.0]])],
            ]
        ),
    ),
    *(
        fk(
            f"15 RRR, H_{i}_0",
            "notes_rrr",
            [T1, T2, T3],
            f"link_{i}",
            np.linalg.multi_dot([np.eye(4), *RRR[:i]]),
        )
        for i in (1, 2, 3)
    ),
    fk("26 cart, H_1_0", "notes_cart", [CART_X, CART_PHI], "link_1",
       dh_matrix(0.0, CART_X, 0.0, -pi / 2.0)),
    fk("26 pendulum, H_2_0", "notes_cart", [CART_X, CART_PHI], "link_2",
       dh_matrix(0.0, CART_X, 0.0, -pi / 2.0) @ dh_matrix(CART_PHI, 0.0, ROD, 0.0)),
    Example(
        "26 pendulum, r_2 of the notes",
        "robots/notes_cart/fk",
        {"joints": [CART_X, CART_PHI]},
        lambda found: found["pose"]["position"],
        [ROD * np.cos(CART_PHI), 0.0, CART_X - ROD * np.sin(CART_PHI)],
    ),
    Example(
        "27 R_2_0 of the pendulum",
        "robots/notes_cart/fk",
        {"joints": [CART_X, CART_PHI], "orientation": "rotation_matrix"},
        lambda found: found["pose"]["rotation_matrix"],
        [
            [np.cos(CART_PHI), -np.sin(CART_PHI), 0.0],
            [0.0, 0.0, 1.0],
            [-np.sin(CART_PHI), -np.cos(CART_PHI), 0.0],
        ],
    ),
]  # fmt: skip


@each(EXAMPLES)
def test_example(service: httpx.Client, example: Example) -> None:
    check(service, example)


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
