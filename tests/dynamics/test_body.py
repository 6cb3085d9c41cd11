"""Bodies of a chain, loads, motors, dry friction and another gravity."""

from dataclasses import replace
from typing import Any

import casadi
import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import ArrayLike
from scipy.integrate import solve_ivp

from dynamics.forward import forward_dynamics
from dynamics.inverse import inverse_dynamics
from dynamics.model.body import (
    SMOOTH_SPEED,
    bodies,
    joints_without_inertia,
    massless_joints,
    scale_masses,
)
from dynamics.model.payload import (
    Motor,
    attach_motors,
    inertia,
    with_gravity,
    with_inertias,
    with_motors,
    with_payload,
)
from dynamics.symbolic import symbolic_inverse_dynamics
from dynamics.terms import augmented_mass_matrix, gravity_vector, kinetic_energy, mass_matrix
from kinematics.arrays import Array
from kinematics.errors import InvalidLinkName, InvalidOption, MissingInertia
from kinematics.forward import forward
from kinematics.jacobian import geometric
from kinematics.model.chain import Chain, Inertia, Link
from kinematics.model.dh import DhRow, DhTable, chain_from_dh, dh_from_chain
from kinematics.tree.serial_chain import serial_chain
from kinematics.urdf.urdf import parse_urdf
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.kinds.constraint import TorqueConstraint
from planning.proof.constraints.constraint_limits import constrained_efforts
from planning.values.limits import EffortLimits
from tests.dynamics.samples import (
    pinocchio_model,
    planar_rr,
    random_chain,
    random_inertia,
    random_state,
    relative_error,
)
from tests.tracking.samples import constant, slider
from tracking.controllers.model_based import ComputedTorque
from tracking.simulation.simulation import SimulationOptions, simulate


def without(chain: Chain, *names: str) -> Chain:
    """The chain with the inertia of some links taken away."""
    links = tuple(
        replace(link, inertia=None) if link.name in names else link for link in chain.links
    )
    return replace(chain, links=links)


@pytest.mark.parametrize("seed", range(10))
def test_merges_like_pinocchio(seed: int) -> None:
    chain = random_chain(seed, 1 + seed % 6)
    packed, model = bodies(chain), pinocchio_model(chain)
    for i in range(chain.n):
        body = model.inertias[i + 1]
        assert packed.masses[i] == pytest.approx(body.mass, rel=1e-13)
        np.testing.assert_allclose(packed.centers[i], body.lever, atol=1e-13)
        np.testing.assert_allclose(packed.tensors[i], body.inertia, atol=1e-13)


def test_a_frame_without_inertia_fixed_to_a_body_adds_nothing() -> None:
    chain = random_chain(1)
    links = (*chain.links, Link("camera_optical", 3, np.eye(4)))
    more = bodies(replace(chain, links=links))
    np.testing.assert_array_equal(more.masses, bodies(chain).masses)
    np.testing.assert_array_equal(more.tensors, bodies(chain).tensors)


def test_a_robot_whose_links_all_lack_an_inertia_is_refused_and_they_are_named() -> None:
    chain = random_chain(1, 4)
    bare = replace(chain, links=tuple(replace(link, inertia=None) for link in chain.links))
    with pytest.raises(MissingInertia, match=r"'joint0', .*'joint3'.*link3, rider, tool") as caught:
        mass_matrix(bare, np.zeros(4))
    assert caught.value.details["joints"] == list(chain.joint_names)


def test_a_joint_beyond_which_nothing_has_inertia_is_massless() -> None:
    whole = random_chain(1, 4)
    chain = without(without(whole, "link3"), "link2")
    q, qd, qdd = np.random.default_rng(5).uniform(-1.0, 1.0, (3, 4))
    D = mass_matrix(chain, q)
    assert not D[2:].any()
    assert not D[:, 2:].any()
    torques = inverse_dynamics(chain, q, qd, qdd)
    model = pinocchio_model(whole)
    for i in (2, 3):
        model.inertias[i + 1] = pin.Inertia.Zero()
    expected = pin.rnea(model, model.createData(), q, qd, qdd)
    np.testing.assert_allclose(torques, expected, atol=1e-10)
    assert joints_without_inertia(chain) == ("joint2", "joint3")
    with pytest.raises(MissingInertia, match="'joint2'"):
        forward_dynamics(chain, q, qd, torques)


def test_a_motor_is_an_inertia_to_its_joint() -> None:
    chain = without(random_chain(1, 3), "link2")
    driven = replace(chain, motor_inertia=np.array([0.0, 0.0, 0.2]))
    assert joints_without_inertia(chain) == ("joint2",)
    assert joints_without_inertia(driven) == ()
    q, qd, qdd = np.random.default_rng(6).uniform(-1.0, 1.0, (3, 3))
    torques = inverse_dynamics(driven, q, qd, qdd)
    np.testing.assert_allclose(forward_dynamics(driven, q, qd, torques), qdd, atol=1e-9)


def test_links_without_inertia_are_massless_where_a_later_one_has_some() -> None:
    """As pinocchio has it, where the body has mass 0."""
    whole = random_chain(1, 4)
    chain = without(whole, "link1")
    assert massless_joints(chain) == (1,)
    assert massless_joints(whole) == ()
    zero = Inertia(0.0, np.zeros(3), np.zeros((3, 3)))
    links = tuple(replace(k, inertia=zero) if k.name == "link1" else k for k in whole.links)
    model = pinocchio_model(replace(whole, links=links))
    data, rng = model.createData(), np.random.default_rng(5)
    for q, qd, qdd in rng.uniform(-2.0, 2.0, (20, 3, 4)):
        expected = pin.rnea(model, data, q, qd, qdd)
        np.testing.assert_allclose(inverse_dynamics(chain, q, qd, qdd), expected, atol=1e-10)
        back = forward_dynamics(chain, q, qd, expected)
        np.testing.assert_allclose(back, qdd, atol=1e-7)


def test_inertia_without_mass_counts() -> None:
    chain = without(random_chain(1, 3), "link2")
    rotor = Link("rotor", 2, np.eye(4), Inertia(0.0, np.zeros(3), np.diag([1.0, 2.0, 3.0])))
    packed = bodies(replace(chain, links=(*chain.links, rotor)))
    assert packed.masses[2] == 0.0
    np.testing.assert_array_equal(packed.tensors[2], np.diag([1.0, 2.0, 3.0]))


def test_gravity_can_be_replaced() -> None:
    chain = random_chain(2)
    np.testing.assert_array_equal(bodies(chain, [0, 0, -1.62]).gravity, [0, 0, -1.62])
    np.testing.assert_array_equal(bodies(chain).gravity, chain.gravity)
    for wrong in ([0.0, 0.0], [0.0, 0.0, np.inf]):
        with pytest.raises(InvalidOption, match="gravity"):
            bodies(chain, wrong)


def test_scaled_masses_scale_the_mass_matrix() -> None:
    chain = random_chain(3)
    q = np.linspace(-1, 1, chain.n)
    np.testing.assert_allclose(
        mass_matrix(scale_masses(chain, 1.7), q), 1.7 * mass_matrix(chain, q), rtol=1e-12
    )
    factors = np.linspace(0.5, 2.0, chain.n)
    np.testing.assert_allclose(
        bodies(scale_masses(chain, factors)).masses, factors * bodies(chain).masses, rtol=1e-14
    )


@pytest.mark.parametrize("factors", [0.0, -1.0, np.nan, np.inf, [1.0, 2.0], [[1.0] * 6]])
def test_wrong_factors_are_refused(factors: ArrayLike) -> None:
    with pytest.raises(InvalidOption, match="6, one for each joint"):
        scale_masses(random_chain(3), factors)


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
    # R u = V r k_m.
    assert motor.voltage(np.array(1.0)) == pytest.approx(0.8 / (100.0 * 0.05))


def test_faults_are_named() -> None:
    chain = random_chain(3, 3)
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


URDF = """<robot name="wheel"><link name="base"/><link name="rim"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="axle" type="continuous"><parent link="base"/><child link="rim"/><axis xyz="0 0 1"/>
<limit effort="9" velocity="9"/><dynamics damping="0.5" friction="2.0"/></joint></robot>"""


def dry(seed: int = 3, n: int = 4) -> Chain:
    """A random arm with dry friction at all joints but one."""
    chain = random_chain(seed, n, motors=True)
    friction = np.random.default_rng(seed).uniform(0.5, 3.0, n)
    friction[1] = 0.0
    return replace(chain, coulomb_friction=friction)


def test_a_urdf_gives_both_frictions() -> None:
    chain = serial_chain(parse_urdf(URDF))
    np.testing.assert_array_equal(chain.coulomb_friction, [2.0])
    for speed, expected in ((1.0, 2.5), (-1.0, -2.5), (0.0, 0.0), (0.01, 0.005 + 2 * np.tanh(1))):
        assert inverse_dynamics(chain, [0.0], [speed], [0.0])[0] == pytest.approx(expected)
    assert chain.content_hash != replace(chain, coulomb_friction=np.zeros(1)).content_hash


def test_a_table_gives_it_and_gets_it_back() -> None:
    row = DhRow("revolute", a=0.5, lower=-1.0, upper=1.0, mass=1.0, coulomb_friction=0.7)
    chain = chain_from_dh("arm", DhTable("standard", (row, replace(row, coulomb_friction=None))))
    np.testing.assert_array_equal(chain.coulomb_friction, [0.7, 0.0])
    assert [r.coulomb_friction for r in dh_from_chain(chain).rows] == [0.7, 0.0]


def test_inverse_and_forward_dynamics_are_pinocchios_and_friction() -> None:
    chain = dry()
    model = pinocchio_model(chain)
    data, rng = model.createData(), np.random.default_rng(0)
    for q, qd, qdd in rng.uniform(-1.0, 1.0, (30, 3, 4)):
        motors = chain.motor_inertia * qdd + chain.viscous_friction * qd
        friction = chain.coulomb_friction * np.tanh(qd / SMOOTH_SPEED)
        model.armature[:], model.damping[:] = 0.0, 0.0
        expected = pin.rnea(model, data, q, qd, qdd) + motors + friction
        tau = inverse_dynamics(chain, q, qd, qdd)
        np.testing.assert_allclose(tau, expected, atol=1e-10)
        np.testing.assert_allclose(forward_dynamics(chain, q, qd, tau), qdd, atol=1e-8)
        state = (casadi.DM(q), casadi.DM(qd), casadi.DM(qdd))
        symbolic = np.array(symbolic_inverse_dynamics(chain, *state)).ravel()
        np.testing.assert_allclose(symbolic, tau, atol=1e-9)


def test_a_slider_slows_down_as_the_equation_says() -> None:
    """M q_ddot + F tanh(q_dot / v) + Kd q_dot + Kp q = 0, by scipy."""
    chain = replace(slider(2.0), coulomb_friction=np.array([1.5]))
    controller = ComputedTorque(slider(2.0), np.array([4.0]), np.array([1.0]))
    result = simulate(
        controller,
        constant(chain, np.zeros(1), 2.0),
        SimulationOptions(saturate=False),
        robot=chain,
        initial_position=[0.5],
    )
    exact = solve_ivp(
        lambda _, x: [x[1], -4.0 * x[0] - x[1] - 0.75 * np.tanh(x[1] / SMOOTH_SPEED)],
        (0.0, 2.0),
        [0.5, 0.0],
        method="Radau",
        rtol=1e-10,
        atol=1e-12,
        t_eval=result.times,
    )
    np.testing.assert_allclose(result.position[:, 0], exact.y[0], atol=1e-7)


def test_it_takes_its_part_of_every_torque_limit() -> None:
    chain = dry()
    limits = EffortLimits(chain, np.full(4, 10.0))
    assert limits.effort is not None
    np.testing.assert_allclose(limits.effort, 10.0 - chain.coulomb_friction)
    assert not limits.chain.coulomb_friction.any()
    again = replace(limits, tool_speed=1.0)
    np.testing.assert_array_equal(again.effort, limits.effort)
    with pytest.raises(InvalidOption, match="takes all of its torque limit"):
        EffortLimits(chain, chain.coulomb_friction + 1e-300)


@pytest.mark.parametrize("given", [None, 20.0, 9.0])
def test_it_takes_its_part_of_constrained_torques_once(given: float | None) -> None:
    chain = dry()
    efforts = None if given is None else EffortLimits(chain, np.full(4, given))
    asked = ConstraintSet(chain, (TorqueConstraint([10.0] * 4),))
    both = constrained_efforts(efforts, asked, chain)
    assert both is not None
    assert both.effort is not None
    least = 10.0 if given is None else min(given, 10.0)
    np.testing.assert_allclose(both.effort, least - chain.coulomb_friction)
    assert not both.chain.coulomb_friction.any()
