"""Tables over HTTP: what GET answers as dh is accepted by POST, with the solids of links."""

from typing import Any

import httpx
import numpy as np
import pytest

from armwright_wire.robots.robot import RobotAnswer
from tests.service.robots import answer, problem, scene, solid

ROW: dict[str, Any] = {
    "type": "revolute", "a": 0.4, "alpha": 0.3, "d": 0.1, "theta": 0.2, "beta": 0.05,
    "lower": -2.0, "upper": 3.0, "velocity": 2.0, "acceleration": 5.0, "jerk": 50.0,
    "effort": 80.0, "mass": 2.5, "center_of_mass": [0.1, 0.02, -0.03],
    "inertia": [[0.02, 0.001, 0.0], [0.001, 0.03, 0.0], [0.0, 0.0, 0.04]],
    "motor_inertia": 0.1, "viscous_friction": 0.2, "coulomb_friction": 0.3,
    "continuous": False, "geometry": None, "motor": None,
}  # fmt: skip
TURN = [np.sin(0.2), 0.0, 0.0, np.cos(0.2)]
TABLE: dict[str, Any] = {
    "convention": "modified",
    "rows": [
        ROW,
        ROW | {"type": "prismatic", "lower": 0.0, "upper": 0.5},
        ROW | {"lower": None, "upper": None, "continuous": True},
    ],
    "base": {"position": [0.1, 0.2, 0.3], "quaternion_xyzw": TURN},
    "tool": {"position": [0.0, 0.0, 0.15], "quaternion_xyzw": [0.0, 0.0, 0.0, 1.0]},
    "gravity": [0.0, 1.0, -9.7],
    "geometry": {"capsules": 0.04},
}


def test_every_field_of_a_table_comes_back(client: httpx.Client) -> None:
    dh = store(client, "exchanged", TABLE)["dh"]
    for told, given in zip(dh["rows"], TABLE["rows"], strict=True):
        assert told == given
    np.testing.assert_allclose(dh["base"]["quaternion_xyzw"], TURN, atol=1e-15)
    assert dh["base"]["position"] == TABLE["base"]["position"]
    assert dh["tool"] == TABLE["tool"]
    assert {name: dh[name] for name in ("convention", "gravity", "geometry")} == {
        name: TABLE[name] for name in ("convention", "gravity", "geometry")
    }


@pytest.mark.parametrize("name", ["panda", "ur5e", "puma560", "stanford", "cart_pendulum"])
def test_a_robot_stored_from_its_table_is_the_same_robot(client: httpx.Client, name: str) -> None:
    model = answer(client.get(f"/v1/robots/{name}"))
    copy = store(client, f"{name}_table", model["dh"])
    assert copy["joint_types"] == model["joint_types"]
    assert copy["limits"] == model["limits"]
    n = len(model["joint_names"])
    rng = np.random.default_rng(3)
    q, qd, qdd = rng.uniform(-1.0, 1.0, (3, 5, n)).tolist()
    state = {"joints": q, "velocities": qd, "accelerations": qdd}
    poses, terms = [], []
    for robot in (name, f"{name}_table"):
        fk = answer(client.post(f"/v1/robots/{robot}/fk", json={
            "joints": q, "orientation": "rotation_matrix"}))  # fmt: skip
        poses.append([[pose["position"], *pose["rotation_matrix"]] for pose in fk["pose"]])
        terms.append(answer(client.post(f"/v1/robots/{robot}/dynamics", json=state)))
    np.testing.assert_allclose(poses[1], poses[0], rtol=0, atol=1e-12)
    for field in ("mass_matrix", "coriolis_matrix", "gravity", "torques"):
        scale = np.abs(terms[0][field]).max()
        np.testing.assert_allclose(terms[1][field], terms[0][field], rtol=0, atol=1e-12 * scale)
    again = store(client, f"{name}_again", copy["dh"])
    assert again["dh"]["rows"] == copy["dh"]["rows"]


def test_solids_of_a_table_are_in_its_urdf(client: httpx.Client) -> None:
    rows = [ROW | {"beta": 0.0, "geometry": [
        {"shape": {"type": "cylinder", "radius": 0.05, "height": 0.2}},
        {"shape": {"type": "sphere", "radius": 0.06},
         "pose": {"position": [0.1, 0.0, 0.0], "rpy": [0.1, 0.2, 0.3]}},
        {"shape": {"type": "box", "size": [0.1, 0.1, 0.1]}},
    ]}]  # fmt: skip
    dh = {"convention": "standard", "rows": rows, "geometry": {"capsules": 0.04}}
    store(client, "solid_table", dh)
    text = client.get("/v1/robots/solid_table/urdf").text
    assert "a solid of link_1 is left out" in text
    assert "motor inertias at the joints: 0.1" in text
    assert "gravity in the base frame" in text
    without = {**dh, "rows": [rows[0] | {"geometry": rows[0]["geometry"][:2]}]}
    store(client, "round_table", without)
    copy = client.get("/v1/robots/round_table/urdf").text
    answer(client.post("/v1/robots", json={"name": "round_copy", "urdf": copy}), 201)
    ball = solid("ball", "sphere", [0.7, 0.3, 0.5], radius=0.1)
    checks = [
        answer(client.post("/v1/check", json={
            "robot": robot, "joints": [[0.3], [-1.0]], "scene": {"obstacles": [ball]}}))
        for robot in ("round_table", "round_copy")
    ]  # fmt: skip
    np.testing.assert_allclose(checks[1]["clearance"], checks[0]["clearance"], atol=1e-9)


LINK = {
    "type": "revolute", "a": 0.5, "alpha": 0.0, "d": 0.0, "theta": 0.0,
    "lower": -3.0, "upper": 3.0, "velocity": 2.0, "acceleration": 5.0, "jerk": 50.0,
}  # fmt: skip
BALL = solid("ball", "sphere", [0.9, 0.0, 0.0], radius=0.1)
START, GOAL = [-0.8, 0.0], [0.8, 0.0]


def table(**more: Any) -> dict[str, Any]:
    return {"convention": "standard", "rows": [LINK, LINK]} | more


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
