"""Motors: the joint's equation beside that of the rotor, and what cannot be a motor."""

from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from dynamics.forward import forward_dynamics
from dynamics.model.payload import Motor, attach_motors
from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from tests.dynamics.samples import pinocchio_model, planar_rr, random_chain, random_state

FIELDS = ("inertia", "friction", "torque_constant", "back_emf", "resistance", "gear_ratio")


def random_motor(rng: np.random.Generator) -> Motor:
    """A motor of plausible numbers."""
    return Motor(
        inertia=rng.uniform(1e-5, 1e-3),
        friction=rng.uniform(0.0, 1e-3),
        torque_constant=rng.uniform(0.02, 0.2),
        back_emf=rng.uniform(0.02, 0.2),
        resistance=rng.uniform(0.3, 2.0),
        gear_ratio=rng.uniform(20.0, 160.0),
    )


def rotor_accelerations(
    motors: list[Motor], M: Array, bias: Array, qd: Array, voltage: Array
) -> Array:
    """Joint accelerations from the circuits and rotors themselves, theta_m = r q.

    J_m theta_m'' = k_m i - B_m theta_m' - tau_load / r with R i = V - k_b theta_m', and
    M q'' + bias = tau_load.
    """
    r = np.array([motor.gear_ratio for motor in motors])
    speed = r * qd
    current = np.array(
        [
            (V - m.back_emf * w) / m.resistance
            for m, V, w in zip(motors, voltage, speed, strict=True)
        ]
    )
    drive = np.array([m.torque_constant * i for m, i in zip(motors, current, strict=True)])
    brake = np.array([m.friction * w for m, w in zip(motors, speed, strict=True)])
    rotor = np.diag([m.inertia * m.gear_ratio**2 for m in motors])
    return np.asarray(np.linalg.solve(M + rotor, r * (drive - brake) - bias))


@pytest.mark.parametrize("seed", range(5))
def test_a_driven_robot_moves_as_its_circuits_and_rotors_say(seed: int) -> None:
    chain, rng = random_chain(seed, 4), np.random.default_rng(seed)
    motors = [random_motor(rng) for _ in range(chain.n)]
    model = pinocchio_model(chain)
    data = model.createData()
    robot = attach_motors(chain, motors)
    for q, qd, _ in zip(*random_state(chain, seed, 5), strict=True):
        voltage = rng.uniform(-48.0, 48.0, chain.n)
        M = pin.crba(model, data, q)
        M = np.triu(M) + np.triu(M, 1).T
        expected = rotor_accelerations(motors, M, pin.nle(model, data, q, qd), qd, voltage)
        u = np.array([float(m.torque(V)) for m, V in zip(motors, voltage, strict=True)])
        np.testing.assert_allclose(
            forward_dynamics(robot, q, qd, u), expected, rtol=1e-9, atol=1e-9
        )


def test_voltage_and_torque_undo_each_other() -> None:
    rng = np.random.default_rng(1)
    for _ in range(20):
        motor, u = random_motor(rng), rng.normal(size=(3, 4))
        np.testing.assert_allclose(motor.torque(motor.voltage(u)), u, rtol=1e-14)
        np.testing.assert_allclose(motor.voltage(motor.torque(u)), u, rtol=1e-14)


def test_the_voltage_of_a_motor_that_stands_is_the_current_times_the_resistance() -> None:
    motor = Motor(1e-4, torque_constant=0.05, resistance=2.0, gear_ratio=100.0)
    # 10 N m at the joint are 0.1 N m at the rotor, 2 A and 4 V.
    assert motor.voltage(np.array(10.0)) == pytest.approx(4.0)


def test_a_bare_rotor_has_unit_constants_and_no_friction() -> None:
    motor = Motor(0.3)
    assert motor.reflected_inertia == 0.3
    assert motor.reflected_friction == 0.0
    assert motor.torque(np.array(2.0)) == motor.voltage(np.array(2.0)) == 2.0


def test_a_gear_reflects_by_its_square() -> None:
    plain = Motor(1e-4, 1e-3, 0.05, 0.06, 2.0)
    geared = Motor(1e-4, 1e-3, 0.05, 0.06, 2.0, gear_ratio=50.0)
    assert geared.reflected_inertia == pytest.approx(2500.0 * plain.reflected_inertia)
    assert geared.reflected_friction == pytest.approx(2500.0 * plain.reflected_friction)
    assert plain.reflected_friction == pytest.approx(1e-3 + 0.05 * 0.06 / 2.0)


@pytest.mark.parametrize("name", FIELDS)
@pytest.mark.parametrize("value", [-1e-9, np.nan, np.inf, -np.inf])
def test_numbers_of_no_motor_are_refused_by_name(name: str, value: float) -> None:
    values: dict[str, Any] = {"inertia": 1.0} | {name: value}
    with pytest.raises(InvalidOption, match=f"the {name} of a motor"):
        Motor(**values)


@pytest.mark.parametrize("name", FIELDS)
def test_zero_is_refused_only_where_it_would_be_divided_by(name: str) -> None:
    values: dict[str, Any] = {"inertia": 1.0} | {name: 0.0}
    if name in {"inertia", "friction", "back_emf"}:
        assert getattr(Motor(**values), name) == 0.0
    else:
        with pytest.raises(InvalidOption) as caught:
            Motor(**values)
        assert caught.value.hint == "Give a number that is positive."


@pytest.mark.parametrize("count", [0, 1, 3])
def test_every_joint_has_one_motor(count: int) -> None:
    with pytest.raises(InvalidOption, match=rf"{count} motor\(s\) for the 2 joints") as caught:
        attach_motors(planar_rr(), [Motor(1.0)] * count)
    assert "q1, q2" in (caught.value.hint or "")


def test_motors_keep_the_order_of_the_joints() -> None:
    robot = attach_motors(planar_rr(), [Motor(1.0, 0.1), Motor(2.0, 0.2, gear_ratio=10.0)])
    np.testing.assert_allclose(robot.motor_inertia, [1.0, 200.0])
    np.testing.assert_allclose(robot.viscous_friction, [0.1, 20.0])
