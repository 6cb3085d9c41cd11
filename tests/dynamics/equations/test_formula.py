"""The shape of formulas: products of cosines, and factors taken out."""

import math

import numpy as np
import pytest

from dynamics.equations.formula import Collect, Notation, Writer, formula, numeric_value, real_terms
from dynamics.equations.polynomial import Polynomial
from dynamics.equations.table import SymbolicTable, symbolic_table
from tests.dynamics.equations.tables import articulated_arm

TABLE: SymbolicTable = symbolic_table(articulated_arm())
V = TABLE.variables


def written(value: Polynomial, collect: Collect = Collect.ANGLES) -> str:
    return Writer(Notation.TEXT).write(formula(TABLE, value, collect))


def cos(*joints: int) -> Polynomial:
    """Cosine of the sum of the angles of some joints, numbered from 1."""
    return rotation(*joints)[0]


def rotation(*joints: int) -> tuple[Polynomial, Polynomial]:
    c, s = V.rotation(f"q_{joints[0]}")
    for j in joints[1:]:
        c_j, s_j = V.rotation(f"q_{j}")
        c, s = c * c_j - s * s_j, s * c_j + c * s_j
    return c, s


def test_angles_of_parallel_axes_add_and_those_of_others_do_not() -> None:
    assert TABLE.groups == (0, 1, 1)
    (c2, s2), (c3, s3) = rotation(2), rotation(3)
    assert written(c2 * c3 - s2 * s3) == "c_23"
    assert written(s2 * c3 + c2 * s3) == "s_23"
    assert written(cos(1) * c2) == "c_1 * c_2"
    assert written(c2 * c3 + s2 * s3) == "c_2m3"


def test_sums_become_products_where_that_is_shorter() -> None:
    c2, s2 = rotation(2)
    c23, s23 = rotation(2, 3)
    assert written(c2 * c2) == "c_2**2"
    assert written(s2 * s2) == "s_2**2"
    assert written(c2 * c23) == "c_2 * c_23"
    assert written(s2 * s23) == "s_2 * s_23"
    assert written(s2 * c23) == "s_2 * c_23"
    assert written(c2 * c2 - s2 * s2) == "c_22"
    assert written(c2 * c2 + s2 * s2) == "1"


def test_factors_are_taken_out() -> None:
    m, a, g = V.symbol("m_2"), V.symbol("a_2"), V.symbol("g")
    c1, c2 = cos(1), cos(2)
    assert written(m * a * c2 + m * g, Collect.MASSES) == "m_2 * (a_2 * c_2 + g)"
    assert written(c1 * (a * c2 + g)) == "c_1 * (g + a_2 * c_2)"
    assert written(-(a * c2) - g) == "-(g + a_2 * c_2)"
    assert written(a - a) == "0"
    assert written(a * 0.5) == "1/2 * a_2"


@pytest.mark.parametrize("seed", range(8))
def test_every_form_has_the_same_value(seed: int) -> None:
    rng = np.random.default_rng(seed)
    factors = [f for j in (1, 2, 3) for f in rotation(j)]
    factors += [V.symbol(name) for name in ("m_2", "m_3", "a_2", "qd_1", "g")]
    value = sum(
        (factors[i] * factors[j] * factors[k] * float(rng.integers(-3, 4))
         for i, j, k in rng.integers(0, len(factors), (8, 3))),
        V.symbol("a_3"),
    )  # fmt: skip
    numbers = {
        name: float(x) for name, x in zip(V.names, rng.normal(size=len(V.names)), strict=True)
    }
    expected = 0.0
    for key, coefficient in value.terms.items():
        term = coefficient
        for name, power in zip(V.names, V.exponents(key), strict=True):
            base = np.exp(1j * numbers[name]) if name in V.angles else numbers[name]
            term *= base**power
        expected += term.real
    for collect in Collect:
        assert numeric_value(formula(TABLE, value, collect), numbers) == pytest.approx(expected)
    assert len(real_terms(TABLE, value, pair=False)) >= len(real_terms(TABLE, value))
    assert math.isfinite(expected)
