"""Controllers: a torque for a state and a reference, and a Lyapunov function."""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Self

import numpy as np

from kinematics.arrays import Array
from kinematics.model.chain import Chain
from tracking.controllers.control_law import (
    Law,
    control_kernel,
    lyapunov_kernel,
    lyapunov_rate_kernel,
    space,
)


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


class LawController(Controller):
    """A controller of this package, evaluated by the kernels of the compiled loop.

    Its methods raise InvalidRobotState where the state has the wrong length or is not finite, and
    MissingInertia where the model, or the true robot, lacks an inertia that counts.
    """

    __slots__ = ()

    @abstractmethod
    def compiled_law(self, robot: Chain | None = None) -> Law:
        """The controller as arrays, driving a robot; its own model where none is given."""

    def command(self, q: Array, qd: Array, reference: Reference) -> tuple[Array, Array]:
        """Torque (n,) and rate of change of the estimate (b,), which others do not have."""
        law = _law(self, None)
        u, rate = np.empty(self.chain.n), np.empty(len(law.columns))
        state, at = self._at(q, qd, reference)
        control_kernel(law, space(len(u), law), state, at, self._estimate(), u, rate)
        return u, rate

    def torque(self, _t: float, q: Array, qd: Array, reference: Reference, /) -> Array:
        """Torque u of the law, shape (n,) [N m or N]."""
        return self.command(q, qd, reference)[0]

    def lyapunov(
        self, q: Array, qd: Array, reference: Reference, robot: Chain | None = None
    ) -> float:
        """Lyapunov function V of the controller's own stability proof."""
        law = _law(self, robot)
        state, at = self._at(q, qd, reference)
        return lyapunov_kernel(law, space(self.chain.n, law), state, at, self._estimate())

    def lyapunov_rate(self, flow: Flow, reference: Reference, robot: Chain | None = None) -> float:
        """Rate V_dot of ``lyapunov`` along the motion of the closed loop."""
        law = _law(self, robot)
        state, at = self._at(flow.position, flow.velocity, reference)
        rate = np.concatenate([flow.velocity, flow.acceleration, flow.estimate_rate])
        made = space(self.chain.n, law)
        return lyapunov_rate_kernel(law, made, state, at, self._estimate(), rate)

    def _at(self, q: Array, qd: Array, reference: Reference) -> tuple[Array, Array]:
        """State (2, n) and reference (3, n) as the kernels read them."""
        state = [self.chain.state(q), self.chain.state(qd, "joint_velocities")]
        at = [reference.position, reference.velocity, reference.acceleration]
        return np.array(state), np.array(at, dtype=np.float64)

    def _estimate(self) -> Array:
        """Theta_hat, shape (b,), in memory of its own; empty where nothing is learned."""
        return np.array(self.estimate) if isinstance(self, AdaptiveController) else np.zeros(0)


@lru_cache(maxsize=8)
def _law(controller: LawController, robot: Chain | None) -> Law:
    """The law of a controller, for as long as it is evaluated from Python."""
    return controller.compiled_law(robot)
