"""Nonlinear Lyapunov functions: rates by sympy, verdicts by theory, motions by scipy."""

from typing import Any

import numpy as np
import pytest
import sympy
from scipy.integrate import solve_ivp

from kinematics.errors import InvalidOption
from tracking.controllers.nonlinear_form import NonlinearLyapunov, nonlinear_lyapunov
from tracking.controllers.quadratic_form import Verdict, quadratic_lyapunov
from tracking.controllers.state_formulas import read_formula, write

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
