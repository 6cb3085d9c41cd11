"""A robot with links whose joints mimic one of its chain, over HTTP."""

from collections.abc import Iterator
from typing import Any

import httpx
import numpy as np
import pytest

from tests.kinematics.test_mimic_joints import Oracle
from tests.mimic_joints import urdf
from tests.service.robots import answer

START, GOAL = [-0.9, 0.2, -0.5, 0.4, 0.5, 0.0], [0.9, 0.2, -0.5, -1.2, 0.5, 0.0]


@pytest.fixture(autouse=True)
def palletiser(client: httpx.Client) -> Iterator[dict[str, Any]]:
    body = {"name": "palletiser", "urdf": urdf(), "tip_link": "flange"}
    yield answer(client.post("/v1/robots", json=body), 201)
    client.delete("/v1/robots/palletiser")


def test_what_follows_is_told(palletiser: dict[str, Any]) -> None:
    assert palletiser["joint_names"] == ["j1", "j2", "j3", "j4", "j5", "j6"]
    assert {"rod", "flap", "drum"} <= set(palletiser["links"])
    lint = "\n".join(palletiser["lint"])
    assert "'rod_joint' moves with 'j2', which it mimics: -1 x" in lint
    assert "forces and torques are not known" in lint


def test_a_plan_passes_what_only_the_drum_would_hit(client: httpx.Client) -> None:
    """A post that the arm itself never comes near, in the way of what turns behind the base."""
    oracle = Oracle()
    tip = oracle.pose(np.array([0.0, *START[1:]]), "drum")
    post = tip[:3, 3] + 0.22 * tip[:3, 0]
    shape = {"type": "sphere", "radius": 0.04}
    scene = {"obstacles": [{"id": "post", "shape": shape, "pose": {"position": post.tolist()}}]}
    body = {"robot": "palletiser", "scene": scene, "joints": [[0.0, *START[1:]]]}
    checked = answer(client.post("/v1/check", json=body))
    assert "drum" in str(checked)
    problem_body = {
        "robot": "palletiser", "scene": scene, "start": {"joints": START},
        "goal": {"joints": GOAL}, "timeout": 20.0,
    }  # fmt: skip
    # All ways turn the drum, which follows the first joint, past the post.
    refused = client.post("/v1/plan", json=problem_body | {"timeout": 2.0})
    blocked = refused.json()["details"]["blocked_by"]
    assert ["drum", "post"] in [item["pair"] for item in blocked], refused.text
    free = {"obstacles": [scene["obstacles"][0] | {"pose": {"position": [0.6, 1.4, 0.4]}}]}
    plan = answer(client.post("/v1/plan", json=problem_body | {"scene": free}))
    assert plan["certificate"]["verified"]


def test_dynamics_are_refused_by_name(client: httpx.Client) -> None:
    refused = client.post("/v1/robots/palletiser/dynamics", json={"joints": START})
    assert refused.status_code == 422
    assert "rod_joint" in refused.text
    assert "mimic" in refused.text
