"""PD control with gravity compensation: no model but the weight, for a constant reference."""

from dataclasses import dataclass

import numpy as np

from dynamics.terms import augmented_mass_matrix, gravity_vector, kinetic_rate
from kinematics.arrays import Array
from kinematics.model.chain import Chain
from tracking.controllers.control_law import Kind, Law, law
from tracking.controllers.controller import Controller, Flow, Reference
from tracking.controllers.gain import gain_matrix


@dataclass(frozen=True, slots=True, eq=False)
class PdGravity(Controller):
    """Spring and damper to the reference, with the weight held.

        u = K_p q_tilde + K_d q_tilde_dot + G(q).

    Asymptotically stable for a constant reference (LaSalle); a moving one is followed with a lag.

    Args:
        chain: The model; its mass matrix serves ``lyapunov`` only.
        Kp: Symmetric positive definite, (n, n), (n,) or () [N m/rad or N/m].
        Kd: Symmetric positive definite, (n, n), (n,) or () [N m s/rad or N s/m].

    Raises:
        InvalidOption: A gain has the wrong shape or is not symmetric positive definite.
    """

    chain: Chain
    Kp: Array
    Kd: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "Kp", gain_matrix(self.chain, "Kp", self.Kp))
        object.__setattr__(self, "Kd", gain_matrix(self.chain, "Kd", self.Kd))

    def torque(self, _t: float, q: Array, qd: Array, reference: Reference, /) -> Array:
        """Torque u = K_p q_tilde + K_d q_tilde_dot + G(q), shape (n,).

        Raises:
            InvalidRobotState: The state has the wrong length or is not finite.
            MissingInertia: The model lacks an inertia.
        """
        e, e_dot = reference.position - q, reference.velocity - qd
        return np.asarray(self.Kp @ e + self.Kd @ e_dot + gravity_vector(self.chain, q))

    def lyapunov(
        self, q: Array, qd: Array, reference: Reference, robot: Chain | None = None
    ) -> float:
        """Kinetic plus virtual potential energy, V = (q_dot^T M q_dot + q_tilde^T K_p q_tilde) / 2.

        For a constant reference V_dot = -q_dot^T (B + K_d) q_dot.

        Raises:
            InvalidRobotState: The state has the wrong length or is not finite.
            MissingInertia: The model lacks an inertia.
        """
        e = reference.position - q
        M = augmented_mass_matrix(robot or self.chain, q)
        return 0.5 * float(qd @ M @ qd + e @ self.Kp @ e)

    def lyapunov_rate(self, flow: Flow, reference: Reference, robot: Chain | None = None) -> float:
        """V_dot = q_dot^T (M q_ddot + C q_dot) + q_tilde_dot^T K_p q_tilde.

        Raises:
            InvalidRobotState: The state has the wrong length or is not finite.
            MissingInertia: The model lacks an inertia.
        """
        e, e_dot = reference.position - flow.position, reference.velocity - flow.velocity
        q, qd = flow.position, flow.velocity
        kinetic = kinetic_rate(robot or self.chain, q, qd, qd, flow.acceleration)
        return float(kinetic + e_dot @ self.Kp @ e)

    def compiled_law(self, robot: Chain) -> Law:
        """The controller as arrays for the compiled loop."""
        return law(Kind.PD_GRAVITY, self.chain, robot, Kp=self.Kp, Kd=self.Kd)
