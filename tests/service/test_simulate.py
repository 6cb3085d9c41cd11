"""References, stops and notes of `simulate` over HTTP, and loops that motors of robots drive."""

import json
from typing import Any

import httpx
import numpy as np
import pytest

from kinematics.robots import builtin_urdf
from tests.service.robots import answer, problem
from tests.service.test_robots import archive

PLANAR = {"robot": "planar_rr", "saturate": False}
TORQUE = {"type": "computed_torque", "natural_frequency": 10.0}
HOLD = {"type": "hold", "joints": [0.3, -0.4], "duration": 0.5}


def simulate(client: httpx.Client, **fields: Any) -> dict[str, Any]:
    body = PLANAR | {"reference": HOLD, "controller": TORQUE} | fields
    return answer(client.post("/v1/simulate", json=body))


def test_a_step_starts_where_it_stands_before(client: httpx.Client) -> None:
    step = {"type": "step", "from": [0.1, 0.2], "to": [0.4, 0.0], "duration": 0.5}
    found = simulate(client, reference=step)
    assert found["position"][0] == [0.1, 0.2]
    assert found["reference"]["position"][0] == [0.4, 0.0]
    # The double pole at -10: e (1 + w t) exp(-w t).
    t = np.array(found["time"])
    expected = 0.3 * (1.0 + 10.0 * t) * np.exp(-10.0 * t)
    np.testing.assert_allclose(np.array(found["tracking_error"])[:, 0], expected, atol=1e-7)


def test_the_lecture_s_parameters_are_learned_by_name(client: httpx.Client) -> None:
    learner = {"type": "adaptive", "Lambda": 5.0, "K": 5.0, "Gamma": 2.0, "known_zeros": True}
    found = simulate(client, controller=learner)["controller"]
    assert len(found["parameter_names"]) == 4
    assert found["parameter_labels"][3] == "m2·lc2 [kg m]"
    assert found["parameter_units"] == ["kg m²", "kg m", "kg m²", "kg m"]
    one = simulate(client, controller=learner | {"parameters": ["mx2"], "estimate": [0.1]})
    assert one["controller"]["parameter_names"] == ["mx2"]
    assert one["estimate"][0] == [0.1]


def test_a_stop_holds_a_joint_and_is_told(client: httpx.Client) -> None:
    row = {"type": "revolute", "a": 1.0, "alpha": 0.0, "d": 0.0, "theta": 0.0, "lower": -0.5,
           "upper": 0.5, "mass": 1.0, "center_of_mass": [0.0, 0.0, 0.0],
           "inertia": [[0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]]}  # fmt: skip
    table = {"convention": "standard", "rows": [row], "gravity": [0.0, 0.0, -9.81]}
    client.post("/v1/robots", json={"name": "stopped", "dh": table})
    body = {"robot": "stopped", "saturate": False, "controller": {"type": "pd_gravity", "Kp": 50.0,
            "Kd": 20.0}, "reference": {"type": "hold", "joints": [1.5], "duration": 5.0},
            "initial_state": {"joints": [0.0]}}  # fmt: skip
    free = answer(client.post("/v1/simulate", json=body))
    assert free["position"][-1][0] == pytest.approx(1.5, abs=1e-3)
    assert "stops without joint_stops" in str(free["notes"])
    held = answer(client.post("/v1/simulate", json=body | {"joint_stops": {}}))
    # k_p (1.5 - q) = k (q - 0.5)
    assert held["position"][-1][0] == pytest.approx((75.0 + 5000.0) / 10050.0, abs=1e-6)
    assert "is pressed into its stop" in str(held["notes"])
    inside = body | {"joint_stops": {"stiffness": 1e5}, "initial_state": {"joints": [0.6]}}
    response = client.post("/v1/simulate", json=inside)
    assert response.status_code == 422
    assert "starts at 0.6, inside its stop" in response.text


def test_what_has_no_effect_is_said(client: httpx.Client) -> None:
    found = simulate(
        client,
        disturbance={"amplitude": 1.0},
        noise={"period": 0.01},
        control_period=0.01,
        allowed_collisions=[["link_1", "link_2"]],
    )
    for text in ("disturbance.amplitude", "noise.period", "allowed_collisions"):
        assert any(note.startswith(f"{text} has no effect") for note in found["notes"]), text
    alone = {"type": "independent_joint", "Kp": 10.0, "Kd": 5.0}
    found = simulate(
        client, controller=alone, model_error={"mass_scale": 1.1},
        disturbance={"frequency": 1.0, "torque": 0.5},
    )  # fmt: skip
    assert any("disturbance.frequency" in note for note in found["notes"])
    assert any("model_error: mass_scale does not enter" in note for note in found["notes"])


def test_a_rise_of_v_is_said(client: httpx.Client) -> None:
    push = {"disturbance": {"torque": [3.0, 0.0]}, "initial_state": {"offset": [0.01, 0.0]}}
    assert any(note.startswith("V grows from") for note in simulate(client, **push)["notes"])
    assert simulate(client, initial_state={"offset": [0.01, 0.0]})["notes"] == []


def test_dry_friction_of_a_request_is_the_robot_s(client: httpx.Client) -> None:
    state = {"joints": [0.3, 0.4], "velocities": [1.0, -1.0], "coulomb_friction": [0.5, 0.25]}
    rough = answer(client.post("/v1/robots/planar_rr/dynamics", json=state))
    smooth = answer(client.post("/v1/robots/planar_rr/dynamics", json=state | {
        "coulomb_friction": 0.0}))  # fmt: skip
    np.testing.assert_allclose(np.subtract(rough["torques"], smooth["torques"]), [0.5, -0.25])
    assert rough["coulomb_friction"] == [0.5, 0.25]
    longer = HOLD | {"duration": 1.5}
    exact = simulate(
        client, reference=longer, coulomb_friction=0.5, initial_state={"offset": [0.1, 0.0]}
    )
    blind = simulate(
        client, reference=longer, coulomb_friction=0.5, initial_state={"offset": [0.1, 0.0]},
        model_error={"coulomb_friction": 0.0},
    )  # fmt: skip
    assert exact["coulomb_friction"] == [0.5, 0.5]
    assert abs(exact["tracking_error"][-1][0]) < 0.3 * abs(blind["tracking_error"][-1][0])


MOTORS: list[dict[str, Any]] = [
    {"inertia": 1.2e-4, "friction": 2e-5, "torque_constant": 0.05, "back_emf": 0.002,
     "resistance": 0.5, "gear_ratio": 50.0, "voltage_limit": 5.0},
    {"inertia": 2e-4, "friction": 1e-4, "torque_constant": 0.04, "back_emf": 0.003,
     "resistance": 0.8, "gear_ratio": 30.0, "voltage_limit": 2.5},
]  # fmt: skip
ROW: dict[str, Any] = {
    "type": "revolute", "a": 0.5, "alpha": 0.0, "d": 0.0, "theta": 0.0, "lower": -3.0,
    "upper": 3.0, "velocity": 3.0, "acceleration": 20.0, "mass": 1.0,
    "center_of_mass": [-0.25, 0.0, 0.0],
    "inertia": [[1e-4, 0.0, 0.0], [0.0, 0.02, 0.0], [0.0, 0.0, 0.02]],
}  # fmt: skip
GRAVITY = [0.0, -9.81, 0.0]
STEP = {"type": "step", "from": [0.0, 0.0], "to": [0.4, -0.3], "duration": 0.5}
CONTROLLERS: dict[str, dict[str, Any]] = {
    "independent_joint": {"Kp": 90.0, "Kd": 25.0},
    "computed_torque": {"Kp": 90.0, "Kd": 25.0},
    "pd_gravity": {"Kp": 90.0, "Kd": 25.0},
    "passivity": {"Lambda": 5.0, "K": 9.0},
    "adaptive": {"Lambda": 5.0, "K": 9.0, "Gamma": 2.0},
}


def table(*motors: dict[str, Any]) -> dict[str, Any]:
    rows = [ROW | ({"motor": motor} if motor else {}) for motor in motors]
    return {"convention": "standard", "rows": rows, "gravity": GRAVITY}


def stored(client: httpx.Client, name: str, dh: dict[str, Any]) -> dict[str, Any]:
    """The robot of a table, which is stored by the first test that needs it."""
    present = client.get(f"/v1/robots/{name}")
    if present.status_code == 200:
        return answer(present)
    return answer(client.post("/v1/robots", json={"name": name, "dh": dh}), 201)


@pytest.fixture
def driven(client: httpx.Client) -> dict[str, Any]:
    """The answer of a robot that has motors; `undriven` is the same arm without."""
    stored(client, "undriven", table({}, {}))
    return stored(client, "driven", table(*MOTORS))


def driven_run(client: httpx.Client, robot: str, kind: str, **more: Any) -> dict[str, Any]:
    body = {"robot": robot, "reference": STEP, "controller": {"type": kind} | CONTROLLERS[kind],
            "sample_period": 0.05} | more  # fmt: skip
    return answer(client.post("/v1/simulate", json=body))


@pytest.mark.parametrize("kind", list(CONTROLLERS))
def test_the_robots_motors_drive_as_those_of_a_request(
    client: httpx.Client, driven: dict[str, Any], kind: str
) -> None:
    own = driven_run(client, driven["name"], kind)
    assert own == driven_run(client, "undriven", kind, motors=MOTORS)
    volts = [m["resistance"] / (m["gear_ratio"] * m["torque_constant"]) for m in MOTORS]
    np.testing.assert_allclose(own["voltage"], np.array(own["torque"]) * volts, rtol=1e-12)
    largest = np.abs(own["voltage"]).max(axis=0)
    assert largest[0] == pytest.approx(5.0)
    assert largest[1] <= 2.5 * (1.0 + 1e-12)
    assert any(own["saturated"])
    J = [m["gear_ratio"] ** 2 * m["inertia"] for m in MOTORS]
    assert own["motor_inertia"] == pytest.approx(J, rel=1e-14)


def test_motors_of_a_request_replace_the_robots(
    client: httpx.Client, driven: dict[str, Any]
) -> None:
    stronger = [motor | {"voltage_limit": 48.0, "gear_ratio": 20.0} for motor in MOTORS]
    asked = driven_run(client, driven["name"], "computed_torque", motors=stronger)
    assert asked == driven_run(client, "undriven", "computed_torque", motors=stronger)
    free = driven_run(client, driven["name"], "computed_torque", saturate=False)
    assert np.abs(free["voltage"]).max() > 5.0


def test_friction_of_a_request_replaces_that_of_the_robots_motors(
    client: httpx.Client, driven: dict[str, Any]
) -> None:
    bare = {"motor_inertia": 0.2, "viscous_friction": [0.5, 0.6]}
    own = driven_run(client, driven["name"], "computed_torque", **bare)
    assert (own["motor_inertia"], own["viscous_friction"]) == ([0.2, 0.2], [0.5, 0.6])
    assert np.abs(own["voltage"]).max() == pytest.approx(5.0)


def test_a_table_with_motors_comes_back_and_is_accepted_as_it_is(
    client: httpx.Client, driven: dict[str, Any]
) -> None:
    assert [row["motor"] for row in driven["dh"]["rows"]] == MOTORS
    assert driven["motors"] == dict(zip(("joint_1", "joint_2"), MOTORS, strict=True))
    body = {"name": "driven_again", "dh": driven["dh"]}
    again = answer(client.post("/v1/robots", json=body), 201)
    assert (again["dh"], again["motors"]) == (driven["dh"], driven["motors"])
    changed = answer(client.patch("/v1/robots/driven_again", json={
        "joint_limits": {"*": {"acceleration": 4.0}}}))  # fmt: skip
    assert changed["motors"] == driven["motors"]
    own = driven_run(client, "driven", "passivity")
    assert driven_run(client, "driven_again", "passivity") == own


def test_motors_beside_a_urdf_drive_it_and_its_table(client: httpx.Client) -> None:
    body = {"name": "driven_urdf", "urdf": builtin_urdf("planar_rr")}
    names = answer(client.get("/v1/robots/planar_rr"))["joint_names"]
    motors = dict(zip(names, MOTORS, strict=True))
    model = answer(client.post("/v1/robots", json=body | {"motors": motors}), 201)
    assert model["motors"] == motors
    assert [row["motor"] for row in model["dh"]["rows"]] == MOTORS
    own = driven_run(client, "driven_urdf", "computed_torque")
    asked = driven_run(client, "planar_rr", "computed_torque", motors=MOTORS)
    assert own == asked
    answer(client.post("/v1/robots", json={"name": "driven_table", "dh": model["dh"]}), 201)
    copy = driven_run(client, "driven_table", "computed_torque")
    np.testing.assert_allclose(copy["voltage"], own["voltage"], rtol=0, atol=1e-6)


def test_motors_beside_an_archive_are_a_field_of_its_form(client: httpx.Client) -> None:
    file = {"file": ("driven_archive.zip", archive({"arm.urdf": builtin_urdf("planar_rr")}))}
    form = {"motors": json.dumps({"*": MOTORS[0]})}
    model = answer(client.post("/v1/robots", files=file, data=form), 201)
    assert list(model["motors"].values()) == [MOTORS[0]] * 2
    document = problem(
        client.post("/v1/robots", files=file, data={"name": "x", "motors": '{"knee": {}}'}),
        422, "VALIDATION_ERROR",
    )  # fmt: skip
    assert "motors.knee.inertia" in document["detail"]
