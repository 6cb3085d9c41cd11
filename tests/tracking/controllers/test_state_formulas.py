"""Formulas of states: what is read, what is refused with its place, values."""

from typing import Any

import numpy as np
import pytest
import sympy

from kinematics.errors import InvalidOption
from tracking.controllers.state_formulas import read_formula, values, write

X = np.random.default_rng(0).uniform(0.1, 0.9, (20, 2))
x1, x2 = X.T


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("x2**2/2 + 4.9*(1 - cos(x1))", x2**2 / 2 + 4.9 * (1 - np.cos(x1))),
        ("-0.8*x2 - +4.9*sin(x1)", -0.8 * x2 - 4.9 * np.sin(x1)),
        (" exp(-x1)*log(1 + x2)/sqrt(x1)", np.exp(-x1) * np.log(1 + x2) / np.sqrt(x1)),
        ("tan(x1)*tanh(x2)**-2 + 1e-3", np.tan(x1) / np.tanh(x2) ** 2 + 1e-3),
        ("x1**0.5*2 + exp(1)", 2 * np.sqrt(x1) + np.e),
        ("(((3)))", np.full(20, 3.0)),
    ],
)
def test_formulas_have_the_values_of_numpy(text: str, expected: Any) -> None:
    formula = read_formula("V", text, 2)
    np.testing.assert_allclose(np.broadcast_to(values(formula, X), 20), expected, rtol=1e-13)
    again = sympy.lambdify(sympy.symbols("x1 x2"), sympy.sympify(write(formula)))
    np.testing.assert_allclose(np.broadcast_to(again(x1, x2), 20), expected, rtol=1e-13)


def test_numbers_are_exact() -> None:
    assert read_formula("V", "0.1 + 0.2 - 0.3 + x1 - x1", 1) == 0
    assert (
        write(read_formula("V", "0.1*x1 + x1**2/2 + x1/3", 1)) == "x1**2/2 + 0.433333333333333*x1"
    )


@pytest.mark.parametrize(
    ("text", "fault", "place"),
    [
        ("x1 + y", "'y' is no name of a formula", 6),
        ("  x1 + y", "'y' is no name of a formula", 8),
        ("x1 + x3", "'x3' is no name of a formula", 6),
        ("x1 ^ 2", "'^' is no sign of a formula", 4),
        ("(x1) // 2", "'//' is no sign of a formula", 6),
        ("__import__('os').system('true')", "is no part of a formula", 1),
        ("x1.real", "'x1.real' is no part of a formula", 1),
        ("x1[0]", "is no part of a formula", 1),
        ("[x1]", "is no part of a formula", 1),
        ("lambda: x1", "is no part of a formula", 1),
        ("1j*x1", "'1j' is no part of a formula", 1),
        ("True", "is no part of a formula", 1),
        ("x1 if x2 else 1", "is no part of a formula", 1),
        ("eval(x1)", "'eval' is no function of one argument", 1),
        ("sin(x1, x2)", "'sin' is no function of one argument", 1),
        ("x1**x2", "an exponent is a number up to 16", 5),
        ("x1**17", "an exponent is a number up to 16", 5),
        ("(((x1**16)**16)**16)", "powers and products go beyond 32", 13),
        ("1/0", "no real number", 1),
        ("x1 + log(0)", "no real number", 6),
        ("sqrt(-1)", "no real number", 1),
        ("exp(exp(100))", "no real number up to 1e+30", 5),
        ("1e999", "too large or too small", 1),
        ("x1 +", "no formula", 1),
        ("", "no formula", 1),
        ("x1 × x2", "'×' is no sign of a formula", 4),
        ("-" * 100 + "x1", "nested more than 60 deep", 62),
        ("\0", "no formula", 1),
    ],
)
def test_what_is_no_formula_is_refused_with_its_place(text: str, fault: str, place: int) -> None:
    with pytest.raises(InvalidOption) as caught:
        read_formula("f[1]", text, 2)
    assert caught.value.message.startswith("f[1]: ")
    assert fault in caught.value.message
    assert caught.value.details["character"] == place
    assert "sin, cos, tan" in (caught.value.hint or "")
