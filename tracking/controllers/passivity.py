"""Passivity-based control: the robot's own energy does the convincing."""

from dataclasses import dataclass

import numpy as np

from dynamics.inverse import reference_dynamics
from dynamics.terms import augmented_mass_matrix, kinetic_rate
from kinematics.arrays import Array
from kinematics.model.chain import Chain
from tracking.controllers.control_law import Kind, Law, law
from tracking.controllers.controller import Controller, Flow, Reference
from tracking.controllers.gain import filtered_gains


@dataclass(frozen=True, slots=True, eq=False)
class Passivity(Controller):
    """Tracking through the filtered error r = q_tilde_dot + Lambda q_tilde.

        u = M a + C v + B q_dot + G + K r,
        v = q^r_dot + Lambda q_tilde,    a = q^r_ddot + Lambda q_tilde_dot,

    so that M r_dot + (C + K) r = 0. C is that of the Christoffel symbols.

    Args:
        chain: The model.
        Lambda: Positive, the diagonal of Lambda, shape (n,) or () for all joints [1/s].
        K: Symmetric positive definite, (n, n), (n,) or () [N m s/rad or N s/m]; the proof needs
            one that commutes with Lambda, so that K couples only joints of equal Lambda.

    Raises:
        InvalidOption: A gain has the wrong shape, or is not (symmetric) positive (definite).
    """

    chain: Chain
    Lambda: Array
    K: Array

    def __post_init__(self) -> None:
        Lambda, K = filtered_gains(self.chain, self.Lambda, self.K)
        object.__setattr__(self, "Lambda", Lambda)
        object.__setattr__(self, "K", K)

    def filtered_error(self, q: Array, qd: Array, reference: Reference) -> Array:
        """The filtered error r = q_tilde_dot + Lambda q_tilde, shape (n,) [rad/s or m/s]."""
        e, e_dot = reference.position - q, reference.velocity - qd
        return np.asarray(e_dot + self.Lambda * e)

    def torque(self, _t: float, q: Array, qd: Array, reference: Reference, /) -> Array:
        """Torque u = M a + C v + B q_dot + G + K r, shape (n,).

        Raises:
            InvalidRobotState: The state has the wrong length or is not finite.
            MissingInertia: The model lacks an inertia.
        """
        r = self.filtered_error(q, qd, reference)
        a = reference.acceleration + self.Lambda * (reference.velocity - qd)
        return np.asarray(reference_dynamics(self.chain, q, qd, r + qd, a) + self.K @ r)

    def lyapunov(
        self, q: Array, qd: Array, reference: Reference, robot: Chain | None = None
    ) -> float:
        """Energy of the filtered error and a spring, V = r^T M r / 2 + q_tilde^T Lambda K q_tilde.

        V_dot = -q_tilde_dot^T K q_tilde_dot - q_tilde^T Lambda K Lambda q_tilde
        where Lambda and K commute. V has the symmetric part of Lambda K in any case.

        Raises:
            InvalidRobotState: The state has the wrong length or is not finite.
            MissingInertia: The model lacks an inertia.
        """
        r, e = self.filtered_error(q, qd, reference), reference.position - q
        M = augmented_mass_matrix(robot or self.chain, q)
        return float(0.5 * r @ M @ r + (self.Lambda * e) @ self.K @ e)

    def lyapunov_rate(self, flow: Flow, reference: Reference, robot: Chain | None = None) -> float:
        """V_dot = r^T (M r_dot + C r) + q_tilde^T (Lambda K + K Lambda) q_tilde_dot.

        Raises:
            InvalidRobotState: The state has the wrong length or is not finite.
            MissingInertia: The model lacks an inertia.
        """
        q, qd = flow.position, flow.velocity
        e, e_dot = reference.position - q, reference.velocity - qd
        r_dot = reference.acceleration - flow.acceleration + self.Lambda * e_dot
        kinetic = kinetic_rate(robot or self.chain, q, qd, e_dot + self.Lambda * e, r_dot)
        bend = (self.Lambda * e) @ self.K @ e_dot + e @ self.K @ (self.Lambda * e_dot)
        return float(kinetic + bend)

    def compiled_law(self, robot: Chain) -> Law:
        """The controller as arrays for the compiled loop."""
        return law(Kind.PASSIVITY, self.chain, robot, Kd=self.K, Lambda=self.Lambda)
