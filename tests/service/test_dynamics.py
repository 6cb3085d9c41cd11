"""Dynamics, formulas, Lyapunov functions and identification over HTTP."""

from typing import Any

import httpx
import numpy as np
import pytest

from armwright_wire.motions.simulation import SimulateAnswer
from armwright_wire.robots.dynamics import DynamicsAnswer, RegressorAnswer, WrenchAnswer
from dynamics.inverse import inverse_dynamics
from dynamics.model.payload import with_payload
from dynamics.terms import mass_matrix
from kinematics.calibration.calibrate import poses_of, with_corrections
from kinematics.forward import forward
from kinematics.robots import builtin_chain, builtin_srdf, builtin_urdf
from tests.dynamics.identification.logs import exciting, real_arm
from tests.kinematics.calibration.test_maker_file import FILE
from tests.service.poses import matrix
from tests.service.robots import HOME, POST, answer, bench, problem, scene

RATES = [0.1, -0.2, 0.3, 0.1, 0.0, -0.1, 0.2]
MOTION = {
    "segments": [
        {"t0": 1.0, "t1": 2.0, "coefficients": [[0, 0, 0, 10, -15, 6], [0.5, 0, 0, -10, 15, -6]]}
    ]
}


def simulate(client: httpx.Client, **changes: Any) -> dict[str, Any]:
    body = {
        "robot": "planar_rr",
        "trajectory": MOTION,
        "controller": {"type": "computed_torque", "Kp": 100.0, "Kd": [20.0, 20.0]},
        **changes,
    }
    found = answer(client.post("/v1/simulate", json=body))
    SimulateAnswer.model_validate(found)
    return found


@pytest.mark.parametrize("count", [1, 3, 50])
def test_one_and_many_states(client: httpx.Client, count: int) -> None:
    chain = builtin_chain("panda")
    rng = np.random.default_rng(count)
    q, qd, qdd = rng.uniform(-1, 1, (3, count, 7))
    body = {"joints": q.tolist(), "velocities": qd.tolist(), "accelerations": qdd.tolist()}
    many = answer(client.post("/v1/robots/panda/dynamics", json=body))
    DynamicsAnswer.model_validate(many)
    assert np.shape(many["mass_matrix"]) == (count, 7, 7)
    np.testing.assert_allclose(many["torques"], inverse_dynamics(chain, q, qd, qdd), atol=1e-11)
    one = {name: rows[0] for name, rows in body.items()}
    single = answer(client.post("/v1/robots/panda/dynamics", json=one))
    np.testing.assert_allclose(single["mass_matrix"], mass_matrix(chain, q[0]), rtol=1e-12)
    np.testing.assert_array_equal(single["torques"], many["torques"][0])
    found = answer(client.post("/v1/robots/panda/regressor", json=body))
    RegressorAnswer.model_validate(found)
    np.testing.assert_allclose(found["torques"], many["torques"], atol=1e-10)
    beta = [parameter["value"] for parameter in found["base_parameters"]]
    assert len(beta) == 43
    np.testing.assert_allclose(np.array(found["base_regressor"]) @ beta, many["torques"], atol=1e-9)
    held = {"joints": q.tolist(), "wrench": np.ones((count, 6)).tolist()}
    WrenchAnswer.model_validate(answer(client.post("/v1/robots/panda/wrench", json=held)))


def test_motors_and_friction_count(client: httpx.Client) -> None:
    body = {
        "joints": HOME,
        "velocities": RATES,
        "accelerations": RATES,
        "motor_inertia": 0.5,
        "viscous_friction": [1.0] * 7,
    }
    with_motors = answer(client.post("/v1/robots/panda/dynamics", json=body))
    bare = {name: body[name] for name in ("joints", "velocities", "accelerations")}
    without = answer(client.post("/v1/robots/panda/dynamics", json=bare))
    more = np.subtract(with_motors["torques"], without["torques"])
    np.testing.assert_allclose(more, 1.5 * np.array(RATES), atol=1e-11)
    assert with_motors["mass_matrix"] == without["mass_matrix"]
    found = answer(client.post("/v1/robots/panda/regressor", json=body))
    assert len(found["parameters"]) == 84
    assert found["parameter_names"][-1] == "B7"
    np.testing.assert_allclose(found["torques"], with_motors["torques"], atol=1e-10)


def test_a_robot_without_inertias_is_told_which(client: httpx.Client) -> None:
    answer(client.post("/v1/robots", json=bench("weightless")), 201)
    state = {"joints": [0.1, 0.2], "velocities": [0, 0], "accelerations": [0, 0]}
    controller = {"type": "computed_torque", "natural_frequency": 5.0}
    for path, body in (
        ("/v1/robots/weightless/dynamics", state),
        ("/v1/robots/weightless/regressor", state),
        ("/v1/robots/weightless/forward-dynamics", {"joints": [0.1, 0.2]}),
        (
            "/v1/simulate",
            {"robot": "weightless", "trajectory": MOTION, "controller": controller},
        ),
    ):
        found = problem(client.post(path, json=body), 422, "MISSING_INERTIA")
        assert found["details"]["links"] == ["lower", "upper", "tip"]
        assert "'shoulder', 'elbow'" in found["detail"]
    # Statics need none.
    answer(
        client.post("/v1/robots/weightless/wrench", json={"joints": [0, 0], "wrench": [1.0] * 6})
    )


def test_an_exact_model_tracks_exactly(client: httpx.Client) -> None:
    found = simulate(client)
    assert found["outcome"] == "completed"
    assert found["max_tracking_error"] < 1e-6
    assert found["settled"]
    assert found["time"][0] == 1.0
    assert found["time"][-1] == 2.0
    assert found["tube"] is None
    assert found["controller"]["gains"]["Kp"] == [100.0, 100.0]
    with_offset = simulate(client, initial_state={"offset": [0.1, 0.0]}, duration=2.0)
    t = np.array(with_offset["time"]) - 1.0
    expected = -0.1 * (1.0 + 10.0 * t) * np.exp(-10.0 * t)
    np.testing.assert_allclose(np.array(with_offset["tracking_error"])[:, 0], expected, atol=1e-6)


def test_a_disturbance_acts_in_the_time_of_the_trajectory(client: httpx.Client) -> None:
    """The motion lasts from 1 s to 2 s, the push from 1.3 s to 1.5 s."""
    push = {"torque": [3.0, 0.0], "start": 1.3, "end": 1.5}
    found = simulate(client, disturbance=push)
    error = np.abs(found["tracking_error"]).max(axis=1)
    time = np.array(found["time"])
    assert error[time < 1.3].max() < 1e-6
    assert error[(time > 1.35) & (time < 1.5)].min() > 1e-3
    early = simulate(client, disturbance={"torque": [3.0, 0.0], "end": 1.01})
    assert np.abs(early["tracking_error"][2]).max() > 1e-6


URL = "/v1/robots/panda/forward-dynamics"
TORQUES = [1.0, -20.0, 3.0, 15.0, 0.5, 1.0, -0.2]


def test_forward_and_inverse_dynamics_agree_with_motors_payload_and_wrench(
    client: httpx.Client,
) -> None:
    model: dict[str, Any] = {
        "joints": HOME, "velocities": RATES, "wrench": [1.0, 2.0, -3.0, 0.1, 0.2, 0.3],
        "payload": {"mass": 1.5}, "motor_inertia": 0.2, "viscous_friction": 0.7,
    }  # fmt: skip
    found = answer(client.post(URL, json=model | {"torques": TORQUES}))["accelerations"]
    back = client.post("/v1/robots/panda/dynamics", json=model | {"accelerations": found})
    np.testing.assert_allclose(answer(back)["torques"], TORQUES, atol=1e-9)


#: Four skew axes with offsets everywhere: half a second of algebra and more.
ROWS: list[dict[str, Any]] = [
    {"type": "revolute", "a": 0.3 + 0.01 * i, "alpha": (np.pi / 2.0, 0.0)[i % 2],
     "d": 0.1 + 0.02 * i, "theta": 0.1 * i, "mass": 1.0 + i, "center_of_mass": [0.1, 0.02, 0.03],
     "inertia": [[0.11, 0.01, 0.01], [0.01, 0.21, 0.01], [0.01, 0.01, 0.31]]}
    for i in range(4)
]  # fmt: skip
EQUATIONS_URL = "/v1/robots/slow_arm/equations"


def test_the_formulas_of_a_slow_arm_are_there_within_the_deadline_or_not_at_all(
    client: httpx.Client,
) -> None:
    body = {"name": "slow_arm", "dh": {"convention": "standard", "rows": ROWS}}
    answer(client.post("/v1/robots", json=body), 201)
    document = problem(client.get(EQUATIONS_URL, params={"timeout": 0.1}), 504, "TIMED_OUT")
    assert document["hint"]
    formulas = answer(client.get(EQUATIONS_URL, headers={"Prefer": "respond-async"}))
    assert len(formulas["dynamics"]["mass_matrix"]) == 4
    assert answer(client.get(EQUATIONS_URL, params={"timeout": 60.0})) == formulas


def test_deadlines_out_of_range_are_refused(client: httpx.Client) -> None:
    where = "/v1/robots/planar_rr/equations"
    for timeout in ("0", "nan", "1e6", "soon"):
        document = problem(client.get(where, params={"timeout": timeout}), 422, "VALIDATION_ERROR")
        assert "timeout" in document["detail"]
    document = problem(client.get(where, params={"timeout": 400.0}), 422, "VALIDATION_ERROR")
    assert "longer than the 300 s allowed here" in document["detail"]


def test_the_determinant_of_named_rows_is_that_of_the_jacobian(client: httpx.Client) -> None:
    where = "/v1/robots/planar_rr/equations"
    found = answer(client.get(where, params={"format": "text", "axes": "x,z"}))
    assert found["determinant"] == "l_1 * l_2 * s_2"
    assert "det_J = l_1 * l_2 * s_2" in found["document"]
    assert answer(client.get(where))["determinant"] is None
    wrong = problem(client.get(where, params={"axes": "x,y,z"}), 422, "VALIDATION_ERROR")
    assert "as many rows of the Jacobian as there are joints, 2" in wrong["detail"]
    problem(client.get(where, params={"axes": "x,up"}), 422, "VALIDATION_ERROR")


def test_query_parameters_that_a_get_does_not_take_are_refused(client: httpx.Client) -> None:
    for where in ("/v1/robots/planar_rr/equations", "/v1/robots/planar_rr", "/v1/jobs"):
        document = problem(client.get(where, params={"axis": "x,y"}), 422, "VALIDATION_ERROR")
        assert "axis: unknown query parameter" in document["detail"]
    assert client.get("/healthz", params={"verbose": "1"}).status_code == 200


SPRING = [[0.0, 1.0], [-1.0, -1.0]]


def test_a_form_is_examined(client: httpx.Client) -> None:
    body = {"A": SPRING, "P": [[1.0, 0.5], [0.5, 1.0]], "x": [[0.5, 0.0], [0.0, 1.0]]}
    found = answer(client.post("/v1/lyapunov", json=body))
    assert (found["V"], found["V_dot"]) == ("x1² + x1 x2 + x2²", "-x1² - x1 x2 - x2²")
    assert found["P"]["minors"] == pytest.approx([1.0, 0.75])
    assert found["Q"]["definiteness"] == "positive definite"
    assert found["verdict"] == "asymptotically_stable"
    assert found["values"] == pytest.approx([0.25, 1.0])
    assert found["rates"] == pytest.approx([-0.25, -1.0])
    assert found["notes"] == []
    assert found["poles"][0] == pytest.approx({"real": -0.5, "imaginary": -np.sqrt(0.75)})


def test_a_form_that_is_not_symmetric_is_told(client: httpx.Client) -> None:
    body = {"A": SPRING, "P": [[1.0, 1.0], [0.0, 1.0]], "x": [1.0, 1.0]}
    found = answer(client.post("/v1/lyapunov", json=body))
    assert found["P"]["matrix"] == [[1.0, 0.5], [0.5, 1.0]]
    assert found["values"] == pytest.approx(3.0)
    assert "not symmetric" in found["notes"][0]


def test_a_formula_is_examined(client: httpx.Client) -> None:
    body = {"f": ["x2", "-0.8*x2 - 4.9*sin(x1)"], "V": "x2**2/2 + 4.9*(1 - cos(x1))"}
    found = answer(client.post("/v1/lyapunov", json=body | {"x": [0.6, -0.4]}))
    assert (found["V_dot"], found["verdict"]) == ("-0.8*x2**2", "asymptotically_stable")
    assert "LaSalle" in found["reason"]
    assert found["lasalle"] == {"set": ["x2"], "invariant": ["sin(x1)"]}
    assert found["values"] == pytest.approx(0.08 + 4.9 * (1.0 - np.cos(0.6)))
    assert found["rates"] == pytest.approx(-0.128)
    many = answer(client.post("/v1/lyapunov", json=body | {"x": [[0.6, -0.4], [0.0, 0.0]]}))
    assert many["values"] == [found["values"], 0.0]


def test_a_pendulum_is_known_by_name(client: httpx.Client) -> None:
    body = {"system": "pendulum", "parameters": {"mass": 2.0, "length": 0.5, "damping": 0.4}}
    found = answer(client.post("/v1/lyapunov", json=body | {"x": [0.6, -0.4]}))
    assert found["f"] == ["x2", "-0.8*x2 - 19.62*sin(x1)"]
    energy = 2.0 * (0.5 * 0.4) ** 2 / 2.0 + 2.0 * 9.81 * 0.5 * (1.0 - np.cos(0.6))
    assert found["values"] == pytest.approx(energy)
    assert found["rates"] == pytest.approx(-0.4 * 0.4**2)
    assert "LaSalle" in found["reason"]


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
