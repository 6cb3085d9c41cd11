"""Lyapunov functions of linear and nonlinear systems on the wire."""

from typing import Annotated, ClassVar, Literal

from pydantic import ConfigDict, Field

from armwright_wire.base import (
    MAX_BATCH,
    Answer,
    Beside,
    Body,
    BodyWithRules,
    Matrix,
    NonNegative,
    Number,
    Positive,
    examples,
)

#: States of a linear system: more than any loop of an arm has.
MAX_STATES = 128

_Row = Annotated[list[Number], Field(min_length=1, max_length=MAX_STATES)]
SquareMatrix = Annotated[list[_Row], Field(min_length=1, max_length=MAX_STATES)]
#: A formula of x1 ... xn.
Formula = Annotated[str, Field(min_length=1, max_length=500)]


class PendulumParameters(Body):
    """A point mass on a rod: m l² dω/dt = −m g l sin θ − b ω, with x1 = θ and x2 = ω."""

    mass: Positive
    """m [kg]"""
    length: Positive
    """l [m]"""
    gravity: Positive = 9.81
    """g [m/s²]"""
    damping: NonNegative = 0.0
    """b [N m s/rad]"""


class LyapunovRequest(BodyWithRules):
    """A linear system dx/dt = A x with P of V = xᵀ P x or Q of dV/dt = −xᵀ Q x, or f and V.

    Formulas are made of numbers, x1 … xn, + - * / ** and sin, cos, tan, exp, log, sqrt, tanh.
    """

    one_of: ClassVar[tuple[str, ...]] = ("P", "Q", "V", "system")
    only_beside: ClassVar[Beside] = {
        "A": ("P", "Q"),
        "P": ("A",),
        "Q": ("A",),
        "f": ("V",),
        "V": ("f",),
        "system": ("parameters",),
        "parameters": ("system",),
    }

    model_config = ConfigDict(json_schema_extra={"examples": examples("LyapunovRequest")})

    A: SquareMatrix | None = None
    """rows"""
    P: SquareMatrix | None = None
    """rows; of one that is not symmetric the symmetric part is taken"""
    Q: SquareMatrix | None = None
    """rows, symmetric, in place of P: Aᵀ P + P A = −Q is solved for P"""
    f: Annotated[list[Formula], Field(min_length=1, max_length=8)] | None = None
    """formulas of dx/dt = f(x), one a state, in place of A; f(0) = 0"""
    V: Formula | None = None
    """formula of V(x), with V(0) = 0, beside f"""
    system: Literal["pendulum"] | None = None
    """by name, in place of f and V: its V is the energy"""
    parameters: PendulumParameters | None = None
    """of that system"""
    x: _Row | Annotated[list[_Row], Field(min_length=1, max_length=MAX_BATCH)] | None = None
    """a state, or a list of them, at which V and dV/dt are answered"""


class FormAnswer(Answer):
    """A quadratic form xᵀ S x."""

    matrix: Matrix
    """S, rows, symmetric"""
    minors: list[float]
    """leading principal minors: all positive exactly where S is positive definite"""
    eigenvalues: list[float]
    """ascending"""
    definiteness: Literal[
        "positive definite",
        "positive semidefinite",
        "zero",
        "indefinite",
        "negative semidefinite",
        "negative definite",
    ]
    """by the eigenvalues; below rounding error they count as 0"""


class Pole(Answer):
    """An eigenvalue of A."""

    real: float
    """part"""
    imaginary: float
    """part"""


class LasalleAnswer(Answer):
    """The set where dV/dt = 0, and what holds along motions that stay there."""

    set: list[str]
    """formulas that are 0 together where dV/dt = 0"""
    invariant: list[str]
    """formulas that are 0 too on motions that stay there: their derivatives along f"""


class LyapunovAnswer(Answer):
    """V = xᵀ P x with dV/dt = −xᵀ Q x, Q = −(Aᵀ P + P A); of formulas P and Q of second order."""

    f: list[str] | None = None
    """formulas of the system, where it has them"""
    P: FormAnswer
    Q: FormAnswer
    V: str = Field(examples=["x1² + x1 x2 + x2²"])
    """as a formula"""
    V_dot: str = Field(examples=["-x1² - x1 x2 - x2²"])
    """as a formula"""
    verdict: Literal["asymptotically_stable", "stable", "unstable", "nothing"]
    """what this V proves of the origin"""
    reason: str
    """the verdict as a sentence, with the theorem's conditions"""
    lasalle: LasalleAnswer | None = None
    """of a nonlinear V with dV/dt ≤ 0 that is not negative definite"""
    poles: list[Pole]
    """eigenvalues of A, of formulas the Jacobian of f at 0"""
    values: list[float] | float | None = None
    """V at the states x"""
    rates: list[float] | float | None = None
    """dV/dt at the states x"""
    notes: list[str]
    """a P that is not symmetric"""
