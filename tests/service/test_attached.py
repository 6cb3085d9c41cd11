"""Held objects over HTTP: in every request that checks collisions, from grasp to release."""

from typing import Any

import httpx
import numpy as np
import pytest

from kinematics.forward import forward
from kinematics.robots import builtin_chain
from tests.service.robots import HOME, answer, problem, scene, solid

CHAIN = builtin_chain("panda")
#: The hand points down and holds a crate that stands on a table.
DOWN = [0.0, 0.2, 0.0, -2.1, 0.0, 2.3, 0.785]
TIP = forward(CHAIN, DOWN)[:3, 3]
SIZE = [0.05, 0.05, 0.1]
CRATE = solid("crate", "box", [float(TIP[0]), float(TIP[1]), float(TIP[2])], size=SIZE)
TABLE = solid("table", "box", [0.55, 0.0, float(TIP[2]) - 0.07], size=[0.5, 1.0, 0.04])
PLACE = scene(TABLE, CRATE)
FINGERS = ["panda_link7"]
HELD = {"id": "crate", "link": "panda_hand", "grasp_joints": DOWN, "touch_links": FINGERS}


def check(client: httpx.Client, **more: Any) -> dict[str, Any]:
    body = {"robot": "panda", "scene": PLACE, "joints": DOWN, **more}
    return answer(client.post("/v1/check", json=body))


def by_request(found: dict[str, Any]) -> list[list[str]]:
    return [item["pair"] for item in found["allowed_collisions"] if item["reason"] == "request"]


def test_what_is_taken_is_no_obstacle_any_more(client: httpx.Client) -> None:
    assert {"crate"} < {name for item in check(client)["collisions"] for name in item["pair"]}
    held = check(client, attached=[HELD])
    # It rests on the table: that contact is told until it is allowed.
    assert [item["pair"] for item in held["collisions"]] in ([], [["crate", "table"]])
    assert held["clearance"] == pytest.approx(0.0, abs=1e-6)
    resting = HELD | {"touch_links": [*FINGERS, "table"]}
    assert check(client, attached=[resting])["valid"]
    allowed = check(client, attached=[HELD], allowed_collisions=[["table", "crate"]])
    assert allowed["valid"]
    assert by_request(allowed) == [["crate", "table"]]
    many = check(client, joints=[DOWN, DOWN], attached=[HELD], allowed_collisions=[
        ["table", "crate"]])  # fmt: skip
    assert many["valid"] == [True, True]
    assert by_request(many) == [["crate", "table"]]


def test_plan_validate_and_ik_know_what_is_held(client: httpx.Client) -> None:
    resting = HELD | {"touch_links": [*FINGERS, "table"], "mass": 1.5}
    body = {
        "robot": "panda",
        "scene": PLACE,
        "start": {"joints": DOWN},
        "goal": {"joints": HOME},
        "attached": [resting],
        "timing": {"torque_limits": True},
        "allowed_collisions": [["panda_hand", "crate"]],
        "timeout": 30.0,
    }
    found = answer(client.post("/v1/plan", json=body))
    assert by_request(found["certificate"]) == [["crate", "panda_hand"]]
    told = problem(
        client.post("/v1/plan", json=body | {"attached": [HELD]}), 422, "START_STATE_IN_COLLISION"
    )["details"]
    assert told["pair"] == ["crate", "table"]
    assert told["depth"] == pytest.approx(0.0, abs=1e-6)
    motion = {
        "robot": "panda",
        "scene": PLACE,
        "trajectory": found["trajectory"],
        "attached": [resting],
        "limits": {"effort": [87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0]},
    }
    proved = answer(client.post("/v1/validate", json=motion))
    assert proved["verified"], proved
    heavy = motion | {"attached": [resting | {"mass": 40.0}]}
    assert answer(client.post("/v1/validate", json=heavy))["violation"]["kind"] == "torque"
    dropped = answer(client.post("/v1/validate", json=motion | {"attached": None}))
    assert dropped["violation"]["kind"] == "collision"
    pose = {"position": [0.5, 0.0, float(TIP[2])], "rpy": [np.pi, 0.0, 0.0]}
    ask = {"pose": pose, "scene": scene(TABLE), "max_solutions": 1}
    free = answer(client.post("/v1/robots/panda/ik", json=ask))
    assert free["solutions"][0]["collision_free"]
    long = solid("pole", "cylinder", [0.0, 0.0, 0.4], radius=0.01, height=0.6) | {
        "link": "panda_hand",
        "touch_links": FINGERS,
    }
    refused = problem(
        client.post("/v1/robots/panda/ik", json=ask | {"attached": [long]}), 422, "NO_IK_SOLUTION"
    )
    assert "pole" in refused["detail"]
    through = ask | {"attached": [long], "allowed_collisions": [["pole", "table"]]}
    assert by_request(answer(client.post("/v1/robots/panda/ik", json=through))) == [
        ["pole", "table"]
    ]


@pytest.mark.parametrize("where", ["scene", "request"])
def test_a_pair_with_a_name_of_an_obstacle_and_a_link_is_refused(
    client: httpx.Client, where: str
) -> None:
    """It could mean the link, or the obstacle, which it would let the robot touch unseen."""
    named = scene(TABLE, CRATE | {"id": "panda_link7"})
    pair = ["panda_link7", "panda_hand"]
    body: dict[str, Any] = {"robot": "panda", "joints": DOWN, "scene": named}
    assert answer(client.post("/v1/check", json=body))["collisions"]
    if where == "scene":
        body["scene"] = named | {"allowed_collisions": [pair]}
    else:
        body["allowed_collisions"] = [pair]
    told = problem(client.post("/v1/check", json=body), 422, "INVALID_SCENE")
    assert "'panda_link7' is the name of an obstacle and of a link" in told["detail"]
    assert told["hint"] == "Give the obstacle another id."
    # Pairs that do not name it are allowed as ever.
    free = body | {"scene": named, "allowed_collisions": [["table", "panda_hand"]]}
    assert answer(client.post("/v1/check", json=free))["allowed_collisions"]
