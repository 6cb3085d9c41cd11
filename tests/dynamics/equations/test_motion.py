"""Equations of motion in symbols: the notes' formulas, regressors and sheets."""

import math
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
import sympy
from matplotlib.mathtext import MathTextParser

from dynamics.equations.formula import Notation
from dynamics.equations.motion import equations_of_motion
from dynamics.equations.polynomial import TooManyTerms
from dynamics.equations.sheet import Sheet, write_page, write_sheet
from dynamics.equations.table import symbolic_table, textbook_table
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
