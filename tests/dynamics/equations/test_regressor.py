"""Regressors in symbols: the parameters of the notes, and tau = Y Theta."""

import numpy as np
import pytest
import sympy

from dynamics.inverse import inverse_dynamics
from dynamics.parameters.base_parameters import base_parameters
from kinematics.model.dh import chain_from_dh
from tests.dynamics.equations.tables import (
    QD,
    QDD,
    TABLES,
    Q,
    cart_pendulum,
    evaluate,
    parse,
    planar_arm,
    state,
    text_sheet,
)

m1, m2, l1, lc1, lc2, I1, I2, g = sympy.symbols("m_1 m_2 l_1 l_c1 l_c2 I_1 I_2 g")


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
