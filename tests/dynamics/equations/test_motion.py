"""Equations of motion in symbols: the notes' formulas, regressors, polynomials, determinants."""

import math
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
import sympy
from matplotlib.mathtext import MathTextParser

from dynamics.equations import polynomial
from dynamics.equations.formula import Collect, Notation, formula, numeric_value, real_terms
from dynamics.equations.motion import equations_of_motion
from dynamics.equations.polynomial import Polynomial, TooManyTerms, Variables, constant
from dynamics.equations.sheet import AXES, Sheet, write_page, write_sheet
from dynamics.equations.table import SymbolicTable, symbolic_table, textbook_table
from dynamics.inverse import inverse_dynamics
from dynamics.parameters.base_parameters import base_parameters
from dynamics.terms import (
    christoffel_symbols,
    coriolis_matrix,
    gravity_vector,
    mass_matrix,
    potential_energy,
)
from kinematics.errors import InvalidOption
from kinematics.forward import forward
from kinematics.jacobian import geometric
from kinematics.model.dh import DhRow, DhTable, chain_from_dh
from kinematics.robots import builtin_chain
from tests.dynamics.equations.tables import (
    QD,
    QDD,
    TABLES,
    Q,
    articulated_arm,
    cart_pendulum,
    evaluate,
    parse,
    planar_arm,
    state,
    text_sheet,
)
from tests.dynamics.samples import pinocchio_model

m1, m2, l1, lc1, lc2, I1, I2, g = sympy.symbols("m_1 m_2 l_1 l_c1 l_c2 I_1 I_2 g")


def same(sheet: Any, written: Any, expected: Any) -> bool:
    """Whether written formulas are the expected ones, by sympy's simplification."""
    rows = sympy.Matrix([[parse(sheet, text) for text in row] for row in written])
    difference: Any = (rows - sympy.Matrix(expected)).applyfunc(sympy.simplify)
    return bool(difference == sympy.zeros(*difference.shape))


def test_the_planar_arm_has_the_formulas_of_lecture_27() -> None:
    sheet = text_sheet(planar_arm())
    motion = sheet.motion
    assert motion is not None
    q1, q2, *_ = Q
    d12 = m2 * (lc2**2 + l1 * lc2 * sympy.cos(q2)) + I2
    d11 = m1 * lc1**2 + m2 * (l1**2 + lc2**2 + 2 * l1 * lc2 * sympy.cos(q2)) + I1 + I2
    assert same(sheet, motion.mass_matrix, [[d11, d12], [d12, m2 * lc2**2 + I2]])
    h = -m2 * l1 * lc2 * sympy.sin(q2)
    C = [[h * QD[1], h * (QD[0] + QD[1])], [-h * QD[0], 0]]
    assert same(sheet, motion.coriolis_matrix, C)
    second = m2 * lc2 * g * sympy.cos(q1 + q2)
    G = [[(m1 * lc1 + m2 * l1) * g * sympy.cos(q1) + second], [second]]
    assert same(sheet, [[text] for text in motion.gravity], G)
    U = m1 * g * lc1 * sympy.sin(q1) + m2 * g * (l1 * sympy.sin(q1) + lc2 * sympy.sin(q1 + q2))
    assert same(sheet, [[motion.potential_energy]], [[U]])
    assert motion.christoffel_symbols is not None
    found = {item[:3]: parse(sheet, item[3]) for item in motion.christoffel_symbols}
    assert set(found) == {(1, 2, 1), (2, 2, 1), (1, 1, 2)}
    assert all(sympy.simplify(found[index] - h) == 0 for index in ((1, 2, 1), (2, 2, 1)))
    assert sympy.simplify(found[1, 1, 2] + h) == 0


def test_the_pendulum_on_a_cart_has_the_formulas_of_lecture_26() -> None:
    sheet = text_sheet(cart_pendulum())
    motion = sheet.motion
    assert motion is not None
    phi, I_zz = Q[1], sympy.Symbol("I_zz2")
    coupling = -m2 * lc2 * sympy.cos(phi)
    D = [[m1 + m2, coupling], [coupling, I_zz + m2 * lc2**2]]
    assert same(sheet, motion.mass_matrix, D)
    assert same(sheet, motion.coriolis_matrix, [[0, m2 * lc2 * sympy.sin(phi) * QD[1]], [0, 0]])
    # The scan of the notes has a cosine here; the derivative of U has a sine.
    assert same(sheet, [[t] for t in motion.gravity], [[0], [-m2 * lc2 * g * sympy.sin(phi)]])
    assert same(sheet, [[motion.potential_energy]], [[m2 * g * lc2 * sympy.cos(phi)]])


@pytest.mark.parametrize("name", TABLES)
def test_formulas_have_the_values_of_the_kernels_and_of_pinocchio(name: str) -> None:
    table = TABLES[name]
    chain, sheet = chain_from_dh(name, table), text_sheet(table)
    motion = sheet.motion
    assert motion is not None
    model = pinocchio_model(chain)
    data = model.createData()
    for q, qd, qdd in np.random.default_rng(2).uniform(-1.5, 1.5, (2, 3, chain.n)):
        at = state(q, qd, qdd)
        T = evaluate(sheet, sheet.frame, at)
        np.testing.assert_allclose(T, forward(chain, q)[:3], atol=1e-12)
        np.testing.assert_allclose(
            evaluate(sheet, sheet.jacobian, at), geometric(chain, q), atol=1e-12
        )
        D, C = (evaluate(sheet, rows, at) for rows in (motion.mass_matrix, motion.coriolis_matrix))
        G = evaluate(sheet, motion.gravity, at)
        np.testing.assert_allclose(D, mass_matrix(chain, q), atol=1e-12)
        np.testing.assert_allclose(C, coriolis_matrix(chain, q, qd), atol=1e-12)
        np.testing.assert_allclose(G, gravity_vector(chain, q), atol=1e-11)
        energy = evaluate(sheet, [motion.potential_energy], at)[0]
        masses = sum(row.mass or 0.0 for row in table.rows)
        origin = -masses * float(table.gravity @ table.base[:3, 3])
        assert energy + origin == pytest.approx(float(potential_energy(chain, q)), abs=1e-11)
        expected = pin.rnea(model, data, q, qd, qdd)
        driven = chain.motor_inertia * qdd + chain.viscous_friction * qd
        driven += chain.coulomb_friction * np.tanh(qd / 0.01)
        bare = D @ qdd + C @ qd + G
        np.testing.assert_allclose(bare + driven, inverse_dynamics(chain, q, qd, qdd), atol=1e-10)
        np.testing.assert_allclose(bare, expected - np.asarray(model.armature) * qdd, atol=1e-10)


@pytest.mark.parametrize("name", TABLES)
def test_every_christoffel_symbol_is_that_of_the_kernel(name: str) -> None:
    table = TABLES[name]
    chain, sheet = chain_from_dh(name, table), text_sheet(table)
    assert sheet.motion is not None
    assert sheet.motion.christoffel_symbols is not None
    q = np.random.default_rng(4).uniform(-1.5, 1.5, chain.n)
    expected = christoffel_symbols(chain, q)
    found = np.zeros((chain.n,) * 3)
    for i, j, k, text in sheet.motion.christoffel_symbols:
        value = evaluate(sheet, [text], state(q, q, q))[0]
        found[i - 1, j - 1, k - 1] = found[j - 1, i - 1, k - 1] = value
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_long_arms_have_no_formulas_of_their_dynamics() -> None:
    twisted = DhRow("revolute", a=0.3, alpha=math.pi / 2, d=0.1, mass=1.0)
    with pytest.raises(TooManyTerms):
        equations_of_motion(symbolic_table(DhTable("standard", (twisted,) * 7)))
    odd = DhRow("revolute", a=0.3, alpha=0.3, d=0.2, mass=1.0, center_of_mass=[0.1, 0.2, 0.3])
    with pytest.raises(TooManyTerms):
        equations_of_motion(symbolic_table(DhTable("standard", (odd,) * 4)))


def test_the_pendulum_on_a_cart_has_the_three_parameters_of_lecture_33() -> None:
    sheet = text_sheet(cart_pendulum())
    assert sheet.motion is not None
    assert sheet.motion.regressor is not None
    found = sheet.motion.regressor
    Theta = [parse(sheet, text) for text in found.parameters]
    assert Theta == [m1 + m2, lc2 * m2, sympy.Symbol("I_zz2") + lc2**2 * m2]
    c, s = sympy.cos(Q[1]), sympy.sin(Q[1])
    expected = sympy.Matrix(
        [[QDD[0], -c * QDD[1] + s * QD[1] ** 2, 0], [0, -c * QDD[0] - g * s, QDD[1]]]
    )
    Y = sympy.Matrix([[parse(sheet, text) for text in row] for row in found.regressor])
    assert (Y - expected).applyfunc(sympy.simplify) == sympy.zeros(2, 3)
    np.testing.assert_allclose(found.values, [1.5, 0.15, 3e-3 + 0.3 * 0.25], rtol=1e-14)


def test_the_planar_arm_has_the_five_parameters_of_textbooks() -> None:
    sheet = text_sheet(planar_arm())
    assert sheet.motion is not None
    assert sheet.motion.regressor is not None
    expected = [
        m1 * lc1**2 + m2 * (l1**2 + lc2**2) + I1 + I2,
        m2 * l1 * lc2,
        m2 * lc2**2 + I2,
        m1 * lc1 + m2 * l1,
        m2 * lc2,
    ]
    for text, value in zip(sheet.motion.regressor.parameters, expected, strict=True):
        assert sympy.expand(parse(sheet, text) - value) == 0


@pytest.mark.parametrize("name", TABLES)
def test_regressor_times_parameters_are_the_torques(name: str) -> None:
    chain, sheet = chain_from_dh(name, TABLES[name]), text_sheet(TABLES[name])
    assert sheet.motion is not None
    assert sheet.motion.regressor is not None
    regressor = sheet.motion.regressor
    # The lengths are unknown here and known there, so there are at least as many parameters.
    assert len(regressor.parameters) >= len(base_parameters(chain, known_zeros=True).names)
    for q, qd, qdd in np.random.default_rng(6).uniform(-1.5, 1.5, (3, 3, chain.n)):
        at = state(q, qd, qdd)
        Y = evaluate(sheet, regressor.regressor, at)
        Theta = evaluate(sheet, regressor.parameters, at)
        np.testing.assert_allclose(Theta, regressor.values, rtol=1e-12)
        np.testing.assert_allclose(Y @ Theta, inverse_dynamics(chain, q, qd, qdd), atol=1e-10)


@pytest.mark.parametrize("name", ["planar", "cart", "articulated"])
def test_no_parameter_can_be_left_out(name: str) -> None:
    """Columns of Y over many states and parameters over many robots are independent."""
    table = TABLES[name]
    sheet = text_sheet(table)
    assert sheet.motion is not None
    assert sheet.motion.regressor is not None
    rng = np.random.default_rng(8)
    n, Theta = len(table.rows), sheet.motion.regressor.parameters
    rows = [
        evaluate(sheet, sheet.motion.regressor.regressor, state(*rng.uniform(-2, 2, (3, n))))
        for _ in range(3 * len(Theta))
    ]
    assert np.linalg.matrix_rank(np.vstack(rows), tol=1e-8) == len(Theta)
    names = [parameter.symbol for parameter in sheet.parameters]
    still = state(np.zeros(n), np.zeros(n), np.zeros(n))
    robots = []
    for _ in range(3 * len(Theta)):
        robot = rng.uniform(0.5, 2.0, len(names)).tolist()
        robots.append(evaluate(sheet, Theta, still | dict(zip(names, robot, strict=True))))
    assert np.linalg.matrix_rank(np.array(robots), tol=1e-8) == len(Theta)


ROBOTS = ["planar_rr", "cart_pendulum", "scara", "ur5e", "panda"]


@lru_cache
def builtin_sheet(name: str) -> Sheet:
    return write_sheet(textbook_table(builtin_chain(name)), Notation.TEXT)


@pytest.mark.parametrize("name", ROBOTS)
def test_poses_of_built_in_robots_are_those_of_the_kernels(name: str) -> None:
    chain = builtin_chain(name)
    sheet = builtin_sheet(chain.name)
    for q in np.random.default_rng(1).uniform(-1.5, 1.5, (3, chain.n)):
        T = evaluate(sheet, sheet.frame, state(q, q, q))
        np.testing.assert_allclose(T, forward(chain, q)[:3], atol=1e-12)


def test_the_tool_at_the_end_of_the_last_link_is_part_of_its_row() -> None:
    table = textbook_table(builtin_chain("planar_rr"))
    assert [row.a for row in table.rows] == [1.0, 1.0]
    np.testing.assert_array_equal(table.tool[:3, 3], np.zeros(3))


@pytest.mark.parametrize("name", ["planar", "cart", "articulated"])
def test_every_latex_formula_renders(name: str) -> None:
    sheet = write_sheet(TABLES[name], Notation.LATEX)
    assert sheet.motion is not None
    rows = [*sheet.frame, *sheet.jacobian, sheet.motion.gravity, *sheet.motion.mass_matrix]
    formulas = [text for row in rows for text in row]
    formulas += [symbol for pair in sheet.abbreviations for symbol in pair]
    formulas += [parameter.symbol for parameter in sheet.parameters]
    parser = MathTextParser("path")
    for text in dict.fromkeys(formulas):
        parser.parse(f"${text}$")


def test_symbols_have_their_values_and_meanings() -> None:
    sheet = text_sheet(planar_arm())
    values = {parameter.symbol: parameter.value for parameter in sheet.parameters}
    assert values == {
        "l_1": 0.6, "l_2": 0.5, "m_1": 2.0, "l_c1": 0.25, "I_1": 0.06, "m_2": 1.7,
        "l_c2": pytest.approx(0.22), "I_2": pytest.approx(0.07), "g": 9.81,
    }  # fmt: skip
    assert {p.unit for p in sheet.parameters} == {"m", "kg", "kg m^2", "m/s^2"}
    assert dict(sheet.abbreviations)["c_12"] == "cos(q_1 + q_2)"


def test_an_angle_added_to_a_joint_is_part_of_its_cosine() -> None:
    table = DhTable("standard", (DhRow("revolute", a=0.5, theta=0.3),))
    sheet = text_sheet(table)
    assert sheet.frame[0][3] == "a_1 * c_1" or sheet.frame[0][3] == "l_1 * c_1"
    assert dict(sheet.abbreviations)["c_1"] == "cos(q_1 + theta_1)"
    latex = write_sheet(table, Notation.LATEX)
    assert dict(latex.abbreviations)["c_{1}"] == r"\cos\left(q_{1} + \theta_{1}\right)"


def test_motors_and_friction_are_terms_of_the_equation() -> None:
    sheet = text_sheet(articulated_arm())
    assert sheet.motion is not None
    assert sheet.motion.equation == "(D(q) + J)*qdd + C(q, qd)*qd + B*qd + F*f(qd) + G(q) = tau"
    values = {parameter.symbol: parameter.value for parameter in sheet.parameters}
    assert (values["J_1"], values["B_2"], values["F_2"]) == (0.1, 0.2, 0.3)
    assert dict(sheet.abbreviations)["f_1"] == "tanh(qd_1 / 0.01)"


def test_what_is_left_out_is_told() -> None:
    bare = replace(planar_arm(), rows=tuple(DhRow("revolute", a=0.4) for _ in range(2)))
    sheet = text_sheet(bare)
    assert sheet.motion is None
    assert "no link has a mass" in sheet.notes[0]
    panda = builtin_sheet("panda")
    assert panda.motion is None
    assert "beyond 6 joints" in panda.notes[0]
    ur5e = builtin_sheet("ur5e")
    assert ur5e.motion is not None
    assert ur5e.motion.regressor is None
    assert "beyond 4 joints" in ur5e.notes[0]


def test_the_dynamics_of_six_joints_have_the_values_of_the_kernels() -> None:
    chain = builtin_chain("ur5e")
    sheet = builtin_sheet(chain.name)
    assert sheet.motion is not None
    q, qd = np.random.default_rng(3).uniform(-1.5, 1.5, (2, 6))
    D = evaluate(sheet, sheet.motion.mass_matrix, state(q, qd, qd))
    np.testing.assert_allclose(D, mass_matrix(chain, q), atol=1e-11)
    C = evaluate(sheet, sheet.motion.coriolis_matrix, state(q, qd, qd))
    np.testing.assert_allclose(C, coriolis_matrix(chain, q, qd), atol=1e-11)


def test_arms_whose_poses_nobody_could_read_are_refused() -> None:
    row = DhRow("revolute", a=0.1, alpha=math.pi / 2, d=0.2)
    with pytest.raises(InvalidOption, match="12 joints") as caught:
        text_sheet(DhTable("standard", (row,) * 12))
    assert "seven joints" in (caught.value.hint or "")


def test_the_page_holds_every_formula() -> None:
    sheet = text_sheet(planar_arm())
    lines = write_page(sheet).splitlines()
    assert "D_22 = m_2 * l_c2**2 + I_2" in lines
    assert "Theta_5 = m_2 * l_c2" in lines
    assert "c_112 = m_2 * l_1 * l_c2 * s_2" in lines
    assert "c_12 = cos(q_1 + q_2)" in lines
    latex = write_page(write_sheet(planar_arm(), Notation.LATEX))
    assert r"\[ D(q) \ddot{q} + C(q, \dot{q}) \dot{q} + G(q) = \tau \]" in latex
    assert latex.count(r"\begin{bmatrix}") == latex.count(r"\end{bmatrix}") == 10


def test_long_formulas_are_refused_soon() -> None:
    """Five joints at odd angles: their poses expand to millions of products."""
    row = DhRow("revolute", a=0.3, alpha=0.4, d=0.2, theta=0.1, mass=1.0)
    with pytest.raises(InvalidOption, match="too long to be read"):
        text_sheet(DhTable("standard", (row,) * 5))


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
