"""Controllers by the robot's model: computed torque, passivity-based, gravity compensation.

Computed torque, or feedback linearisation: the model cancels the robot.

Passivity-based control: the robot's own energy does the convincing.

PD control with gravity compensation: no model but the weight, for a constant reference.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from kinematics.arrays import Array
from kinematics.model.chain import Chain
from tracking.controllers.control_law import Kind, Law, law
from tracking.controllers.controller import LawController
from tracking.controllers.gain import filtered_gains, gain_matrix, gain_vector, placed_gains


@dataclass(frozen=True, slots=True, eq=False)
class ComputedTorque(LawController):
    """Feedback linearisation with a PD controller for each joint.

        u = M(q) v + C(q, q_dot) q_dot + B q_dot + G(q),
        v = q^r_ddot + k_d q_tilde_dot + k_p q_tilde,

    so that q_tilde_ddot + k_d q_tilde_dot + k_p q_tilde = 0: the poles are the roots of
    s^2 + k_d s + k_p (critically damped at rate w: k_p = w^2, k_d = 2 w). The quadratic form of the
    linear error dynamics with its cross term,
    V = sum (q_tilde_dot^2 + (k_p + k_d^2 / 2) q_tilde^2 + k_d q_tilde q_tilde_dot) / 2, has
    V_dot = -sum k_d (q_tilde_dot^2 + k_p q_tilde^2) / 2, negative definite.

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

    def compiled_law(self, robot: Chain | None = None) -> Law:
        """The controller as arrays for the compiled loop."""
        Kp, Kd = np.diag(self.Kp), np.diag(self.Kd)
        return law(Kind.COMPUTED_TORQUE, self.chain, robot, Kp=Kp, Kd=Kd)


@dataclass(frozen=True, slots=True, eq=False)
class Passivity(LawController):
    """Tracking through the filtered error r = q_tilde_dot + Lambda q_tilde.

        u = M a + C v + B q_dot + G + K r,
        v = q^r_dot + Lambda q_tilde,    a = q^r_ddot + Lambda q_tilde_dot,

    so that M r_dot + (C + K) r = 0. C is that of the Christoffel symbols. The energy of the
    filtered error and a spring, V = r^T M r / 2 + q_tilde^T Lambda K q_tilde, has
    V_dot = -q_tilde_dot^T K q_tilde_dot - q_tilde^T Lambda K Lambda q_tilde
    where Lambda and K commute. V has the symmetric part of Lambda K in any case.

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

    def compiled_law(self, robot: Chain | None = None) -> Law:
        """The controller as arrays for the compiled loop."""
        return law(Kind.PASSIVITY, self.chain, robot, Kd=self.K, Lambda=self.Lambda)


@dataclass(frozen=True, slots=True, eq=False)
class PdGravity(LawController):
    """Spring and damper to the reference, with the weight held.

        u = K_p q_tilde + K_d q_tilde_dot + G(q).

    Asymptotically stable for a constant reference (LaSalle); a moving one is followed with a lag.
    Kinetic plus virtual potential energy, V = (q_dot^T M q_dot + q_tilde^T K_p q_tilde) / 2, has
    V_dot = -q_dot^T (B + K_d) q_dot there.

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

    def compiled_law(self, robot: Chain | None = None) -> Law:
        """The controller as arrays for the compiled loop."""
        return law(Kind.PD_GRAVITY, self.chain, robot, Kp=self.Kp, Kd=self.Kd)
