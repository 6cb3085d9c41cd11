"""Quadratic Lyapunov functions against matrix exponentials, sympy and the notes' review."""

import numpy as np
import pytest
import sympy
from scipy.linalg import expm

from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from tracking.controllers.quadratic_form import (
    Definiteness,
    Verdict,
    form_text,
    quadratic_lyapunov,
    solve_lyapunov,
    symmetric_form,
)

#: The damped mass on a spring of the notes with k = m = b = 1.
SPRING = np.array([[0.0, 1.0], [-1.0, -1.0]])
HARMONIC = np.array([[0.0, 1.0], [-1.0, 0.0]])
#: V = (x1² + x1 x2 + x2²)/2, whose rate is -V.
CROSS = 0.5 * np.array([[1.0, 0.5], [0.5, 1.0]])


def random_system(seed: int, n: int = 4) -> Array:
    A = np.random.default_rng(seed).normal(size=(n, n))
    return np.asarray(A - (0.3 + np.linalg.eigvals(A).real.max()) * np.eye(n))


def test_the_form_of_the_notes_falls_as_its_own_negative() -> None:
    found = quadratic_lyapunov(SPRING, CROSS)
    np.testing.assert_allclose(found.Q.matrix, CROSS, atol=1e-15)
    np.testing.assert_allclose(found.P.minors, [0.5, 3.0 / 16.0])
    np.testing.assert_allclose(found.poles, [-0.5 - 0.75**0.5 * 1j, -0.5 + 0.75**0.5 * 1j])
    assert found.verdict is Verdict.ASYMPTOTICALLY_STABLE
    V, V_dot = found.values([[0.5, 0.0], [1.0, -2.0]])
    np.testing.assert_allclose(V, [0.125, 1.5])
    np.testing.assert_allclose(V_dot, -V)


@pytest.mark.parametrize("seed", range(5))
def test_the_solution_is_that_of_the_linear_equations(seed: int) -> None:
    # (A' ⊗ I + I ⊗ A') vec(P) = -vec(Q).
    A = random_system(seed)
    Q = np.diag([1.0, 2.0, 3.0, 0.5]) + 0.2
    found = solve_lyapunov(A, Q)
    one = np.eye(len(A))
    P = np.linalg.solve(np.kron(A.T, one) + np.kron(one, A.T), -Q.ravel()).reshape(A.shape)
    np.testing.assert_allclose(found.P.matrix, P, rtol=1e-9, atol=1e-9)
    assert found.verdict is Verdict.ASYMPTOTICALLY_STABLE
    back = quadratic_lyapunov(A, found.P.matrix)
    np.testing.assert_allclose(back.Q.matrix, Q, atol=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_rates_are_the_slopes_of_v_along_motions(seed: int) -> None:
    rng = np.random.default_rng(seed)
    A, S = rng.normal(size=(2, 3, 3))
    found = quadratic_lyapunov(A, S)
    assert not found.is_symmetric
    x, h = rng.normal(size=3), 1e-5
    V, V_dot = found.values(x)
    assert float(V) == pytest.approx(float(x @ S @ x))
    ahead, behind = (expm(s * h * A) @ x for s in (1.0, -1.0))
    slope = (ahead @ S @ ahead - behind @ S @ behind) / (2.0 * h)
    assert float(V_dot) == pytest.approx(float(slope), rel=1e-6, abs=1e-7)


def test_minors_are_those_of_sympy() -> None:
    S = np.array([[4, 1, 0], [1, 3, -2], [0, -2, 5]])
    exact = [float(sympy.Matrix(S[:k, :k]).det()) for k in (1, 2, 3)]
    np.testing.assert_allclose(symmetric_form(S.astype(float)).minors, exact)
    assert symmetric_form(S.astype(float)).definiteness is Definiteness.POSITIVE


@pytest.mark.parametrize(
    ("diagonal", "kind"),
    [
        ([1.0, 2.0], Definiteness.POSITIVE),
        ([0.0, 2.0], Definiteness.SEMIPOSITIVE),
        ([0.0, 0.0], Definiteness.ZERO),
        ([-1.0, 2.0], Definiteness.INDEFINITE),
        ([-1.0, 0.0], Definiteness.SEMINEGATIVE),
        ([-1.0, -2.0], Definiteness.NEGATIVE),
    ],
)
def test_definiteness_is_that_of_the_eigenvalues(diagonal: list[float], kind: Definiteness) -> None:
    c, s = np.cos(0.7), np.sin(0.7)
    R = np.array([[c, -s], [s, c]])
    assert symmetric_form(R @ np.diag(diagonal) @ R.T).definiteness is kind


def test_verdicts_are_those_of_the_theorems() -> None:
    energy = np.eye(2)
    # V_dot = -2 b x2²: semidefinite, and LaSalle.
    assert quadratic_lyapunov(SPRING, energy).verdict is Verdict.STABLE_BY_LASALLE
    assert quadratic_lyapunov(HARMONIC, energy).verdict is Verdict.STABLE
    assert quadratic_lyapunov(np.diag([-1.0, 0.0]), energy).verdict is Verdict.STABLE
    assert quadratic_lyapunov(-SPRING, energy).verdict is Verdict.NO_FALL
    assert quadratic_lyapunov(SPRING, np.diag([1.0, -1.0])).verdict is Verdict.NO_POSITIVE_V
    assert quadratic_lyapunov(SPRING, np.diag([1.0, 0.0])).verdict is Verdict.NO_POSITIVE_V
    saddle = np.array([[1.0, 0.0], [0.0, -2.0]])
    assert solve_lyapunov(saddle, energy).verdict is Verdict.UNSTABLE
    assert solve_lyapunov(-SPRING, energy).verdict is Verdict.UNSTABLE


def test_faults_say_what_is_wrong() -> None:
    with pytest.raises(InvalidOption, match="A has shape"):
        quadratic_lyapunov([[1.0, 2.0]], [[1.0]])
    with pytest.raises(InvalidOption, match="A is 2 x 2, P is 1 x 1"):
        quadratic_lyapunov(SPRING, [[1.0]])
    with pytest.raises(InvalidOption, match="not finite"):
        quadratic_lyapunov(SPRING, [[np.nan, 0.0], [0.0, 1.0]])
    with pytest.raises(InvalidOption, match="not a matrix of numbers"):
        quadratic_lyapunov([[1.0], [1.0, 2.0]], [[1.0]])
    with pytest.raises(InvalidOption, match="Q is not symmetric"):
        solve_lyapunov(SPRING, [[1.0, 1.0], [0.0, 1.0]])
    with pytest.raises(InvalidOption, match="add up to 0"):
        solve_lyapunov(HARMONIC, np.eye(2))
    with pytest.raises(InvalidOption, match="add up to 0"):
        solve_lyapunov(np.diag([1.0, -1.0, 3.0]), np.eye(3))
    with pytest.raises(InvalidOption, match="2 finite numbers"):
        quadratic_lyapunov(SPRING, CROSS).values([1.0, 2.0, 3.0])


def test_forms_are_written_as_people_write_them() -> None:
    assert form_text(np.array([[1.0, 0.5], [0.5, 1.0]])) == "x1² + x1 x2 + x2²"
    assert form_text(np.array([[-2.0, -0.5], [-0.5, 0.25]])) == "-2 x1² - x1 x2 + 0.25 x2²"
    assert form_text(np.array([[0.0, 1.0], [1.0, 0.0]])) == "2 x1 x2"
    assert form_text(np.zeros((2, 2))) == "0"
