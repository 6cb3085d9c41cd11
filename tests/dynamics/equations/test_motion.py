"""Equations of motion in symbols: the notes' formulas term by term, the kernels, pinocchio."""

import math
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
import sympy

from dynamics.equations.motion import equations_of_motion
from dynamics.equations.polynomial import TooManyTerms
from dynamics.equations.table import symbolic_table
from dynamics.inverse import inverse_dynamics
from dynamics.terms import (
    christoffel_symbols,
    coriolis_matrix,
    gravity_vector,
    mass_matrix,
    potential_energy,
)
from kinematics.forward import forward
from kinematics.jacobian import geometric
from kinematics.model.dh import chain_from_dh
from kinematics.model.dh_table import DhRow, DhTable
from tests.dynamics.equations.tables import (
    QD,
    TABLES,
    Q,
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
