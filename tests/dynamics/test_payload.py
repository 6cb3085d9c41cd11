"""Loads, replaced inertias, motors and gravity, against pinocchio and by hand."""

import numpy as np
import pinocchio as pin
import pytest

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
from kinematics.errors import InvalidLinkName, InvalidOption
from kinematics.forward import forward
from kinematics.jacobian import geometric
from kinematics.model.chain import Inertia
from tests.dynamics.oracle import relative_error
from tests.dynamics.samples import pinocchio_model, random_chain, random_inertia, random_state


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
