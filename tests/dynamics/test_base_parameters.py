"""Base parameters, their units and labels."""

import re
from dataclasses import replace

import numpy as np
import pytest

from dynamics.model.body import scale_masses
from dynamics.model.payload import with_gravity, with_motors
from dynamics.parameters.base_parameters import (
    BaseParameters,
    base_parameter_labels,
    base_parameter_units,
    base_parameters,
    parameter_unit,
)
from dynamics.parameters.regressor import parameter_names, regressor, standard_parameters
from kinematics.arrays import Array
from kinematics.errors import InvalidOption, MissingInertia
from kinematics.model.chain import Chain
from kinematics.robots import builtin_chain
from tests.dynamics.samples import (
    cart_pendulum,
    planar_rr,
    random_chain,
    random_state,
    relative_error,
)


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


def test_robots_of_other_joints_are_refused() -> None:
    base = base_parameters(planar_rr(), motors=True)
    with pytest.raises(InvalidOption, match="36 parameters, not 24"):
        base.of(random_chain(1, 3))
    # Five joints with motors have as many parameters as six without.
    five = base_parameters(random_chain(2, 5), motors=True)
    with pytest.raises(InvalidOption, match="72 parameters, not 60"):
        five.of(random_chain(2, 6))


def test_without_gravity_fewer_can_be_told_apart() -> None:
    for seed in range(3):
        chain = random_chain(seed, 3)
        level = with_gravity(chain, [0.0, 0.0, 0.0])
        W = observations(level, motors=False)
        base = base_parameters(level)
        assert base.count == np.linalg.matrix_rank(W, tol=1e-9 * np.linalg.norm(W))
        assert base.count <= base_parameters(chain).count


def test_the_choice_is_the_same_every_time_and_cannot_be_changed() -> None:
    chain = random_chain(4, 3)
    base = base_parameters(chain)
    base_parameters.cache_clear()
    again = base_parameters(replace(chain))
    assert again is not base
    np.testing.assert_array_equal(again.columns, base.columns)
    np.testing.assert_array_equal(again.combination, base.combination)
    for values in (base.columns, base.combination, base.values):
        with pytest.raises(ValueError, match="read-only"):
            values[0] = 0


def test_a_regressor_of_a_batch_keeps_its_leading_dimensions() -> None:
    chain = planar_rr()
    base = base_parameters(chain)
    Y = np.arange(2 * 3 * 2 * 20.0).reshape(2, 3, 2, 20)
    np.testing.assert_array_equal(base.regressor(Y), Y[..., base.columns])


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
