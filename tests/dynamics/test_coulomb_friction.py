"""Dry friction F tanh(q_dot / v) in every part of the dynamics, from URDF and tables."""

from dataclasses import replace

import casadi
import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp

from dynamics.forward import forward_dynamics
from dynamics.inverse import inverse_dynamics
from dynamics.model.body import SMOOTH_SPEED
from dynamics.parameters.base_parameters import base_parameters
from dynamics.parameters.regressor import (
    parameter_names,
    reference_regressor,
    regressor,
    standard_parameters,
)
from dynamics.symbolic import symbolic_inverse_dynamics
from kinematics.errors import InvalidOption
from kinematics.model.chain import Chain
from kinematics.model.dh import chain_from_dh, dh_from_chain
from kinematics.model.dh_table import DhRow, DhTable
from kinematics.tree.serial_chain import serial_chain
from kinematics.urdf.urdf import parse_urdf
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.kinds.constraint import TorqueConstraint
from planning.proof.constraints.constraint_limits import constrained_efforts
from planning.values.limits import EffortLimits
from tests.dynamics.samples import pinocchio_model, random_chain
from tests.tracking.samples import constant, slider, smooth
from tracking.controllers.adaptive import Adaptive
from tracking.controllers.model_based import ComputedTorque
from tracking.simulation.simulation import SimulationOptions, simulate

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


def test_it_is_identified_from_motion_and_torque() -> None:
    chain, rng = dry(), np.random.default_rng(1)
    q, qd, qdd = rng.uniform(-2.0, 2.0, (3, 400, 4))
    names = parameter_names(chain)
    assert names[-4:] == ("F1", "F2", "F3", "F4")
    Theta = standard_parameters(chain)
    np.testing.assert_array_equal(Theta[-4:], chain.coulomb_friction)
    tau = inverse_dynamics(chain, q, qd, qdd)
    np.testing.assert_allclose(regressor(chain, q, qd, qdd) @ Theta, tau, atol=1e-9)
    v, a = rng.uniform(-2.0, 2.0, (2, 400, 4))
    twice = np.tanh(qd / SMOOTH_SPEED) * chain.coulomb_friction
    smooth = reference_regressor(replace(chain, coulomb_friction=np.zeros(4)), q, qd, v, a)
    both = reference_regressor(chain, q, qd, v, a) @ Theta
    np.testing.assert_allclose(both - smooth @ Theta[:-4], twice, atol=1e-9)
    base = base_parameters(chain, motors=True)
    Y = base.regressor(regressor(chain, q, qd, qdd))
    beta = np.linalg.lstsq(Y.reshape(-1, base.count), tau.ravel(), rcond=None)[0]
    found = dict(zip(base.names, beta, strict=True))
    for i, value in enumerate(chain.coulomb_friction, 1):
        assert found[f"F{i}"] == pytest.approx(value, abs=1e-8)
    # A robot without it has the parameters that it had.
    assert len(parameter_names(random_chain(3, 4))) == 48


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


def test_the_adaptive_controller_learns_it() -> None:
    chain = replace(slider(2.0, friction=0.3), coulomb_friction=np.array([1.5]))
    wrong = replace(chain, coulomb_friction=np.array([0.5]))
    there = smooth(chain, np.zeros(1), np.ones(1))
    controller = Adaptive(wrong, np.array(10.0), np.array(20.0), np.array(500.0))
    assert controller.parameters.names[-1] == "F1"
    options = SimulationOptions(saturate=False)
    result = simulate(controller, there, options, robot=chain)
    exact = simulate(ComputedTorque.by_pole_placement(chain, 10.0), there, options)
    assert exact.max_tracking_error.max() < 1e-6
    assert abs(result.estimate[-1, -1] - 1.5) < 0.5 * abs(0.5 - 1.5)


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
