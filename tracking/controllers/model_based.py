"""Controllers by the robot's model: computed torque, passivity-based, gravity compensation.

Computed torque, or feedback linearisation: the model cancels the robot.

Passivity-based control: the robot's own energy does the convincing.

PD control with gravity compensation: no model but the weight, for a constant reference.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from dynamics.inverse import inverse_dynamics, reference_dynamics
from dynamics.terms import augmented_mass_matrix, gravity_vector, kinetic_rate
from kinematics.arrays import Array
from kinematics.model.chain import Chain
from tracking.controllers.control_law import Kind, Law, law
from tracking.controllers.controller import Controller, Flow, Reference
from tracking.controllers.gain import filtered_gains, gain_matrix, gain_vector, placed_gains


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
