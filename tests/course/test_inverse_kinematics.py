"""Lectures 10, 11, 15, 16: decoupling with all branches, numeric and gradient methods."""

from math import atan2, cos, pi, sin
from typing import Any

import httpx
import numpy as np
import pytest

from tests.course.example import ROUNDING, ask, dh_matrix, pose_matrix
from tests.course.robots import RRR_A2, RRR_A3, RRR_D1

#: Lengths of the built-in elbow manipulator with a spherical wrist [m].
D1 = ELBOW_A2 = D4 = 0.4
D6 = 0.1
POSITION, ZYZ = [0.35, 0.25, 0.55], [0.4, 1.8, -0.6]
POSE: dict[str, Any] = {"position": POSITION, "euler_zyz": ZYZ}
SEED = [0.5, 0.6, 0.9, 0.3, 0.8, 0.1]


def elbow(q: Any) -> list[Any]:
    """The transformations of the rows of the elbow manipulator."""
    table = [
        (D1, 0.0, pi / 2), (0.0, ELBOW_A2, 0.0), (0.0, 0.0, pi / 2),
        (D4, 0.0, -pi / 2), (0.0, 0.0, pi / 2), (D6, 0.0, 0.0),
    ]  # fmt: skip
    return [dh_matrix(angle, *row) for angle, row in zip(q, table, strict=True)]


def distance(p: Any, q: Any) -> float:
    """Largest difference of two configurations, whole turns aside [rad]."""
    return float(np.abs(np.angle(np.exp(1j * (np.array(p) - q)))).max())


def test_six_coordinates_are_too_many_for_two_joints(service: httpx.Client) -> None:
    body = {"pose": {"position": [0.55, 0.45, 0.2]}}
    refused = service.post("/v1/robots/notes_two_link/ik", json=body)
    assert refused.status_code == 422
    assert refused.json()["code"] == "NO_IK_SOLUTION"


def test_seven_joints_have_a_family_of_solutions(service: httpx.Client) -> None:
    joints = [0.1, 0.6, 0.2, -1.2, 0.3, 0.9, 0.5]
    fk = {"joints": joints, "orientation": "quaternion_xyzw"}
    tip = ask(service, "robots/iiwa14/fk", fk)["pose"]
    pose = {name: tip[name] for name in ("position", "quaternion_xyzw")}
    body = {
        "pose": pose,
        "method": "analytic",
        "parameters": [-0.4, 0.0, 0.4],
        "all_solutions": True,
    }
    found = ask(service, "robots/iiwa14/ik", body)["solutions"]
    assert len(found) >= 3
    rows = [one["joints"] for one in found]
    poses = ask(service, "robots/iiwa14/fk", {"joints": rows})["pose"]
    for one in poses:
        assert one["position"] == pytest.approx(pose["position"], abs=1e-8)
    assert max(distance(rows[0], row) for row in rows[1:]) > 0.1


def test_a_straight_wrist_determines_a_sum_of_angles_only(service: httpx.Client) -> None:
    joints = [0.3, 0.7, 0.8, 0.2, 0.0, 0.5]
    fk = {"joints": joints, "orientation": "rotation_matrix"}
    tip = ask(service, "robots/elbow_wrist/fk", fk)["pose"]
    np.testing.assert_allclose(pose_matrix(tip), np.linalg.multi_dot(elbow(joints)), atol=ROUNDING)
    pose = {"position": tip["position"], "rotation_matrix": tip["rotation_matrix"]}
    body = {"pose": pose, "method": "analytic", "seed_joints": [0.3, 0.7, 0.8, 0.6, 0.0, 0.0]}
    found = ask(service, "robots/elbow_wrist/ik", body)["solutions"]
    q = found[0]["joints"]
    assert q[3] + q[5] == pytest.approx(0.7, abs=1e-7)
    assert q[3] == pytest.approx(0.6, abs=1e-7)
    rank = ask(service, "robots/elbow_wrist/jacobian", {"joints": q})["rank"]
    assert rank == 5


def follow(service: httpx.Client, seed: Any, **options: Any) -> dict[str, Any]:
    """The answer of the gradient method with its trace."""
    body = {
        "pose": POSE,
        "method": "gradient",
        "seed_joints": list(seed),
        "gradient": {"trace": True} | options,
    }
    found: dict[str, Any] = ask(service, "robots/elbow_wrist/ik", body)
    return found


def test_the_descent_of_lecture_15_lowers_the_error(service: httpx.Client) -> None:
    found = follow(service, SEED, rule="transpose")
    trace = found["trace"]
    cost = np.array(trace["position_error"]) ** 2 + np.array(trace["orientation_error"]) ** 2
    assert (np.diff(cost) <= 1e-12).all()
    assert cost[-1] < 1e-6 * cost[0]


@pytest.mark.parametrize("form", ["flow", "step"])
def test_positions_of_the_articulated_arm_by_the_transpose(
    service: httpx.Client, form: str
) -> None:
    # q' = gamma J^T (O_d - O_3) and its discrete form, from the same seed.
    target = np.array([0.3, 0.4, 0.7])
    body = {
        "pose": {"position": target.tolist()},
        "axes": ["x", "y", "z"],
        "method": "gradient",
        "seed_joints": [0.2, 0.4, 0.3],
        "gradient": {"rule": "transpose", "form": form, "gain": 0.5, "trace": True},
    }
    found = ask(service, "robots/notes_rrr/ik", body)
    q = np.array([0.2, 0.4, 0.3])
    trace = np.array(found["trace"]["joints"])
    np.testing.assert_allclose(trace[0], q, atol=ROUNDING)
    if form == "step":
        for row in trace[:20]:
            np.testing.assert_allclose(row, q, atol=ROUNDING)
            H = [dh_matrix(q[0], RRR_D1, 0.0, pi / 2), dh_matrix(q[1], 0.0, RRR_A2, 0.0),
                 dh_matrix(q[2], 0.0, RRR_A3, 0.0)]  # fmt: skip
            frames = [np.eye(4), H[0], H[0] @ H[1], H[0] @ H[1] @ H[2]]
            tip = frames[3][:3, 3]
            J = np.column_stack([np.cross(T[:3, 2], tip - T[:3, 3]) for T in frames[:3]])
            q = q + 0.5 * J.T @ (target - tip)
    end = found["solutions"][0]["joints"]
    # The cosine law gives the configuration that both descents approach.
    t3 = np.arccos((0.5**2 + 0.3**2 - RRR_A2**2 - RRR_A3**2) / (2.0 * RRR_A2 * RRR_A3))
    t2 = atan2(0.3, 0.5) - atan2(RRR_A3 * sin(t3), RRR_A2 + RRR_A3 * cos(t3))
    np.testing.assert_allclose(end, [atan2(0.4, 0.3), t2, t3], atol=1e-4)
    tip = ask(service, "robots/notes_rrr/fk", {"joints": end})["pose"]["position"]
    np.testing.assert_allclose(tip, target, atol=1e-5)
