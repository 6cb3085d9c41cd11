"""Units and labels of dynamic parameters."""

from dataclasses import replace

import numpy as np
import pytest

from dynamics.parameters.base_parameters import (
    base_parameter_labels,
    base_parameter_units,
    base_parameters,
    parameter_unit,
)
from kinematics.errors import InvalidOption
from tests.dynamics.samples import cart_pendulum, planar_rr, random_chain

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


def test_a_centre_of_mass_off_its_axis_has_coordinates() -> None:
    chain = random_chain(1, 2)
    labels = base_parameter_labels(base_parameters(chain), chain)
    assert any("·xc2" in label for label in labels)
    assert not any("·lc" in label for label in labels)


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
