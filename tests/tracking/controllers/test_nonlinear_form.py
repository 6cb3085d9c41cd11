"""Lyapunov functions, quadratic and by formulas, against sympy, scipy and the theorems."""

from typing import Any

import numpy as np
import pytest
import sympy
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from tracking.controllers.nonlinear_form import NonlinearLyapunov, nonlinear_lyapunov
from tracking.controllers.quadratic_form import (
    Definiteness,
    Verdict,
    form_text,
    quadratic_lyapunov,
    solve_lyapunov,
    symmetric_form,
)
from tracking.controllers.state_formulas import read_formula, values, write

ENERGY = "x2**2/2 + 4.9*(1 - cos(x1))"
NORM = "x1**2 + x2**2"
#: System, V, verdict, a word of the reason.
CASES: list[tuple[list[str], str, str, str]] = [
    (["x2", "-0.8*x2 - 4.9*sin(x1)"], ENERGY, "asymptotically_stable", "LaSalle"),
    (["x2", "-4.9*sin(x1)"], ENERGY, "stable", "0 everywhere"),
    (["x2", "0.8*x2 - 4.9*sin(x1)"], ENERGY, "nothing", "V_dot is"),
    (["x2", "-x1**3 - x2"], "x2**2/2 + x1**4/4", "asymptotically_stable", "LaSalle"),
    (["x2", "-x1 - x2*(1 - x1**2)"], NORM, "asymptotically_stable", "LaSalle"),
    (["x2", "-x1 + x2*(1 - x1**2)"], NORM, "nothing", "V_dot is 2e-06 at x = [0, 0.001]"),
    (["x2", "-x1 - tanh(x2)"], NORM, "asymptotically_stable", "LaSalle"),
    (["-x1 + x2**3", "-x1*x2**2 - x2"], NORM, "asymptotically_stable", "negative definite"),
    (["-x1**3", "-x2"], NORM, "asymptotically_stable", "negative definite"),
    (["x2 - x1*(x1**2 + x2**2)", "-x1 - x2*(x1**2 + x2**2)"], NORM, "asymptotically_stable",
     "negative definite"),
    (["x1 + x2**3", "-x2"], "x2**2 - x1**2", "unstable", "instability"),
    (["x1", "x2**3"], "x1**2 + x2**2", "unstable", "instability"),
    (["-x1", "0"], NORM, "stable", "not shown"),
    (["-x1", "-x2"], "x1**2", "nothing", "not shown to be positive definite"),
    (["-x1", "-x2"], "x1 + x2**2", "nothing", "V is -0.001 at x = [-0.001, 0]"),
    (["x2", "(-sin(x1) - x2)/(1 + sin(x1)**2)"], "x2**2*(1 + sin(x1)**2)/2 + 1 - cos(x1)",
     "asymptotically_stable", "LaSalle"),
    (["x2", "-x1 - x2", "-x3**5"], "x1**2 + x2**2 + x3**2", "asymptotically_stable", "LaSalle"),
]  # fmt: skip


def examine(f: list[str], V: str) -> NonlinearLyapunov:
    n = len(f)
    return nonlinear_lyapunov([read_formula("f", text, n) for text in f], read_formula("V", V, n))


@pytest.mark.parametrize(("f", "V", "verdict", "word"), CASES)
def test_verdicts_are_those_of_the_theorems(f: list[str], V: str, verdict: str, word: str) -> None:
    found = examine(f, V)
    assert found.verdict == verdict
    assert found.reason.startswith(verdict.replace("_", " "))
    assert word in found.reason
    assert (found.zeros is not None) == ("LaSalle" in found.reason or "everywhere" in found.reason)


@pytest.mark.parametrize(("f", "V", "verdict", "word"), CASES)
def test_rates_are_those_of_sympy(f: list[str], V: str, verdict: str, word: str) -> None:
    x = sympy.symbols(f"x1:{len(f) + 1}")
    rate = sum(
        sympy.diff(sympy.sympify(V), a) * sympy.sympify(b) for a, b in zip(x, f, strict=True)
    )
    assert sympy.simplify(sympy.sympify(write(examine(f, V).V_dot)) - sympy.nsimplify(rate)) == 0
    states = np.random.default_rng(1).uniform(-0.8, 0.8, (10, len(f)))
    values, rates = examine(f, V).values(states)
    np.testing.assert_allclose(values, sympy.lambdify(x, V)(*states.T), atol=1e-14)
    expected = np.broadcast_to(sympy.lambdify(x, rate)(*states.T), 10)
    np.testing.assert_allclose(rates, expected, atol=1e-14)


@pytest.mark.parametrize(("f", "V", "verdict", "word"), CASES)
def test_motions_do_what_the_verdict_says(f: list[str], V: str, verdict: str, word: str) -> None:
    rate: Any = sympy.lambdify(
        [sympy.symbols(f"x1:{len(f) + 1}")], [sympy.sympify(one) for one in f]
    )
    start = np.full(len(f), 0.05)
    motion = solve_ivp(lambda _, x: rate(x), (0.0, 60.0), start, rtol=1e-9, atol=1e-12,
                       events=lambda _, x: np.abs(x).max() - 0.8).y  # fmt: skip
    size = np.abs(motion).max(axis=0)
    if verdict == "asymptotically_stable":
        energy = sympy.lambdify(sympy.symbols(f"x1:{len(f) + 1}"), V)(*motion)
        assert energy[-1] < 0.9 * energy[0]
        assert size.max() < 0.3
    elif verdict == "stable":
        assert size.max() < 0.3
    elif verdict == "unstable":
        assert size.max() > 0.5


def test_the_pendulum_has_its_sets() -> None:
    found = examine(*CASES[0][:2])
    assert write(found.V_dot) == "-0.8*x2**2"
    assert [write(one) for one in found.zeros or ()] == ["x2"]
    assert [write(one) for one in found.invariant] == ["sin(x1)"]
    np.testing.assert_allclose(found.P.matrix, [[2.45, 0.0], [0.0, 0.5]])
    np.testing.assert_allclose(found.poles, np.roots([1.0, 0.8, 4.9])[::-1], atol=1e-12)


@pytest.mark.parametrize("seed", range(12))
def test_linear_systems_have_the_verdicts_of_their_quadratic_forms(seed: int) -> None:
    rng = np.random.default_rng(seed)
    A = rng.integers(-2, 3, (2, 2)).astype(float) - seed % 3 * np.eye(2)
    P = np.diag(rng.integers(1, 3, 2)).astype(float)
    known = quadratic_lyapunov(A, P)
    f = [f"{row[0]}*x1 + {row[1]}*x2" for row in A.tolist()]
    found = examine(f, f"{P[0, 0]}*x1**2 + {P[1, 1]}*x2**2")
    np.testing.assert_allclose(found.P.matrix, known.P.matrix, atol=1e-12)
    np.testing.assert_allclose(found.Q.matrix, known.Q.matrix, atol=1e-12)
    np.testing.assert_allclose(found.poles, known.poles, atol=1e-12)
    expected = {
        Verdict.ASYMPTOTICALLY_STABLE: "asymptotically_stable",
        Verdict.STABLE_BY_LASALLE: "asymptotically_stable",
        Verdict.STABLE: "stable",
        Verdict.NO_FALL: "nothing",
    }[known.verdict]
    # A positive definite V_dot proves instability, which the quadratic form leaves open.
    assert found.verdict in {expected, "unstable"}
    assert (found.verdict == "unstable") == (np.linalg.eigvalsh(known.Q.matrix)[-1] < -1e-12)


@pytest.mark.parametrize(
    ("f", "V", "fault"),
    [
        (["x2 + 1", "-x1"], NORM, r"f\[0\] is 1 at x = 0, so x = 0 is no equilibrium"),
        (["x2", "-x1"], "cos(x1)", "V is 1 at x = 0"),
        (["x2", "-x1 + log(x2)"], NORM, r"f\[1\] is not a finite number all around"),
        (["x2", "-x1"], "x1**2 + x2**2 + x1**2.5", "V is not a finite number all around"),
        (["x2", "-x1"], "sqrt(x1**2 + x2**2)", "derivatives of V are no finite numbers"),
    ],
)
def test_what_theorems_do_not_cover_is_refused(f: list[str], V: str, fault: str) -> None:
    with pytest.raises(InvalidOption, match=fault):
        examine(f, V)
    with pytest.raises(InvalidOption, match=r"V is not a finite number at x = \[-2"):
        examine(["-x1"], "log(1 + x1)**2").values(np.array([[0.5], [-2.0]]))


def test_the_largest_formulas_are_examined_within_seconds() -> None:
    total = "+".join(f"x{i}" for i in range(1, 9))
    found = examine([f"({total})**16", *(f"-x{i}" for i in range(2, 9))], f"({total})**16")
    assert found.verdict == "nothing"


#: The damped mass on a spring of the notes with k = m = b = 1.
SPRING = np.array([[0.0, 1.0], [-1.0, -1.0]])
HARMONIC = np.array([[0.0, 1.0], [-1.0, 0.0]])


def random_system(seed: int, n: int = 4) -> Array:
    A = np.random.default_rng(seed).normal(size=(n, n))
    return np.asarray(A - (0.3 + np.linalg.eigvals(A).real.max()) * np.eye(n))


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


def test_verdicts_are_those_of_the_theorems_of_quadratic_form() -> None:
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


def test_forms_are_written_as_people_write_them() -> None:
    assert form_text(np.array([[1.0, 0.5], [0.5, 1.0]])) == "x1² + x1 x2 + x2²"
    assert form_text(np.array([[-2.0, -0.5], [-0.5, 0.25]])) == "-2 x1² - x1 x2 + 0.25 x2²"
    assert form_text(np.array([[0.0, 1.0], [1.0, 0.0]])) == "2 x1 x2"
    assert form_text(np.zeros((2, 2))) == "0"


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
