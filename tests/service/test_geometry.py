"""Collision geometry over HTTP: triangles in the frames that forward kinematics answers."""

import httpx
import numpy as np
import trimesh

from armwright_client.geometry import GeometryAnswer
from tests.service.robots import answer, bench, problem


def test_surfaces_are_those_of_the_description(client: httpx.Client) -> None:
    answer(client.post("/v1/robots", json=bench("drawn")), 201)
    body = answer(client.get("/v1/robots/drawn/geometry"))
    read = GeometryAnswer.model_validate(body)
    assert read.robot == "drawn"
    assert [item.link for item in read.bodies] == ["lower", "upper"]
    lower, upper = (trimesh.Trimesh(s.corners(), s.triangles()) for s in read.bodies)
    np.testing.assert_allclose(lower.bounds, [[-0.05, -0.05, 0.0], [0.05, 0.05, 0.3]], atol=1e-6)
    np.testing.assert_allclose(upper.bounds, [[-0.04, -0.04, 0.05], [0.04, 0.04, 0.25]], atol=1e-6)
    # Counter-clockwise from outside: the volumes are positive.
    np.testing.assert_allclose([lower.volume, upper.volume], [0.003, 0.00128], rtol=1e-5)


def test_frames_are_links_of_forward_kinematics(client: httpx.Client) -> None:
    model = answer(client.get("/v1/robots/panda"))
    body = answer(client.get("/v1/robots/panda/geometry"))
    links = answer(client.post("/v1/robots/panda/fk", json={"joints": [0.0] * 7}))["links"]
    assert body["bodies"]
    assert {item["frame"] for item in body["bodies"]} <= set(links)
    assert {item["link"] for item in body["bodies"]} <= set(model["links"])


def test_an_unknown_robot_has_none(client: httpx.Client) -> None:
    problem(client.get("/v1/robots/nobody/geometry"), 404, "NOT_FOUND")
