"""Quadratic Lyapunov functions of linear systems on the wire."""

from typing import Annotated, ClassVar, Literal

from pydantic import ConfigDict, Field, model_validator
from pydantic.config import JsonDict

from armwright_wire.base import MAX_BATCH, Answer, Body, Matrix, Number, exactly_one

#: States of a linear system: more than any loop of an arm has.
MAX_STATES = 128

_Row = Annotated[list[Number], Field(min_length=1, max_length=MAX_STATES)]
SquareMatrix = Annotated[list[_Row], Field(min_length=1, max_length=MAX_STATES)]

_EXAMPLE: JsonDict = {
    "A": [[0.0, 1.0], [-1.0, -1.0]],
    "P": [[1.0, 0.5], [0.5, 1.0]],
    "x": [0.5, 0.0],
}


class LyapunovRequest(Body):
    """A linear system dx/dt = A x, with P of V = xᵀ P x or with Q of dV/dt = −xᵀ Q x."""

    one_of: ClassVar[tuple[str, ...]] = ("P", "Q")

    model_config = ConfigDict(json_schema_extra={"examples": [_EXAMPLE]})

    A: SquareMatrix = Field(description="rows")
    P: SquareMatrix | None = Field(
        None, description="rows; of one that is not symmetric the symmetric part is taken"
    )
    Q: SquareMatrix | None = Field(
        None, description="rows, symmetric, in place of P: Aᵀ P + P A = −Q is solved for P"
    )
    x: _Row | Annotated[list[_Row], Field(min_length=1, max_length=MAX_BATCH)] | None = Field(
        None, description="a state, or a list of them, at which V and dV/dt are answered"
    )

    @model_validator(mode="after")
    def _check_form(self) -> "LyapunovRequest":
        exactly_one(self, self.one_of)
        return self


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


class LyapunovAnswer(Answer):
    """V = xᵀ P x with dV/dt = −xᵀ Q x, Q = −(Aᵀ P + P A)."""

    P: FormAnswer
    Q: FormAnswer
    V: str = Field(description="as a formula", examples=["x1² + x1 x2 + x2²"])
    V_dot: str = Field(description="as a formula", examples=["-x1² - x1 x2 - x2²"])
    verdict: Literal["asymptotically_stable", "stable", "unstable", "nothing"] = Field(
        description="what this V proves of the origin"
    )
    reason: str = Field(description="the verdict as a sentence, with the theorem's conditions")
    poles: list[Pole] = Field(description="eigenvalues of A, for comparison")
    values: list[float] | float | None = Field(None, description="V at the states x")
    rates: list[float] | float | None = Field(None, description="dV/dt at the states x")
    notes: list[str] = Field(description="a P that is not symmetric")
