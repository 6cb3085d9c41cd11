"""Equations of motion in process: models of requests, rows that fit, answers by pinocchio."""

import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from armwright_wire.robots.dynamics import (
    DynamicsAnswer,
    DynamicsRequest,
    ForwardDynamicsRequest,
    RegressorRequest,
    WrenchAnswer,
    WrenchRequest,
)
from kinematics.errors import InvalidLinkName, InvalidOption, InvalidRobotState
from kinematics.robots import builtin_chain, builtin_urdf
from service.endpoints.dynamics.task import dynamics, forward_dynamics, model, regressor, wrench
from tests.dynamics.samples import pinocchio_model

CHAIN = builtin_chain("panda")
ROWS = np.random.default_rng(2).uniform(-1.0, 1.0, (3, 3, 7))
Q, QD, QDD = ROWS


def asked(q: Any, **fields: Any) -> dict[str, Any]:
    body = DynamicsRequest.model_validate({"joints": np.asarray(q).tolist()} | fields)
    answer: dict[str, Any] = json.loads(dynamics(CHAIN, body))
    DynamicsAnswer.model_validate(answer)
    return answer


@pytest.mark.parametrize("row", range(3))
def test_the_equations_are_those_of_pinocchio(row: int) -> None:
    arm = pinocchio_model(CHAIN)
    arm.armature[:] = 0.0
    data = arm.createData()
    q, qd, qdd = Q[row], QD[row], QDD[row]
    answer = asked(q, velocities=qd.tolist(), accelerations=qdd.tolist())
    J, B = np.array(answer["motor_inertia"]), np.array(answer["viscous_friction"])
    expected = pin.rnea(arm, data, q, qd, qdd) + J * qdd + B * qd
    np.testing.assert_allclose(answer["torques"], expected, rtol=1e-8, atol=1e-8)
    M = np.triu(pin.crba(arm, data, q))
    np.testing.assert_allclose(answer["mass_matrix"], M + np.triu(M, 1).T, rtol=1e-8, atol=1e-9)
    gravity = pin.computeGeneralizedGravity(arm, data, q)
    np.testing.assert_allclose(answer["gravity"], gravity, rtol=1e-8, atol=1e-9)
    still = asked(q)
    np.testing.assert_allclose(still["torques"], gravity, rtol=1e-8, atol=1e-9)
    assert still["kinetic_energy"] == 0.0
    energy = pin.computeKineticEnergy(arm, data, q, qd) + 0.5 * J @ qd**2
    assert answer["kinetic_energy"] == pytest.approx(energy)


def test_many_states_are_answered_as_each_alone() -> None:
    together = asked(Q, velocities=QD.tolist(), accelerations=QDD.tolist())
    for i in range(3):
        alone = asked(Q[i], velocities=QD[i].tolist(), accelerations=QDD[i].tolist())
        for name in ("mass_matrix", "coriolis_matrix", "gravity", "torques", "kinetic_energy"):
            np.testing.assert_allclose(together[name][i], alone[name], rtol=1e-12, atol=1e-12)


def test_a_request_may_change_gravity_motors_and_payload() -> None:
    body = DynamicsRequest.model_validate({"joints": [0.0] * 7})
    assert model(CHAIN, body) is CHAIN
    floating = asked(Q[0], gravity=[0.0, 0.0, 0.0])
    np.testing.assert_allclose(floating["gravity"], 0.0, atol=1e-12)
    driven = asked(Q[0], motor_inertia=0.5, viscous_friction=[0.1] * 7)
    assert driven["motor_inertia"] == [0.5] * 7
    assert driven["viscous_friction"] == [0.1] * 7
    only_friction = asked(Q[0], viscous_friction=0.2)
    assert only_friction["motor_inertia"] == CHAIN.motor_inertia.tolist()
    assert only_friction["viscous_friction"] == [0.2] * 7
    heavier = asked(Q[0], payload={"mass": 5.0})
    assert np.trace(heavier["mass_matrix"]) > np.trace(asked(Q[0])["mass_matrix"]) + 0.1


def test_a_wrench_is_held_by_the_transposed_jacobian() -> None:
    F = [1.0, 2.0, 3.0, 0.1, 0.2, 0.3]
    body = WrenchRequest.model_validate({"joints": Q[0].tolist(), "wrench": F})
    answer = json.loads(wrench(CHAIN, body))
    WrenchAnswer.model_validate(answer)
    more = np.array(asked(Q[0], wrench=F)["torques"]) - asked(Q[0])["torques"]
    np.testing.assert_allclose(answer["torques"], more, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(
    ("joints", "wrenches", "fits"),
    [(Q[0], [0.0] * 6, True), (Q, [0.0] * 6, True), (Q, [[0.0] * 6] * 3, True),
     (Q, [[0.0] * 6] * 2, False), (Q[0], [[0.0] * 6], False), (Q[:1], [[0.0] * 6], True)],
)  # fmt: skip
def test_a_wrench_is_one_for_all_or_one_each(joints: Any, wrenches: Any, fits: bool) -> None:
    fields = {"joints": joints.tolist(), "wrench": wrenches}
    asks: list[Callable[[], bytes]] = [
        lambda: wrench(CHAIN, WrenchRequest.model_validate(fields)),
        lambda: dynamics(CHAIN, DynamicsRequest.model_validate(fields)),
    ]
    for ask in asks:
        if fits:
            ask()
        else:
            with pytest.raises(InvalidRobotState, match="do not fit"):
                ask()


def test_a_regressor_reproduces_the_torques_in_both_forms() -> None:
    fields = {"joints": Q[0].tolist(), "velocities": QD[0].tolist(),
              "accelerations": QDD[0].tolist()}  # fmt: skip
    for motors in ({}, {"viscous_friction": 0.3}):
        body = RegressorRequest.model_validate(fields | motors)
        answer = json.loads(regressor(CHAIN, body))
        Y, Theta = np.array(answer["regressor"]), np.array(answer["parameters"])
        expected = asked(Q[0], velocities=QD[0].tolist(), accelerations=QDD[0].tolist(), **motors)
        np.testing.assert_allclose(Y @ Theta, expected["torques"], rtol=1e-8, atol=1e-8)
        beta = [item["value"] for item in answer["base_parameters"]]
        base = np.array(answer["base_regressor"]) @ beta
        np.testing.assert_allclose(base, expected["torques"], rtol=1e-6, atol=1e-6)
        assert len(answer["parameter_names"]) == len(Theta)
        for item in answer["base_parameters"]:
            column = np.array(answer["base_regressor"])[:, answer["base_parameters"].index(item)]
            np.testing.assert_array_equal(column, Y[:, item["column"]])


def tip(q: Any) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """R_root_tool and the tip's Jacobian, by pinocchio."""
    arm = pin.buildModelFromXML(builtin_urdf("panda"))
    data, frame = arm.createData(), arm.getFrameId(CHAIN.tip_link)
    full = np.concatenate([q, np.zeros(arm.nq - 7)])
    J = pin.computeFrameJacobian(arm, data, full, frame, pin.LOCAL_WORLD_ALIGNED)
    pin.framesForwardKinematics(arm, data, full)
    return np.array(data.oMf[frame].rotation), J[:, :7]


def test_wrenches_and_gravity_are_meant_along_the_axes_of_the_frame() -> None:
    F, g = np.array([1.0, -2.0, 3.0, 0.1, 0.2, -0.3]), np.array([1.0, 2.0, -9.0])
    R, _ = tip(Q[0])
    turned = np.concatenate([R @ F[:3], R @ F[3:]]).tolist()
    there = asked(Q[0], wrench=F.tolist(), gravity=g.tolist(), frame="tool", partial_jacobians=True)
    here = asked(Q[0], wrench=turned, gravity=(R @ g).tolist(), partial_jacobians=True)
    assert (there["frame"], here["frame"]) == ("tool", CHAIN.root_link)
    for name in ("torques", "gravity", "potential_energy"):
        np.testing.assert_allclose(there[name], here[name], rtol=1e-9, atol=1e-9)
    for seen, body in zip(there["partial_jacobians"], here["partial_jacobians"], strict=True):
        for part in ("linear", "angular"):
            np.testing.assert_allclose(R @ seen[part], body[part], atol=1e-12)
    state = {"joints": Q[0].tolist(), "velocities": QD[0].tolist(), "torques": QDD[0].tolist()}
    ways = ({"wrench": F.tolist(), "frame": "tool"}, {"wrench": turned})
    moved = [
        json.loads(forward_dynamics(CHAIN, ForwardDynamicsRequest.model_validate(state | way)))
        for way in ways
    ]
    np.testing.assert_allclose(moved[0]["accelerations"], moved[1]["accelerations"], rtol=1e-9)
    assert moved[0]["frame"] == "tool"


def test_a_wrench_in_the_tools_frame_is_another_one_at_each_configuration() -> None:
    F = [1.0, -2.0, 3.0, 0.1, 0.2, -0.3]
    fields: dict[str, Any] = {"joints": Q.tolist(), "wrench": F, "frame": "tool"}
    told = json.loads(wrench(CHAIN, WrenchRequest.model_validate(fields)))
    WrenchAnswer.model_validate(told)
    for q, torques in zip(Q, told["torques"], strict=True):
        R, J = tip(q)
        turned = np.concatenate([R @ F[:3], R @ F[3:]])
        np.testing.assert_allclose(torques, J.T @ turned, atol=1e-9)
    with pytest.raises(InvalidOption, match="gravity in the frame of the tool"):
        asked(Q, gravity=[0.0, 0.0, -9.81], frame="tool")
    with pytest.raises(InvalidLinkName, match="moves with the arm"):
        asked(Q[0], frame="panda_link4")
