"""Newton-Euler against pinocchio, the Lagrangian terms and the notes' closed forms."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from dynamics.inverse import inverse_dynamics
from kinematics.errors import InvalidOption, InvalidRobotState
from kinematics.forward import forward
from tests.dynamics.samples import (
    pinocchio_model,
    random_chain,
    random_state,
    relative_error,
)


@pytest.mark.parametrize("seed", range(20))
def test_equals_pinocchio(seed: int) -> None:
    chain = random_chain(seed, 1 + seed % 9, motors=seed % 2 == 1)
    model = pinocchio_model(chain)
    data = model.createData()
    q, qd, qdd = random_state(chain, seed)
    torque = inverse_dynamics(chain, q, qd, qdd)
    for k in range(len(q)):
        expected = pin.rnea(model, data, q[k], qd[k], qdd[k]) + chain.viscous_friction * qd[k]
        assert relative_error(torque[k], expected) < 1e-11


@pytest.mark.parametrize("seed", range(10))
def test_a_wrench_on_the_surroundings_is_minus_a_wrench_on_the_tip(seed: int) -> None:
    chain = random_chain(seed, 5)
    model = pinocchio_model(chain)
    data = model.createData()
    rng = np.random.default_rng(seed)
    for q, qd, qdd in zip(*random_state(chain, seed, 5), strict=True):
        f, n = rng.normal(size=(2, 3))
        T = pin.SE3(forward(chain, q))
        # At the tip, in base axes, then in the frame of the last joint as pinocchio wants it.
        at_tip = pin.SE3(T.rotation.T, np.zeros(3)).act(pin.Force(f, n))
        pin.forwardKinematics(model, data, q)
        at_joint = (data.oMi[chain.n].inverse() * T).act(at_tip)
        forces = pin.StdVec_Force([pin.Force.Zero() for _ in range(chain.n)] + [-at_joint])
        expected = pin.rnea(model, data, q, qd, qdd, forces)
        torque = inverse_dynamics(chain, q, qd, qdd, wrench=np.concatenate([f, n]))
        assert relative_error(torque, expected) < 1e-11


def test_without_gravity_a_robot_at_rest_needs_no_torque() -> None:
    chain = random_chain(4)
    zero = np.zeros(chain.n)
    q = random_state(chain, 1, 1)[0][0]
    torque = inverse_dynamics(chain, q, zero, zero, gravity=[0.0, 0.0, 0.0])
    np.testing.assert_array_equal(torque, zero)
    moon = inverse_dynamics(replace(chain, gravity=np.array([0, 0, -1.62])), q, zero, zero)
    np.testing.assert_array_equal(inverse_dynamics(chain, q, zero, zero, None, [0, 0, -1.62]), moon)


def test_faults_are_named() -> None:
    chain = random_chain(4)
    q = np.zeros((3, chain.n))
    with pytest.raises(InvalidRobotState, match="velocities has 2 value"):
        inverse_dynamics(chain, q, [1.0, 2.0], q)
    with pytest.raises(InvalidRobotState, match="accelerations is not finite at joint 'joint5'"):
        inverse_dynamics(chain, q[0], q[0], [0, 0, 0, 0, 0, np.nan])
    with pytest.raises(InvalidRobotState, match="batches do not fit"):
        inverse_dynamics(chain, q, q[:2], q)
    with pytest.raises(InvalidOption, match="six finite numbers"):
        inverse_dynamics(chain, q, q, q, wrench=[1.0, 2.0, 3.0])
    with pytest.raises(InvalidOption, match="does not fit joints"):
        inverse_dynamics(chain, q, q, q, wrench=np.zeros((2, 6)))
