"""Computed torque, or feedback linearisation: the model cancels the robot."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from dynamics.inverse import inverse_dynamics
from kinematics.arrays import Array
from kinematics.model.chain import Chain
from tracking.controllers.control_law import Kind, Law, law
from tracking.controllers.controller import Controller, Flow, Reference
from tracking.controllers.gain import gain_vector, placed_gains


@dataclass(frozen=True, slots=True, eq=False)
class ComputedTorque(Controller):
    """Feedback linearisation with a PD controller for each joint.

        u = M(q) v + C(q, q_dot) q_dot + B q_dot + G(q),
        v = q^r_ddot + k_d q_tilde_dot + k_p q_tilde,

    so that q_tilde_ddot + k_d q_tilde_dot + k_p q_tilde = 0: the poles are the roots of
    s^2 + k_d s + k_p (critically damped at rate w: k_p = w^2, k_d = 2 w).

    Args:
        chain: The model.
        Kp: Positive, shape (n,) or () for all joints [1/s^2].
        Kd: Positive, shape (n,) or () [1/s].

    Raises:
        InvalidOption: A gain is not positive, or their number is wrong.
    """

    chain: Chain
    Kp: Array
    Kd: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "Kp", gain_vector(self.chain, "Kp", self.Kp))
        object.__setattr__(self, "Kd", gain_vector(self.chain, "Kd", self.Kd))

    @classmethod
    def by_pole_placement(
        cls, chain: Chain, natural_frequency: ArrayLike, damping: ArrayLike = 1.0
    ) -> "ComputedTorque":
        """The controller whose error has the poles of s^2 + 2 zeta w s + w^2 at every joint.

        Args:
            chain: The model.
            natural_frequency: w, one number or shape (n,) [rad/s].
            damping: zeta, one number or shape (n,).

        Raises:
            InvalidOption: A value is not positive, or their number is wrong.
        """
        return cls(chain, *placed_gains(chain, natural_frequency, damping))

    def torque(self, _t: float, q: Array, qd: Array, reference: Reference, /) -> Array:
        """Torque u = M v + C q_dot + B q_dot + G, shape (n,), by Newton-Euler.

        Raises:
            InvalidRobotState: The state has the wrong length or is not finite.
            MissingInertia: The model lacks an inertia.
        """
        e, e_dot = reference.position - q, reference.velocity - qd
        v = reference.acceleration + self.Kd * e_dot + self.Kp * e
        return inverse_dynamics(self.chain, q, qd, v)

    def lyapunov(
        self, q: Array, qd: Array, reference: Reference, _robot: Chain | None = None
    ) -> float:
        """Quadratic form x^T P x of the linear error dynamics, with its cross term.

        V = sum (q_tilde_dot^2 + (k_p + k_d^2 / 2) q_tilde^2 + k_d q_tilde q_tilde_dot) / 2 has
        V_dot = -sum k_d (q_tilde_dot^2 + k_p q_tilde^2) / 2, negative definite.
        """
        e, e_dot = reference.position - q, reference.velocity - qd
        kp, kd = self.Kp, self.Kd
        return 0.5 * float(np.sum(e_dot**2 + (kp + 0.5 * kd**2) * e**2 + kd * e * e_dot))

    def lyapunov_rate(self, flow: Flow, reference: Reference, _robot: Chain | None = None) -> float:
        """V_dot = sum q_tilde_dot (q_tilde_ddot + (k_p + k_d^2 / 2) q_tilde) + k_d (...) / 2.

        The last term is k_d (q_tilde_dot^2 + q_tilde q_tilde_ddot) / 2.
        """
        e, e_dot = reference.position - flow.position, reference.velocity - flow.velocity
        e_ddot = reference.acceleration - flow.acceleration
        kp, kd = self.Kp, self.Kd
        rates = e_dot * (e_ddot + (kp + 0.5 * kd**2) * e) + 0.5 * kd * (e_dot**2 + e * e_ddot)
        return float(rates.sum())

    def compiled_law(self, robot: Chain) -> Law:
        """The controller as arrays for the compiled loop."""
        Kp, Kd = np.diag(self.Kp), np.diag(self.Kd)
        return law(Kind.COMPUTED_TORQUE, self.chain, robot, Kp=Kp, Kd=Kd)
