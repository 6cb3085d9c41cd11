"""Collision geometry over HTTP: triangles in the frames that forward kinematics answers."""

import httpx
import numpy as np
import trimesh

from armwright_wire.robots.robot import GeometryAnswer
from tests.service.conftest import Served
from tests.service.robots import LOOKS, answer, bench, problem, urdf


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


def test_what_a_robot_looks_like(served: Served) -> None:
    client, prepared = served.client, served.data / "prepared"
    before = set(prepared.glob("*.visuals"))
    where = "/v1/robots/seen/geometry"
    made = answer(client.post("/v1/robots", json=bench("seen", urdf=urdf(extra=LOOKS))), 201)
    (line,) = (line for line in made["lint"] if "visual" in line)
    assert "lid" in line
    assert "eye" not in line
    body = answer(client.get(where, params={"kind": "visual"}))
    read = GeometryAnswer.model_validate(body)
    assert read.kind == "visual"
    # Links that look like nothing have their collision geometry beside it.
    assert [item.link for item in read.bodies] == ["eye", "eye", "lower", "upper"]
    assert [item.color for item in read.bodies] == [[1, 0.5, 0, 1], [0, 0, 1, 1], None, None]
    box, ball = (trimesh.Trimesh(s.corners(), s.triangles()) for s in read.bodies[:2])
    np.testing.assert_allclose(box.bounds, [[-0.05, -0.05, 0.1], [0.05, 0.05, 0.4]], atol=1e-6)
    np.testing.assert_allclose(ball.bounds[:, 2], [-0.1, 0.1], atol=1e-6)
    plain = answer(client.get(where))
    assert plain["kind"] == "collision"
    assert plain["bodies"] == body["bodies"][2:]
    # Its file is made again where it is lost, and goes with the robot.
    (kept,) = set(prepared.glob("*.visuals")) - before
    kept.unlink()
    assert answer(client.get(where, params={"kind": "visual"})) == body
    assert kept.exists()
    assert client.delete("/v1/robots/seen").status_code == 204
    assert not kept.exists()


def test_a_robot_without_looks_has_no_visual_bodies(client: httpx.Client) -> None:
    body = answer(client.get("/v1/robots/panda/geometry", params={"kind": "visual"}))
    assert body["bodies"] == []
    problem(client.get("/v1/robots/panda/geometry?kind=pretty"), 422, "VALIDATION_ERROR")
