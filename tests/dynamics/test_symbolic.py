"""The CasADi twin equals the kernels, and the notes' definitions written down independently."""

import casadi
import numpy as np
import pytest

from dynamics.inverse import inverse_dynamics
from dynamics.symbolic import (
    equations_function,
    inverse_function,
    symbolic_equations,
    symbolic_inverse_dynamics,
)
from dynamics.terms import (
    coriolis_matrix,
    gravity_vector,
    kinetic_energy,
    mass_matrix,
    potential_energy,
)
from kinematics.errors import InvalidRobotState
from kinematics.model.chain import Chain
from kinematics.robots import builtin_chain
from tests.dynamics.oracle import relative_error
from tests.dynamics.samples import cart_pendulum, planar_rr, random_chain, random_state

SMALL = [planar_rr(), cart_pendulum(), random_chain(2, 3, motors=True), random_chain(5, 4)]


@pytest.mark.parametrize("chain", SMALL, ids=lambda chain: chain.name)
def test_all_terms_equal_the_kernels(chain: Chain) -> None:
    equations = equations_function(chain)
    for q, qd, qdd in zip(*random_state(chain, 0, 10), strict=True):
        D, C, G, T, U, tau = (np.array(part) for part in equations(q, qd, qdd))
        assert relative_error(D, mass_matrix(chain, q)) < 1e-12
        np.testing.assert_allclose(C, coriolis_matrix(chain, q, qd), atol=1e-11)
        np.testing.assert_allclose(G[:, 0], gravity_vector(chain, q), atol=1e-11)
        assert float(T[0, 0]) == pytest.approx(float(kinetic_energy(chain, q, qd)), rel=1e-12)
        assert float(U[0, 0]) == pytest.approx(float(potential_energy(chain, q)), abs=1e-11)
        assert relative_error(tau[:, 0], inverse_dynamics(chain, q, qd, qdd)) < 1e-11


@pytest.mark.parametrize("name", ["panda", "puma560", "stanford", "scara"])
def test_the_recursion_equals_the_kernel(name: str) -> None:
    chain = builtin_chain(name)
    inverse = inverse_function(chain)
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
    symbols = (casadi.SX.sym("q", 2), casadi.SX.sym("v", 2))
    terms = symbolic_equations(chain, *symbols, casadi.DM([0, 0]))
    assert terms.mass_matrix.shape == (2, 2)


def test_faults_are_named() -> None:
    with pytest.raises(InvalidRobotState, match="3 symbolic"):
        symbolic_inverse_dynamics(planar_rr(), *(casadi.SX.sym(x, 3) for x in "qva"))
