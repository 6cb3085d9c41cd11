"""Exports over HTTP: the answer is that of the library, read back and sampled by other code."""

import base64
import io
import json
from typing import Any

import httpx
import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from scipy.interpolate import BPoly

from armwright_wire.motions.export import ExportAnswer
from armwright_wire.scenes.scene import Scene
from obstacles.collision.fcl_distance import FclWorld
from service.storage.caches import worker_cache
from service.storage.caches.cache_key import builtin_reference
from service.translate import poses
from tests.service.robots import ASIDE, FLOOR, HOME, answer, problem, scene, solid

STEP = np.array(ASIDE) - np.array(HOME)
ROWS = np.stack([HOME, 0 * STEP, 0 * STEP, 10 * STEP, -15 * STEP, 6 * STEP], axis=-1)
MOTION = {
    "segments": [{"t0": 0.0, "t1": 3.0, "coefficients": (ROWS / 3.0 ** np.arange(6)).tolist()}]
}
BODY: dict[str, Any] = {"robot": "panda", "scene": scene(FLOOR), "trajectory": MOTION}


def export(client: httpx.Client, **more: Any) -> dict[str, Any]:
    given = answer(client.post("/v1/export", json=BODY | more))
    ExportAnswer.model_validate(given)
    return given


def test_a_goal_for_ros2_control_is_as_clear_as_proved(client: httpx.Client) -> None:
    given = export(client, format="ros2_control", sample_period=0.25, interpolation="cubic")
    assert given["proved"]
    assert given["file_name"] == "armwright.yaml"
    goal = yaml.safe_load(given["content"])
    points = goal["trajectory"]["points"]
    assert len(points) == given["point_count"] == 13
    times = [p["time_from_start"]["sec"] + p["time_from_start"]["nanosec"] / 1e9 for p in points]
    rows = [[p["positions"], p["velocities"]] for p in points]
    curve = BPoly.from_derivatives(times, np.array(rows))
    instants = np.linspace(0.0, 3.0, 400)
    dense = curve(instants)
    exact = np.array([np.polynomial.Polynomial(row)(instants / 3.0) for row in ROWS]).T
    apart = np.abs(dense - exact).max(axis=0)
    bound = np.array(given["joint_deviation"])
    assert (apart <= bound + 1e-12).all()
    assert (bound <= apart + 1e-5).all()
    assert bound.max() > 1e-5
    geometry = worker_cache.robot(builtin_reference("panda")).geometry
    world = FclWorld(geometry, poses.scene(Scene.model_validate(BODY["scene"])))
    least = min(world.clearance(q).distance for q in dense[::8])
    assert 0.0 < given["certificate"]["min_clearance"] <= least + 1e-7
    assert {row["position"] for row in goal["path_tolerance"]} == {given["joint_tolerance"]}


def test_a_recording_shows_the_motion_that_is_proved(client: httpx.Client) -> None:
    given = export(client, format="mcap", sample_period=0.5, name="pick")
    assert (given["file_name"], given["proved"], given["unproved"]) == ("pick.mcap", True, [])
    reader = make_reader(io.BytesIO(base64.b64decode(given["content"])))
    rows: dict[str, list[Any]] = {}
    for _, channel, message in reader.iter_messages():
        rows.setdefault(channel.topic, []).append((message.log_time, json.loads(message.data)))
    assert [time for time, _ in rows["/joint_states"]] == [i * 500_000_000 for i in range(7)]
    middle = [joint["position"] for joint in rows["/joint_states"][3][1]["joints"]]
    np.testing.assert_allclose(middle, 0.5 * (np.array(HOME) + np.array(ASIDE)), atol=1e-9)
    least = min(value["distance"] for _, value in rows["/clearance"])
    assert least >= given["certificate"]["min_clearance"] - 1e-9
    assert [one["id"] for one in rows["/scene"][0][1]["entities"]] == [FLOOR["id"]]


def test_a_program_says_what_is_not_proved(client: httpx.Client) -> None:
    given = export(client, format="krl", blend=0.05)
    assert given["interpolation"] == "straight_legs"
    assert given["proved"] is True
    assert any("outside of the triangle" in sentence for sentence in given["unproved"])
    for sentence in given["unproved"]:
        assert f"; Not covered: {sentence}" in given["content"]
    assert given["joint_deviation"] is None


def test_an_export_that_collides_is_not_proved(client: httpx.Client) -> None:
    high = FLOOR | {"shape": {"type": "halfspace", "normal": [0, 0, 1], "offset": 0.55}}
    given = export(client, format="csv", scene=scene(high))
    assert given["proved"] is False
    assert given["certificate"]["violation"]["kind"] == "collision"
    assert given["joint_tolerance"] is None
    assert "# NOT PROVED free of collisions." in given["content"]


def test_a_stored_scene_and_the_same_inline_have_the_same_hash(client: httpx.Client) -> None:
    inline = export(client, format="csv")["certificate"]["premises"]
    answer(client.post("/v1/scenes", json=BODY["scene"] | {"name": "export_floor"}), 201)
    stored = export(client, format="csv", scene="export_floor")["certificate"]["premises"]
    assert stored == inline | {"scene": "export_floor"}
    assert inline["scene"] is None
    assert (inline["robot"], inline["obstacles"], inline["attached"]) == ("panda", 1, [])
    model = answer(client.get("/v1/robots/panda/geometry"))
    assert inline["robot_hash"] == model["hash"]


PART = solid("part", "box", [0.0, 0.0, 0.12], size=[0.02, 0.03, 0.04]) | {"link": "panda_hand"}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"scene": None}, "here are 0"),
        ({"scene": scene(FLOOR | {"margin": 0.001})}, "other obstacles"),
        ({"attached": None}, "hold part, here it holds nothing"),
        ({"attached": [PART | {"pose": {"position": [0.0, 0.0, 0.13]}}]}, "what it holds differs"),
        ({"allowed_collisions": [["floor", "part"]]}, "other pairs may touch"),
    ],
)
def test_a_motion_is_not_exported_under_other_premises_unless_told(
    client: httpx.Client, change: dict[str, Any], words: str
) -> None:
    held = BODY | {"attached": [PART]}
    premises = answer(client.post("/v1/validate", json=held))["premises"]
    body = held | {"format": "csv", "premises": premises}
    same = answer(client.post("/v1/export", json=body))
    assert same["certificate"]["premises"] == premises
    other = {name: value for name, value in (body | change).items() if value is not None}
    refused = problem(client.post("/v1/export", json=other), 422, "VALIDATION_ERROR")
    assert words in refused["detail"]
    assert "different_scene" in refused["hint"]
    told = answer(client.post("/v1/export", json=other | {"different_scene": True}))
    assert told["certificate"]["premises"] != premises
    if change == {"scene": None}:
        assert "against the robot itself only" in told["content"]
