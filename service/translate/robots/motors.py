"""Motors of robots from wire to domain and back."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from pydantic import BaseModel, ConfigDict

from armwright_wire.base import MAX_NUMBER
from armwright_wire.robots import robot as schema
from armwright_wire.robots.robot import RobotBody
from dynamics.model.payload import Motor, attach_motors
from kinematics.errors import InvalidRobotDescription
from kinematics.model.chain import Chain
from kinematics.tree.joint_limits import ALL_JOINTS


class _MotorsOfAnswer(BaseModel):
    """The motors in a robot's answer; its other fields are passed over."""

    model_config = ConfigDict(extra="ignore", frozen=True)

    motors: dict[str, schema.Motor] | None = None


def domain_motors(motors: Iterable[schema.Motor]) -> tuple[Motor, ...]:
    """Motors as values of the domain.

    Args:
        motors: Motors on the wire, in any order that the caller keeps.
    """
    return tuple(Motor(**motor.model_dump()) for motor in motors)


def answered_motors(answer: bytes) -> tuple[Motor, ...] | None:
    """The motors of a robot from its answer, in the order of its joints; None where it has none.

    Args:
        answer: The robot as the service answers it, JSON.
    """
    motors = _MotorsOfAnswer.model_validate_json(answer).motors
    return None if motors is None else domain_motors(motors.values())


def robot_motors(body: RobotBody, joints: Sequence[str]) -> dict[str, schema.Motor] | None:
    """The motors of a robot by joint, base to tip; None where its description has none.

    Args:
        body: The description.
        joints: Names of the joints of its chain, base to tip.

    Raises:
        InvalidRobotDescription: Only some joints have a motor, a motor belongs to none of them,
            or comes to more at its joint than can be computed with.
    """
    motors = _uploaded_motors(body, joints) if body.dh is None else _table_motors(body, joints)
    if not motors:
        return None
    missing = [name for name in joints if name not in motors]
    if missing:
        raise InvalidRobotDescription(
            f"{', '.join(missing)} have no motor, though {', '.join(motors)} have one",
            hint="Give every joint of the chain a motor, or none.",
            joints=missing,
        )
    for name in joints:
        _check_reflected(name, domain_motors([motors[name]])[0])
    return {name: motors[name] for name in joints}


def reflected(motor: schema.Motor) -> dict[str, Any]:
    """Inertia and friction of a motor at its joint, as fields of a table's row."""
    (value,) = domain_motors([motor])
    return {
        "motor_inertia": value.reflected_inertia,
        "viscous_friction": value.reflected_friction,
    }


def with_robot_motors(chain: Chain, body: RobotBody) -> Chain:
    """The chain of a URDF with the motors of its upload.

    Raises:
        InvalidRobotDescription: As `robot_motors`.
    """
    motors = robot_motors(body, chain.joint_names)
    return chain if motors is None else attach_motors(chain, domain_motors(motors.values()))


def _table_motors(body: RobotBody, joints: Sequence[str]) -> dict[str, schema.Motor]:
    """Motors of the rows of a table, by joint."""
    assert body.dh is not None
    rows = zip(joints, body.dh.rows, strict=True)
    return {name: row.motor for name, row in rows if row.motor is not None}


def _uploaded_motors(body: RobotBody, joints: Sequence[str]) -> dict[str, schema.Motor]:
    """Motors beside a URDF, by joint; that of "*" drives every joint that is not named."""
    motors: Mapping[str, schema.Motor] = body.motors or {}
    for name in motors:
        if name not in (*joints, ALL_JOINTS):
            raise InvalidRobotDescription(
                f"motors names the joint {name!r}, which the chain does not have",
                hint=f"Its joints are: {', '.join(joints)}.",
                joint=name,
            )
    every = {} if ALL_JOINTS not in motors else dict.fromkeys(joints, motors[ALL_JOINTS])
    return every | {name: motor for name, motor in motors.items() if name != ALL_JOINTS}


def _check_reflected(joint: str, motor: Motor) -> None:
    """See that a motor's inertia and friction at the joint are numbers of this world.

    Raises:
        InvalidRobotDescription: One of them is too large.
    """
    for value, name in (
        (motor.reflected_inertia, "inertia"),
        (motor.reflected_friction, "friction"),
    ):
        if not value <= MAX_NUMBER:
            raise InvalidRobotDescription(
                f"the motor of {joint} has the {name} {value:g} at the joint, more than "
                f"{MAX_NUMBER:g}",
                hint="Check gear_ratio and resistance: J = r^2 J_m, B = r^2 (B_m + k_m k_b / R).",
                joint=joint,
            )
