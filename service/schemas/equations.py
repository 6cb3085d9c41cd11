"""Equations of a robot as formulas, on the wire."""

from typing import Literal

from pydantic import Field

from service.schemas.base import Answer

Formula = str
FormulaMatrix = list[list[Formula]]


class JointSymbol(Answer):
    """The variable of a joint."""

    joint: str
    symbol: Formula = Field(examples=["q_{1}"])
    type: Literal["revolute", "prismatic"]


class ParameterSymbol(Answer):
    """A number of the robot that the formulas call by a symbol."""

    symbol: Formula = Field(examples=["l_{c2}"])
    value: float
    unit: str = Field(examples=["m"])
    meaning: str = Field(examples=["from axis 2 to the centre of mass of link 2"])


class Abbreviation(Answer):
    """A function that the formulas call by a short name."""

    symbol: Formula = Field(examples=["c_{12}"])
    formula: Formula = Field(examples=[r"\cos\left(q_{1} + q_{2}\right)"])


class PoseFormulas(Answer):
    """The pose of a link in the root frame."""

    link: str
    position: list[Formula]
    rotation_matrix: FormulaMatrix


class ChristoffelFormula(Answer):
    """A Christoffel symbol c_ijk = c_jik that is not 0."""

    i: int
    j: int
    k: int
    formula: Formula


class RegressorFormulas(Answer):
    """τ = Y(q, q̇, q̈) Θ with the fewest parameters."""

    regressor: FormulaMatrix = Field(description="Y, n x p")
    parameters: list[Formula] = Field(description="Θ, p combinations of masses and lengths")
    values: list[float] = Field(description="of the parameters")


class MotionFormulas(Answer):
    """The terms of (D + J) q̈ + C q̇ + B q̇ + F f + G = τ."""

    equation: Formula = Field(description="the terms that this robot has")
    mass_matrix: FormulaMatrix = Field(description="D, n x n")
    christoffel_symbols: list[ChristoffelFormula] | None = Field(
        None, description="those with i ≤ j that are not 0; null for more than four joints"
    )
    coriolis_matrix: FormulaMatrix = Field(description="C, n x n")
    potential_energy: Formula = Field(
        description="U; 0 where all masses lie at the origin of frame 0"
    )
    gravity: list[Formula] = Field(description="G = ∂U/∂q, n")
    regressor: RegressorFormulas | None = Field(None, description="null for more than four joints")


class EquationsAnswer(Answer):
    """Kinematics and dynamics of a robot as formulas in LaTeX or plain text.

    Plain text is an expression that Python and sympy evaluate.
    """

    format: Literal["latex", "text"]
    convention: Literal["standard", "modified"]
    joints: list[JointSymbol]
    parameters: list[ParameterSymbol]
    abbreviations: list[Abbreviation]
    transformations: list[FormulaMatrix] = Field(description="H_i of frame i in frame i − 1, 4 x 4")
    pose: PoseFormulas
    jacobian: FormulaMatrix = Field(
        description="of the origin of that link, 6 x n, linear rows first"
    )
    dynamics: MotionFormulas | None = Field(
        None, description="null where the formulas would be too long or there are no inertias"
    )
    notes: list[str] = Field(description="what is left out, and why")
    document: str = Field(description="all of it on one page: LaTeX, or plain text")
