"""What answers say of controllers, and which parameters an adaptive one learns."""

from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter

from armwright_wire.motions.simulation import Controller
from kinematics.errors import InvalidOption
from kinematics.robots import builtin_chain
from service.endpoints.simulate.controllers import controller, controller_answer
from tracking.simulation.references import hold

CHAIN = builtin_chain("planar_rr")
BODY: TypeAdapter[Any] = TypeAdapter(Controller)


def made(**fields: Any) -> Any:
    return controller(BODY.validate_python(fields), CHAIN, hold(CHAIN, [0.3, -0.4], 1.0))


def adaptive(**fields: Any) -> Any:
    return made(type="adaptive", natural_frequency=5.0, **fields)


def test_an_adaptive_controller_learns_what_is_named() -> None:
    assert adaptive().parameters.count == 6
    assert adaptive(known_zeros=True).parameters.count == 4
    two = adaptive(known_zeros=True, parameters=["mx2", "Izz2"], Gamma=[2.0, 3.0])
    np.testing.assert_array_equal(two.Gamma, np.diag([2.0, 3.0]))
    np.testing.assert_allclose(two.estimate, two.parameters.of(CHAIN))
    assert two.known is not None
    assert two.known.count == 2
    zero = adaptive(known_zeros=True, parameters=["mx2"], estimate="zero")
    np.testing.assert_array_equal(zero.estimate, [0.0])
    answer = controller_answer(two)
    assert answer["parameter_labels"] == ["m2·lc2 [kg m]", "Izz2 [kg m²]"]
    assert answer["parameter_units"] == ["kg m", "kg m²"]


def test_an_estimate_of_another_length_is_refused() -> None:
    with pytest.raises(InvalidOption, match="the estimate must be 1 finite numbers"):
        adaptive(known_zeros=True, parameters=["mx2"], estimate=[0.1, 0.2])
    with pytest.raises(InvalidOption, match="Gamma"):
        adaptive(known_zeros=True, parameters=["mx2"], Gamma=[1.0, 2.0])


def test_others_have_no_parameters() -> None:
    answer = controller_answer(made(type="passivity", natural_frequency=5.0))
    assert answer["type"] == "passivity"
    assert (answer["parameter_names"], answer["parameter_labels"]) == (None, None)
