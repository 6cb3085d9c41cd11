"""Velocities, forces, equations of motion and the potential field."""

from typing import Any, Self

from pydantic import model_validator

from armwright_client.base import (
    Answer,
    Matrix,
    NonNegative,
    Request,
    Rows,
    Vector,
    Vector6,
)
from armwright_client.scene import SceneReference


class VelocityRequest(Request):
    """Joint velocities, or the twist (linear, angular) of the tip they are to cause."""

    joints: Vector
    joint_velocities: Vector | None = None
    twist: Vector6 | None = None
    nullspace: Vector | None = None

    @model_validator(mode="after")
    def _check_form(self) -> Self:
        if (self.joint_velocities is None) == (self.twist is None):
            raise ValueError("give joint_velocities or twist, not both")
        return self


class VelocityAnswer(Answer):
    """What was asked for of twist and joint velocities, and what of the twist is left."""

    twist: list[float] | None = None
    joint_velocities: list[float] | None = None
    residual: Any = None


class WrenchRequest(Request):
    """A wrench (force [N], moment [N m]) at the tip in the base frame."""

    joints: Vector
    wrench: Vector6


class WrenchAnswer(Answer):
    """Joint torques that balance the wrench: τ = Jᵀ F [N m or N]."""

    torques: list[float]


class DynamicsRequest(Request):
    """Configurations, with velocities, accelerations and a wrench if they matter."""

    joints: Vector | Rows
    velocities: Vector | Rows | None = None
    accelerations: Vector | Rows | None = None
    wrench: Vector6 | None = None


class DynamicsAnswer(Answer):
    """The equations of motion D(q) q̈ + C(q, q̇) q̇ + G(q) = τ.

    Args:
        mass_matrix: D, n x n.
        coriolis_matrix: C from Christoffel symbols, n x n.
        gravity: G, n [N m or N].
        torques: τ, n [N m or N].
    """

    mass_matrix: Matrix
    coriolis_matrix: Matrix | None = None
    gravity: list[float]
    torques: list[float] | None = None


class DynamicsBatch(Answer):
    """The equations at many configurations, in their order; see `DynamicsAnswer`."""

    mass_matrix: list[Matrix]
    coriolis_matrix: list[Matrix] | None = None
    gravity: list[list[float]]
    torques: list[list[float]] | None = None


class RegressorRequest(Request):
    """A configuration in motion."""

    joints: Vector
    velocities: Vector
    accelerations: Vector


class RegressorAnswer(Answer):
    """The equations of motion, linear in the parameters: τ = Y Θ.

    Args:
        regressor: Y, n x p.
        parameters: Θ, p.
        parameter_names: p names.
        base_parameters: Combinations of the parameters that can be told apart.
    """

    regressor: Matrix
    parameters: list[float]
    parameter_names: list[str]
    base_parameters: Any = None


class PotentialOptions(Request):
    """Weights of the potential field and how far obstacles are felt [m]."""

    attractive_weights: Vector | None = None
    attractive_cap: NonNegative | None = None
    repulsive_weights: Vector | None = None
    influence_distance: NonNegative | None = None


class PotentialRequest(Request):
    """A configuration, a goal and what is in the way."""

    joints: Vector
    goal_joints: Vector
    scene: SceneReference
    options: PotentialOptions | None = None


class ControlPoint(Answer):
    """A point of the arm that is pulled to its goal and pushed away by obstacles.

    Args:
        origin: [m].
        attractive_force: [N].
        repulsive_force: [N].
        projection: The nearest point of an obstacle [m].
        distance: To it [m].
    """

    origin: list[float]
    attractive_force: list[float]
    repulsive_force: list[float]
    projection: list[float] | None = None
    distance: float | None = None


class PotentialAnswer(Answer):
    """The potential, the force in joint space that it exerts, and where that comes from."""

    potential: float
    gradient: Any = None
    joint_force: list[float] | None = None
    control_points: list[ControlPoint]
