"""Equations of a robot as formulas, on the wire."""

from typing import Literal

from pydantic import Field

from armwright_wire.base import Answer

Formula = str
FormulaMatrix = list[list[Formula]]


class JointSymbol(Answer):
    """The variable of a joint."""

    joint: str = Field(description="name of the joint")
    symbol: Formula = Field(examples=["q_{1}"], description="of its variable")
    type: Literal["revolute", "prismatic"] = Field(description="kind of joint")


class ParameterSymbol(Answer):
    """A number of the robot that the formulas call by a symbol."""

    symbol: Formula = Field(examples=["l_{c2}"], description="in the formulas")
    value: float = Field(description="of this robot")
    unit: str = Field(examples=["m"], description="of the value")
    meaning: str = Field(
        examples=["from axis 2 to the centre of mass of link 2"], description="of the symbol"
    )


class Abbreviation(Answer):
    """A function that the formulas call by a short name."""

    symbol: Formula = Field(examples=["c_{12}"], description="short name in the formulas")
    formula: Formula = Field(
        examples=[r"\cos\left(q_{1} + q_{2}\right)"], description="what it stands for"
    )


class PoseFormulas(Answer):
    """The pose of a link in the root frame."""

    link: str = Field(description="the link meant")
    position: list[Formula] = Field(description="of its origin, x, y, z [m]")
    rotation_matrix: FormulaMatrix = Field(description="of its frame, rows")


class ChristoffelFormula(Answer):
    """A Christoffel symbol c_ijk = c_jik that is not 0."""

    i: int = Field(description="first joint, counted from 1")
    j: int = Field(description="second joint")
    k: int = Field(description="joint whose equation the symbol stands in")
    formula: Formula = Field(description="c_ijk of the joint variables")


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

    format: Literal["latex", "text"] = Field(description="of all formulas")
    convention: Literal["standard", "modified"] = Field(
        description="of the table whose frames the formulas use"
    )
    joints: list[JointSymbol] = Field(description="the joint variables, in their order")
    parameters: list[ParameterSymbol] = Field(description="symbols for numbers of the robot")
    abbreviations: list[Abbreviation] = Field(
        description="short names for functions that come often"
    )
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
