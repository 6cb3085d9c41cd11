"""Kinematics and dynamics of a robot as formulas."""

from typing import Literal

from armwright_client.base import Answer


class JointSymbol(Answer):
    """The variable of a joint.

    Args:
        joint: Its name.
        symbol: As the formulas write it.
        type: How it moves.
    """

    joint: str
    symbol: str
    type: Literal["revolute", "prismatic"]


class ParameterSymbol(Answer):
    """A number of the robot that the formulas call by a symbol.

    Args:
        symbol: As the formulas write it.
        value: [unit].
        unit: As "kg m^2".
        meaning: In words.
    """

    symbol: str
    value: float
    unit: str
    meaning: str


class Abbreviation(Answer):
    """A function that the formulas call by a short name, as c_12 for cos(q_1 + q_2)."""

    symbol: str
    formula: str


class PoseFormulas(Answer):
    """The pose of a link in the root frame.

    Args:
        link: The link.
        position: Three formulas.
        rotation_matrix: 3 x 3.
    """

    link: str
    position: list[str]
    rotation_matrix: list[list[str]]


class ChristoffelFormula(Answer):
    """A Christoffel symbol c_ijk = c_jik that is not 0; joints count from 1."""

    i: int
    j: int
    k: int
    formula: str


class RegressorFormulas(Answer):
    """tau = Y(q, q_dot, q_ddot) Theta.

    Args:
        regressor: Y, n x p.
        parameters: Theta, p.
        values: Of the parameters.
    """

    regressor: list[list[str]]
    parameters: list[str]
    values: list[float]


class MotionFormulas(Answer):
    """The terms of the equations of motion.

    Args:
        equation: The terms that this robot has.
        mass_matrix: D, n x n.
        christoffel_symbols: Those with i <= j that are not 0; None for more than four joints.
        coriolis_matrix: C, n x n.
        potential_energy: U.
        gravity: G, n.
        regressor: None for more than four joints.
    """

    equation: str
    mass_matrix: list[list[str]]
    christoffel_symbols: list[ChristoffelFormula] | None = None
    coriolis_matrix: list[list[str]]
    potential_energy: str
    gravity: list[str]
    regressor: RegressorFormulas | None = None


class EquationsAnswer(Answer):
    """Kinematics and dynamics of a robot as formulas in LaTeX or plain text.

    Args:
        format: The form of the formulas; plain text can be evaluated by Python.
        convention: Of the Denavit-Hartenberg table.
        joints: Their variables.
        parameters: The numbers that formulas use.
        abbreviations: The functions that formulas use.
        transformations: H_i of frame i in frame i - 1, each 4 x 4.
        pose: Of the tip.
        jacobian: Of the tip's origin, 6 x n, linear rows first.
        dynamics: None where the formulas are left out.
        notes: What is left out, and why.
        document: All of it on one page.
    """

    format: Literal["latex", "text"]
    convention: Literal["standard", "modified"]
    joints: list[JointSymbol]
    parameters: list[ParameterSymbol]
    abbreviations: list[Abbreviation]
    transformations: list[list[list[str]]]
    pose: PoseFormulas
    jacobian: list[list[str]]
    dynamics: MotionFormulas | None = None
    notes: list[str]
    document: str
