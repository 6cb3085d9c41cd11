"""Sheets of formulas: both notations, names, values, and what is left out."""

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from matplotlib.mathtext import MathTextParser

from dynamics.equations.formula import Notation
from dynamics.equations.sheet import Sheet, write_page, write_sheet
from dynamics.equations.table import textbook_table
from dynamics.terms import coriolis_matrix, mass_matrix
from kinematics.errors import InvalidOption
from kinematics.forward import forward
from kinematics.model.dh_table import DhRow, DhTable
from kinematics.robots import builtin_chain
from tests.dynamics.equations.tables import (
    TABLES,
    articulated_arm,
    evaluate,
    planar_arm,
    state,
    text_sheet,
)

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
