"""Requests about meshes of every make: convex and not, fine and coarse, closed and open."""

import base64
from typing import Any

import httpx
import numpy as np
import pytest
import trimesh

from tests.service.robots import HOME, answer, bench, scene, solid

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


def obj(form: Mesh) -> str:
    lines = [f"v {x} {y} {z}" for x, y, z in form[0]]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in form[1]]
    return base64.b64encode("\n".join(lines).encode()).decode()


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


@pytest.fixture(scope="module")
def bent(served: Any) -> str:
    """A stored arm whose first link is no convex mesh, and whose second is a fine one."""
    links = bench("bent")
    links["urdf"] = links["urdf"].replace(
        '<box size="0.08 0.08 0.2"/>', '<mesh filename="package://meshes/ring.obj"/>'
    )
    links["meshes"] = {
        "package://meshes/box.obj": obj(elbow()),
        "package://meshes/ring.obj": obj(ring(0.08)),
    }
    answer(served.client.post("/v1/robots", json=links), 201)
    return "bent"


def at(name: str, z: float) -> dict[str, Any]:
    obstacle = OBSTACLES[name]
    return scene(obstacle | {"pose": {"position": [0.0, 0.0, z]}})


def check(client: httpx.Client, robot: str, place: dict[str, Any], joints: Any) -> Any:
    body = {"robot": robot, "scene": place, "joints": joints}
    return answer(client.post("/v1/check", json=body))


@pytest.mark.parametrize("name", ["elbow", "ring", "sheet", "pebble", "cloud"])
@pytest.mark.parametrize("planner", ["auto", "rrt_connect", "potential_field"])
def test_motions_beside_meshes_are_planned_and_proved(
    client: httpx.Client, bent: str, name: str, planner: str
) -> None:
    obstacle = OBSTACLES[name] | {"pose": {"position": [0.45, 0.0, 0.5]}}
    body = {
        "robot": bent, "scene": scene(obstacle), "planner": planner,
        "start": {"joints": [-0.6, 0.2]}, "goal": {"joints": [-1.2, -0.4]},
    }  # fmt: skip
    plan = answer(client.post("/v1/plan", json=body))
    assert plan["certificate"]["verified"] is True
    motion = {"robot": bent, "scene": body["scene"], "trajectory": plan["trajectory"]}
    assert answer(client.post("/v1/validate", json=motion))["verified"] is True


@pytest.mark.parametrize("name", list(OBSTACLES))
def test_a_tool_is_brought_beside_every_solid(client: httpx.Client, name: str) -> None:
    place = scene(OBSTACLES[name] | {"pose": {"position": [0.5, 0.3, 0.2 * (name != "floor")]}})
    pose = {"position": [0.4, -0.2, 0.4], "rpy": [np.pi, 0.0, 0.0]}
    found = answer(client.post("/v1/robots/panda/ik", json={"pose": pose, "scene": place}))
    assert found["solutions"][0]["collision_free"] is True
    body = {"robot": "panda", "scene": place, "start": {"joints": HOME}, "goal": {"pose": pose}}
    assert answer(client.post("/v1/plan", json=body))["certificate"]["verified"] is True
