"""Velocities, forces and equations of motion."""

from typing import Generic, Self, TypedDict, TypeVar

from pydantic import model_validator

from armwright_client.base import (
    Answer,
    InFrame,
    Matrix,
    Matrix3,
    Positive,
    Request,
    Rows,
    Vector,
    Vector3,
    Vector6,
    VectorLike,
)

#: Velocities and accelerations: a vector for one configuration, rows for many.
V = TypeVar("V")


class VelocityOptions(TypedDict, total=False):
    """Options of velocity kinematics.

    Args:
        joint_velocities: Whose twist is asked for [rad/s or m/s].
        twist: (linear, angular), whose joint velocities are asked for [m/s, rad/s].
        nullspace: Joint velocities of which the part that leaves the link at rest is added.
        link: The tip if left out.
        point: A point fixed to the link, in its frame [m]; its origin if left out.
        damped_below: Singular values below it are damped; 0 for the plain pseudo-inverse.
        frame: Of the twist: a link that stands still, or "tool"; the root frame if left out.
    """

    joint_velocities: VectorLike
    twist: VectorLike
    nullspace: VectorLike
    link: str
    point: VectorLike
    damped_below: float
    frame: str


class VelocityRequest(Request):
    """Joint velocities, or the twist (linear, angular) they are to cause."""

    joints: Vector
    joint_velocities: Vector | None = None
    twist: Vector6 | None = None
    nullspace: Vector | None = None
    link: str | None = None
    point: Vector3 | None = None
    damped_below: float | None = None
    frame: str | None = None

    @model_validator(mode="after")
    def _check_form(self) -> Self:
        if (self.joint_velocities is None) == (self.twist is None):
            raise ValueError("give joint_velocities or twist, not both")
        return self


class DampedDirection(Answer):
    """A direction in which the joints were kept from racing.

    Args:
        singular_value: Of the Jacobian.
        gain: What of the twist along it is still followed, 0 to 1.
        twist: The direction, of length 1.
        joint_velocities: The joints' part in it, of length 1.
    """

    singular_value: float
    gain: float
    twist: list[float]
    joint_velocities: list[float]


class VelocityAnswer(InFrame):
    """Twist and joint velocities that belong together.

    Args:
        twist: Of the link [m/s, rad/s].
        joint_velocities: [rad/s or m/s].
        residual: What of the twist asked for is not followed.
        rank: Of the Jacobian.
        singular_values: Largest first.
        damped: The directions that were damped.
    """

    twist: list[float]
    joint_velocities: list[float]
    residual: list[float]
    rank: int
    singular_values: list[float]
    damped: list[DampedDirection]


class Payload(Request):
    """A rigid load fixed to a link, the tip if none is named.

    Args:
        mass: [kg].
        center_of_mass: In the link's frame [m].
        inertia: About the centre of mass [kg m²]; a point mass if left out.
        link: What carries it.
    """

    mass: Positive
    center_of_mass: Vector3 | None = None
    inertia: Matrix3 | None = None
    link: str | None = None


class ModelOptions(TypedDict, total=False):
    """Changes of the robot's model: payload, motors, friction, gravity.

    Args:
        gravity: In the frame [m/s²].
        frame: A link that stands still, or "tool"; the root frame if left out.
        payload: A load in addition.
        motor_inertia: J, one number or one a joint [kg m² or kg].
        viscous_friction: B, one number or one a joint [N m s/rad or N s/m].
        coulomb_friction: Dry friction, one number or one a joint [N m or N].
    """

    gravity: VectorLike
    frame: str
    payload: Payload
    motor_inertia: float | VectorLike
    viscous_friction: float | VectorLike
    coulomb_friction: float | VectorLike


class DynamicsOptions(ModelOptions, Generic[V], total=False):
    """State of motion and wrench; see also `ModelOptions`.

    Args:
        velocities: One row a configuration [rad/s or m/s]; at rest if left out.
        accelerations: One row a configuration [rad/s² or m/s²]; 0 if left out.
        wrench: (force, moment) that the tip exerts, along the frame's axes [N, N m].
        christoffel_symbols: Answer c_ijk too.
        partial_jacobians: Answer J_v and J_w of every body too.
    """

    velocities: V | None
    accelerations: V | None
    wrench: VectorLike | None
    christoffel_symbols: bool
    partial_jacobians: bool


class ForwardDynamicsOptions(ModelOptions, Generic[V], total=False):
    """State of motion, torques and wrench; see also `ModelOptions`.

    Args:
        velocities: One row a configuration [rad/s or m/s]; at rest if left out.
        torques: One row a configuration [N m or N]; 0 if left out.
        wrench: (force, moment) that the tip exerts, along the frame's axes [N, N m].
    """

    velocities: V | None
    torques: V | None
    wrench: VectorLike | None


class WrenchOptions(TypedDict, total=False):
    """Options of a wrench: where it is exerted.

    Args:
        link: The tip if left out.
        point: In the link's frame [m]; its origin if left out.
        frame: Whose axes the wrench is given along: a link that stands still, or "tool"; the root
            frame if left out.
    """

    link: str
    point: VectorLike
    frame: str


class RegressorOptions(ModelOptions, total=False):
    """Options of the regressor; see also `ModelOptions`.

    Args:
        reference_velocities: v of Y(q, q̇, a, v), with the accelerations as a.
        motors: With motor inertias and frictions; by default where the robot has any.
        known_zeros: Count parameters that are exactly 0 as known.
    """

    reference_velocities: VectorLike
    motors: bool
    known_zeros: bool


class WrenchRequest(Request):
    """A wrench (force [N], moment [N m]) that a link exerts, along the frame's axes."""

    joints: Vector | Rows
    wrench: Vector6
    link: str | None = None
    point: Vector3 | None = None
    frame: str | None = None


class WrenchAnswer(InFrame):
    """Joint torques that balance the wrench: τ = Jᵀ F [N m or N]."""

    torques: list[float]


class WrenchBatch(InFrame):
    """Joint torques that balance a wrench at many configurations [N m or N]."""

    torques: list[list[float]]


class DynamicsRequest(Request):
    """Configurations, with velocities, accelerations and a wrench if they matter."""

    joints: Vector | Rows
    velocities: Vector | Rows | None = None
    accelerations: Vector | Rows | None = None
    wrench: Vector6 | None = None
    christoffel_symbols: bool | None = None
    partial_jacobians: bool | None = None
    gravity: Vector3 | None = None
    frame: str | None = None
    payload: Payload | None = None
    motor_inertia: float | Vector | None = None
    viscous_friction: float | Vector | None = None
    coulomb_friction: float | Vector | None = None


class ForwardDynamicsRequest(Request):
    """Configurations, with velocities, torques and a wrench if they matter."""

    joints: Vector | Rows
    velocities: Vector | Rows | None = None
    torques: Vector | Rows | None = None
    wrench: Vector6 | None = None
    gravity: Vector3 | None = None
    frame: str | None = None
    payload: Payload | None = None
    motor_inertia: float | Vector | None = None
    viscous_friction: float | Vector | None = None
    coulomb_friction: float | Vector | None = None


class ForwardDynamicsAnswer(InFrame):
    """Accelerations that torques cause, n [rad/s² or m/s²]."""

    accelerations: list[float]


class ForwardDynamicsBatch(InFrame):
    """Accelerations that torques cause in many states [rad/s² or m/s²]."""

    accelerations: list[list[float]]


class PartialJacobian(Answer):
    """Jacobians of the body that moves with a joint.

    Args:
        joint: Its name.
        linear: J_v of the centre of mass, 3 x n; a list of them at many configurations.
        angular: J_w, likewise.
    """

    joint: str
    linear: Matrix | list[Matrix]
    angular: Matrix | list[Matrix]


class DynamicsAnswer(InFrame):
    """The equations of motion (D + J) q̈ + C q̇ + B q̇ + G + Jᵀ F = τ.

    Args:
        mass_matrix: D of the links, n x n.
        coriolis_matrix: C from Christoffel symbols, n x n.
        gravity: G, n [N m or N].
        torques: τ, n [N m or N].
        motor_inertia: J, n.
        viscous_friction: B, n.
        coulomb_friction: Dry friction F, n [N m or N].
        kinetic_energy: [J].
        potential_energy: [J].
        christoffel_symbols: On request; [i][j][k] is c_ijk.
        partial_jacobians: On request, of every body.
    """

    mass_matrix: Matrix
    coriolis_matrix: Matrix
    gravity: list[float]
    torques: list[float]
    motor_inertia: list[float] | None = None
    viscous_friction: list[float] | None = None
    coulomb_friction: list[float] | None = None
    kinetic_energy: float | None = None
    potential_energy: float | None = None
    christoffel_symbols: list[Matrix] | None = None
    partial_jacobians: list[PartialJacobian] | None = None


class DynamicsBatch(InFrame):
    """The equations at many configurations, in their order; see `DynamicsAnswer`."""

    mass_matrix: list[Matrix]
    coriolis_matrix: list[Matrix]
    gravity: list[list[float]]
    torques: list[list[float]]
    motor_inertia: list[float] | None = None
    viscous_friction: list[float] | None = None
    kinetic_energy: list[float] | None = None
    potential_energy: list[float] | None = None
    christoffel_symbols: list[list[Matrix]] | None = None
    partial_jacobians: list[PartialJacobian] | None = None


class RegressorRequest(Request):
    """A configuration in motion."""

    joints: Vector
    velocities: Vector
    accelerations: Vector
    reference_velocities: Vector | None = None
    motors: bool | None = None
    known_zeros: bool | None = None
    gravity: Vector3 | None = None
    frame: str | None = None
    payload: Payload | None = None
    motor_inertia: float | Vector | None = None
    viscous_friction: float | Vector | None = None
    coulomb_friction: float | Vector | None = None


class BaseParameter(Answer):
    """A combination of parameters that motion can tell from all others.

    Args:
        name: The combination, such as "Izz1 + Iyy2 + 0.25 m2".
        value: Of this robot.
        column: The column of the regressor that it is multiplied with.
    """

    name: str
    value: float
    column: int


class RegressorAnswer(InFrame):
    """The equations of motion, linear in the parameters: τ = Y Θ = Y_b β.

    Args:
        regressor: Y, n x p.
        parameters: Θ, p.
        parameter_names: p names.
        base_parameters: β, the fewest that there can be.
        base_regressor: Y_b, n x b.
        torques: Y Θ, n.
    """

    regressor: Matrix
    parameters: list[float]
    parameter_names: list[str]
    base_parameters: list[BaseParameter]
    base_regressor: Matrix
    torques: list[float]
