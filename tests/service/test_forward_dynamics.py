"""Forward dynamics, Christoffel symbols and partial Jacobians over HTTP."""

from typing import Any

import httpx
import numpy as np
import pinocchio as pin
import pytest

from kinematics.robots import builtin_chain
from tests.dynamics.samples import pinocchio_model
from tests.service.robots import HOME, answer

URL = "/v1/robots/panda/forward-dynamics"
RATES = [0.1, -0.2, 0.3, 0.1, 0.0, -0.1, 0.2]
TORQUES = [1.0, -20.0, 3.0, 15.0, 0.5, 1.0, -0.2]


@pytest.mark.parametrize("count", [1, 40])
def test_accelerations_are_those_of_pinocchio(client: httpx.Client, count: int) -> None:
    chain = builtin_chain("panda")
    model = pinocchio_model(chain)
    model.armature, model.damping = chain.motor_inertia.copy(), np.zeros(7)
    q, qd, torque = np.random.default_rng(count).uniform(-1, 1, (3, count, 7))
    body = {"joints": q.tolist(), "velocities": qd.tolist(), "torques": torque.tolist()}
    found = answer(client.post(URL, json=body))["accelerations"]
    for k, row in enumerate(found):
        pushed = torque[k] - chain.viscous_friction * qd[k]
        expected = pin.aba(model, model.createData(), q[k], qd[k], pushed)
        np.testing.assert_allclose(row, expected, rtol=1e-9, atol=1e-9)


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


def test_what_is_left_out_is_zero(client: httpx.Client) -> None:
    falling = answer(client.post(URL, json={"joints": HOME}))["accelerations"]
    zeros = {"joints": HOME, "velocities": [0.0] * 7, "torques": [0.0] * 7}
    assert falling == answer(client.post(URL, json=zeros))["accelerations"]
    assert np.abs(falling).max() > 1.0


def test_christoffel_symbols_and_partial_jacobians_are_answered_on_request(
    client: httpx.Client,
) -> None:
    body: dict[str, Any] = {"joints": HOME, "velocities": RATES}
    plain = answer(client.post("/v1/robots/panda/dynamics", json=body))
    assert plain["christoffel_symbols"] is None
    assert plain["partial_jacobians"] is None
    body |= {"christoffel_symbols": True, "partial_jacobians": True}
    one = answer(client.post("/v1/robots/panda/dynamics", json=body))
    C = np.einsum("ijk,i->kj", one["christoffel_symbols"], RATES)
    np.testing.assert_allclose(C, plain["coriolis_matrix"], atol=1e-12)
    names = [row["joint"] for row in one["partial_jacobians"]]
    assert names == list(builtin_chain("panda").joint_names)
    body |= {"joints": [HOME] * 2, "velocities": [RATES] * 2}
    many = answer(client.post("/v1/robots/panda/dynamics", json=body))
    assert np.shape(many["christoffel_symbols"]) == (2, 7, 7, 7)
    for first, both in zip(one["partial_jacobians"], many["partial_jacobians"], strict=True):
        np.testing.assert_array_equal(both["linear"][1], first["linear"])
        np.testing.assert_array_equal(both["angular"][0], first["angular"])
