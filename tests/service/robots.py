"""Robots and scenes that the tests of the service share, and how to read a problem."""

import base64
import json
from typing import Any

import httpx
import pytest

from service.http.errors import KINDS

#: Fields of a problem document.
FIELDS = {"type", "title", "status", "detail", "instance", "code", "stage", "hint", "details"}
HOME = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]
ASIDE = [1.2, -0.3, 0.0, -2.0, 0.0, 1.8, 0.785]


def solid(name: str, kind: str, position: list[float], **measures: Any) -> dict[str, Any]:
    """An obstacle of a scene, with the axes of its frame."""
    shape = {"type": kind, **measures}
    return {"id": name, "shape": shape, "pose": {"position": position}}


#: In the way of the straight motion from HOME to ASIDE.
POST = solid("post", "box", [0.42, 0.28, 0.6], size=[0.1, 0.1, 1.2])
FLOOR = solid("floor", "halfspace", [0, 0, 0], normal=[0, 0, 1], offset=-0.2)
#: A box of 0.1 x 0.1 x 0.3 m that stands on its frame.
BOX_OBJ = "\n".join(
    [f"v {x} {y} {z}" for x in (-0.05, 0.05) for y in (-0.05, 0.05) for z in (0.0, 0.3)]
    + ["f 1 2 4", "f 1 4 3", "f 5 7 8", "f 5 8 6", "f 1 5 6", "f 1 6 2"]
    + ["f 3 4 8", "f 3 8 7", "f 1 3 7", "f 1 7 5", "f 2 6 8", "f 2 8 4"]
)
LIMIT = '<limit lower="-2" upper="2" velocity="2" effort="10"/>'


def urdf(mesh: str = "package://meshes/box.obj", limit: str = LIMIT, extra: str = "") -> str:
    """An arm of two joints whose first link is a mesh."""
    return f"""<?xml version="1.0"?>
<robot name="bench">
  <link name="base"/>
  <link name="lower"><collision><geometry><mesh filename="{mesh}"/></geometry></collision></link>
  <link name="upper">
    <collision><origin xyz="0 0 0.15"/><geometry><box size="0.08 0.08 0.2"/></geometry></collision>
  </link>
  <link name="tip"/>
  <joint name="shoulder" type="revolute">
    <parent link="base"/><child link="lower"/><axis xyz="0 1 0"/>{limit}
  </joint>
  <joint name="elbow" type="revolute">
    <parent link="lower"/><child link="upper"/><origin xyz="0 0 0.3"/><axis xyz="0 1 0"/>{limit}
  </joint>
  <joint name="end" type="fixed">
    <parent link="upper"/><child link="tip"/><origin xyz="0 0 0.3"/>
  </joint>
  {extra}
</robot>"""


#: What the links of `urdf` look like: a mesh, a blue ball, and a mesh that is not there.
LOOKS = """<link name="eye"><visual><origin xyz="0 0 0.1"/><geometry><mesh
  filename="package://meshes/box.obj"/></geometry><material name="m"><color rgba="1 0.5 0 1"/>
  </material></visual><visual><geometry><sphere radius="0.1"/></geometry><material name="blue">
  <color rgba="0 0 1 1"/></material></visual></link>
  <link name="lid"><visual><geometry><mesh filename="package://meshes/gone.dae"/></geometry></visual>
  </link>
  <joint name="eye_joint" type="fixed"><parent link="upper"/><child link="eye"/></joint>
  <joint name="lid_joint" type="fixed"><parent link="eye"/><child link="lid"/></joint>"""
ACCELERATIONS = {"shoulder": {"acceleration": 5.0}, "elbow": {"acceleration": 5.0}}


def bench(name: str, **changes: Any) -> dict[str, Any]:
    """A request that creates the arm of `urdf`; a change to None leaves a field out."""
    meshes = {"package://meshes/box.obj": base64.b64encode(BOX_OBJ.encode()).decode()}
    body = {"name": name, "urdf": urdf(), "meshes": meshes, "joint_limits": ACCELERATIONS}
    return {key: value for key, value in (body | changes).items() if value is not None}


def scene(*obstacles: dict[str, Any], **more: Any) -> dict[str, Any]:
    return {"obstacles": list(obstacles), **more}


def problem(response: httpx.Response, status: int, code: str) -> dict[str, Any]:
    """The problem document of a response, which must have this status and code."""
    assert response.headers["content-type"] == "application/problem+json", response.text
    document: dict[str, Any] = json.loads(response.content, parse_constant=pytest.fail)
    assert set(document) == FIELDS
    assert (response.status_code, document["code"]) == (status, code), document
    assert (document["status"], document["title"]) == (status, KINDS[code].title)
    assert document["detail"]
    assert "Traceback" not in response.text
    return document


def answer(response: httpx.Response, status: int = 200) -> dict[str, Any]:
    """The answer of a response, which must have this status."""
    assert response.status_code == status, response.text
    found: dict[str, Any] = response.json()
    return found


#: Past the post, a plan that takes some steps.
DETOUR: dict[str, Any] = {
    "robot": "panda",
    "scene": scene(POST, FLOOR),
    "start": {"joints": HOME},
    "goal": {"joints": ASIDE},
    "timeout": 60.0,
}


def stuck(robot: str, timeout: float) -> dict[str, Any]:
    """A plan for ``bench`` robots to which no way exists, so it is worked on until time is up."""
    ball = solid("ball", "sphere", [0.0, 0.0, 0.2], radius=0.02)
    return {
        "robot": robot,
        "scene": scene(ball),
        "start": {"joints": [-1.5, 0.0]},
        "goal": {"joints": [1.5, 0.0]},
        "timeout": timeout,
    }
