"""Independent joint control: each joint a motor of its own, all else a disturbance."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from dynamics.terms import augmented_mass_matrix
from kinematics.arrays import Array, frozen
from kinematics.errors import InvalidOption
from kinematics.model.chain import Chain
from tracking.controllers.control_law import Kind, Law, law
from tracking.controllers.controller import LawController
from tracking.controllers.gain import gain_vector, placed_gains


@dataclass(frozen=True, slots=True, eq=False)
class IndependentJoint(LawController):
    """PD control with feedforward of each motor, J q_ddot + B q_dot = u.

        u = J q^r_ddot + B q^r_dot + K_p q_tilde + K_d q_tilde_dot,

    so that J q_tilde_ddot + (B + K_d) q_tilde_dot + K_p q_tilde = 0 without load. The energy of the
    error, V = (q_tilde_dot^T J q_tilde_dot + q_tilde^T K_p q_tilde) / 2, has
    V_dot = -q_tilde_dot^T (B + K_d) q_tilde_dot for the motors alone; the arm they carry is outside
    this proof, so V may grow.

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

    @classmethod
    def by_pole_placement(
        cls,
        chain: Chain,
        natural_frequency: ArrayLike,
        damping: ArrayLike = 1.0,
        inertia: Array | None = None,
    ) -> "IndependentJoint":
        """The controller whose error has the poles of s^2 + 2 zeta w s + w^2 at every joint.

        K_p = J w^2 and K_d = 2 zeta w J - B, as far as a joint is its motor alone.

        Args:
            chain: The model.
            natural_frequency: w, one number or shape (n,) [rad/s].
            damping: zeta, one number or shape (n,).
            inertia: J where it is not the motors' own, shape (n,), see
                ``effective_inertia`` [kg m^2 or kg].

        Raises:
            InvalidOption: A value is not positive, their number is wrong, a joint has no inertia,
                or friction alone damps it more than asked.
        """
        kp, kd = placed_gains(chain, natural_frequency, damping)
        J = chain.motor_inertia if inertia is None else gain_vector(chain, "inertia", inertia)
        if (J <= 0.0).any():
            joint = chain.joint_names[int(np.argmin(J))]
            raise InvalidOption(
                f"the motor of joint {joint!r} has no inertia, so its poles can't be placed",
                hint="Give the robot's motors, or inertia: effective_inertia of a configuration.",
                joint=joint,
            )
        Kd = J * kd - chain.viscous_friction
        if (Kd <= 0.0).any():
            joint = chain.joint_names[int(np.argmin(Kd))]
            raise InvalidOption(
                f"friction alone damps joint {joint!r} more than asked",
                hint="Ask for a higher natural_frequency or damping.",
                joint=joint,
            )
        return cls(chain, frozen(J * kp), frozen(Kd), frozen(J))

    @property
    def J(self) -> Array:
        """The inertia that is fed forward, shape (n,)."""
        return self.chain.motor_inertia if self.inertia is None else self.inertia

    def compiled_law(self, robot: Chain | None = None) -> Law:
        """The controller as arrays for the compiled loop."""
        return law(
            Kind.INDEPENDENT_JOINT,
            self.chain,
            robot,
            Kp=np.diag(self.Kp),
            Kd=np.diag(self.Kd),
            motors=(self.J, self.chain.viscous_friction),
        )


def effective_inertia(chain: Chain, q: ArrayLike) -> Array:
    """Effective inertia at each motor, diag(D(q)) + J, the mean over a batch, (n,).

    Args:
        chain: The model.
        q: One configuration (n,) or a batch (..., n) [rad or m].

    Raises:
        InvalidRobotState: Wrong length or not finite.
        MissingInertia: The model lacks an inertia.
    """
    M = augmented_mass_matrix(chain, q).reshape(-1, chain.n, chain.n)
    return np.asarray(np.diagonal(M, axis1=1, axis2=2).mean(axis=0))
