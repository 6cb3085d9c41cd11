"""Identification over HTTP: bodies and loads from logs, stored as a robot's own."""

from typing import Any

import httpx
import numpy as np

from dynamics.inverse import inverse_dynamics
from dynamics.model.payload import with_payload
from kinematics.calibration.calibrate import poses_of, with_corrections
from kinematics.forward import forward
from kinematics.robots import builtin_chain, builtin_srdf, builtin_urdf
from tests.dynamics.identification.logs import exciting, real_arm
from tests.kinematics.calibration.test_maker_file import FILE
from tests.service.poses import matrix
from tests.service.robots import POST, answer, problem, scene

CHAIN = builtin_chain("ur5e")
ROBOT = {"urdf": builtin_urdf("ur5e"), "srdf": builtin_srdf("ur5e")}


def test_found_bodies_are_stored_with_their_origin(client: httpx.Client) -> None:
    truth = real_arm(CHAIN, 2)
    _, q, qd, qdd = exciting(CHAIN, 2, 0.02)
    rng = np.random.default_rng(0)
    gains = np.array([100.0, 100.0, 80.0, 20.0, 20.0, 20.0])
    tau = truth.torques(q, qd, qdd) + 0.05 * rng.standard_normal(q.shape)
    log = {"positions": q.tolist(), "velocities": qd.tolist(), "accelerations": qdd.tolist(),
           "currents": (tau / gains).tolist(), "gains": gains.tolist(), "period": 0.02}  # fmt: skip
    found = answer(client.post("/v1/robots/ur5e/identify", json={"logs": [log]}))
    assert len(found["parameters"]) == 58
    assert not found["not_excited"]
    assert all(row["residual"] < 0.06 < row["torque"] for row in found["joints"])
    document = ROBOT | {"name": "my_ur5e"}
    answer(client.post("/v1/robots", json=document), 201)
    changed = answer(client.patch("/v1/robots/my_ur5e", json={"inertias": found["inertias"]}))
    assert changed["inertias"] == found["inertias"]
    assert any("inertias: identified from 1 log" in line for line in changed["lint"])
    state = {"joints": q[::100].tolist(), "velocities": qd[::100].tolist(),
             "accelerations": qdd[::100].tolist()}  # fmt: skip
    torques = answer(client.post("/v1/robots/my_ur5e/dynamics", json=state))["torques"]
    rest = np.array(torques) + [row["offset"] for row in found["joints"]]
    assert np.abs(rest - truth.torques(q[::100], qd[::100], qdd[::100])).max() < 0.1
    kept = answer(client.get("/v1/robots/my_ur5e"))
    again = answer(client.post("/v1/robots", json=document | {
        "name": "other_ur5e", "inertias": kept["inertias"]}), 201)  # fmt: skip
    assert again["inertias"] == kept["inertias"]


def test_a_found_load_is_taken_by_other_requests(client: httpx.Client) -> None:
    loaded = with_payload(CHAIN, 3.0, [0.01, 0.02, 0.05])
    q = np.random.default_rng(1).uniform(-2.0, 2.0, (6, 6))
    log: dict[str, Any] = {
        "positions": q.tolist(),
        "torques": inverse_dynamics(loaded, q, 0.0 * q, 0.0 * q).tolist(),
    }
    asked = {"logs": [log], "find": "payload"}
    found = answer(client.post("/v1/robots/ur5e/identify", json=asked))
    payload = found["payload"]
    np.testing.assert_allclose(payload["mass"], 3.0, rtol=1e-6)
    np.testing.assert_allclose(payload["center_of_mass"], [0.01, 0.02, 0.05], atol=1e-6)
    assert sorted(line[:3] for line in found["not_excited"]) == [
        "Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz"
    ]  # fmt: skip
    torques = answer(
        client.post("/v1/robots/ur5e/dynamics", json={"joints": q.tolist(), "payload": payload})
    )["torques"]
    np.testing.assert_allclose(torques, log["torques"], atol=1e-4)


def test_an_exciting_motion_is_certified_and_can_be_validated(client: httpx.Client) -> None:
    start = [1.8, -1.4, 1.5, -1.6, -1.5, 0.2]
    asked = {"start": start, "scene": scene(POST), "evaluations": 50, "sample_period": 0.5}
    found = answer(client.post("/v1/robots/ur5e/excitation", json=asked))
    assert found["certificate"]["verified"]
    assert found["certificate"]["proved"]["collisions"]
    assert len(found["base_parameters"]) == 58
    assert found["condition"] < 30.0
    assert found["trajectory"]["samples"]["position"][0] == start
    motion = {name: found["trajectory"][name] for name in ("joint_names", "segments")}
    body = {"robot": "ur5e", "scene": scene(POST), "trajectory": motion}
    assert answer(client.post("/v1/validate", json=body))["verified"]
    hit = asked | {"scene": scene(POST | {"pose": {"position": [0.0, 0.0, 0.6]}})}
    problem(client.post("/v1/robots/ur5e/excitation", json=hit), 422, "START_STATE_INVALID")
    late = asked | {"evaluations": 100_000, "timeout": 0.001}
    problem(client.post("/v1/robots/ur5e/excitation", json=late), 504, "TIMED_OUT")


def test_a_calibration_is_stored_and_a_second_one_stands_behind_it(client: httpx.Client) -> None:
    rng = np.random.default_rng(0)
    names = CHAIN.joint_names
    made = poses_of(1e-3 * rng.standard_normal((6, 6)))
    truth = with_corrections(CHAIN, dict(zip(names, made, strict=True)))
    q = rng.uniform(-2.0, 2.0, (60, 6))
    T = forward(truth, q)
    points = (T[:, :3, 3] + 5e-5 * rng.standard_normal((60, 3))).tolist()
    answer(client.post("/v1/robots", json=ROBOT | {"name": "made_ur5e"}), 201)
    where = "/v1/robots/made_ur5e"
    asked = {"joints": q.tolist(), "positions": points}
    found = answer(client.post(f"{where}/calibrate", json=asked))
    assert found["error_after"] < 1e-4
    assert found["error_before"] > 1e-3
    assert len(found["corrections"]) == 42
    assert found["identifiable"] > 25
    worst = max(found["margins"], key=lambda row: row["calibrated"])
    assert 1e-4 < worst["calibrated"] < worst["described"] < 0.05
    changed = answer(client.patch(where, json={"calibration": found["calibration"]}))
    assert any("calibration: measured in 60" in line for line in changed["lint"])
    fk = answer(client.post(f"{where}/fk", json={"joints": q.tolist()}))["pose"]
    tip = matrix(found["tip"])
    at = np.array([(matrix(pose) @ tip)[:3, 3] for pose in fk])
    assert np.sqrt(np.mean((at - T[:, :3, 3]) ** 2)) < 1e-4
    again = answer(client.post(f"{where}/calibrate", json=asked))
    assert again["error_before"] < 2e-3
    joint = "elbow_joint"
    first, second = (one["calibration"]["joints"][joint] for one in (found, again))
    assert np.abs(matrix(first) - matrix(second)).max() < 1e-3
    refused = problem(client.patch(where, json={"calibration": "kinematics: {}"}), 422,
                      "INVALID_ROBOT_DESCRIPTION")  # fmt: skip
    assert "no kinematics" in refused["detail"]
    filed = answer(client.patch(where, json={"calibration": FILE}))
    assert filed["calibration"] == FILE
    third = answer(client.post(f"{where}/calibrate", json=asked))["calibration"]
    assert third["file"] == FILE
    answer(client.patch(where, json={"calibration": third}))
    fk = answer(client.post(f"{where}/fk", json={"joints": q.tolist()}))["pose"]
    assert np.abs(np.array([pose["position"] for pose in fk]) - points).max() < 0.01
