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

    mass: Positive = Field(description="m [kg]")
    length: Positive = Field(description="l [m]")
    gravity: Positive = Field(9.81, description="g [m/s²]")
    damping: NonNegative = Field(0.0, description="b [N m s/rad]")


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

    A: SquareMatrix | None = Field(None, description="rows")
    P: SquareMatrix | None = Field(
        None, description="rows; of one that is not symmetric the symmetric part is taken"
    )
    Q: SquareMatrix | None = Field(
        None, description="rows, symmetric, in place of P: Aᵀ P + P A = −Q is solved for P"
    )
    f: Annotated[list[Formula], Field(min_length=1, max_length=8)] | None = Field(
        None, description="formulas of dx/dt = f(x), one a state, in place of A; f(0) = 0"
    )
    V: Formula | None = Field(None, description="formula of V(x), with V(0) = 0, beside f")
    system: Literal["pendulum"] | None = Field(
        None, description="by name, in place of f and V: its V is the energy"
    )
    parameters: PendulumParameters | None = Field(None, description="of that system")
    x: _Row | Annotated[list[_Row], Field(min_length=1, max_length=MAX_BATCH)] | None = Field(
        None, description="a state, or a list of them, at which V and dV/dt are answered"
    )


class FormAnswer(Answer):
    """A quadratic form xᵀ S x."""

    matrix: Matrix = Field(description="S, rows, symmetric")
    minors: list[float] = Field(
        description="leading principal minors: all positive exactly where S is positive definite"
    )
    eigenvalues: list[float] = Field(description="ascending")
    definiteness: Literal[
        "positive definite",
        "positive semidefinite",
        "zero",
        "indefinite",
        "negative semidefinite",
        "negative definite",
    ] = Field(description="by the eigenvalues; below rounding error they count as 0")


class Pole(Answer):
    """An eigenvalue of A."""

    real: float = Field(description="part")
    imaginary: float = Field(description="part")


class LasalleAnswer(Answer):
    """The set where dV/dt = 0, and what holds along motions that stay there."""

    set: list[str] = Field(description="formulas that are 0 together where dV/dt = 0")
    invariant: list[str] = Field(
        description="formulas that are 0 too on motions that stay there: their derivatives along f"
    )


class LyapunovAnswer(Answer):
    """V = xᵀ P x with dV/dt = −xᵀ Q x, Q = −(Aᵀ P + P A); of formulas P and Q of second order."""

    f: list[str] | None = Field(None, description="formulas of the system, where it has them")
    P: FormAnswer
    Q: FormAnswer
    V: str = Field(description="as a formula", examples=["x1² + x1 x2 + x2²"])
    V_dot: str = Field(description="as a formula", examples=["-x1² - x1 x2 - x2²"])
    verdict: Literal["asymptotically_stable", "stable", "unstable", "nothing"] = Field(
        description="what this V proves of the origin"
    )
    reason: str = Field(description="the verdict as a sentence, with the theorem's conditions")
    lasalle: LasalleAnswer | None = Field(
        None, description="of a nonlinear V with dV/dt ≤ 0 that is not negative definite"
    )
    poles: list[Pole] = Field(description="eigenvalues of A, of formulas the Jacobian of f at 0")
    values: list[float] | float | None = Field(None, description="V at the states x")
    rates: list[float] | float | None = Field(None, description="dV/dt at the states x")
    notes: list[str] = Field(description="a P that is not symmetric")
