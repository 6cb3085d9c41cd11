"""Equations of motion, their linear parametrisation and statics on the wire."""

from typing import Annotated

from pydantic import Field

from armwright_wire.base import (
    MAX_BATCH,
    Answer,
    Body,
    Frame,
    InFrame,
    Joints,
    Label,
    Matrix,
    NonNegative,
    Point,
    Positive,
    Vector3,
    Vector6,
)
from armwright_wire.kinematics import JOINTS_EXAMPLE

RATES_EXAMPLE = [0.1, -0.2, 0.3, 0.1, 0.0, -0.1, 0.2]

#: One row for each configuration, or the same for all.
Wrenches = Vector6 | Annotated[list[Vector6], Field(min_length=1, max_length=MAX_BATCH)]
Tensor = Annotated[list[Vector3], Field(min_length=3, max_length=3)]


class Payload(Body):
    """A rigid load fixed to a link, in addition to what the robot's description has."""

    mass: Positive = Field(description="[kg]", examples=[1.5])
    center_of_mass: Point = Field([0.0, 0.0, 0.0], description="in the link's frame [m]")
    inertia: Tensor | None = Field(
        None, description="about the centre of mass [kg m²]; a point mass if left out"
    )
    link: Label | None = Field(None, description="the tip if left out")


class Model(Body):
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


class WrenchRequest(Body):
    """A wrench that the tip exerts on its surroundings, along the axes of the frame."""

    joints: Joints = Field(examples=[JOINTS_EXAMPLE])
    wrench: Wrenches = Field(
        description="force [N] and moment [N m]", examples=[[0.0, 0.0, -10.0, 0.0, 0.0, 0.5]]
    )
    link: Label | None = Field(None, description="the tip if left out")
    point: Point | None = Field(None, description="where on the link, in its frame [m]")
    frame: Frame | None = None


class WrenchAnswer(InFrame):
    """τ = Jᵀ F; with many configurations a list of them."""

    torques: list[float] | Matrix = Field(description="[N m or N]")


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
