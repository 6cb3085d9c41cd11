"""Regressors and base parameters: what they multiply to, how many there are, their labels."""

import re
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from dynamics.model.body import bodies, scale_masses
from dynamics.model.payload import with_gravity, with_motors
from dynamics.parameters.base_parameters import (
    BaseParameters,
    base_parameter_labels,
    base_parameter_units,
    base_parameters,
    parameter_unit,
)
from dynamics.parameters.regressor import (
    parameter_names,
    reference_regressor,
    regressor,
    standard_parameters,
)
from dynamics.terms import augmented_mass_matrix, coriolis_matrix, gravity_vector
from kinematics.arrays import Array
from kinematics.errors import InvalidOption, MissingInertia
from kinematics.model.chain import Chain
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


def observations(chain: Chain, motors: bool, seed: int = 90) -> Array:
    """Regressors of many random motions, one above the other."""
    Y = regressor(chain, *random_state(chain, seed, 60), motors=motors)
    return Y.reshape(-1, Y.shape[-1])


CASES = [(planar_rr(), True), (cart_pendulum(), False), (random_chain(3, 4), True),
         (random_chain(5, 3), False), (builtin_chain("scara"), True),
         (builtin_chain("panda"), False)]  # fmt: skip


@pytest.mark.parametrize(("chain", "motors"), CASES)
def test_they_are_as_few_as_the_rank_and_explain_every_torque(chain: Chain, motors: bool) -> None:
    base, W = base_parameters(chain, motors=motors), observations(chain, motors)
    assert base.count == np.linalg.matrix_rank(W, tol=1e-9 * np.linalg.norm(W))
    assert np.linalg.matrix_rank(base.regressor(W)) == base.count
    assert relative_error(base.regressor(W) @ base.combination, W) < 1e-9
    Theta = standard_parameters(chain, motors=motors)
    np.testing.assert_allclose(base.values, base.combination @ Theta, rtol=1e-13)


@pytest.mark.parametrize(("chain", "motors"), CASES)
def test_each_leads_its_own_combination_and_no_other(chain: Chain, motors: bool) -> None:
    base = base_parameters(chain, motors=motors)
    np.testing.assert_array_equal(base.combination[:, base.columns], np.eye(base.count))
    assert base.parameter_names == parameter_names(chain, motors=motors)
    leaders = [name.split()[0] for name in base.names]
    assert leaders == [base.parameter_names[k] for k in base.columns]
    assert len(set(base.names)) == base.count
    assert not bodies(chain).rows.flags.writeable


def read_back(base: BaseParameters, Theta: Array) -> list[float]:
    """The values of the names as formulas of the standard parameters."""
    values = dict(zip(base.parameter_names, Theta, strict=True))
    sums = []
    for text in base.names:
        total = 0.0
        for sign, factor, name in re.findall(r"(?:^|([+-]) )(?:([\d.e+-]+) )?([A-Za-z]\w*)", text):
            total += (-1.0 if sign == "-" else 1.0) * float(factor or 1.0) * values[name]
        sums.append(total)
    return sums


@pytest.mark.parametrize(("chain", "motors"), CASES)
def test_names_are_formulas_of_the_values(chain: Chain, motors: bool) -> None:
    base = base_parameters(chain, motors=motors)
    Theta = standard_parameters(chain, motors=motors)
    scale = float(np.abs(Theta).max())
    np.testing.assert_allclose(read_back(base, Theta), base.values, rtol=2e-5, atol=2e-5 * scale)


def test_known_zeros_are_left_out_of_names_and_change_no_torque() -> None:
    arm = planar_rr()
    base = base_parameters(arm, known_zeros=True)
    zeros = [
        name
        for name, value in zip(
            base.parameter_names, standard_parameters(arm, motors=False), strict=True
        )
        if value == 0.0
    ]
    assert {"my1", "mz1"} <= set(zeros)
    assert not any(zero in name.split() for name in base.names for zero in zeros)
    W = observations(arm, motors=False)
    expected = W @ standard_parameters(arm, motors=False)
    assert relative_error(base.regressor(W) @ base.values, expected) < 1e-10


def test_heavier_robots_of_the_same_joints_have_their_own_values() -> None:
    chain = random_chain(3, 4, motors=True)
    heavy = with_motors(scale_masses(chain, [2.0, 1.0, 0.5, 3.0]), inertia=0.7)
    for motors in (False, True):
        base, W = base_parameters(chain, motors=motors), observations(chain, motors)
        np.testing.assert_allclose(base.of(chain), base.values, rtol=1e-12, atol=1e-12)
        torque = W @ standard_parameters(heavy, motors=motors)
        assert relative_error(base.regressor(W) @ base.of(heavy), torque) < 1e-9


def test_a_robot_without_inertias_has_none() -> None:
    arm = planar_rr()
    bare = replace(arm, links=tuple(replace(link, inertia=None) for link in arm.links))
    with pytest.raises(MissingInertia, match="'q1', 'q2'"):
        base_parameters(bare)


ARM, CART = planar_rr(), cart_pendulum()


@pytest.mark.parametrize(
    ("name", "unit"),
    [("m2", "kg"), ("mx1", "kg m"), ("mz12", "kg m"), ("Ixx3", "kg m²"), ("J2", "kg m²"),
     ("B2", "N m s/rad"), ("F2", "N m"), ("J1", "kg"), ("B1", "N s/m"), ("F1", "N")],
)  # fmt: skip
def test_units_are_those_of_the_joint(name: str, unit: str) -> None:
    # The cart slides, its pendulum turns.
    assert parameter_unit(name, CART) == unit


def test_the_textbook_s_parameters_are_named_as_there() -> None:
    base = base_parameters(ARM, known_zeros=True)
    labels = base_parameter_labels(base, ARM)
    assert base_parameter_units(base, ARM) == ("kg m²", "kg m", "kg m²", "kg m")
    assert labels[3] == "m2·lc2 [kg m]"
    assert labels[0].startswith("Izz1 + ")
    assert labels[0].endswith("·m2 [kg m²]")
    assert labels[1].startswith("m1·lc1 + ")
    cart = base_parameters(CART, known_zeros=True)
    assert len(base_parameter_labels(cart, CART)) == 3


def test_motors_and_dry_friction_are_labelled() -> None:
    driven = replace(
        ARM, motor_inertia=np.ones(2), viscous_friction=np.ones(2), coulomb_friction=np.ones(2)
    )
    labels = base_parameter_labels(base_parameters(driven, motors=True), driven)
    assert "B1 [N m s/rad]" in labels
    assert "F2 [N m]" in labels


def test_some_parameters_are_selected_by_name() -> None:
    base = base_parameters(ARM, known_zeros=True)
    assert base.indices(["mx2", base.names[0]]) == [3, 0]
    some = base.select([3, 0])
    assert some.names == (base.names[3], base.names[0])
    np.testing.assert_array_equal(some.of(ARM), base.of(ARM)[[3, 0]])
    with pytest.raises(InvalidOption, match="'mx9' is unknown"):
        base.indices(["mx9"])
    with pytest.raises(InvalidOption, match="given twice"):
        base.indices([base.names[0], "Izz1"])
