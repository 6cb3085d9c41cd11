"""Quadratic Lyapunov functions of linear systems."""

from armwright_client.base import Answer, Matrix, Request


class LyapunovRequest(Request):
    """A linear system dx/dt = A x, with P of V = x'Px or with Q of dV/dt = -x'Qx."""

    A: Matrix
    P: Matrix | None = None
    Q: Matrix | None = None
    x: list[float] | Matrix | None = None


class QuadraticForm(Answer):
    """A quadratic form x'Sx.

    Args:
        matrix: S, rows.
        minors: Leading principal minors.
        eigenvalues: Ascending.
        definiteness: "positive definite", "positive semidefinite", "indefinite", ...
    """

    matrix: Matrix
    minors: list[float]
    eigenvalues: list[float]
    definiteness: str


class Pole(Answer):
    """An eigenvalue of A."""

    real: float
    imaginary: float


class Lyapunov(Answer):
    """V = x'Px with dV/dt = -x'Qx, Q = -(A'P + PA).

    Args:
        P: The form V.
        Q: The form -dV/dt.
        V: As a formula.
        V_dot: As a formula.
        verdict: "asymptotically_stable", "stable", "unstable" or "nothing".
        reason: The verdict as a sentence.
        poles: Eigenvalues of A.
        values: V at the states that were sent.
        rates: dV/dt there.
        notes: A P that is not symmetric.
    """

    P: QuadraticForm
    Q: QuadraticForm
    V: str
    V_dot: str
    verdict: str
    reason: str
    poles: list[Pole]
    values: list[float] | float | None = None
    rates: list[float] | float | None = None
    notes: list[str]
