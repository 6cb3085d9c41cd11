"""Robots with a load, motors or another direction of gravity."""

from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from dynamics.forward import forward_dynamics
from dynamics.inverse import inverse_dynamics
from dynamics.model.body import bodies
from dynamics.model.payload import (
    Motor,
    attach_motors,
    inertia,
    with_gravity,
    with_inertias,
    with_motors,
    with_payload,
)
from dynamics.terms import augmented_mass_matrix, gravity_vector, kinetic_energy, mass_matrix
from kinematics.arrays import Array
from kinematics.errors import InvalidLinkName, InvalidOption
from kinematics.forward import forward
from kinematics.jacobian import geometric
from kinematics.model.chain import Inertia
from tests.dynamics.samples import (
    pinocchio_model,
    planar_rr,
    random_chain,
    random_inertia,
    random_state,
    relative_error,
)


@pytest.mark.parametrize("seed", range(5))
def test_payload_equals_a_body_appended_in_pinocchio(seed: int) -> None:
    chain = random_chain(seed, 4)
    load = random_inertia(np.random.default_rng(seed))
    loaded = with_payload(chain, load.mass, load.center_of_mass, load.tensor)
    model = pinocchio_model(chain)
    body = pin.Inertia(load.mass, np.array(load.center_of_mass), np.array(load.tensor))
    model.appendBodyToJoint(chain.n, body, pin.SE3(np.array(chain.tip.T_joint_link)))
    data = model.createData()
    for q, qd, qdd in zip(*random_state(chain, seed, 5), strict=True):
        expected = pin.rnea(model, data, q, qd, qdd)
        assert relative_error(inverse_dynamics(loaded, q, qd, qdd), expected) < 1e-11


def test_a_point_mass_is_its_weight_at_its_place() -> None:
    chain = random_chain(3, 4)
    q = random_state(chain, 3, 1)[0][0]
    loaded = with_payload(chain, 2.0, [0.1, 0.2, -0.3], link="link2")
    J = geometric(chain, q, "link2", [0.1, 0.2, -0.3])
    more = gravity_vector(loaded, q) - gravity_vector(chain, q)
    np.testing.assert_allclose(more, -2.0 * J[:3].T @ chain.gravity, atol=1e-12)
    heavier = mass_matrix(loaded, q) - mass_matrix(chain, q)
    np.testing.assert_allclose(heavier, 2.0 * J[:3].T @ J[:3], atol=1e-12)
    twice = with_payload(loaded, 1.0)
    assert [link.name for link in twice.links[-2:]] == ["payload", "payload_2"]
    np.testing.assert_array_equal(forward(twice, q), forward(chain, q))


def test_inertias_are_replaced_by_name() -> None:
    chain = random_chain(3, 4)
    light = Inertia(0.1, np.zeros(3), 0.01 * np.eye(3))
    changed = with_inertias(chain, {"link2": light})
    assert bodies(changed).masses[2] == pytest.approx(0.1)
    others = [0, 1, 3]
    np.testing.assert_array_equal(bodies(changed).masses[others], bodies(chain).masses[others])
    with pytest.raises(InvalidLinkName, match="nothing"):
        with_inertias(chain, {"nothing": light})


def test_motors_reflect_through_their_gears() -> None:
    chain = random_chain(3, 3)
    motor = Motor(2e-4, 1e-3, 0.05, 0.04, 0.8, 100.0)
    arm = attach_motors(chain, [motor, motor, Motor(1e-4)])
    np.testing.assert_allclose(arm.motor_inertia, [2.0, 2.0, 1e-4])
    friction = 1e4 * (1e-3 + 0.05 * 0.04 / 0.8)
    np.testing.assert_allclose(arm.viscous_friction, [friction, friction, 0.0])
    q, qd, qdd = (part[0] for part in random_state(chain, 0, 1))
    np.testing.assert_allclose(
        augmented_mass_matrix(arm, q) - mass_matrix(chain, q), np.diag(arm.motor_inertia)
    )
    more = inverse_dynamics(arm, q, qd, qdd) - inverse_dynamics(chain, q, qd, qdd)
    expected = arm.motor_inertia * qdd + arm.viscous_friction * qd
    np.testing.assert_allclose(more, expected, atol=1e-9)
    energy = kinetic_energy(arm, q, qd) - kinetic_energy(chain, q, qd)
    assert energy == pytest.approx(0.5 * float(arm.motor_inertia @ qd**2))
    # R u = V r k_m, whichever way round.
    u = np.array([3.0, -1.0])
    np.testing.assert_allclose(motor.torque(motor.voltage(u)), u)
    assert motor.voltage(np.array(1.0)) == pytest.approx(0.8 / (100.0 * 0.05))


def test_gravity_is_replaced() -> None:
    chain = random_chain(3, 3)
    q = random_state(chain, 0, 1)[0][0]
    upside = with_gravity(chain, -chain.gravity)
    np.testing.assert_allclose(gravity_vector(upside, q), -gravity_vector(chain, q), atol=1e-12)


def test_faults_are_named() -> None:
    chain = random_chain(3, 3)
    with pytest.raises(InvalidOption, match="mass is -1"):
        with_payload(chain, -1.0)
    with pytest.raises(InvalidOption, match="not those of a rigid body"):
        inertia(1.0, [0, 0, 0], np.diag([1.0, 1.0, 3.0]))
    with pytest.raises(InvalidOption, match="positive semidefinite"):
        inertia(1.0, [0, 0, 0], np.diag([1.0, 1.0, -0.5]))
    with pytest.raises(InvalidOption, match="shape"):
        inertia(1.0, [0, 0], np.eye(3))
    with pytest.raises(InvalidOption, match="not finite"):
        inertia(1.0, [0, 0, np.nan], np.eye(3))
    with pytest.raises(InvalidOption, match="inertia must be"):
        with_motors(chain, [-1.0, 0.0, 0.0])
    with pytest.raises(InvalidOption, match="gravity"):
        with_gravity(chain, [0.0, 1.0])
    with pytest.raises(InvalidOption, match="gear_ratio"):
        Motor(1e-4, gear_ratio=0.0)
    with pytest.raises(InvalidOption, match="1 motor"):
        attach_motors(chain, [Motor(1e-4)])


@pytest.mark.parametrize("mass", [0.0, -1e-12, np.nan, np.inf])
def test_a_load_has_a_positive_mass(mass: float) -> None:
    with pytest.raises(InvalidOption, match="mass"):
        with_payload(random_chain(1, 2), mass)
    with pytest.raises(InvalidOption, match="mass"):
        inertia(mass, np.zeros(3), np.eye(3))


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
