"""Reach over HTTP: poses, grids, tolerances, bases, pictures, and what is refused."""

import io
from base64 import b64decode
from typing import Any
from xml.etree import ElementTree

import httpx
import pytest
import trimesh

from armwright_wire.robots.reach import ReachAnswer
from tests.service.jobs.requests import ended, submit
from tests.service.robots import FLOOR, POST, answer, problem, scene, solid

DOWN = [1.0, 0.0, 0.0, 0.0]
BOX = {"size": [0.8, 0.6, 0.0], "pose": {"position": [0.45, 0.0, 0.3]}, "spacing": 0.1,
       "orientations": [DOWN]}  # fmt: skip


def reach(client: httpx.Client, robot: str = "panda", **body: Any) -> Any:
    body.setdefault("scene", scene(FLOOR, POST))
    found = answer(client.post(f"/v1/robots/{robot}/reach", json=body))
    ReachAnswer.model_validate(found)
    return found


def test_the_configurations_reach_the_poses_and_are_free(client: httpx.Client) -> None:
    poses = [{"position": [x, 0.1, 0.4], "quaternion_xyzw": DOWN} for x in (0.3, 0.42, 0.6, 2.0)]
    found = reach(client, poses=poses)
    assert found["count"] == 4
    assert found["statuses"] == ["out_of_reach", "outside_limits", "in_collision", "reached"]
    assert found["status"][3] == 0
    assert found["joints"][3] is None
    assert found["manipulability"][3] is None
    reached = [k for k, status in enumerate(found["status"]) if status == 3]
    assert found["reached"] == len(reached) >= 2
    for k in reached:
        q = found["joints"][k]
        at = answer(client.post("/v1/robots/panda/fk", json={"joints": q}))["pose"]
        assert at["position"] == pytest.approx(poses[k]["position"], abs=1e-6)
        body = {"robot": "panda", "joints": q, "scene": scene(FLOOR, POST)}
        verdict = answer(client.post("/v1/check", json=body))
        assert verdict["valid"]
        assert found["clearance"][k] == pytest.approx(verdict["clearance"], abs=1e-6)


def test_a_box_is_answered_in_the_order_of_its_grid(client: httpx.Client) -> None:
    found = reach(client, box=BOX, joints=True)
    assert found["grid"]["shape"] == [9, 7, 1, 1]
    assert found["count"] == len(found["status"]) == 63
    xs, ys, _ = found["grid"]["axes"]
    k = found["status"].index(3)
    at = answer(client.post("/v1/robots/panda/fk", json={"joints": found["joints"][k]}))["pose"]
    assert at["position"] == pytest.approx([0.45 + xs[k // 7], ys[k % 7], 0.3], abs=1e-6)
    assert reach(client, box=BOX, joints=False)["joints"] is None


def test_the_best_base_comes_first(client: httpx.Client) -> None:
    poses = [{"position": [x, y, 0.3], "quaternion_xyzw": DOWN} for x in (1.0, 1.2) for y in (0, 1)]
    bases = [{"position": [0.0, 0.0, 0.0]}, {"position": [0.8, 0.5, 0.0]}]
    found = reach(client, "ur5e", poses=poses, bases=bases, scene=scene(POST))
    first, second = found["bases"]
    assert first["index"] == 1
    assert first["reached"] == found["reached"] == 4
    assert second["reached"] < 4
    assert len(second["unreached"]) == 4 - second["reached"]
    assert first["clearance"] == pytest.approx(min(found["clearance"]), abs=1e-5)
    assert first["pose"]["position"] == [0.8, 0.5, 0.0]


def test_a_region_of_bases_is_a_grid_with_yaws(client: httpx.Client) -> None:
    region = {"x": [0.0, 0.4], "y": [0.0, 0.0], "spacing": 0.2, "yaws": 4}
    found = reach(client, "ur5e", poses=[{"position": [0.6, 0.2, 0.3]}], base_region=region)
    assert sorted(item["index"] for item in found["bases"]) == list(range(12))
    scores = [item["reached"] for item in found["bases"]]
    assert scores == sorted(scores, reverse=True)


def test_a_picture_has_a_square_for_each_point(client: httpx.Client) -> None:
    body = {"box": BOX, "format": "svg", "scene": scene(FLOOR, POST)}
    response = client.post("/v1/robots/panda/reach", json=body)
    assert response.headers["content-type"].startswith("image/svg+xml")
    picture = ElementTree.fromstring(response.text)
    squares = picture.findall("{http://www.w3.org/2000/svg}rect")
    assert len(squares) == 63 + 1
    assert len({square.get("fill") for square in squares}) > 3


def test_a_mesh_holds_what_is_reached(client: httpx.Client) -> None:
    body = {"box": BOX, "format": "glb", "scene": scene(FLOOR, POST)}
    response = client.post("/v1/robots/panda/reach", json=body)
    assert response.headers["content-type"] == "model/gltf-binary"
    mesh = trimesh.load(io.BytesIO(response.content), file_type="glb", force="mesh", process=False)
    counted = reach(client, "panda", box=BOX, scene=scene(FLOOR, POST))["reached"]
    assert mesh.volume == pytest.approx(counted * 0.1**3, rel=1e-4)
    job = ended(client, submit(client, body, "/v1/robots/panda/reach"))
    assert b64decode(job["result"]) == response.content


def test_a_frame_moves_the_poses(client: httpx.Client) -> None:
    pose = {"position": [0.1, 0.0, 0.1], "quaternion_xyzw": DOWN}
    found = reach(client, poses=[pose | {"position": [0.4, -0.3, 0.5]}], frame="panda_link0")
    assert found["frame"] == "panda_link0"
    assert found["status"] == [3]


def test_a_deadline_is_kept(client: httpx.Client) -> None:
    body = {"box": BOX | {"spacing": 0.002}, "timeout": 0.3}
    refusal = problem(client.post("/v1/robots/panda/reach", json=body), 504, "TIMED_OUT")
    # On a busy machine time may be up before a worker has begun: then nothing is told of poses.
    if "completed" in refusal["details"]:
        assert refusal["details"]["completed"] < 120_000
        assert "poses" in refusal["detail"]


def test_what_is_held_counts(client: httpx.Client) -> None:
    block = solid("block", "box", [0, 0, 0.3], size=[0.3, 0.3, 0.3]) | {"link": "panda_hand"}
    with_block = reach(client, box=BOX, attached=[block])
    assert with_block["reached"] < reach(client, box=BOX)["reached"]
