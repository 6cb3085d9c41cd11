"""Motors of robots from wire to domain: of a table's rows, beside a URDF, out of an answer."""

from typing import Any

import pytest

from armwright_wire.robots import robot as schema
from armwright_wire.robots.robot import RobotBody
from dynamics.model.payload import Motor
from kinematics.errors import InvalidRobotDescription
from kinematics.robots import builtin_urdf
from service.translate.robots import motors, robots

SMALL: dict[str, Any] = {"inertia": 1e-4, "friction": 2e-5, "torque_constant": 0.05,
    "back_emf": 0.04, "resistance": 0.5, "gear_ratio": 50.0, "voltage_limit": 24.0}  # fmt: skip
LARGE = SMALL | {"gear_ratio": 80.0}
#: J = r² J_m and B = r² (B_m + k_m k_b / R) of the two, by hand.
INERTIAS, FRICTIONS = (0.25, 0.64), (10.05, 25.728)
ROW: dict[str, Any] = {"type": "revolute", "a": 0.4, "alpha": 0.0, "d": 0.0, "theta": 0.0,
    "mass": 1.0}  # fmt: skip
JOINTS = ("joint_1", "joint_2")


def table(*rows: dict[str, Any]) -> RobotBody:
    dh = {"convention": "standard", "rows": [ROW | row for row in rows]}
    return RobotBody.model_validate({"name": "arm", "dh": dh})


def urdf(**motors_by_joint: Any) -> RobotBody:
    text = builtin_urdf("planar_rr")
    return RobotBody.model_validate({"name": "arm", "urdf": text, "motors": motors_by_joint})


def test_motors_of_rows_drive_the_joints_of_the_chain() -> None:
    body = table({"motor": SMALL}, {"motor": LARGE})
    geometry, _ = robots.robot(body)
    assert geometry.chain.motor_inertia.tolist() == pytest.approx(INERTIAS, rel=1e-14)
    assert geometry.chain.viscous_friction.tolist() == pytest.approx(FRICTIONS, rel=1e-14)
    assert motors.robot_motors(body, JOINTS) == {
        "joint_1": schema.Motor(**SMALL), "joint_2": schema.Motor(**LARGE),
    }  # fmt: skip


def test_motors_beside_a_urdf_drive_its_joints() -> None:
    chain = robots.robot(urdf(**{"*": SMALL}))[0].chain
    last = chain.joint_names[-1]
    body = urdf(**{last: LARGE, "*": SMALL})
    chain = robots.robot(body)[0].chain
    assert chain.motor_inertia.tolist() == pytest.approx(INERTIAS, rel=1e-14)
    assert chain.viscous_friction.tolist() == pytest.approx(FRICTIONS, rel=1e-14)
    uploaded = motors.robot_motors(body, chain.joint_names)
    assert uploaded is not None
    assert list(uploaded) == list(chain.joint_names)


def test_a_robot_without_motors_has_none() -> None:
    body = table({"motor_inertia": 0.1, "viscous_friction": 0.2}, {})
    assert motors.robot_motors(body, JOINTS) is None
    geometry, _ = robots.robot(body)
    assert geometry.chain.motor_inertia.tolist() == [0.1, 0.0]


def test_motors_come_back_out_of_an_answer() -> None:
    body = table({"motor": SMALL}, {"motor": LARGE})
    answer = robots.robot_answer(*robots.robot(body), "arm", is_built_in=False, body=body)
    content = answer.model_dump_json().encode()
    assert motors.answered_motors(content) == (Motor(**SMALL), Motor(**LARGE))
    assert motors.answered_motors(b'{"name": "arm", "motors": null}') is None


@pytest.mark.parametrize(
    ("body", "text"),
    [
        (table({"motor": SMALL}, {}), "joint_2 have no motor, though joint_1 have one"),
        (urdf(elbow_3=SMALL), "motors names the joint 'elbow_3', which the chain does not have"),
        (table({"motor": SMALL | {"gear_ratio": 1e9}}), "joint_1 has the inertia 1e+14"),
        (table({"motor": SMALL | {"resistance": 1e-300}}), "has the friction"),
    ],
)  # fmt: skip
def test_bad_motors_are_refused(body: RobotBody, text: str) -> None:
    with pytest.raises(InvalidRobotDescription) as caught:
        robots.robot(body)
    assert text in caught.value.message
    assert caught.value.hint
