"""Independent joint control: each joint a motor of its own, all else a disturbance."""

from dataclasses import dataclass

import numpy as np

from kinematics.chain import Array, Chain, frozen
from kinematics.errors import InvalidOption
from tracking.controller import Controller, Reference
from tracking.gain import gain_vector
from tracking.law import Kind, Law, law


@dataclass(frozen=True, slots=True, eq=False)
class IndependentJoint(Controller):
    """PD control with feedforward of each motor, J q_ddot + B q_dot = u.

        u = J q^r_ddot + B q^r_dot + K_p q_tilde + K_d q_tilde_dot,

    so that J q_tilde_ddot + (B + K_d) q_tilde_dot + K_p q_tilde = 0 without load.

    Args:
        chain: The model; only the motors' inertia and friction are read.
        Kp: Positive, shape (n,) or () for all joints [N m/rad or N/m].
        Kd: Positive, shape (n,) or () [N m s/rad or N s/m].
        inertia: J to feed forward in place of the motors' own, for example with a mean of the
            arm's, shape (n,), not negative [kg m^2 or kg].

    Raises:
        InvalidOption: A gain is not positive, an inertia negative, or their number is wrong.
    """

    chain: Chain
    Kp: Array
    Kd: Array
    inertia: Array | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "Kp", gain_vector(self.chain, "Kp", self.Kp))
        object.__setattr__(self, "Kd", gain_vector(self.chain, "Kd", self.Kd))
        if self.inertia is not None:
            J = frozen(self.inertia)
            if J.shape != (self.chain.n,) or not (np.isfinite(J) & (J >= 0.0)).all():
                raise InvalidOption(
                    f"inertia must be {self.chain.n} numbers that are not negative, one a joint"
                )
            object.__setattr__(self, "inertia", J)

    @property
    def J(self) -> Array:
        """The inertia that is fed forward, shape (n,)."""
        return self.chain.motor_inertia if self.inertia is None else self.inertia

    def torque(self, _t: float, q: Array, qd: Array, reference: Reference, /) -> Array:
        """Torque u = J q^r_ddot + B q^r_dot + K_p q_tilde + K_d q_tilde_dot, shape (n,)."""
        e, e_dot = reference.position - q, reference.velocity - qd
        feedforward = self.J * reference.acceleration
        feedforward = feedforward + self.chain.viscous_friction * reference.velocity
        return np.asarray(feedforward + self.Kp * e + self.Kd * e_dot)

    def lyapunov(
        self, q: Array, qd: Array, reference: Reference, _robot: Chain | None = None
    ) -> float:
        """Energy of the error, V = (q_tilde_dot^T J q_tilde_dot + q_tilde^T K_p q_tilde) / 2.

        For the motors alone V_dot = -q_tilde_dot^T (B + K_d) q_tilde_dot; the arm they carry is
        outside this proof, so V may grow.
        """
        e, e_dot = reference.position - q, reference.velocity - qd
        return 0.5 * float(e_dot @ (self.J * e_dot) + e @ (self.Kp * e))

    def compiled(self, robot: Chain) -> Law:
        """The controller as arrays for the compiled loop."""
        return law(
            Kind.INDEPENDENT_JOINT,
            self.chain,
            robot,
            Kp=np.diag(self.Kp),
            Kd=np.diag(self.Kd),
            inertia=self.J,
            friction=self.chain.viscous_friction,
        )
