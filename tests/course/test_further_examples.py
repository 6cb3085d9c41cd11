"""Worked examples of several lectures that no other file of this folder asks the service for."""

from math import pi
from typing import Any

import httpx
import numpy as np
import pytest

from tests.course.example import ROUNDING, ask, pose_matrix
from tests.course.robots import A1, A2, BOB, CART, I_BOB, RRR_D1

RRR_STATE = ([0.4, -0.6, 1.1], [0.7, -0.3, 0.5])
PLANAR_STATE = ([0.5, -0.8], [1.2, -0.7], [0.3, 2.0])
CART_STATE = ([0.3, 0.6], [0.7, -1.1], [0.4, 0.9])


# -------------------------------------------------------------------------- lectures 2 and 7


@pytest.mark.parametrize(
    ("robot", "types"),
    [("notes_rrr", "RRR"), ("stanford", "RRPRRR"), ("scara", "RRPR"), ("notes_cart", "PR")],
)
def test_topologies_are_told_by_the_types_of_joints(
    service: httpx.Client, robot: str, types: str
) -> None:
    kinds = service.get(f"/v1/robots/{robot}").json()["joint_types"]
    assert "".join(kind[0].upper() for kind in kinds) == types


def test_a_spherical_wrist_is_recognised(service: httpx.Client) -> None:
    assert service.get("/v1/robots/elbow_wrist").json()["wrist"] == "spherical"
    assert service.get("/v1/robots/notes_rrr").json()["wrist"] == "none"


def arm_of_axes(xyz: str, rpy: str) -> str:
    """An arm of two joints whose second axis stands at a place and an angle to the first."""
    return f"""<robot name="axes"><link name="a"/><link name="b"/><link name="c"/><link name="d"/>
    <joint name="q1" type="continuous"><parent link="a"/><child link="b"/>
    <axis xyz="0 0 1"/></joint>
    <joint name="q2" type="continuous"><parent link="b"/><child link="c"/>
    <origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="0 0 1"/></joint>
    <joint name="end" type="fixed"><parent link="c"/><child link="d"/>
    <origin xyz="0.2 0 0.1"/></joint>
    </robot>"""


@pytest.mark.parametrize(
    ("case", "xyz", "rpy"),
    [("skew", "0.3 0.1 0.5", "0.7 0 0.2"), ("intersecting", "0 0 0.5", "0.9 0 0"),
     ("parallel", "0.3 0.4 0.2", "0 0 0.3")],
)  # fmt: skip
def test_derived_frames_follow_both_rules_in_the_three_cases(
    service: httpx.Client, case: str, xyz: str, rpy: str
) -> None:
    body = {"name": f"axes_{case}", "urdf": arm_of_axes(xyz, rpy)}
    stored = service.post("/v1/robots", json=body)
    assert stored.status_code == 201, stored.text
    first, second = stored.json()["dh"]["rows"]
    copy = {"name": f"axes_{case}_table", "dh": stored.json()["dh"]}
    assert service.post("/v1/robots", json=copy).status_code == 201
    body_fk = {"joints": [0.4, -0.9], "orientation": "rotation_matrix"}
    links = ask(service, f"robots/axes_{case}_table/fk", body_fk)["links"]
    original = ask(service, f"robots/axes_{case}/fk", body_fk)
    np.testing.assert_allclose(
        pose_matrix(links["tool"]), pose_matrix(original["pose"]), atol=1e-12
    )
    # DH1 and DH2 for frame 1: x_1 is orthogonal to z_0 and meets it.
    T, z0 = pose_matrix(links["link_1"]), np.array([0.0, 0.0, 1.0])
    x, O = T[:3, 0], T[:3, 3]  # noqa: E741
    assert abs(x @ z0) < 1e-12
    assert abs(np.cross(x, z0) @ O) < 1e-12
    # Frame 1 lies on axis 2 with z along it.
    axis = pose_matrix(original["links"]["c"])
    assert abs(T[:3, 2] @ axis[:3, 2]) == pytest.approx(1.0, abs=1e-12)
    np.testing.assert_allclose(np.cross(O - axis[:3, 3], axis[:3, 2]), np.zeros(3), atol=1e-12)
    u, p = axis[:3, 2], axis[:3, 3]
    common = np.cross(z0, u)
    if case == "parallel":
        assert first["a"] == pytest.approx(np.hypot(0.3, 0.4), abs=1e-12)
    else:
        distance = abs(common @ p) / np.linalg.norm(common)
        assert first["a"] == pytest.approx(distance, abs=1e-12)
    assert second["type"] == "revolute"


# ------------------------------------------------------------------------ lectures 5, 11, 12


def test_translation_before_rotation_is_another_motion(service: httpx.Client) -> None:
    d, turn = {"position": [0.3, -0.2, 0.5]}, {"axis_angle": [0.0, 1.0, 0.0, 0.7]}
    fixed = [motion | {"about": "fixed"} for motion in (turn, d)]
    usual = ask(service, "poses/convert", {"motions": fixed})["pose"]
    other = ask(service, "poses/convert", {"motions": fixed[::-1]})["pose"]
    R = np.array(usual["rotation_matrix"])
    np.testing.assert_allclose(usual["position"], d["position"], atol=ROUNDING)
    np.testing.assert_allclose(other["position"], R @ d["position"], atol=ROUNDING)


def test_beyond_the_triangle_of_the_links_there_is_no_solution(service: httpx.Client) -> None:
    """|D| > 1 in lecture 11: the wrist centre is farther from joint 2 than both links reach."""
    table = service.get("/v1/robots/elbow_wrist").json()["dh"]["rows"]
    d1, a2, d4, d6 = table[0]["d"], table[1]["a"], table[3]["d"], table[5]["d"]
    far = a2 + d4 + 0.25
    pose = {"position": [far + d6, 0.0, d1], "rpy": [0.0, pi / 2.0, 0.0]}
    answer = service.post("/v1/robots/elbow_wrist/ik", json={"pose": pose})
    assert answer.status_code == 422
    D = (far**2 - a2**2 - d4**2) / (2.0 * a2 * d4)
    assert D > 1.0
    assert answer.json()["details"]["out_of_reach_by"] == pytest.approx(0.25, abs=1e-9)


def test_the_skew_matrix_is_linear_and_turns_with_its_vector(service: httpx.Client) -> None:
    def skew(w: Any) -> Any:
        body = {"pose": {"position": [0, 0, 0]}, "angular_velocity": list(map(float, w))}
        return np.array(ask(service, "poses/convert", body)["skew"])

    w1, w2, factor = np.array([0.3, -0.7, 0.4]), np.array([-1.1, 0.2, 0.6]), 2.5
    np.testing.assert_allclose(
        skew(w1 + factor * w2), skew(w1) + factor * skew(w2), atol=ROUNDING
    )  # fmt: skip
    R = np.array(ask(service, "poses/convert", {"pose": {"euler_zyz": [0.8, 1.9, -1.3]}})
                 ["pose"]["rotation_matrix"])  # fmt: skip
    np.testing.assert_allclose(R @ skew(w1) @ R.T, skew(R @ w1), atol=ROUNDING)


# -------------------------------------------------------------------- lectures 12 to 14 and 17


def test_the_velocity_of_a_point_is_that_of_its_frame_and_of_the_rotation(
    service: httpx.Client,
) -> None:
    joints, rates = RRR_STATE
    body = {"joints": joints, "joint_velocities": rates}
    p1 = [0.1, -0.2, 0.3]
    frame = np.array(ask(service, "robots/notes_rrr/velocity", body)["twist"])
    point = np.array(ask(service, "robots/notes_rrr/velocity", body | {"point": p1})["twist"])
    fk = ask(service, "robots/notes_rrr/fk", {"joints": joints, "orientation": "rotation_matrix"})
    R = np.array(fk["pose"]["rotation_matrix"])
    np.testing.assert_allclose(point[:3], frame[:3] + np.cross(frame[3:], R @ p1), atol=ROUNDING)
    np.testing.assert_allclose(point[3:], frame[3:], atol=ROUNDING)


def test_velocities_are_handed_on_from_frame_to_frame(service: httpx.Client) -> None:
    """O_i' - O_(i-1)' = w_i x (O_i - O_(i-1)) for revolute joints, w_i = w_(i-1) + q_i' z_(i-1)."""
    joints, rates = RRR_STATE
    body = {"joints": joints, "joint_velocities": rates}
    fk = ask(service, "robots/notes_rrr/fk", {"joints": joints, "orientation": "rotation_matrix"})
    frames = [np.eye(4)] + [pose_matrix(fk["links"][f"link_{i}"]) for i in (1, 2, 3)]
    w, v = np.zeros(3), np.zeros(3)
    for i in (1, 2, 3):
        w = w + rates[i - 1] * frames[i - 1][:3, 2]
        v = v + np.cross(w, frames[i][:3, 3] - frames[i - 1][:3, 3])
        twist = ask(service, "robots/notes_rrr/velocity", body | {"link": f"link_{i}"})["twist"]
        np.testing.assert_allclose(twist, [*v, *w], atol=ROUNDING)


def test_the_power_of_a_wrench_is_that_of_the_joints(service: httpx.Client) -> None:
    joints, rates = RRR_STATE
    F = [3.0, -1.0, 10.0, 0.4, 0.2, -0.5]
    twist = ask(
        service, "robots/notes_rrr/velocity", {"joints": joints, "joint_velocities": rates}
    )["twist"]  # fmt: skip
    tau = ask(service, "robots/notes_rrr/wrench", {"joints": joints, "wrench": F})["torques"]
    assert np.dot(rates, tau) == pytest.approx(np.dot(twist, F), abs=ROUNDING)


# ---------------------------------------------------------------------------- lectures 18 to 20


def test_the_line_to_the_projection_is_normal_to_the_obstacle(service: httpx.Client) -> None:
    """(O - pi(O))^T d pi / dO = 0 by central differences, at a box's face, edge and corner."""
    box = {"id": "box", "shape": {"type": "box", "size": [0.4, 0.3, 0.2]},
           "pose": {"position": [0.1, 0.2, 0.3], "rpy": [0.3, -0.4, 0.6]}}  # fmt: skip
    assert service.post("/v1/scenes", json={"name": "normals", "obstacles": [box]}).is_success
    h = 1e-6
    for point in ([0.2, 0.3, 0.9], [0.6, 0.2, 0.7], [0.7, 0.8, 0.9]):
        steps = [np.add(point, k * h * e).tolist() for e in np.eye(3) for k in (1, -1)]
        found = ask(service, "scenes/normals/project", {"points": [point, *steps]})["projections"]
        pi_ = np.array([item["projection"] for row in found for item in row])
        jacobian = (pi_[1::2] - pi_[2::2]).T / (2.0 * h)
        np.testing.assert_allclose((point - pi_[0]) @ jacobian, np.zeros(3), atol=1e-8)


def test_waypoints_of_a_descent_become_a_spline(service: httpx.Client) -> None:
    """Lecture 19 ends with a spline through the waypoints; lecture 20 makes it."""
    ball = {"id": "ball", "shape": {"type": "sphere", "radius": 0.12},
            "pose": {"position": [0.75, 0.55, 0.0]}}  # fmt: skip
    body = {
        "robot": "notes_two_link", "start": {"joints": [0.0, 0.3]}, "goal": {"joints": [1.4, -0.3]},
        "scene": {"obstacles": [ball]}, "planner": "potential_field", "collisions": "ignore",
        "planner_options": {"repulsive_weights": 0.002, "influence_distance": 0.25,
                            "max_iterations": 5000},
    }  # fmt: skip
    waypoints = ask(service, "plan", body)["potential_field"]["joints"]
    chosen = [waypoints[0], waypoints[len(waypoints) // 2], waypoints[-1]]
    timing = {"method": "spline", "interpolation": "natural_spline", "times": [0.0, 1.0, 2.5]}
    path = {"path": {"joints": chosen}, "robot": "notes_two_link", "timing": timing}
    segments = ask(service, "retime", path)["trajectory"]["segments"]
    for piece, point in zip(segments, chosen[:-1], strict=True):
        np.testing.assert_allclose([c[0] for c in piece["coefficients"]], point, atol=1e-9)


# -------------------------------------------------------------------- lectures 23 to 25, 27, 28


def energies(service: httpx.Client, robot: str, q: Any, qd: Any) -> tuple[float, float]:
    body = {"joints": list(map(float, q)), "velocities": list(map(float, qd))}
    answer = ask(service, f"robots/{robot}/dynamics", body)
    return answer["kinetic_energy"], answer["potential_energy"]


@pytest.mark.parametrize(
    ("robot", "state"), [("notes_cart", CART_STATE), ("notes_planar", PLANAR_STATE)]
)
def test_the_torques_are_those_of_the_euler_lagrange_equations(
    service: httpx.Client, robot: str, state: Any
) -> None:
    """d/dt dL/dq' - dL/dq of the answered energies, by central differences along the motion."""
    q, qd, qdd = (np.array(row) for row in state)
    h, n = 1e-4, len(state[0])
    rows_q, rows_qd = [], []
    for k in (1, -1):  # dL/dq' a moment later and earlier
        q_k, qd_k = q + k * h * qd + 0.5 * h**2 * qdd, qd + k * h * qdd
        for e in np.eye(n):
            rows_q += [q_k, q_k]
            rows_qd += [qd_k + h * e, qd_k - h * e]
    for e in np.eye(n):  # dL/dq
        rows_q += [q + h * e, q - h * e]
        rows_qd += [qd, qd]
    body = {"joints": np.array(rows_q).tolist(), "velocities": np.array(rows_qd).tolist()}
    answer = ask(service, f"robots/{robot}/dynamics", body)
    L = np.array(answer["kinetic_energy"]) - np.array(answer["potential_energy"])
    slopes = (L[0::2] - L[1::2]) / (2.0 * h)
    later, earlier, by_q = slopes[:n], slopes[n : 2 * n], slopes[2 * n :]
    expected = (later - earlier) / (2.0 * h) - by_q
    names = ("joints", "velocities", "accelerations")
    exact = ask(service, f"robots/{robot}/dynamics", dict(zip(names, state, strict=True)))
    np.testing.assert_allclose(exact["torques"], expected, atol=1e-5)


@pytest.mark.parametrize(
    ("robot", "q"), [("notes_cart", CART_STATE[0]), ("notes_planar", PLANAR_STATE[0])]
)
def test_the_mass_matrix_is_the_sum_over_the_links(
    service: httpx.Client, robot: str, q: list[float]
) -> None:
    """D = sum m_i J_vi^T J_vi + J_wi^T R_i I_i R_i^T J_wi of the answered partial Jacobians."""
    rows = service.get(f"/v1/robots/{robot}").json()["dh"]["rows"]
    answer = ask(service, f"robots/{robot}/dynamics", {"joints": q, "partial_jacobians": True})
    fk = ask(service, f"robots/{robot}/fk", {"joints": q, "orientation": "rotation_matrix"})
    D = np.zeros((2, 2))
    for i, (row, part) in enumerate(zip(rows, answer["partial_jacobians"], strict=True), start=1):
        Jv, Jw = np.array(part["linear"]), np.array(part["angular"])
        R = np.array(fk["links"][f"link_{i}"]["rotation_matrix"])
        rotational = Jw.T @ R @ np.array(row["inertia"]) @ R.T @ Jw
        if robot == "notes_cart" and i == 2:
            np.testing.assert_allclose(rotational, [[0.0, 0.0], [0.0, I_BOB]], atol=ROUNDING)
        D += row["mass"] * Jv.T @ Jv + rotational
    np.testing.assert_allclose(answer["mass_matrix"], D, atol=ROUNDING)


def test_gravity_is_the_gradient_of_the_potential_energy(service: httpx.Client) -> None:
    q, h = np.array(PLANAR_STATE[0]), 1e-5
    rows = [(q + k * h * e).tolist() for e in np.eye(2) for k in (1, -1)]
    U = np.array(ask(service, "robots/notes_planar/dynamics", {"joints": rows})["potential_energy"])
    G = ask(service, "robots/notes_planar/dynamics", {"joints": q.tolist()})["gravity"]
    np.testing.assert_allclose(G, (U[0::2] - U[1::2]) / (2.0 * h), atol=1e-8)


def test_feedback_linearisation_gives_the_chosen_accelerations(service: httpx.Client) -> None:
    """u = M v + C q' + B q' + G leaves q'' = v."""
    q, qd, _ = PLANAR_STATE
    v = [0.9, -1.7]
    body = {"joints": q, "velocities": qd}
    u = ask(service, "robots/notes_motors/dynamics", body | {"accelerations": v})["torques"]
    found = ask(service, "robots/notes_motors/forward-dynamics", body | {"torques": u})
    np.testing.assert_allclose(found["accelerations"], v, atol=1e-11)


def test_the_cart_has_the_total_mass_before_its_acceleration(service: httpx.Client) -> None:
    """m x'' = u with the pendulum at rest and horizontal, where cos(phi) = 0."""
    body = {"joints": [0.0, pi / 2.0], "accelerations": [2.0, 0.0]}
    tau = ask(service, "robots/notes_cart/dynamics", body)["torques"]
    assert tau[0] == pytest.approx((CART + BOB) * 2.0, abs=ROUNDING)


# ------------------------------------------------------------------------ lectures 29 and 30


def test_the_quadratic_form_of_the_spring(service: httpx.Client) -> None:
    """P = [[1, 1/2], [1/2, 1]] / 2 with k = m = b = 1: V' = -V, and V is positive definite."""
    A, P = [[0.0, 1.0], [-1.0, -1.0]], [[0.5, 0.25], [0.25, 0.5]]
    x = [0.7, -0.3]
    answer = ask(service, "lyapunov", {"A": A, "P": P, "x": x})
    V = 0.5 * (x[0] ** 2 + x[0] * x[1] + x[1] ** 2)
    assert answer["values"] == pytest.approx(V, abs=ROUNDING)
    assert answer["rates"] == pytest.approx(-V, abs=ROUNDING)
    np.testing.assert_allclose(answer["P"]["minors"], [0.5, 0.1875], atol=ROUNDING)
    assert answer["P"]["definiteness"] == "positive definite"
    assert answer["verdict"] == "asymptotically_stable"


def test_the_energy_of_the_spring_is_no_strict_lyapunov_function(service: httpx.Client) -> None:
    """V = (k x1^2 + m x2^2) / 2 has V' = -b x2^2, which is negative semidefinite only."""
    A, P = [[0.0, 1.0], [-1.0, -1.0]], [[0.5, 0.0], [0.0, 0.5]]
    answer = ask(service, "lyapunov", {"A": A, "P": P, "x": [0.7, 0.0]})
    assert answer["rates"] == pytest.approx(0.0, abs=ROUNDING)
    np.testing.assert_allclose(answer["Q"]["matrix"], [[0.0, 0.0], [0.0, 1.0]], atol=ROUNDING)
    assert answer["Q"]["definiteness"] == "positive semidefinite"


def test_lengths_of_the_arms_are_those_of_their_tables(service: httpx.Client) -> None:
    """The sum of all links is reached where the arm is stretched out."""
    stretched = ask(service, "robots/notes_two_link/fk", {"joints": [0.0, 0.0]})["pose"]
    assert stretched["position"] == pytest.approx([A1 + A2, 0.0, 0.0], abs=ROUNDING)
    up = ask(service, "robots/notes_rrr/fk", {"joints": [0.0, pi / 2.0, 0.0]})["pose"]
    assert up["position"][2] > RRR_D1
