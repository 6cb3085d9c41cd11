"""Trigonometric polynomials, formulas, tables and determinants in symbols against sympy."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import sympy

from dynamics.equations import polynomial
from dynamics.equations.formula import Collect, Notation, formula, numeric_value, real_terms
from dynamics.equations.polynomial import Polynomial, TooManyTerms, Variables, constant
from dynamics.equations.sheet import AXES, write_sheet
from dynamics.equations.table import SymbolicTable, symbolic_table
from kinematics.errors import InvalidOption
from kinematics.model.dh import DhRow, DhTable
from tests.dynamics.equations.tables import (
    TABLES,
    articulated_arm,
    evaluate,
    state,
)

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


TABLE: SymbolicTable = symbolic_table(articulated_arm())
FORMULA_V = TABLE.variables


def cos(*joints: int) -> Polynomial:
    """Cosine of the sum of the angles of some joints, numbered from 1."""
    return rotation(*joints)[0]


def rotation(*joints: int) -> tuple[Polynomial, Polynomial]:
    c, s = FORMULA_V.rotation(f"q_{joints[0]}")
    for j in joints[1:]:
        c_j, s_j = FORMULA_V.rotation(f"q_{j}")
        c, s = c * c_j - s * s_j, s * c_j + c * s_j
    return c, s


@pytest.mark.parametrize("seed", range(8))
def test_every_form_has_the_same_value(seed: int) -> None:
    rng = np.random.default_rng(seed)
    factors = [f for j in (1, 2, 3) for f in rotation(j)]
    factors += [FORMULA_V.symbol(name) for name in ("m_2", "m_3", "a_2", "qd_1", "g")]
    value = sum(
        (factors[i] * factors[j] * factors[k] * float(rng.integers(-3, 4))
         for i, j, k in rng.integers(0, len(factors), (8, 3))),
        FORMULA_V.symbol("a_3"),
    )  # fmt: skip
    numbers = {
        name: float(x)
        for name, x in zip(FORMULA_V.names, rng.normal(size=len(FORMULA_V.names)), strict=True)
    }
    expected = 0.0
    for key, coefficient in value.terms.items():
        term = coefficient
        for name, power in zip(FORMULA_V.names, FORMULA_V.exponents(key), strict=True):
            base = np.exp(1j * numbers[name]) if name in FORMULA_V.angles else numbers[name]
            term *= base**power
        expected += term.real
    for collect in Collect:
        assert numeric_value(formula(TABLE, value, collect), numbers) == pytest.approx(expected)
    assert len(real_terms(TABLE, value, pair=False)) >= len(real_terms(TABLE, value))
    assert math.isfinite(expected)


def table(*alphas: float, convention: Any = "standard", **changes: Any) -> DhTable:
    rows = tuple(DhRow("revolute", a=0.3, alpha=alpha, **changes) for alpha in alphas)
    return DhTable(convention, rows)


def test_zeros_and_quarter_turns_are_no_symbols() -> None:
    rows = (
        DhRow("revolute", a=0.3, alpha=math.pi / 2, d=0.0, theta=-math.pi),
        DhRow("prismatic", a=1e-14, alpha=0.3, d=0.2, mass=1.0, center_of_mass=[0.0, 0.1, 0.0],
              inertia=np.diag([0.1, 0.2, 0.3])),
    )  # fmt: skip
    symbols = symbolic_table(DhTable("standard", rows))
    names = [parameter.symbol for parameter in symbols.parameters]
    assert names == ["a_1", "d_2", "alpha_2", "m_2", "y_c2", "I_xx2", "I_yy2", "I_zz2", "g"]


UP = math.pi / 2


def arm(*rows: dict[str, Any]) -> DhTable:
    return DhTable("standard", tuple(DhRow(row.pop("type", "revolute"), **row) for row in rows))


def elbow() -> DhTable:
    return arm({"a": 0.1, "d": 0.4, "alpha": UP}, {"a": 0.5, "d": 0.1}, {"a": 0.35})


def skew() -> DhTable:
    return arm({"d": 0.4, "alpha": 0.4}, {"a": 0.5, "alpha": 0.7}, {"a": 0.35})


def spherical() -> DhTable:
    return arm({"d": 0.3, "alpha": -UP}, {"d": 0.1, "alpha": UP}, {"type": "prismatic"})


def scara() -> DhTable:
    return arm({"a": 0.5, "d": 0.3}, {"a": 0.4, "alpha": math.pi}, {"type": "prismatic"}, {})


def wrist() -> DhTable:
    return arm({"alpha": -UP}, {"alpha": UP}, {"d": 0.1})


@pytest.mark.parametrize(
    ("table", "axes", "expected"),
    [
        (TABLES["planar"], "x,y", "l_1 * l_2 * s_2"),
        (TABLES["planar of three"], "x,y,rz", "l_1 * l_2 * s_2"),
        (elbow(), "x,y,z", "-a_2 * a_3 * s_3 * (a_1 + a_2 * c_2 + a_3 * c_23)"),
        (spherical(), "x,y,z", "-s_2 * q_3**2"),
        (scara(), "x,y,z,rz", "a_1 * a_2 * s_2"),
        (wrist(), "rx,ry,rz", "-s_2"),
        (
            skew(),
            "x,y,z",
            "a_2 * a_3 * s_alpha1 * s_3 * (a_3 * c_alpha2 * s_2 * s_3 - c_2 * (a_2 + a_3 * c_3))",
        ),
        (wrist(), "x,y,z", "0"),
    ],
)
def test_textbook_arms_have_their_factors(table: DhTable, axes: str, expected: str) -> None:
    assert write_sheet(table, Notation.TEXT, axes.split(",")).determinant == expected


@pytest.mark.parametrize("seed", range(6))
def test_arms_at_odd_angles_have_the_values_of_numpy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    kinds = rng.choice(["revolute", "revolute", "prismatic"], 4 - seed % 2)
    rows = tuple(
        DhRow(kind, a=rng.uniform(), d=rng.uniform(), alpha=rng.choice([0.0, UP, -UP, 0.3]),
              theta=rng.choice([0.0, 0.4, UP]))
        for kind in kinds
    )  # fmt: skip
    axes = rng.permutation(AXES)[: len(rows)].tolist()
    sheet = write_sheet(DhTable("standard", rows), Notation.TEXT, axes)
    for q in rng.uniform(-2.0, 2.0, (3, len(rows))):
        J = evaluate(sheet, sheet.jacobian, state(q, q, q))[[AXES.index(axis) for axis in axes]]
        found = evaluate(sheet, [sheet.determinant], state(q, q, q))[0]
        assert found == pytest.approx(np.linalg.det(J.astype(float)), abs=1e-12)


def test_long_arms_and_wrong_axes_are_told() -> None:
    table = TABLES["planar"]
    for axes in (["x"], ["x", "x"], ["x", "y", "z"], ["x", "up"]):
        with pytest.raises(InvalidOption, match="as many rows of the Jacobian as there are joints"):
            write_sheet(table, Notation.TEXT, axes)
    five = replace(table, rows=tuple(DhRow("revolute", a=0.3) for _ in range(5)))
    sheet = write_sheet(five, Notation.TEXT, AXES[:5])
    assert sheet.determinant is None
    assert "beyond 4 joints" in sheet.notes[0]
