"""Equations of motion in process: frames of wrenches and of gravity, by pinocchio."""

import json
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from armwright_wire.robots.dynamics import (
    DynamicsAnswer,
    DynamicsRequest,
    ForwardDynamicsRequest,
    WrenchAnswer,
    WrenchRequest,
)
from kinematics.errors import InvalidLinkName, InvalidOption
from kinematics.robots import builtin_chain, builtin_urdf
from service.endpoints.dynamics.task import dynamics, forward_dynamics, wrench

CHAIN = builtin_chain("panda")
ROWS = np.random.default_rng(2).uniform(-1.0, 1.0, (3, 3, 7))
Q, QD, QDD = ROWS


def asked(q: Any, **fields: Any) -> dict[str, Any]:
    body = DynamicsRequest.model_validate({"joints": np.asarray(q).tolist()} | fields)
    answer: dict[str, Any] = json.loads(dynamics(CHAIN, body))
    DynamicsAnswer.model_validate(answer)
    return answer


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
