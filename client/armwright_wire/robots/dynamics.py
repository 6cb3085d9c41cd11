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
    Matrix,
    NonNegative,
    Point,
    Vector3,
    Vector6,
)
from armwright_wire.robots.kinematics import (
    TaskAxes,
    TaskVector,
    WithHeldFrames,
    check_task_vectors,
)
from armwright_wire.robots.payload import Payload
from armwright_wire.scenes.tool import WithTool

RATES_EXAMPLE = [0.1, -0.2, 0.3, 0.1, 0.0, -0.1, 0.2]

#: One row for each configuration, or the same for all.
Wrenches = Vector6 | Annotated[list[Vector6], Field(min_length=1, max_length=MAX_BATCH)]


class Model(WithTool):
    """Configurations, and changes of the robot's model: payload, motors, friction, gravity."""

    joints: Joints = Field(examples=[JOINTS_EXAMPLE])
    gravity: Vector3 | None = None
    """in the frame [m/s²]; the robot's own if left out"""
    frame: Frame | None = None
    payload: Payload | None = None
    motor_inertia: NonNegative | list[NonNegative] | None = None
    """J, reflected at the joints [kg m² or kg]; the robot's own if left out"""
    viscous_friction: NonNegative | list[NonNegative] | None = None
    """B at the joints [N m s/rad or N s/m]; the robot's own if left out"""
    coulomb_friction: NonNegative | list[NonNegative] | None = None
    """dry friction F at the joints [N m or N]; the robot's own if left out"""


class WrenchRequest(WithHeldFrames, BodyWithRules):
    """A wrench that the tip exerts on its surroundings, or the joint torques that it takes."""

    one_of: ClassVar[tuple[str, ...]] = ("wrench", "torques")

    wrench: (
        TaskVector | Annotated[list[TaskVector], Field(min_length=1, max_length=MAX_BATCH)] | None
    ) = Field(None, examples=[[0.0, 0.0, -10.0, 0.0, 0.0, 0.5]])
    """force [N] and moment [N m] along the axes of the frame, a number for each"""
    torques: Joints | None = None
    """torques or forces of the joints whose wrench is asked for [N m or N]"""
    axes: TaskAxes | None = Field(None, examples=[["x", "y", "z"]])
    """parts of the wrench that may differ from 0: forces along x, y, z and moments about rx, ry, rz
    of the frame; all six if left out
    """
    point: Point | None = None
    """where on the link, in its frame [m]"""

    @model_validator(mode="after")
    def _one_of_two(self) -> Self:
        check_task_vectors(self.wrench, self.axes, "wrench")
        return self


class WrenchAnswer(InFrame):
    """τ = Jᵀ F; with many configurations a list of them."""

    torques: list[float] | Matrix
    """[N m or N]"""
    wrench: list[float] | Matrix | None = None
    """of torques: the wrench of least length with Jᵀ F = τ, as nearly as can be, a number for each
    axis that counts [N, N m]
    """
    residual: list[float] | Matrix | None = None
    """of torques: τ − Jᵀ F, which no wrench at this point causes [N m or N]"""


class DynamicsRequest(Model):
    """States whose equations of motion are asked for."""

    velocities: Joints | None = Field(None, examples=[RATES_EXAMPLE])
    """0 if left out"""
    accelerations: Joints | None = Field(None, examples=[RATES_EXAMPLE])
    """0 if left out"""
    wrench: Wrenches | None = None
    """that the tip exerts on its surroundings, along the frame's axes [N, N m]"""
    christoffel_symbols: bool = False
    """answer c_ijk too"""
    partial_jacobians: bool = False
    """answer J_v and J_ω of every body too"""


class PartialJacobian(Answer):
    """Jacobians of the body that moves with a joint; with many configurations each is a list."""

    joint: str
    """joint that moves the body"""
    linear: Matrix | list[Matrix]
    """J_v of the body's centre of mass, 3 x n, in the frame"""
    angular: Matrix | list[Matrix]
    """J_ω of the body, 3 x n, in the frame"""


class DynamicsAnswer(InFrame):
    """(D + J) q̈ + C q̇ + B q̇ + G + Jᵀ F = τ; with many configurations each field is a list."""

    mass_matrix: Matrix | list[Matrix]
    """D of the links, n x n"""
    coriolis_matrix: Matrix | list[Matrix]
    """C by Christoffel symbols, n x n: dD/dt − 2 C is skew-symmetric"""
    gravity: list[float] | Matrix
    """G, n [N m or N]"""
    torques: list[float] | Matrix
    """τ, n [N m or N]"""
    motor_inertia: list[float]
    """J, n; 0 where the robot gives none"""
    viscous_friction: list[float]
    """B, n; 0 where the robot gives none"""
    coulomb_friction: list[float]
    """dry friction F, n: the torque is F tanh(q̇ / v) with v = 0.01 rad/s or m/s"""
    kinetic_energy: float | list[float]
    """with the motors' part [J]"""
    potential_energy: float | list[float]
    """[J]"""
    christoffel_symbols: list[Matrix] | list[list[Matrix]] | None = None
    """on request: [i][j][k] is c_ijk = (∂d_kj/∂q_i + ∂d_ki/∂q_j − ∂d_ij/∂q_k)/2"""
    partial_jacobians: list[PartialJacobian] | None = None
    """on request, of every body; links on fixed joints are part of a body"""


class ForwardDynamicsRequest(Model):
    """States and torques whose accelerations are asked for."""

    velocities: Joints | None = Field(None, examples=[RATES_EXAMPLE])
    """0 if left out"""
    torques: Joints | None = Field(None, examples=[RATES_EXAMPLE])
    """τ of the joints; 0 if left out [N m or N]"""
    wrench: Wrenches | None = None
    """that the tip exerts on its surroundings, along the frame's axes [N, N m]"""


class ForwardDynamicsAnswer(InFrame):
    """q̈ = (D + J)⁻¹ (τ − C q̇ − B q̇ − G − Jᵀ F); with many states a list of them."""

    accelerations: list[float] | Matrix
    """q̈, n [rad/s² or m/s²]"""


class RegressorRequest(Model):
    """States in motion."""

    velocities: Joints = Field(examples=[RATES_EXAMPLE])
    accelerations: Joints = Field(examples=[RATES_EXAMPLE])
    reference_velocities: Joints | None = None
    """v of Y(q, q̇, a, v), with accelerations as a; q̇ if left out"""
    motors: bool | None = None
    """with motor inertias and viscous frictions among the parameters; by default where the robot
    has any
    """
    known_zeros: bool = False
    """count parameters that are exactly 0 in this robot as known, so that fewer base parameters
    remain
    """


class BaseParameter(Answer):
    """A combination of parameters that motion can tell from all others."""

    name: str = Field(examples=["Izz1 + Iyy2 + 0.25 m2"])
    """the combination, as a formula"""
    value: float
    """of this robot, in SI units"""
    column: int
    """the column of the regressor that it is multiplied with"""


class RegressorAnswer(InFrame):
    """τ = Y Θ = Y_b β; with many states the regressors are lists."""

    regressor: Matrix | list[Matrix]
    """Y, n x p"""
    parameters: list[float]
    """Θ: ten a joint (m, m c, inertia about the joint frame's origin), then motors"""
    parameter_names: list[str] = Field(examples=[["m1", "mx1", "my1", "mz1", "Ixx1"]])
    """of Θ, in its order"""
    base_parameters: list[BaseParameter]
    """β, the fewest there can be"""
    base_regressor: Matrix | list[Matrix]
    """Y_b: the columns of Y for β"""
    torques: list[float] | Matrix
    """Y Θ, n [N m or N]"""


Formula = str
FormulaMatrix = list[list[Formula]]


class JointSymbol(Answer):
    """The variable of a joint."""

    joint: str
    """name of the joint"""
    symbol: Formula = Field(examples=["q_{1}"])
    """of its variable"""
    type: Literal["revolute", "prismatic"]
    """kind of joint"""


class ParameterSymbol(Answer):
    """A number of the robot that the formulas call by a symbol."""

    symbol: Formula = Field(examples=["l_{c2}"])
    """in the formulas"""
    value: float
    """of this robot"""
    unit: str = Field(examples=["m"])
    """of the value"""
    meaning: str = Field(examples=["from axis 2 to the centre of mass of link 2"])
    """of the symbol"""


class Abbreviation(Answer):
    """A function that the formulas call by a short name."""

    symbol: Formula = Field(examples=["c_{12}"])
    """short name in the formulas"""
    formula: Formula = Field(examples=[r"\cos\left(q_{1} + q_{2}\right)"])
    """what it stands for"""


class PoseFormulas(Answer):
    """The pose of a link in the root frame."""

    link: str
    """the link meant"""
    position: list[Formula]
    """of its origin, x, y, z [m]"""
    rotation_matrix: FormulaMatrix
    """of its frame, rows"""


class ChristoffelFormula(Answer):
    """A Christoffel symbol c_ijk = c_jik that is not 0."""

    i: int
    """first joint, counted from 1"""
    j: int
    """second joint"""
    k: int
    """joint whose equation the symbol stands in"""
    formula: Formula
    """c_ijk of the joint variables"""


class RegressorFormulas(Answer):
    """τ = Y(q, q̇, q̈) Θ with the fewest parameters."""

    regressor: FormulaMatrix
    """Y, n x p"""
    parameters: list[Formula]
    """Θ, p combinations of masses and lengths"""
    values: list[float]
    """of the parameters"""


class MotionFormulas(Answer):
    """The terms of (D + J) q̈ + C q̇ + B q̇ + F f + G = τ."""

    equation: Formula
    """the terms that this robot has"""
    mass_matrix: FormulaMatrix
    """D, n x n"""
    christoffel_symbols: list[ChristoffelFormula] | None = None
    """those with i ≤ j that are not 0; null for more than four joints"""
    coriolis_matrix: FormulaMatrix
    """C, n x n"""
    potential_energy: Formula
    """U; 0 where all masses lie at the origin of frame 0"""
    gravity: list[Formula]
    """G = ∂U/∂q, n"""
    regressor: RegressorFormulas | None = None
    """null for more than four joints"""


class EquationsAnswer(Answer):
    """Kinematics and dynamics of a robot as formulas in LaTeX or plain text.

    Plain text is an expression that Python and sympy evaluate.
    """

    format: Literal["latex", "text"]
    """of all formulas"""
    convention: Literal["standard", "modified"]
    """of the table whose frames the formulas use"""
    joints: list[JointSymbol]
    """the joint variables, in their order"""
    parameters: list[ParameterSymbol]
    """symbols for numbers of the robot"""
    abbreviations: list[Abbreviation]
    """short names for functions that come often"""
    transformations: list[FormulaMatrix]
    """H_i of frame i in frame i − 1, 4 x 4"""
    pose: PoseFormulas
    jacobian: FormulaMatrix
    """of the origin of that link, 6 x n, linear rows first"""
    determinant: str | None = None
    """of the rows of the Jacobian that `axes` names: 0 at the singularities"""
    dynamics: MotionFormulas | None = None
    """null where the formulas would be too long or there are no inertias"""
    notes: list[str]
    """what is left out, and why"""
    document: str
    """all of it on one page: LaTeX, or plain text"""
