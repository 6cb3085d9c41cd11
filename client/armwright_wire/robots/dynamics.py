"""Equations of motion, their linear parametrisation, statics and formulas, on the wire."""

from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from armwright_wire.base import (
    JOINTS_EXAMPLE,
    MAX_BATCH,
    Answer,
    BodyWithRules,
    Frame,
    InFrame,
    Joints,
    Label,
    Matrix,
    NonNegative,
    Point,
    Vector3,
    Vector6,
)
from armwright_wire.robots.kinematics import TaskAxes, TaskVector, check_task_vectors
from armwright_wire.robots.payload import Payload
from armwright_wire.scenes.tool import WithTool

RATES_EXAMPLE = [0.1, -0.2, 0.3, 0.1, 0.0, -0.1, 0.2]

#: One row for each configuration, or the same for all.
Wrenches = Vector6 | Annotated[list[Vector6], Field(min_length=1, max_length=MAX_BATCH)]


class Model(WithTool):
    """Configurations, and changes of the robot's model: payload, motors, friction, gravity."""

    joints: Joints = Field(examples=[JOINTS_EXAMPLE])
    gravity: Vector3 | None = Field(
        None, description="in the frame [m/s²]; the robot's own if left out"
    )
    frame: Frame | None = None
    payload: Payload | None = None
    motor_inertia: NonNegative | list[NonNegative] | None = Field(
        None, description="J, reflected at the joints [kg m² or kg]; the robot's own if left out"
    )
    viscous_friction: NonNegative | list[NonNegative] | None = Field(
        None, description="B at the joints [N m s/rad or N s/m]; the robot's own if left out"
    )
    coulomb_friction: NonNegative | list[NonNegative] | None = Field(
        None, description="dry friction F at the joints [N m or N]; the robot's own if left out"
    )


class WrenchRequest(WithTool, BodyWithRules):
    """A wrench that the tip exerts on its surroundings, or the joint torques that it takes."""

    one_of: ClassVar[tuple[str, ...]] = ("wrench", "torques")

    joints: Joints = Field(examples=[JOINTS_EXAMPLE])
    wrench: (
        TaskVector | Annotated[list[TaskVector], Field(min_length=1, max_length=MAX_BATCH)] | None
    ) = Field(
        None,
        description="force [N] and moment [N m] along the axes of the frame, a number for each",
        examples=[[0.0, 0.0, -10.0, 0.0, 0.0, 0.5]],
    )
    torques: Joints | None = Field(
        None, description="torques or forces of the joints whose wrench is asked for [N m or N]"
    )
    axes: TaskAxes | None = Field(
        None,
        description="parts of the wrench that may differ from 0: forces along x, y, z and moments "
        "about rx, ry, rz of the frame; all six if left out",
        examples=[["x", "y", "z"]],
    )
    link: Label | None = Field(None, description="the tip if left out")
    point: Point | None = Field(None, description="where on the link, in its frame [m]")
    frame: Frame | None = None

    @model_validator(mode="after")
    def _one_of_two(self) -> Self:
        check_task_vectors(self.wrench, self.axes, "wrench")
        return self


class WrenchAnswer(InFrame):
    """τ = Jᵀ F; with many configurations a list of them."""

    torques: list[float] | Matrix = Field(description="[N m or N]")
    wrench: list[float] | Matrix | None = Field(
        None,
        description="of torques: the wrench of least length with Jᵀ F = τ, as nearly as can be, a "
        "number for each axis that counts [N, N m]",
    )
    residual: list[float] | Matrix | None = Field(
        None, description="of torques: τ − Jᵀ F, which no wrench at this point causes [N m or N]"
    )


class DynamicsRequest(Model):
    """States whose equations of motion are asked for."""

    velocities: Joints | None = Field(None, description="0 if left out", examples=[RATES_EXAMPLE])
    accelerations: Joints | None = Field(
        None, description="0 if left out", examples=[RATES_EXAMPLE]
    )
    wrench: Wrenches | None = Field(
        None, description="that the tip exerts on its surroundings, along the frame's axes [N, N m]"
    )
    christoffel_symbols: bool = Field(False, description="answer c_ijk too")
    partial_jacobians: bool = Field(False, description="answer J_v and J_ω of every body too")


class PartialJacobian(Answer):
    """Jacobians of the body that moves with a joint; with many configurations each is a list."""

    joint: str = Field(description="joint that moves the body")
    linear: Matrix | list[Matrix] = Field(
        description="J_v of the body's centre of mass, 3 x n, in the frame"
    )
    angular: Matrix | list[Matrix] = Field(description="J_ω of the body, 3 x n, in the frame")


class DynamicsAnswer(InFrame):
    """(D + J) q̈ + C q̇ + B q̇ + G + Jᵀ F = τ; with many configurations each field is a list."""

    mass_matrix: Matrix | list[Matrix] = Field(description="D of the links, n x n")
    coriolis_matrix: Matrix | list[Matrix] = Field(
        description="C by Christoffel symbols, n x n: dD/dt − 2 C is skew-symmetric"
    )
    gravity: list[float] | Matrix = Field(description="G, n [N m or N]")
    torques: list[float] | Matrix = Field(description="τ, n [N m or N]")
    motor_inertia: list[float] = Field(description="J, n; 0 where the robot gives none")
    viscous_friction: list[float] = Field(description="B, n; 0 where the robot gives none")
    coulomb_friction: list[float] = Field(
        description="dry friction F, n: the torque is F tanh(q̇ / v) with v = 0.01 rad/s or m/s"
    )
    kinetic_energy: float | list[float] = Field(description="with the motors' part [J]")
    potential_energy: float | list[float] = Field(description="[J]")
    christoffel_symbols: list[Matrix] | list[list[Matrix]] | None = Field(
        None,
        description="on request: [i][j][k] is c_ijk = (∂d_kj/∂q_i + ∂d_ki/∂q_j − ∂d_ij/∂q_k)/2",
    )
    partial_jacobians: list[PartialJacobian] | None = Field(
        None, description="on request, of every body; links on fixed joints are part of a body"
    )


class ForwardDynamicsRequest(Model):
    """States and torques whose accelerations are asked for."""

    velocities: Joints | None = Field(None, description="0 if left out", examples=[RATES_EXAMPLE])
    torques: Joints | None = Field(
        None, description="τ of the joints; 0 if left out [N m or N]", examples=[RATES_EXAMPLE]
    )
    wrench: Wrenches | None = Field(
        None, description="that the tip exerts on its surroundings, along the frame's axes [N, N m]"
    )


class ForwardDynamicsAnswer(InFrame):
    """q̈ = (D + J)⁻¹ (τ − C q̇ − B q̇ − G − Jᵀ F); with many states a list of them."""

    accelerations: list[float] | Matrix = Field(description="q̈, n [rad/s² or m/s²]")


class RegressorRequest(Model):
    """States in motion."""

    velocities: Joints = Field(examples=[RATES_EXAMPLE])
    accelerations: Joints = Field(examples=[RATES_EXAMPLE])
    reference_velocities: Joints | None = Field(
        None, description="v of Y(q, q̇, a, v), with accelerations as a; q̇ if left out"
    )
    motors: bool | None = Field(
        None,
        description="with motor inertias and viscous frictions among the parameters; by default "
        "where the robot has any",
    )
    known_zeros: bool = Field(
        False,
        description="count parameters that are exactly 0 in this robot as known, so that fewer "
        "base parameters remain",
    )


class BaseParameter(Answer):
    """A combination of parameters that motion can tell from all others."""

    name: str = Field(
        examples=["Izz1 + Iyy2 + 0.25 m2"], description="the combination, as a formula"
    )
    value: float = Field(description="of this robot, in SI units")
    column: int = Field(description="the column of the regressor that it is multiplied with")


class RegressorAnswer(InFrame):
    """τ = Y Θ = Y_b β; with many states the regressors are lists."""

    regressor: Matrix | list[Matrix] = Field(description="Y, n x p")
    parameters: list[float] = Field(
        description="Θ: ten a joint (m, m c, inertia about the joint frame's origin), then motors"
    )
    parameter_names: list[str] = Field(
        examples=[["m1", "mx1", "my1", "mz1", "Ixx1"]], description="of Θ, in its order"
    )
    base_parameters: list[BaseParameter] = Field(description="β, the fewest there can be")
    base_regressor: Matrix | list[Matrix] = Field(description="Y_b: the columns of Y for β")
    torques: list[float] | Matrix = Field(description="Y Θ, n [N m or N]")


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
    determinant: str | None = Field(
        None, description="of the rows of the Jacobian that `axes` names: 0 at the singularities"
    )
    dynamics: MotionFormulas | None = Field(
        None, description="null where the formulas would be too long or there are no inertias"
    )
    notes: list[str] = Field(description="what is left out, and why")
    document: str = Field(description="all of it on one page: LaTeX, or plain text")
