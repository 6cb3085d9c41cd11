"""Answers about one configuration or about many, which the service gives by one model each."""

from armwright_wire.base import Answer, Matrix
from armwright_wire.pose import OrientedPoseAnswer
from armwright_wire.robots import dynamics, kinematics, potential
from armwright_wire.robots.kinematics import DampedDirection, IkSolution
from armwright_wire.robots.potential import ControlPoint
from armwright_wire.scenes import check
from armwright_wire.scenes.check import Collision, LimitViolation


class Health(Answer):
    """Health of the service: it answers."""

    status: str
    version: str | None = None


class Readiness(Health):
    """Readiness of the service: work can be sent.

    Args:
        workers: Processes that live.
        busy: Workers that have a job.
        waiting: Jobs that wait for a worker.
    """

    workers: int | None = None
    busy: int | None = None
    waiting: int | None = None


class CheckAnswer(check.CheckAnswer):
    """The verdict about one configuration."""

    valid: bool
    clearance: float | None
    clearance_pair: tuple[str, str] | None
    collisions: list[Collision]
    limit_violations: list[LimitViolation]


class CheckBatch(check.CheckAnswer):
    """The verdicts about many configurations, in their order; see `CheckAnswer`."""

    valid: list[bool]
    clearance: list[float | None]
    clearance_pair: list[tuple[str, str] | None] | None
    collisions: list[list[Collision]]
    limit_violations: list[list[LimitViolation]]


class FkAnswer(kinematics.FkAnswer):
    """Poses in a frame, the root frame if no other was asked for."""

    pose: OrientedPoseAnswer
    links: dict[str, OrientedPoseAnswer]  # type: ignore[assignment]


class FkBatch(kinematics.FkAnswer):
    """Poses of many configurations, in their order; see `FkAnswer`."""

    pose: list[OrientedPoseAnswer]
    links: dict[str, list[OrientedPoseAnswer]]  # type: ignore[assignment]


class JacobianAnswer(kinematics.JacobianAnswer):
    """A Jacobian."""

    jacobian: Matrix
    rank: int
    singular_values: list[float]
    manipulability: float


class JacobianBatch(kinematics.JacobianAnswer):
    """Jacobians of many configurations, in their order; see `JacobianAnswer`."""

    jacobian: list[Matrix]
    rank: list[int]
    singular_values: list[list[float]]
    manipulability: list[float]


class IkAnswer(kinematics.IkAnswer):
    """Solutions, best first, and the trace of a gradient if it was asked for."""

    solutions: list[IkSolution]


class IkBatch(kinematics.IkAnswer):
    """Solutions of many poses, in their order."""

    solutions: list[list[IkSolution]]


class VelocityAnswer(kinematics.VelocityAnswer):
    """Twist and joint velocities that belong together."""

    twist: list[float]
    joint_velocities: list[float]
    residual: list[float]
    rank: int
    singular_values: list[float]
    damped: list[DampedDirection]


class WrenchAnswer(dynamics.WrenchAnswer):
    """Joint torques that balance the wrench: τ = Jᵀ F [N m or N]."""

    torques: list[float]


class WrenchBatch(dynamics.WrenchAnswer):
    """Joint torques that balance a wrench at many configurations [N m or N]."""

    torques: list[list[float]]


class DynamicsAnswer(dynamics.DynamicsAnswer):
    """The equations of motion (D + J) q̈ + C q̇ + B q̇ + G + Jᵀ F = τ."""

    mass_matrix: Matrix
    coriolis_matrix: Matrix
    gravity: list[float]
    torques: list[float]
    kinetic_energy: float
    potential_energy: float
    christoffel_symbols: list[Matrix] | None = None


class DynamicsBatch(dynamics.DynamicsAnswer):
    """The equations at many configurations, in their order; see `DynamicsAnswer`."""

    mass_matrix: list[Matrix]
    coriolis_matrix: list[Matrix]
    gravity: list[list[float]]
    torques: list[list[float]]
    kinetic_energy: list[float]
    potential_energy: list[float]
    christoffel_symbols: list[list[Matrix]] | None = None


class ForwardDynamicsAnswer(dynamics.ForwardDynamicsAnswer):
    """Accelerations that torques cause, n [rad/s² or m/s²]."""

    accelerations: list[float]


class ForwardDynamicsBatch(dynamics.ForwardDynamicsAnswer):
    """Accelerations that torques cause in many states [rad/s² or m/s²]."""

    accelerations: list[list[float]]


class RegressorAnswer(dynamics.RegressorAnswer):
    """The equations of motion, linear in the parameters: τ = Y Θ = Y_b β."""

    regressor: Matrix
    base_regressor: Matrix
    torques: list[float]


class PotentialAnswer(potential.PotentialAnswer):
    """The potential and where it comes from."""

    potential: float
    gradient: list[float]
    joint_force: list[float]
    control_points: list[ControlPoint]


class PotentialBatch(potential.PotentialAnswer):
    """The potential at many configurations, in their order; see `PotentialAnswer`."""

    potential: list[float]
    gradient: Matrix
    joint_force: Matrix
    control_points: list[list[ControlPoint]]
