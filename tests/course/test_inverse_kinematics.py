"""Lectures 10, 11, 15, 16: decoupling with all branches, numeric and gradient methods."""

from itertools import product
from math import asin, atan2, cos, hypot, pi, sin, sqrt
from typing import Any

import httpx
import numpy as np
import pytest

from tests.course.example import ROUNDING, ask, dh_matrix, pose_matrix
from tests.course.robots import A1, A2, RRR_A2, RRR_A3, RRR_D1

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


def desired() -> Any:
    a, b, c = ZYZ
    T = dh_matrix(a, 0, 0, 0) @ np.diag([1, 1, 1, 1.0])
    Ry = np.array([[cos(b), 0, sin(b)], [0, 1, 0], [-sin(b), 0, cos(b)]])
    T[:3, :3] = T[:3, :3] @ Ry @ dh_matrix(c, 0, 0, 0)[:3, :3]
    T[:3, 3] = POSITION
    return T


def branches() -> list[list[float]]:
    """All eight solutions by the formulas of lectures 5, 10 and 11."""
    T = desired()
    x, y, z = T[:3, 3] - T[:3, :3] @ [0.0, 0.0, D6]
    s = z - D1
    D = (x * x + y * y + s * s - ELBOW_A2**2 - D4**2) / (2.0 * ELBOW_A2 * D4)
    found = []
    for shoulder, elbow_sign, wrist in product((1.0, -1.0), repeat=3):
        # With the shoulder turned by half a turn the horizontal distance counts backwards.
        t1, r = atan2(shoulder * y, shoulder * x), shoulder * hypot(x, y)
        t3 = atan2(D, elbow_sign * sqrt(1.0 - D * D))
        t2 = atan2(s, r) - atan2(D4 * sin(t3 - pi / 2), ELBOW_A2 + D4 * cos(t3 - pi / 2))
        H = elbow([t1, t2, t3, 0.0, 0.0, 0.0])
        R = (H[0] @ H[1] @ H[2])[:3, :3].T @ T[:3, :3]
        t5 = wrist * np.arccos(R[2, 2])
        t4 = atan2(wrist * R[1, 2], wrist * R[0, 2])
        t6 = atan2(wrist * R[2, 1], -wrist * R[2, 0])
        found.append([t1, t2, t3, t4, t5, t6])
    return found


def distance(p: Any, q: Any) -> float:
    """Largest difference of two configurations, whole turns aside [rad]."""
    return float(np.abs(np.angle(np.exp(1j * (np.array(p) - q)))).max())


@pytest.fixture(scope="module")
def solutions(service: httpx.Client) -> list[dict[str, Any]]:
    body = {"pose": POSE, "method": "analytic", "all_solutions": True}
    found: list[dict[str, Any]] = ask(service, "robots/elbow_wrist/ik", body)["solutions"]
    return found


def test_decoupling_has_eight_branches(solutions: list[dict[str, Any]]) -> None:
    assert len(solutions) == 8
    assert len({one["branch"] for one in solutions}) == 8


@pytest.mark.parametrize("index", range(8))
def test_each_branch_of_the_notes_is_answered(solutions: list[dict[str, Any]], index: int) -> None:
    by_notes = branches()[index]
    np.testing.assert_allclose(np.linalg.multi_dot(elbow(by_notes)), desired(), atol=ROUNDING)
    assert min(distance(one["joints"], by_notes) for one in solutions) < 1e-8


def test_the_wrist_centre_does_not_depend_on_the_wrist(
    service: httpx.Client, solutions: list[dict[str, Any]]
) -> None:
    T = desired()
    centre = T[:3, 3] - T[:3, :3] @ [0.0, 0.0, D6]
    for one in solutions:
        H = np.linalg.multi_dot(elbow(one["joints"])[:4])
        np.testing.assert_allclose(H[:3, 3], centre, atol=ROUNDING)


def test_both_elbows_satisfy_the_law_of_cosines(solutions: list[dict[str, Any]]) -> None:
    T = desired()
    x, y, z = T[:3, 3] - T[:3, :3] @ [0.0, 0.0, D6]
    D = (x * x + y * y + (z - D1) ** 2 - ELBOW_A2**2 - D4**2) / (2.0 * ELBOW_A2 * D4)
    angles = sorted({round(one["joints"][2] % (2 * pi), 7) for one in solutions})
    assert angles == pytest.approx(sorted([asin(D) % (2 * pi), pi - asin(D)]), abs=1e-6)


def test_two_links_have_two_solutions(service: httpx.Client) -> None:
    # Planar arm by the cosine law; seeds on either side of the straight arm.
    x, y = 0.55, 0.45
    c2 = (x * x + y * y - A1**2 - A2**2) / (2.0 * A1 * A2)
    for sign in (1.0, -1.0):
        t2 = sign * np.arccos(c2)
        t1 = atan2(y, x) - atan2(A2 * sin(t2), A1 + A2 * cos(t2))
        body = {"pose": {"position": [x, y, 0.0]}, "axes": ["x", "y"],
                "method": "numeric", "seed_joints": [0.6, 1.2 * sign]}  # fmt: skip
        joints = ask(service, "robots/notes_two_link/ik", body)["solutions"][0]["joints"]
        assert joints == pytest.approx([t1, t2], abs=1e-5)


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


def test_a_position_of_the_articulated_arm(service: httpx.Client) -> None:
    # Cosine law in the vertical plane of the arm.
    x, y, z = 0.3, 0.4, 0.7
    r, s = hypot(x, y), z - RRR_D1
    c3 = (r * r + s * s - RRR_A2**2 - RRR_A3**2) / (2.0 * RRR_A2 * RRR_A3)
    t3 = np.arccos(c3)
    t2 = atan2(s, r) - atan2(RRR_A3 * sin(t3), RRR_A2 + RRR_A3 * cos(t3))
    body = {"pose": {"position": [x, y, z]}, "axes": ["x", "y", "z"],
            "seed_joints": [0.2, 0.4, 1.0]}  # fmt: skip
    joints = ask(service, "robots/notes_rrr/ik", body)["solutions"][0]["joints"]
    assert joints == pytest.approx([atan2(y, x), t2, t3], abs=1e-5)


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


def test_the_flow_of_lecture_16_ends_at_a_branch(service: httpx.Client) -> None:
    found = follow(service, SEED, rule="pseudo_inverse")
    end = found["solutions"][0]["joints"]
    assert min(distance(end, one) for one in branches()) < 1e-5


@pytest.mark.parametrize("gain", [1.0, 4.0])
def test_the_error_of_the_flow_falls_exponentially(service: httpx.Client, gain: float) -> None:
    # e' = -K e. Near the solution the steps of the integrator are exact to a hundred thousandth.
    trace = follow(service, np.array(branches()[0]) + 0.01, rule="pseudo_inverse", gain=gain)[
        "trace"
    ]
    t, e = np.array(trace["time"]), np.array(trace["position_error"])
    early = gain * t < 5.0
    np.testing.assert_allclose(e[early] / e[0], np.exp(-gain * t[early]), atol=5e-5)


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
