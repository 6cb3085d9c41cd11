"""Lectures 29 and 30, and the final of the review: Lyapunov functions and LaSalle's principle."""

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
import sympy as sp
from scipy.linalg import solve_continuous_lyapunov

from tests.course.exam.arms import Array
from tests.course.exam.question import Question, holds

#: Nonlinear systems: f, V, a state, and the verdict of lectures 29 and 30.
NONLINEAR: list[tuple[list[str], str, str]] = [
    (["x2", "-0.8*x2 - 4.9*sin(x1)"], "x2**2/2 + 4.9*(1 - cos(x1))", "asymptotically_stable"),
    (["x2", "-9.81/0.7*sin(x1)"], "x2**2/2 + 9.81/0.7*(1 - cos(x1))", "stable"),
    (["x2", "-x1**3 - x2"], "x1**4/4 + x2**2/2", "asymptotically_stable"),
    (["x2", "-x1 - x2**3"], "x1**2/2 + x2**2/2", "asymptotically_stable"),
    (["-x1 - x1**3 + x2", "-x1 - 2*x2"], "x1**2/2 + x2**2/2", "asymptotically_stable"),
    (["x2", "x1 - x2"], "x1**2/2 + x2**2/2", "nothing"),
]
STATE = [0.6, -0.4]


def definite(P: Array) -> str:
    """Definiteness by eigenvalues."""
    values = np.linalg.eigvalsh(P)
    low, high = values[0], values[-1]
    if abs(low) < 1e-10:
        return "positive semidefinite" if high > 1e-10 else "zero"
    return "positive definite" if low > 0 else "negative definite" if high < 0 else "indefinite"


def nonlinear(f: list[str], V: str) -> Array:
    """V and V̇ = ∂V/∂x f at the state, by sympy."""
    x = sp.symbols("x1 x2")
    value = sp.sympify(V)
    rate = sum(sp.diff(value, one) * sp.sympify(part) for one, part in zip(x, f, strict=True))
    at = dict(zip(x, STATE, strict=True))
    return np.array([float(value.subs(at)), float(rate.subs(at))])


def hessian(f: list[str], V: str) -> Array:
    """Second derivatives of −V̇ at the origin."""
    x = sp.symbols("x1 x2")
    rate = sum(
        sp.diff(sp.sympify(V), one) * sp.sympify(part) for one, part in zip(x, f, strict=True)
    )
    return np.array(sp.hessian(-rate, x).subs(dict.fromkeys(x, 0)), dtype=float)


def ask(lecture: int, kind: str, body: Any, pick: Any, right: Any, **more: Any) -> Question:
    return Question(lecture, kind, "lyapunov", body, pick, right, **more)


def values(found: Any) -> Any:
    return [found["values"], found["rates"]]


def linear(rng: np.random.Generator) -> Iterator[Question]:
    """Quadratic forms of linear systems."""
    for n in (2, 2, 3, 4):
        (A, G), x = rng.normal(size=(2, n, n)), rng.normal(size=n)
        A, P = A - (np.linalg.eigvals(A).real.max() + 0.5) * np.eye(n), G @ G.T + 0.1 * np.eye(n)
        Q, body = -(A.T @ P + P @ A), {"A": A, "P": P, "x": x}
        minors = [np.linalg.det(P[:k, :k]) for k in range(1, n + 1)]
        solved = solve_continuous_lyapunov(A.T, -np.eye(n))
        yield ask(29, "V and its rate", body, values, [x @ P @ x, 2 * x @ P @ A @ x])
        yield ask(29, "Q = -(A' P + P A)", body, "Q.matrix", Q)
        yield ask(29, "definiteness of Q", body, "Q.definiteness", definite(Q))
        yield ask(30, "leading minors of P", body, "P.minors", minors)
        body = {"A": A, "Q": np.eye(n)}
        yield ask(30, "P of the Lyapunov equation", body, "P.matrix", solved)
    for m, k, b in ((1.0, 2.0, 0.5), (2.0, 7.0, 0.0), (0.5, 3.0, 4.0)):
        body = {"A": [[0.0, 1.0], [-k / m, -b / m]], "P": [[k / 2, 0], [0, m / 2]]}
        right = "asymptotically_stable" if b else "stable"
        yield ask(30, "energy of a mass on a spring, LaSalle", body, "verdict", right)
    body = {"A": [[0, 1], [2, -1]], "Q": [[1, 0], [0, 1]]}
    yield ask(29, "an unstable system", body, "P.definiteness", "indefinite")


def questions(rng: np.random.Generator) -> Iterator[Question]:
    yield from linear(rng)
    for f, V, verdict in NONLINEAR:
        body, right = {"f": f, "V": V, "x": STATE}, partial(nonlinear, f, V)
        yield ask(30, "nonlinear V and its rate", body, values, right, issue=6)
        yield ask(30, "verdict of a nonlinear V", body, "verdict", verdict, issue=6)
        more = {"compare": holds, "issue": 6}
        if verdict == "asymptotically_stable" and definite(hessian(f, V)) != "positive definite":
            yield ask(30, "LaSalle's principle is named", body, "reason", "LaSalle", **more)
