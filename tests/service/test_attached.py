"""Held objects and pairs that may touch over HTTP."""

from typing import Any

import coal
import httpx
import numpy as np
import pytest

from armwright_wire.scenes.check import Attached
from kinematics.forward import forward
from kinematics.robots import builtin_chain
from tests.service.jobs.requests import batch
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


#: A UR5e folded into itself, and the pairs that a MoveIt matrix lets touch there.
FOLDED, OPEN = [0.3, -1.4, 3.0, -1.97, -1.571, 0.2], [0.3, -1.4, 1.8, -1.97, -1.571, 0.2]
_NAMES = ("forearm_link", "shoulder_link", "upper_arm_link", "wrist_1_link", "wrist_2_link",
          "wrist_3_link")  # fmt: skip
_MATRIX = [("forearm_link", "shoulder_link")]
_MATRIX += [("upper_arm_link", f"wrist_{k}_link") for k in (1, 2, 3)]
_MATRIX += [("wrist_1_link", "wrist_2_link")]
_ROWS = "".join(
    f"  - [{', '.join(str((a, b) in _MATRIX or (b, a) in _MATRIX).lower() for b in _NAMES)}]\n"
    for a in _NAMES
)
MATRIX = {
    "moveit": "name: x\nworld:\n  collision_objects: []\nallowed_collision_matrix:\n"
    f"  entry_names: [{', '.join(_NAMES)}]\n  entry_values:\n{_ROWS}"
}
GROUND = solid("ground", "halfspace", [0, 0, 0], normal=[0, 0, 1], offset=0.4433)
BALL = {"type": "sphere", "radius": 0.05}
#: The ball's lowest point is 3 mm below the ground at HOME, wherever joint 1 turns it.
ALLOWED_COLLISIONS_HELD = {
    "id": "ball",
    "shape": BALL,
    "pose": {"position": [0, 0, 0.1]},
    "link": "panda_hand",
}
ABOUT = [0.8, *HOME[1:]]
STILL = [["ground", f"panda_link{k}"] for k in range(8)] + [["ground", "panda_hand"]]


def told(found: dict[str, Any]) -> dict[tuple[str, ...], tuple[str, float | None]]:
    return {tuple(i["pair"]): (i["reason"], i["overlap"]) for i in found["allowed_collisions"]}


def depth_of_ball(client: httpx.Client) -> float:
    """How deep the ball is in the ground, by the answer of forward kinematics and coal."""
    body = {"joints": HOME, "link": "panda_hand"}
    pose = answer(client.post("/v1/robots/panda/fk", json=body))["pose"]
    x, y, z, w = pose["quaternion_xyzw"]
    axis = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
    center = np.array(pose["position"]) + 0.1 * axis
    request = coal.DistanceRequest()
    request.enable_signed_distance = True
    at = coal.Transform3s(np.eye(3), center)
    plane = coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.4433)
    result = coal.DistanceResult()
    distance = coal.distance(coal.Sphere(0.05), at, plane, coal.Transform3s(), request, result)
    return -float(distance)


def test_every_door_tells_the_pairs_of_a_moveit_matrix(client: httpx.Client) -> None:
    base = {"robot": "ur5e", "scene": MATRIX}
    problem_of = {"start": {"joints": FOLDED}, "goal": {"joints": OPEN}, "timeout": 30.0}
    planned = answer(client.post("/v1/plan", json=base | problem_of))
    motion = base | {"trajectory": planned["trajectory"]}
    problems = {"robot": "ur5e", "problems": [{"scene": MATRIX, **problem_of}]}
    many = batch(client, problems)["result"]
    pose = answer(client.post("/v1/robots/ur5e/fk", json={"joints": OPEN}))["pose"]
    goals = [{"id": "a", "joints": OPEN}, {"id": "b", "joints": FOLDED}]
    tour = answer(
        client.post("/v1/tours", json=base | {"start": {"joints": FOLDED}, "goals": goals})
    )
    stages = [{"kind": "move", "goal": {"joints": OPEN}}]
    task = base | {"start": {"joints": FOLDED}, "stages": stages, "timeout": 30.0}
    ik = {"pose": pose, "scene": MATRIX, "seed_joints": OPEN}
    field = {"joints": FOLDED, "goal_joints": OPEN, "scene": MATRIX}
    exported = answer(client.post("/v1/export", json=motion | {"format": "csv"}))
    answers = {
        "plan": planned["certificate"],
        "validate": answer(client.post("/v1/validate", json=motion)),
        "batch": many["results"][0]["certificate"],
        "check": answer(client.post("/v1/check", json=base | {"joints": FOLDED})),
        "verdict": answer(client.post("/v1/check", json=base | {"joints": FOLDED, "depth": False})),
        "ik": answer(client.post("/v1/robots/ur5e/ik", json=ik)),
        "constrained": answer(
            client.post("/v1/robots/ur5e/ik", json=ik | {"method": "constrained"})
        ),
        "potential": answer(client.post("/v1/robots/ur5e/potential", json=field)),
        "reach": answer(
            client.post("/v1/robots/ur5e/reach", json={"poses": [pose], "scene": MATRIX})
        ),
        "tour": tour,
        "leg": tour["legs"][0]["certificate"],
        "task": answer(client.post("/v1/tasks", json=task))["stages"][0]["certificate"],
        "export": exported["certificate"],
    }
    deepest = {}
    for door, found in answers.items():
        pairs = told(found)
        assert set(_MATRIX) <= set(pairs), door
        assert all(pairs[pair][0] == "scene" for pair in _MATRIX), door
        # What the robot's own SRDF lets touch is told too.
        assert pairs["shoulder_link", "upper_arm_link"][0] in ("srdf", "adjacent"), door
        deepest[door] = max(pairs[pair][1] or 0.0 for pair in _MATRIX)
    for door in answers.keys() - {"verdict", "ik", "constrained", "reach"}:
        assert deepest[door] > 0.01, door
    assert deepest["plan"] == pytest.approx(deepest["check"], rel=0.1, abs=1e-4)
    told_in_file = "Not kept apart (scene): upper_arm_link and wrist_1_link, at most"
    assert told_in_file in exported["content"]


@pytest.mark.parametrize("way", ["touch_links", "request", "scene"])
def test_touch_depth_limits_contact_wherever_it_is_given(client: httpx.Client, way: str) -> None:
    depth = depth_of_ball(client)
    assert depth > 0.002
    for limit in (depth + 0.0005, depth - 0.0005, None):
        pair = {"pair": ["ball", "ground"], "touch_depth": limit}
        body: dict[str, Any] = {
            "robot": "panda",
            "scene": scene(GROUND, allowed_collisions=STILL + [pair] * (way == "scene")),
            "attached": [ALLOWED_COLLISIONS_HELD],
        }
        if way == "touch_links":
            body["attached"] = [
                ALLOWED_COLLISIONS_HELD | {"touch_links": ["ground"], "touch_depth": limit}
            ]
        if way == "request":
            body["allowed_collisions"] = [pair]
        checked = answer(client.post("/v1/check", json=body | {"joints": HOME}))
        fine = limit is None or limit > depth
        assert checked["valid"] == fine
        reason, overlap = told(checked)["ball", "ground"]
        assert reason == way
        assert overlap == pytest.approx(depth, abs=1e-6)
        ends = {"start": {"joints": HOME}, "goal": {"joints": ABOUT}, "timeout": 30.0}
        response = client.post("/v1/plan", json=body | ends)
        if fine:
            certificate = answer(response)["certificate"]
            reason, bound = told(certificate)["ball", "ground"]
            assert reason == way
            assert depth - 1e-9 <= (bound or 0.0) <= 1.05 * depth + 1e-4
            continue
        (collision,) = checked["collisions"]
        assert collision["pair"] == ["ball", "ground"]
        assert collision["depth"] == pytest.approx(depth, abs=1e-6)
        refused = problem(response, 422, "START_STATE_IN_COLLISION")
        assert "'ball' and 'ground' overlap by" in refused["detail"]
        assert "touch_depth" in refused["hint"]
        assert refused["details"]["touch_depth"] == limit


def test_touch_links_and_supports_are_a_millimetre_deep_unless_told(client: httpx.Client) -> None:
    touching = ALLOWED_COLLISIONS_HELD | {"touch_links": ["ground"]}
    body = {"robot": "panda", "joints": HOME, "attached": [touching],
            "scene": scene(GROUND, allowed_collisions=STILL)}  # fmt: skip
    assert not answer(client.post("/v1/check", json=body))["valid"]
    any_depth = body | {"attached": [touching | {"touch_depth": None}]}
    assert answer(client.post("/v1/check", json=any_depth))["valid"]
    # The client sends None too, which is left out of other fields.
    pose = {"position": [0.0, 0.0, 0.1]}
    sent = Attached(id="ball", shape=BALL, pose=pose, link="panda_hand", touch_depth=None)  # type: ignore[arg-type]
    assert '"touch_depth":null' in sent.to_json()
