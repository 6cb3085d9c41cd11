"""Trigonometric polynomials against sympy."""

import numpy as np
import pytest
import sympy

from dynamics.equations import polynomial
from dynamics.equations.polynomial import Polynomial, TooManyTerms, Variables, constant, matrix

V = Variables(("u", "v", "m", "l"), frozenset({"u", "v"}))
u, v, m, l = sympy.symbols("u v m l")  # noqa: E741


def as_sympy(value: Polynomial) -> sympy.Expr:
    """The sum of exponentials that a polynomial is."""
    total = sympy.Integer(0)
    for key, coefficient in value.terms.items():
        k_u, k_v, k_m, k_l = V.exponents(key)
        phase = sympy.exp(sympy.I * (k_u * u + k_v * v))
        number = sympy.nsimplify(coefficient.real) + sympy.I * sympy.nsimplify(coefficient.imag)
        total += number * phase * m**k_m * l**k_l
    return total


def equal(value: Polynomial, expected: sympy.Expr) -> bool:
    difference = sympy.expand((as_sympy(value) - expected).rewrite(sympy.exp))
    return bool(sympy.simplify(difference) == 0)


def random_polynomial(rng: np.random.Generator) -> tuple[Polynomial, sympy.Expr]:
    """A sum of products of symbols, cosines and sines, by both."""
    total, expected = constant(0.0), sympy.Integer(0)
    factors = [
        (V.rotation("u")[0], sympy.cos(u)), (V.rotation("u")[1], sympy.sin(u)),
        (V.rotation("v")[0], sympy.cos(v)), (V.rotation("v")[1], sympy.sin(v)),
        (V.symbol("m"), m), (V.symbol("l"), l),
    ]  # fmt: skip
    for _ in range(3):
        size = int(rng.integers(-3, 4))
        product, term = constant(float(size)), sympy.Integer(size)
        for k in rng.integers(0, len(factors), 3):
            product, term = product * factors[k][0], term * factors[k][1]
        total, expected = total + product, expected + term
    return total, expected


@pytest.mark.parametrize("seed", range(6))
def test_sums_products_and_derivatives_are_those_of_sympy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    (a, a_s), (b, b_s) = random_polynomial(rng), random_polynomial(rng)
    assert equal(a + b, a_s + b_s)
    assert equal(a - b, a_s - b_s)
    assert equal(a * b, a_s * b_s)
    assert equal(-a, -a_s)
    for name, symbol in (("u", u), ("m", m), ("l", l)):
        assert equal(V.derivative(a, name), sympy.diff(a_s, symbol))


@pytest.mark.parametrize("turns", [-5, -1, 0, 1, 2, 3, 7])
def test_quarter_turns_are_exact(turns: int) -> None:
    c, s = V.rotation("u", turns)
    assert equal(c, sympy.cos(u + turns * sympy.pi / 2))
    assert equal(s, sympy.sin(u + turns * sympy.pi / 2))


def test_identities_hold_by_themselves() -> None:
    (cu, su), (cv, sv) = V.rotation("u"), V.rotation("v")
    assert cu * cu + su * su == constant(1.0)
    assert not (cu * cv + su * sv) * V.symbol("m") - V.symbol("m") * (su * sv + cv * cu)
    R = matrix([[cu, -su], [su, cu]])
    assert (R @ R.T)[0, 0] == constant(1.0)
    assert not (R @ R.T)[0, 1]


def test_high_powers_keep_their_signs() -> None:
    value, key = constant(1.0), None
    for _ in range(40):
        value = value * V.rotation("u")[0] * V.symbol("l")
    for key in value.terms:
        powers = V.exponents(key)
        assert abs(powers[0]) <= 40
        assert powers[1:] == (0, 0, 40)
        assert V.key(powers) == key


def test_formulas_that_nobody_reads_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(polynomial, "MAX_TERMS", 3)
    cu, cv = V.rotation("u")[0], V.rotation("v")[0]
    with pytest.raises(TooManyTerms):
        cu * cv


def test_products_that_take_too_long_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(polynomial, "MAX_PRODUCTS", 3)
    cu, cv = V.rotation("u")[0], V.rotation("v")[0]
    assert V.symbol("m") * cu
    with pytest.raises(TooManyTerms):
        cu * cv
