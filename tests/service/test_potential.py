"""The potential over HTTP: its slope by finite differences, its parts, what is refused."""

from typing import Any

import httpx
import numpy as np
import pytest

from armwright_wire.robots.potential import PotentialAnswer
from tests.service.robots import FLOOR, HOME, POST, answer, scene

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


def test_at_the_goal_nothing_pulls(client: httpx.Client) -> None:
    found = potential(client, GOAL, scene=None)
    assert found["potential"] == 0.0
    assert found["gradient"] == [0.0] * 7
    assert found["control_points"][0]["projection"] is None
    assert found["control_points"][0]["distance"] is None
    assert found["control_points"][0]["obstacle"] is None
