"""Regressors and base parameters: what they multiply to, and how many there are."""

import numpy as np
import pinocchio as pin
import pytest

from dynamics.inverse import inverse_dynamics
from dynamics.model.body import bodies, scale_masses
from dynamics.model.payload import with_gravity
from dynamics.parameters.base_parameters import base_parameters
from dynamics.parameters.regressor import (
    parameter_names,
    reference_regressor,
    regressor,
    standard_parameters,
)
from dynamics.terms import augmented_mass_matrix, coriolis_matrix, gravity_vector
from kinematics.errors import InvalidOption
from kinematics.robots import builtin_chain, builtin_names
from tests.dynamics.samples import (
    cart_pendulum,
    pinocchio_model,
    planar_rr,
    random_chain,
    random_state,
    relative_error,
)


@pytest.mark.parametrize("seed", range(12))
def test_reference_motion_has_the_christoffel_matrix(seed: int) -> None:
    chain = random_chain(seed, 1 + seed % 7, motors=True)
    q, qd, a = random_state(chain, seed)
    v = np.random.default_rng(seed + 100).uniform(-3, 3, q.shape)
    expected = (
        np.einsum("kij,kj->ki", augmented_mass_matrix(chain, q), a)
        + np.einsum("kij,kj->ki", coriolis_matrix(chain, q, qd), v)
        + chain.viscous_friction * qd
        + gravity_vector(chain, q)
    )
    Y = reference_regressor(chain, q, qd, v, a)
    assert relative_error(Y @ standard_parameters(chain), expected) < 1e-12
    whole = regressor(chain, q, qd, a)
    torque = inverse_dynamics(chain, q, qd, a)
    assert relative_error(whole @ standard_parameters(chain), torque) < 1e-12


def test_does_not_depend_on_the_parameters() -> None:
    chain = random_chain(4, motors=True)
    state = random_state(chain, 0)
    other = scale_masses(chain, np.linspace(0.5, 2.0, chain.n))
    np.testing.assert_array_equal(regressor(chain, *state), regressor(other, *state))
    torque = inverse_dynamics(other, *state)
    assert relative_error(regressor(chain, *state) @ standard_parameters(other), torque) < 1e-12


def test_names_go_with_the_parameters() -> None:
    chain = planar_rr()
    named = dict(zip(parameter_names(chain), standard_parameters(chain), strict=True))
    assert len(named) == 24
    assert named["m1"] == 2.0
    assert named["mx2"] == pytest.approx(1.5 * 0.2)
    assert named["Izz1"] == pytest.approx(0.05 + 2.0 * 0.3**2)
    assert named["J1"] == named["B2"] == 0.0


# Without friction, as published for the arms that are: 36 of the Puma 560, 43 of the Panda. The
# others are derived: of the first joint, fixed to the base with its axis along gravity, one
# parameter counts; each further skew revolute joint brings 7; axes parallel to the one before
# and prismatic joints bring fewer.
COUNTS = {
    "panda": 43, "ur5e": 36, "iiwa14": 43, "kr6_sixx": 36, "puma560": 36, "scara": 8,
    "stanford": 33, "planar_rr": 6, "cart_pendulum": 4, "elbow_wrist": 36,
}  # fmt: skip


@pytest.mark.parametrize("name", builtin_names())
def test_count_is_the_rank_of_pinocchios_regressors(name: str) -> None:
    chain = builtin_chain(name)
    base = base_parameters(chain)
    assert base.count == COUNTS[name]
    model = pinocchio_model(chain)
    data = model.createData()
    rows = [
        pin.computeJointTorqueRegressor(model, data, *state).copy()
        for state in zip(*random_state(chain, 7, 120), strict=True)
    ]
    W = np.vstack(rows)
    assert np.linalg.matrix_rank(W, tol=1e-9 * np.linalg.norm(W)) == base.count
    # The base parameters explain all torques, on states that they were not found with.
    Theta = standard_parameters(chain, motors=False)
    assert relative_error(base.regressor(W) @ base.values, W @ Theta) < 1e-10
    # A wrong model has other torques, and its base parameters say which.
    other = scale_masses(chain, np.linspace(0.7, 1.4, chain.n))
    expected = W @ standard_parameters(other, motors=False)
    assert relative_error(base.regressor(W) @ base.of(other), expected) < 1e-10
    assert np.linalg.matrix_rank(base.regressor(W)) == base.count


def test_textbook_groups() -> None:
    m1, m2, l1, c1, c2, i1, i2 = 2.0, 1.5, 0.7, 0.3, 0.2, 0.05, 0.02
    arm = base_parameters(planar_rr((m1, m2), (l1, 0.5), (c1, c2), (i1, i2)), known_zeros=True)
    assert arm.names == ("Izz1 + 0.49 m2", "mx1 + 0.7 m2", "Izz2", "mx2")
    np.testing.assert_allclose(
        arm.values, [i1 + m1 * c1**2 + m2 * l1**2, m1 * c1 + m2 * l1, i2 + m2 * c2**2, m2 * c2]
    )
    cart = base_parameters(cart_pendulum(1.3, 0.4, 0.6, 0.03), known_zeros=True)
    # The notes' M, m2 l and I + m2 l^2.
    assert cart.names == ("m1 + m2", "Izz2", "mx2")
    np.testing.assert_allclose(cart.values, [1.7, 0.03 + 0.4 * 0.36, 0.24])


def test_gravity_and_motors_decide_what_can_be_told_apart() -> None:
    arm = planar_rr()
    assert base_parameters(arm, known_zeros=True).count == 4
    level = with_gravity(arm, [0.0, 0.0, -9.81])
    # On a table the notes' arm has three: what gravity alone showed, mx1 + l1 m2, is gone.
    assert base_parameters(level, known_zeros=True).count == 3
    assert base_parameters(level).names == ("Izz1 + 0.49 m2", "Izz2", "mx2", "my2")
    # J1 can't be told from Izz1; J2, B1, B2 can.
    assert base_parameters(arm, motors=True).count == 6 + 3


def test_other_robots_are_refused() -> None:
    base = base_parameters(planar_rr())
    with pytest.raises(InvalidOption, match="60 parameters, not 20"):
        base.of(random_chain(3))


def test_is_found_for_random_robots() -> None:
    for seed in range(6):
        chain = random_chain(seed, 2 + seed, motors=True)
        base = base_parameters(chain, motors=True)
        state = random_state(chain, seed + 50)
        Y = regressor(chain, *state)
        torque = Y @ standard_parameters(chain)
        assert relative_error(base.regressor(Y) @ base.values, torque) < 1e-9
        assert len(set(base.names)) == base.count
    assert bodies(chain).rows.flags.writeable is False
