"""Controllers: a torque for a state and a reference, and a Lyapunov function."""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Self

import numpy as np

from kinematics.arrays import Array
from kinematics.model.chain import Chain
from tracking.controllers.control_law import Law


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """Reference state of the robot at one instant, each of shape (n,).

    The tracking error is q_tilde = q^r - q everywhere in this package.

    Args:
        position: q^r [rad or m].
        velocity: [rad/s or m/s].
        acceleration: [rad/s^2 or m/s^2].
    """

    position: Array
    velocity: Array
    acceleration: Array


@dataclass(frozen=True, slots=True, eq=False)
class Flow:
    """State of a closed loop at one instant and its rate of change.

    Args:
        position: q, shape (n,) [rad or m].
        velocity: q_dot, shape (n,) [rad/s or m/s].
        acceleration: q_ddot of the robot, as all forces together make it, shape (n,).
        estimate_rate: Theta_hat_dot of an adaptive controller, shape (p,); empty for the others.
    """

    position: Array
    velocity: Array
    acceleration: Array
    estimate_rate: Array = field(default_factory=lambda: np.zeros(0))


class Controller(ABC):
    """A state feedback u = f(t, q, q_dot, reference) for the augmented robot model.

        M(q) q_ddot + C(q, q_dot) q_dot + B q_dot + G(q) = u,    M = D + J.

    Args:
        chain: The model that the controller believes in; the robot it drives may differ.
    """

    __slots__ = ()
    chain: Chain

    @abstractmethod
    def torque(self, t: float, q: Array, qd: Array, reference: Reference, /) -> Array:
        """Torque u asked of the joints, shape (n,) [N m or N], before any saturation.

        Args:
            t: Time since the motion began [s].
            q: Positions, shape (n,) [rad or m].
            qd: Velocities, shape (n,) [rad/s or m/s].
            reference: Reference of position, velocity and acceleration.
        """

    @abstractmethod
    def lyapunov(
        self, q: Array, qd: Array, reference: Reference, robot: Chain | None = None
    ) -> float:
        """Lyapunov function V of the controller's own stability proof.

        V is 0 at the reference and positive elsewhere; where the proof's assumptions hold (a model
        as exact as it asks, no saturation, no disturbance) it never grows.

        Args:
            q: Positions, shape (n,) [rad or m].
            qd: Velocities, shape (n,) [rad/s or m/s].
            reference: Reference of position, velocity and acceleration.
            robot: The true robot, whose mass matrix and parameters the proofs mean; the model
                where none is given.
        """

    def lyapunov_rate(
        self, _flow: Flow, _reference: Reference, _robot: Chain | None = None
    ) -> float:
        """Rate V_dot of ``lyapunov`` along the motion of the closed loop.

        It is the rate that V really has, with a wrong model, saturation and disturbances; where
        the assumptions of the proof hold, it is the proof's. NaN where a controller gives none.

        Args:
            flow: The state and its rate of change.
            reference: Reference of position, velocity and acceleration.
            robot: The true robot; the model where none is given.
        """
        return math.nan

    def compiled_law(self, _robot: Chain, /) -> Law | None:
        """The controller as arrays for the compiled loop, driving a robot; None if it has none."""
        return None


class AdaptiveController(Controller):
    """A controller whose parameter estimate is integrated along with the robot.

    With a fixed estimate it is a controller like any other, so what changes over time is not
    hidden inside it: the simulation carries the estimate as a part of the state.

    Args:
        estimate: Theta_hat, shape (p,); the one given is where the simulation starts.
    """

    __slots__ = ()
    estimate: Array

    @abstractmethod
    def with_estimate(self, estimate: Array) -> Self:
        """Controller with another estimate, shape (p,)."""

    @abstractmethod
    def adaptation(self, t: float, q: Array, qd: Array, reference: Reference, /) -> Array:
        """Rate of change of the estimate, shape (p,) [1/s times its units]."""
