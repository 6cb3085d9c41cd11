"""Solids of DH tables over HTTP: stored, answered, accepted again, planned around, refused."""

from typing import Any

import httpx
import pytest

from armwright_wire.robots.robot import RobotAnswer
from tests.service.robots import answer, problem, scene

ROW = {
    "type": "revolute", "a": 0.5, "alpha": 0.0, "d": 0.0, "theta": 0.0,
    "lower": -3.0, "upper": 3.0, "velocity": 2.0, "acceleration": 5.0, "jerk": 50.0,
}  # fmt: skip
BALL = {
    "id": "ball",
    "shape": {"type": "sphere", "radius": 0.1},
    "pose": {"position": [0.9, 0.0, 0.0]},
}
BOX = {"shape": {"type": "box", "size": [0.4, 0.1, 0.1]}, "pose": {"position": [-0.25, 0.0, 0.0]}}
START, GOAL = [-0.8, 0.0], [0.8, 0.0]


def table(**more: Any) -> dict[str, Any]:
    return {"convention": "standard", "rows": [ROW, ROW]} | more


def store(client: httpx.Client, name: str, dh: dict[str, Any]) -> Any:
    client.delete(f"/v1/robots/{name}")
    model = answer(client.post("/v1/robots", json={"name": name, "dh": dh}), 201)
    RobotAnswer.model_validate(model)
    return model


def test_an_arm_with_capsules_goes_around_what_it_would_drive_through(
    client: httpx.Client,
) -> None:
    store(client, "thick", table(geometry={"capsules": 0.05}))
    body = {"robot": "thick", "scene": scene(BALL), "start": {"joints": START}}
    straight = body | {"goal": {"joints": GOAL}, "planner": "straight_line"}
    problem(client.post("/v1/plan", json=straight), 422, "PLANNING_FAILED")
    planned = answer(client.post("/v1/plan", json=body | {"goal": {"joints": GOAL}}))
    assert planned["certificate"]["verified"]
    assert planned["certificate"]["min_clearance"] > 0.0
    checked = {"robot": "thick", "scene": scene(BALL), "joints": [[0.0, 0.0], [1.2, 0.0]]}
    verdicts = answer(client.post("/v1/check", json=checked))
    assert verdicts["valid"] == [False, True]
    assert verdicts["collisions"][0][0]["pair"] == ["link_2", "ball"]
    # The ball's centre lies on the axis of a capsule: the way out is the sum of both radii.
    assert verdicts["collisions"][0][0]["depth"] == pytest.approx(0.15, abs=1e-6)


def test_without_solids_it_is_known_to_hit_nothing(client: httpx.Client) -> None:
    assert any("no collision geometry" in line for line in store(client, "thin", table())["lint"])
    lint = store(client, "thick", table(geometry={"capsules": 0.05}))["lint"]
    assert not any("no collision geometry" in line for line in lint)


def test_solids_of_a_row_are_in_its_frame(client: httpx.Client) -> None:
    store(client, "boxed", table(rows=[ROW, ROW | {"geometry": [BOX]}]))
    # From 0.3 to 0.7 of the second link's 0.5 m, which are 0.55 to 0.95 from the base.
    for x, distance in ((0.4, 0.05), (1.1, 0.05)):
        ball = BALL | {"pose": {"position": [x, 0.0, 0.0]}}
        body = {"robot": "boxed", "scene": scene(ball), "joints": [0.0, 0.0]}
        found = answer(client.post("/v1/check", json=body))
        assert found["clearance"] == pytest.approx(distance, abs=1e-6)
        assert found["clearance_pair"] == ["link_2", "ball"]


def test_what_is_answered_as_dh_is_accepted_as_it_is(client: httpx.Client) -> None:
    rows = [ROW, ROW | {"geometry": [BOX, {"shape": {"type": "sphere", "radius": 0.05}}]}]
    store(client, "first", table(rows=rows, geometry={"capsules": 0.05}))
    first = answer(client.get("/v1/robots/first"))
    assert first["dh"]["geometry"] == {"capsules": 0.05}
    assert len(first["dh"]["rows"][1]["geometry"]) == 2
    second = store(client, "second", first["dh"])
    assert second["dh"] == first["dh"]
    assert second["allowed_collisions"] == first["allowed_collisions"]
    configuration = {"joints": [0.3, -0.7], "scene": scene(BALL)}
    clearances = [
        answer(client.post("/v1/check", json=configuration | {"robot": name}))["clearance"]
        for name in ("first", "second")
    ]
    assert clearances[0] == clearances[1]
