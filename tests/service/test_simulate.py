"""References by name, chosen parameters, stops and refusals of `simulate` over HTTP."""

from typing import Any

import httpx
import numpy as np
import pytest

from tests.service.robots import answer

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
