"""The potential over HTTP: its slope by finite differences, its parts, what is refused."""

from typing import Any

import httpx
import numpy as np
import pytest

from armwright_wire.robots.potential import PotentialAnswer
from tests.service.robots import FLOOR, HOME, POST, answer, problem, scene

GOAL = [0.6, -0.3, 0.0, -2.0, 0.0, 1.8, 0.785]
BALL = {"type": "sphere", "radius": 0.06}
OPTIONS = {
    "attractive_weights": [1.0, 0.5, 2.0, 1.0, 1.0, 0.7, 1.5],
    "attractive_cap": 0.15,
    "repulsive_weights": 0.002,
    "influence_distance": 0.25,
}


def potential(client: httpx.Client, joints: Any, robot: str = "panda", **more: Any) -> Any:
    body = {"joints": joints, "goal_joints": GOAL, "scene": scene(POST, FLOOR)} | more
    found = answer(client.post(f"/v1/robots/{robot}/potential", json=body))
    PotentialAnswer.model_validate(found)
    return found


def test_the_gradient_is_the_slope_of_the_potential(client: httpx.Client) -> None:
    random = np.random.default_rng(0)
    step = 1e-6
    felt = 0
    for _ in range(12):
        q = np.array(HOME) + random.normal(0.0, 0.4, 7)
        tip = potential(client, q.tolist())["control_points"][-1]["origin"]
        place = scene(
            POST,
            *(
                {"id": f"b{i}", "shape": BALL, "pose": {"position": (tip + offset).tolist()}}
                for i, offset in enumerate(random.normal(0.0, 0.15, (2, 3)))
            ),
        )
        rows = [q, *(q + d for d in step * np.eye(7)), *(q - d for d in step * np.eye(7))]
        found = potential(client, [row.tolist() for row in rows], scene=place, options=OPTIONS)
        distances = [point["distance"] for point in found["control_points"][0]]
        if min(distances) < 0.01:
            continue
        felt += min(distances) < OPTIONS["influence_distance"]
        u = np.array(found["potential"])
        slope = (u[1:8] - u[8:]) / (2.0 * step)
        assert found["gradient"][0] == pytest.approx(slope, rel=1e-4, abs=1e-5)
        assert found["joint_force"][0] == pytest.approx(-slope, rel=1e-4, abs=1e-5)
    assert felt >= 6


def test_with_projections_by_fcl_it_is_the_same_field(client: httpx.Client) -> None:
    exact = potential(client, [HOME, GOAL], options=OPTIONS)
    fcl = potential(client, [HOME, GOAL], options=OPTIONS, engine="fcl")
    assert fcl["potential"] == pytest.approx(exact["potential"], rel=1e-6)
    for row, expected in zip(fcl["joint_force"], exact["joint_force"], strict=True):
        assert row == pytest.approx(expected, rel=1e-5, abs=1e-6)
    ball = scene({"id": "ball", "shape": BALL, "pose": {"position": [0.4, 0.1, 0.6]}})
    near = potential(client, HOME, scene=ball, options=OPTIONS, engine="fcl")
    for point in near["control_points"]:
        away = np.linalg.norm(np.array(point["origin"]) - [0.4, 0.1, 0.6])
        assert point["distance"] == pytest.approx(away - 0.06, abs=1e-9)
    body = {"joints": HOME, "goal_joints": GOAL, "engine": "bullet"}
    problem(client.post("/v1/robots/panda/potential", json=body), 422, "VALIDATION_ERROR")


def test_forces_add_up_through_the_jacobians(client: httpx.Client) -> None:
    found = potential(client, HOME, options=OPTIONS)
    chain = answer(client.get("/v1/robots/panda"))["joint_names"]
    assert [point["joint"] for point in found["control_points"]] == chain
    total = np.zeros(7)
    for i, point in enumerate(found["control_points"]):
        force = np.array(point["attractive_force"]) + point["repulsive_force"]
        # Columns of later joints are left out: they do not move this point.
        J = np.zeros((3, 7))
        for j in range(i + 1):
            ahead, behind = list(HOME), list(HOME)
            ahead[j], behind[j] = HOME[j] + 1e-6, HOME[j] - 1e-6
            rows = potential(client, [ahead, behind])["control_points"]
            J[:, j] = (np.array(rows[0][i]["origin"]) - rows[1][i]["origin"]) / 2e-6
        total += J.T @ force
    assert found["joint_force"] == pytest.approx(total, abs=1e-6)


def test_nearest_obstacle_is_that_of_the_projection(client: httpx.Client) -> None:
    place = scene(POST, FLOOR)
    found = potential(client, HOME, scene=place)
    answer(client.put("/v1/scenes/field", json=place), 201)
    points = [point["origin"] for point in found["control_points"]]
    projected = answer(client.post("/v1/scenes/field/project", json={"points": points}))
    for point, all_of in zip(found["control_points"], projected["projections"], strict=True):
        nearest = min(all_of, key=lambda item: item["distance"])
        assert point["obstacle"] == nearest["obstacle"]
        assert point["distance"] == pytest.approx(nearest["distance"])
        assert point["projection"] == pytest.approx(nearest["projection"])
    again = potential(client, HOME, scene="field")
    assert again == found


def test_origins_of_a_table_are_those_of_its_frames(client: httpx.Client) -> None:
    """A ball 5 cm above the origin of frame 1 pushes it down, from 5 cm away."""
    limits = {"type": "revolute", "alpha": 0.0, "theta": 0.0, "lower": -3.0, "upper": 3.0}
    rows = [limits | {"a": 0.3, "d": 0.4}, limits | {"a": 0.2, "d": 0.1}]
    dh = {"convention": "standard", "rows": rows, "geometry": {"capsules": 0.02}}
    answer(client.post("/v1/robots", json={"name": "offset_rr", "dh": dh}), 201)
    ball = {"type": "sphere", "radius": 0.1}
    place = scene({"id": "ball", "shape": ball, "pose": {"position": [0.3, 0.0, 0.55]}})
    found = potential(
        client, [0.0, 0.0], robot="offset_rr", goal_joints=[1.0, 0.0], scene=place,
        options={"repulsive_weights": 2e-4, "influence_distance": 0.1},
    )  # fmt: skip
    fk = answer(client.post("/v1/robots/offset_rr/fk", json={"joints": [0.0, 0.0]}))
    points = found["control_points"]
    assert points[0]["origin"] == pytest.approx([0.3, 0.0, 0.4])
    for i, point in enumerate(points, start=1):
        assert point["origin"] == pytest.approx(fk["links"][f"link_{i}"]["position"])
    assert points[0]["distance"] == pytest.approx(0.05)
    # eta (1 / rho - 1 / rho_0) / rho^2 = 2e-4 * 10 / 0.0025
    assert points[0]["repulsive_force"] == pytest.approx([0.0, 0.0, -0.8])


def test_points_with_radii_feel_obstacles_from_their_surface(client: httpx.Client) -> None:
    tip = np.array(potential(client, HOME)["control_points"][-1]["origin"])
    ball = {
        "id": "ball",
        "shape": BALL,
        "pose": {"position": (tip + np.array([0.0, 0.0, 0.2])).tolist()},
    }
    bare = potential(client, HOME, scene=scene(ball))["control_points"][-1]
    assert bare["repulsive_force"] == [0.0, 0.0, 0.0]
    wide = potential(
        client, HOME, scene=scene(ball), options={"point_radii": [0.0] * 6 + [0.09]}
    )["control_points"][-1]  # fmt: skip
    assert (bare["radius"], wide["radius"]) == (0.0, 0.09)
    assert wide["distance"] == pytest.approx(0.14)
    # eta (1 / rho - 1 / rho_0) / rho^2 at rho = 0.14 - 0.09
    assert wide["repulsive_force"] == pytest.approx([0.0, 0.0, -0.8], abs=1e-9)


def test_at_the_goal_nothing_pulls(client: httpx.Client) -> None:
    found = potential(client, GOAL, scene=None)
    assert found["potential"] == 0.0
    assert found["gradient"] == [0.0] * 7
    assert found["control_points"][0]["projection"] is None
    assert found["control_points"][0]["distance"] is None
    assert found["control_points"][0]["obstacle"] is None


def test_inside_an_obstacle_everything_is_finite(client: httpx.Client) -> None:
    tip = potential(client, HOME)["control_points"][-1]["origin"]
    crate = {"id": "crate", "shape": {"type": "box", "size": [0.3, 0.3, 0.3]}}
    # The middle of a box has no nearest face: the surface's midpoint has a face, but no way to it.
    for shift in (0.0, 0.1, 0.15):
        place = scene(crate | {"pose": {"position": [tip[0] + shift, tip[1], tip[2]]}})
        found = potential(client, HOME, scene=place)
        assert found["control_points"][-1]["distance"] == pytest.approx(shift - 0.15, abs=1e-9)
        if shift > 0.0:
            assert found["control_points"][-1]["repulsive_force"][0] < 0.0


def test_a_prismatic_arm(client: httpx.Client) -> None:
    q, goal = [0.1, 0.2, 0.3, 0.1, 0.2, 0.3], [0.0, 0.1, 0.4, 0.0, 0.0, 0.0]
    found = potential(client, q, robot="stanford", goal_joints=goal, scene=None)
    assert len(found["control_points"]) == 6


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ({"joints": [0.0] * 6}, "INVALID_ROBOT_STATE"),
        ({"goal_joints": [0.0] * 8}, "INVALID_ROBOT_STATE"),
        ({"goal_joints": [[0.0] * 7]}, "VALIDATION_ERROR"),
        ({"options": {"attractive_weights": [1.0, 2.0]}}, "VALIDATION_ERROR"),
        ({"options": {"attractive_weights": -1.0}}, "VALIDATION_ERROR"),
        ({"options": {"attractive_cap": 0.0}}, "VALIDATION_ERROR"),
        ({"options": {"influence_distance": 1e-4}}, "VALIDATION_ERROR"),
        ({"options": {"eta": 1.0}}, "VALIDATION_ERROR"),
        ({"options": {"preset": "fast"}}, "VALIDATION_ERROR"),
        ({"options": {"point_radii": [0.1, 0.2]}}, "VALIDATION_ERROR"),
        ({"options": {"point_radii": -0.1}}, "VALIDATION_ERROR"),
        ({"options": {"preset": "quick", "point_radii": 0.1}}, "VALIDATION_ERROR"),
        ({"speed": 1.0}, "VALIDATION_ERROR"),
    ],
)
def test_what_is_refused(client: httpx.Client, change: dict[str, Any], code: str) -> None:
    body = {"joints": HOME, "goal_joints": GOAL, "scene": scene(POST)} | change
    document = problem(client.post("/v1/robots/panda/potential", json=body), 422, code)
    assert document["detail"]


def test_unknown_names(client: httpx.Client) -> None:
    body = {"joints": HOME, "goal_joints": GOAL}
    problem(client.post("/v1/robots/nobody/potential", json=body), 404, "NOT_FOUND")
    problem(
        client.post("/v1/robots/panda/potential", json=body | {"scene": "nowhere"}),
        404,
        "NOT_FOUND",
    )
