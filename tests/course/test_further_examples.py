"""Worked examples of several lectures that no other file of this folder asks the service for."""

from math import pi

import httpx
import numpy as np
import pytest

from tests.course.example import ROUNDING, ask, pose_matrix
from tests.course.robots import A1, A2, ELBOW_A1, ELBOW_D1, ELBOW_D2, I_BOB, RRR_D1, revolute

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


# -------------------------------------------------------------- lectures 3, 5 and 9 to 11


def test_a_left_handed_frame_is_refused(service: httpx.Client) -> None:
    mirror = {"position": [0, 0, 0], "rotation_matrix": [[1, 0, 0], [0, 1, 0], [0, 0, -1]]}
    robot = {"name": "notes_mirror", "dh": {
        "convention": "standard", "rows": [revolute()], "base": mirror}}  # fmt: skip
    refused = service.post("/v1/robots", json=robot)
    assert refused.status_code == 422
    assert "det R = -1" in refused.json()["detail"]


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
    assert np.ptp(rows, axis=0).max() > 0.1


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
    assert "out of reach by 0.25 m" in answer.json()["detail"]
    assert "|D| > 1" in answer.json()["hint"]


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
                            "max_iterations": 5000, "connect": False, "tolerance": 0.01},
    }  # fmt: skip
    found = ask(service, "plan", body)["potential_field"]
    waypoints, ending = found["joints"], found["joints"][found["iterations"]]
    assert np.linalg.norm(np.subtract(ending, body["goal"]["joints"])) < 0.01  # type: ignore[index]
    chosen = [waypoints[0], waypoints[len(waypoints) // 2], waypoints[-1]]
    timing = {"method": "spline", "interpolation": "natural_spline", "times": [0.0, 1.0, 2.5]}
    path = {"path": {"joints": chosen}, "robot": "notes_two_link", "timing": timing}
    segments = ask(service, "retime", path)["trajectory"]["segments"]
    for piece, point in zip(segments, chosen[:-1], strict=True):
        np.testing.assert_allclose([c[0] for c in piece["coefficients"]], point, atol=1e-9)


# -------------------------------------------------------------------- lectures 23 to 25, 27, 28


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


# -------------------------------------------------------------------------------- lecture 9


def test_lengths_of_the_arms_are_those_of_their_tables(service: httpx.Client) -> None:
    """The sum of all links is reached where the arm is stretched out."""
    stretched = ask(service, "robots/notes_two_link/fk", {"joints": [0.0, 0.0]})["pose"]
    assert stretched["position"] == pytest.approx([A1 + A2, 0.0, 0.0], abs=ROUNDING)
    up = ask(service, "robots/notes_rrr/fk", {"joints": [0.0, pi / 2.0, 0.0]})["pose"]
    assert up["position"][2] > RRR_D1
