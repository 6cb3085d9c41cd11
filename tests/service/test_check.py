"""Collision checks and projections over HTTP, and requests about meshes of every make."""

from typing import Any

import httpx
import numpy as np
import pytest
import trimesh

from armwright_wire.scenes.check import CheckAnswer
from armwright_wire.scenes.scene import ProjectAnswer, Scene
from kinematics.robots import builtin_chain
from obstacles.collision.fcl_distance import FclWorld
from service.storage.caches import worker_cache
from service.storage.caches.cache_key import builtin_reference
from service.translate import poses
from tests.service.robots import (
    ASIDE,
    FLOOR,
    HOME,
    POST,
    answer,
    problem,
    scene,
    solid,
)

BALL = solid("ball", "sphere", [-0.4, 0, 0.6], radius=0.2)
CLUTTER = scene(
    POST,
    FLOOR,
    BALL,
    {
        "id": "pipe",
        "shape": {"type": "capsule", "radius": 0.04, "height": 1.0},
        "pose": {"position": [0.3, -0.4, 0.5], "rpy": [1.0, 0.3, 0.0]},
    },
)


def check(client: httpx.Client, joints: Any, **more: Any) -> dict[str, Any]:
    body = {"robot": "panda", "scene": CLUTTER, "joints": joints} | more
    return answer(client.post("/v1/check", json=body))


def world(place: dict[str, Any]) -> FclWorld:
    geometry = worker_cache.robot(builtin_reference("panda")).geometry
    return FclWorld(geometry, poses.scene(Scene.model_validate(place)))


def test_many_configurations_against_the_exact_world(client: httpx.Client) -> None:
    chain = builtin_chain("panda")
    lower, upper = chain.sampling_bounds()
    q = np.random.default_rng(7).uniform(lower, upper, (60, 7))
    found = check(client, q.tolist())
    CheckAnswer.model_validate(found)
    exact = world(CLUTTER)
    assert set(found["valid"]) == {True, False}
    for i, configuration in enumerate(q):
        clearance = exact.clearance(configuration)
        np.testing.assert_allclose(found["clearance"][i], clearance.distance, atol=1e-6)
        collisions = exact.collisions(configuration)
        told = {tuple(item["pair"]): item["depth"] for item in found["collisions"][i]}
        assert told == pytest.approx({item.pair: item.depth for item in collisions}, abs=1e-9)
        assert found["valid"][i] == (clearance.distance > 0.0)
        assert found["limit_violations"][i] == []


def test_one_configuration_is_told_without_lists(client: httpx.Client) -> None:
    found = check(client, HOME, scene=scene(POST))
    CheckAnswer.model_validate(found)
    assert found["valid"] is True
    assert found["collisions"] == []
    assert check(client, [HOME], scene=scene(POST))["valid"] == [True]


def test_a_margin_concerns_obstacles_and_not_the_links_of_the_arm(client: httpx.Client) -> None:
    alone = check(client, HOME, scene=None)
    margin = 2.0 * alone["clearance"]
    found = check(client, HOME, scene=None, margin=margin)
    assert (found["valid"], found["clearance"]) == (True, alone["clearance"])
    body = {"robot": "panda", "start": {"joints": HOME}, "goal": {"joints": ASIDE}}
    assert client.post("/v1/plan", json=body | {"margin": margin}).status_code == 200


def test_time_that_is_up_is_told_with_what_was_checked(client: httpx.Client) -> None:
    """It cost the worker: nothing looked at the deadline."""
    joints = np.random.default_rng(0).uniform(-2.5, 2.5, (5000, 7)).tolist()
    body = {"robot": "panda", "joints": joints, "timeout": 5.0}
    told = problem(client.post("/v1/check", json=body), 504, "TIMED_OUT")
    assert "of 5000 configurations were checked" in told["detail"]
    assert "depth" in told["hint"]
    assert 0 <= told["details"]["checked"] < 5000


def test_limits_are_part_of_the_verdict(client: httpx.Client) -> None:
    outside = [*HOME[:3], 0.5, *HOME[4:]]
    found = check(client, outside, scene=None)
    assert found["valid"] is False
    (broken,) = found["limit_violations"]
    limit = builtin_chain("panda").limits.upper[3]
    assert broken == {"joint": "panda_joint4", "value": 0.5, "limit": limit}


def test_margins(client: httpx.Client) -> None:
    chain = builtin_chain("panda")
    clearance = world(scene(POST)).clearance(HOME).distance
    own = world(scene()).clearance(HOME).distance
    assert clearance == pytest.approx(own), "the robot itself is nearest at home"
    near = world(scene(POST, allowed_collisions=[]))
    near.set_configuration(HOME)
    post = min(near.distance(k) for k in range(len(near.pairs)) if "post" in near.pair_names(k))
    for margin, valid in ((0.9 * post, True), (1.1 * post, False)):
        ways = {"scene": scene(POST | {"margin": margin})}, {"margin": margin}
        both = {"scene": scene(POST | {"margin": 0.4 * margin}), "margin": 0.6 * margin}
        for way in (*ways, both):
            found = check(client, HOME, **({"scene": scene(POST)} | way))
            assert (found["valid"], found["collisions"]) == (valid, [])
            assert found["clearance"] == pytest.approx(own, abs=1e-6), "margins are not taken off"
    assert chain.n == 7


def test_projections(client: httpx.Client) -> None:
    answer(client.post("/v1/scenes", json={"name": "clutter", **CLUTTER}), 201)
    random = np.random.default_rng(4)
    points = random.uniform(-1.0, 1.0, (50, 3))
    path = "/v1/scenes/clutter/project"
    found = answer(client.post(path, json={"points": points.tolist()}))
    ProjectAnswer.model_validate(found)
    by_fcl = answer(client.post(path, json={"points": points.tolist(), "engine": "fcl"}))
    assert by_fcl != found
    for p, row in zip(points, found["projections"], strict=True):
        assert [item["obstacle"] for item in row] == ["post", "floor", "ball", "pipe"]
        for item in row:
            gap = float(np.linalg.norm(p - item["projection"]))
            assert abs(item["distance"]) == pytest.approx(gap, abs=1e-9)
        box = np.clip(p, [0.37, 0.23, 0.0], [0.47, 0.33, 1.2])
        if row[0]["distance"] > 0.0:
            np.testing.assert_allclose(row[0]["projection"], box, atol=1e-12)
        np.testing.assert_allclose(row[1]["projection"], [p[0], p[1], -0.2], atol=1e-12)
        assert row[1]["distance"] == pytest.approx(p[2] + 0.2)
        center = np.array([-0.4, 0.0, 0.6])
        away = float(np.linalg.norm(p - center))
        assert row[2]["distance"] == pytest.approx(away - 0.2)
        nearest = center + 0.2 * (p - center) / away
        np.testing.assert_allclose(row[2]["projection"], nearest, atol=1e-9)


def test_a_scene_without_obstacles_has_no_projections(client: httpx.Client) -> None:
    body = {"points": [[0.0, 0.0, 0.0]]}
    problem(client.post("/v1/scenes/nowhere/project", json=body), 404, "NOT_FOUND")
    answer(client.post("/v1/scenes", json={"name": "empty", "obstacles": []}), 201)
    found = answer(client.post("/v1/scenes/empty/project", json=body))
    assert found == {"projections": [[]], "frame": None}


def test_a_replaced_scene_is_seen_at_once(client: httpx.Client) -> None:
    body = {"robot": "panda", "scene": "changing", "joints": HOME}
    far = POST | {"pose": {"position": [2.0, 2.0, 0.0]}}
    answer(client.put("/v1/scenes/changing", json=scene(far)), 201)
    assert answer(client.post("/v1/check", json=body))["valid"]
    near = POST | {"pose": {"position": [0.3, 0.0, 0.5]}}
    answer(client.put("/v1/scenes/changing", json=scene(near)))
    assert not answer(client.post("/v1/check", json=body))["valid"]
    assert client.delete("/v1/scenes/changing").status_code == 204
    problem(client.post("/v1/check", json=body), 404, "NOT_FOUND")


def test_a_moveit_text_is_a_scene(client: httpx.Client) -> None:
    text = """
name: ""
world:
  collision_objects:
    - id: table
      header: {frame_id: panda_link0}
      pose: {position: [0.3, 0.0, 0.5], orientation: [0, 0, 0, 1]}
      primitives: [{type: box, dimensions: [0.2, 0.2, 0.2]}]
      primitive_poses: [{position: [0, 0, 0], orientation: [0, 0, 0, 1]}]
"""
    body = {"robot": "panda", "scene": {"moveit": text}, "joints": HOME}
    found = answer(client.post("/v1/check", json=body))
    assert {item["pair"][1] for item in found["collisions"]} == {"table"}


Mesh = tuple[list[list[float]], list[list[int]]]


def elbow() -> Mesh:
    """A prism of 0.3 m over an L of 0.1 x 0.1 m with arms 0.04 m wide, standing on its frame."""
    outline = [(0, 0), (0.1, 0), (0.1, 0.04), (0.04, 0.04), (0.04, 0.1), (0, 0.1)]
    vertices = [[x - 0.02, y - 0.02, z] for z in (0.0, 0.3) for x, y in outline]
    caps = [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]]
    faces = [[a, c, b] for a, b, c in caps] + [[a + 6, b + 6, c + 6] for a, b, c in caps]
    for i in range(6):
        j = (i + 1) % 6
        faces += [[i, j, j + 6], [i, j + 6, i + 6]]
    return vertices, faces


def ring(radius: float, rows: int = 24, columns: int = 12) -> Mesh:
    """A torus about z."""
    made = trimesh.creation.torus(radius, 0.3 * radius, rows, columns)
    return made.vertices.tolist(), made.faces.tolist()


def ball(radius: float, subdivisions: int) -> list[list[float]]:
    """Points of a sphere, spread evenly."""
    points: list[list[float]] = trimesh.creation.icosphere(subdivisions, radius).vertices.tolist()
    return points


def sheet() -> Mesh:
    """Two triangles: a square without an inside."""
    return [[-0.1, -0.1, 0], [0.1, -0.1, 0], [0.1, 0.1, 0], [-0.1, 0.1, 0]], [[0, 1, 2], [0, 2, 3]]


def mesh(form: Mesh, name: str, position: list[float]) -> dict[str, Any]:
    return solid(name, "mesh", position, vertices=form[0], faces=form[1])


OBSTACLES = {
    "elbow": mesh(elbow(), "elbow", [0.0, 0.0, 0.0]),
    "ring": mesh(ring(0.1), "ring", [0.0, 0.0, 0.0]),
    "fine ring": mesh(ring(0.1, 60, 30), "ring", [0.0, 0.0, 0.0]),
    "sheet": mesh(sheet(), "sheet", [0.0, 0.0, 0.0]),
    "pebble": solid("pebble", "convex", [0.0, 0.0, 0.0], vertices=ball(0.1, 2)),
    "cloud": solid("cloud", "point_cloud", [0.0, 0.0, 0.0], points=ball(0.1, 4), radius=0.005),
    "dome": solid("dome", "cone", [0.0, 0.0, 0.0], radius=0.1, height=0.2),
    "floor": solid("floor", "halfspace", [0.0, 0.0, 0.0], normal=[0, 0, 1], offset=0.0),
}  # fmt: skip


@pytest.mark.parametrize("name", list(OBSTACLES))
def test_a_tool_is_brought_beside_every_solid(client: httpx.Client, name: str) -> None:
    place = scene(OBSTACLES[name] | {"pose": {"position": [0.5, 0.3, 0.2 * (name != "floor")]}})
    pose = {"position": [0.4, -0.2, 0.4], "rpy": [np.pi, 0.0, 0.0]}
    found = answer(client.post("/v1/robots/panda/ik", json={"pose": pose, "scene": place}))
    assert found["solutions"][0]["collision_free"] is True
    body = {"robot": "panda", "scene": place, "start": {"joints": HOME}, "goal": {"pose": pose}}
    assert answer(client.post("/v1/plan", json=body))["certificate"]["verified"] is True
