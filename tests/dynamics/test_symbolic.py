"""The CasADi twin equals the kernels."""

import casadi
import numpy as np
import pytest

from dynamics.inverse import inverse_dynamics
from dynamics.symbolic import symbolic_inverse_dynamics
from dynamics.terms import gravity_vector
from kinematics.errors import InvalidRobotState
from kinematics.model.chain import Chain
from kinematics.robots import builtin_chain
from tests.dynamics.samples import (
    cart_pendulum,
    planar_rr,
    random_chain,
    random_state,
    relative_error,
)

CHAINS = [planar_rr(), cart_pendulum(), random_chain(2, 3, motors=True), random_chain(5, 4)]
CHAINS += [builtin_chain(name) for name in ("panda", "puma560", "stanford", "scara")]


@pytest.mark.parametrize("chain", CHAINS, ids=lambda chain: chain.name)
def test_the_recursion_equals_the_kernel(chain: Chain) -> None:
    symbols = [casadi.SX.sym(name, chain.n) for name in ("q", "qd", "qdd")]
    inverse = casadi.Function("tau", symbols, [symbolic_inverse_dynamics(chain, *symbols)])
    for q, qd, qdd in zip(*random_state(chain, 1, 10), strict=True):
        expected = inverse_dynamics(chain, q, qd, qdd)
        assert relative_error(np.array(inverse(q, qd, qdd))[:, 0], expected) < 1e-11


def test_serves_an_optimiser() -> None:
    chain, g = planar_rr(), [1.0, -3.0, 0.0]
    q = casadi.MX.sym("q", 2)
    torque = symbolic_inverse_dynamics(chain, q, casadi.DM.zeros(2), casadi.DM.zeros(2), g)
    stiffness = casadi.Function("stiffness", [q], [casadi.jacobian(torque, q)])
    at, step = np.array([0.3, -0.8]), 1e-6
    for j in range(2):
        e = step * np.eye(2)[j]
        slope = (gravity_vector(chain, at + e, g) - gravity_vector(chain, at - e, g)) / (2 * step)
        np.testing.assert_allclose(np.array(stiffness(at))[:, j], slope, atol=1e-8)


def test_faults_are_named() -> None:
    with pytest.raises(InvalidRobotState, match="3 symbolic"):
        symbolic_inverse_dynamics(planar_rr(), *(casadi.SX.sym(x, 3) for x in "qva"))
