"""Tasks of fewer than six rows, wrenches of torques and rates of rotations, against NumPy."""

import json
import math
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from armwright_wire.robots.dynamics import WrenchRequest
from armwright_wire.robots.kinematics import JacobianRequest, VelocityRequest
from kinematics.errors import InvalidPose
from kinematics.jacobian import geometric
from kinematics.model.chain import Chain
from kinematics.model.dh import DhRow, DhTable, chain_from_dh
from kinematics.robots import builtin_chain
from service.endpoints.dynamics.task import wrench
from service.endpoints.kinematics.task import convert_pose, jacobian, velocity

NAMES = ["x", "y", "z", "rx", "ry", "rz"]


def elbow_arm() -> Chain:
    rows = [
        DhRow("revolute", 0.0, math.pi / 2.0, 0.4),
        DhRow("revolute", 0.5),
        DhRow("revolute", 0.3),
    ]
    return chain_from_dh("elbow", DhTable("standard", tuple(rows)))


def planar_arm() -> Chain:
    rows = [DhRow("revolute", a) for a in (0.5, 0.4, 0.2)]
    return chain_from_dh("planar", DhTable("standard", tuple(rows)))


def asked(task: Any, chain: Chain, schema: Any, **body: Any) -> dict[str, Any]:
    answer: dict[str, Any] = json.loads(task(chain, schema.model_validate(body)))
    return answer


def rows_of(chain: Chain, q: list[float], axes: list[str]) -> np.ndarray:
    return np.asarray(geometric(chain, q)[[NAMES.index(axis) for axis in axes]])


def test_joint_velocities_of_a_linear_velocity_are_the_inverse() -> None:
    chain, q, v = elbow_arm(), [0.3, 0.7, -0.9], [0.1, -0.2, 0.05]
    axes = ["x", "y", "z"]
    answer = asked(velocity, chain, VelocityRequest, joints=q, twist=v, axes=axes, damped_below=0.0)
    J = rows_of(chain, q, axes)
    np.testing.assert_allclose(answer["joint_velocities"], np.linalg.solve(J, v), rtol=1e-9)
    np.testing.assert_allclose(answer["twist"], v, atol=1e-12)
    assert answer["rank"] == 3
    six = [*v, 7.0, 8.0, 9.0]  # those of axes that do not count
    same = asked(velocity, chain, VelocityRequest, joints=q, twist=six, axes=axes, damped_below=0)
    assert same == answer


def test_stretched_arm_has_lost_a_direction_of_its_position() -> None:
    answer = asked(
        jacobian, elbow_arm(), JacobianRequest, joints=[0.3, 0.7, 0.0], axes=["x", "y", "z"]
    )
    assert answer["rank"] == 2
    assert answer["manipulability"] == pytest.approx(0.0, abs=1e-12)
    assert np.shape(answer["jacobian"]) == (3, 3)


def test_null_space_of_a_planar_arm_is_projected_for_the_rows_that_count() -> None:
    chain, q, b = planar_arm(), [0.2, 0.5, -0.4], [1.0, 0.0, 0.0]
    axes = ["y", "x"]
    J = rows_of(chain, q, axes)
    answer = asked(
        velocity, chain, VelocityRequest, joints=q, twist=[0.0, 0.0], axes=axes, nullspace=b,
        damped_below=0.0,
    )  # fmt: skip
    expected = b - np.linalg.pinv(J) @ J @ b
    np.testing.assert_allclose(answer["joint_velocities"], expected, atol=1e-12)
    np.testing.assert_allclose(J @ answer["joint_velocities"], 0.0, atol=1e-12)
    forward = asked(velocity, chain, VelocityRequest, joints=q, joint_velocities=b, axes=axes)
    np.testing.assert_allclose(forward["twist"], J @ b, atol=1e-12)


def test_rows_are_those_of_the_frame() -> None:
    chain, q = builtin_chain("panda"), [0.1, -0.5, 0.2, -2.0, 0.3, 1.5, 0.7]
    every = asked(jacobian, chain, JacobianRequest, joints=q, frame="tool")
    some = asked(jacobian, chain, JacobianRequest, joints=q, frame="tool", axes=["rz", "x"])
    np.testing.assert_array_equal(some["jacobian"], [every["jacobian"][5], every["jacobian"][0]])


def test_force_of_torques_is_that_which_they_hold() -> None:
    chain, q = elbow_arm(), [0.3, 0.7, -0.9]
    force, axes = [3.0, -4.0, 5.0], ["x", "y", "z"]
    there = asked(wrench, chain, WrenchRequest, joints=q, wrench=force, axes=axes)
    J = rows_of(chain, q, axes)
    np.testing.assert_allclose(there["torques"], J.T @ force, rtol=1e-12)
    back = asked(wrench, chain, WrenchRequest, joints=q, torques=there["torques"], axes=axes)
    np.testing.assert_allclose(back["wrench"], force, rtol=1e-9)
    np.testing.assert_allclose(back["residual"], 0.0, atol=1e-12)
    # At the stretched arm no force along it is felt: what is left of the torques is told.
    singular = [0.3, 0.7, 0.0]
    tau = [1.0, 2.0, 3.0]
    lost = asked(wrench, chain, WrenchRequest, joints=singular, torques=tau, axes=axes)
    J = rows_of(chain, singular, axes)
    np.testing.assert_allclose(lost["wrench"], np.linalg.pinv(J.T) @ tau, atol=1e-9)
    np.testing.assert_allclose(lost["residual"], tau - J.T @ lost["wrench"], atol=1e-12)


@pytest.mark.parametrize(
    ("schema", "body"),
    [
        (VelocityRequest, {"twist": [0.1, 0.2], "axes": ["x"]}),
        (VelocityRequest, {"twist": [[0.1], [0.2, 0.3]], "axes": ["x"]}),
        (VelocityRequest, {"twist": [0.1, 0.2]}),
        (VelocityRequest, {"twist": [0.1, 0.2], "axes": ["x", "x"]}),
        (JacobianRequest, {"axes": ["x", "x"]}),
        (WrenchRequest, {"wrench": [1.0], "axes": ["x", "y"]}),
        (WrenchRequest, {"wrench": [0.0] * 6, "torques": [0.0] * 3}),
        (WrenchRequest, {}),
    ],
)
def test_vectors_that_do_not_fit_the_axes_are_refused(schema: Any, body: dict[str, Any]) -> None:
    with pytest.raises(ValidationError, match=r"axis|axes|exactly one"):
        schema.model_validate({"joints": [0.1, 0.2, 0.3], **body})


def test_angular_velocity_follows_from_a_rotation_and_its_rate() -> None:
    R = Rotation.from_euler("ZYZ", [0.3, 0.8, -1.1]).as_matrix()
    omega = np.array([0.2, -0.5, 0.9])
    rate = np.cross(omega, R, axisb=0, axisc=0)
    body = {"pose": {"position": [0, 0, 0], "rotation_matrix": R.tolist()}}
    answer = json.loads(convert_pose(json.dumps(body | {"rotation_rate": rate.tolist()}).encode()))
    np.testing.assert_allclose(answer["angular_velocity"], omega, atol=1e-12)
    with pytest.raises(InvalidPose, match="no rate"):
        convert_pose(json.dumps(body | {"rotation_rate": (rate + 0.01).tolist()}).encode())
