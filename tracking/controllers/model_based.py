"""Controllers by the robot's model: torque, passivity, adaptation, gravity compensation.

Computed torque, or feedback linearisation: the model cancels the robot.

Passivity-based control: the robot's own energy does the convincing.

Adaptive control: passivity-based, with the model learned on the way.

PD control with gravity compensation: no model but the weight, for a constant reference.
"""

from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from dynamics.parameters.base_parameters import BaseParameters, base_parameters
from dynamics.terms import augmented_mass_matrix
from kinematics.arrays import Array, frozen
from kinematics.errors import InvalidOption
from kinematics.model.chain import Chain
from tracking.controllers.control_law import Estimated, Kind, Law, law
from tracking.controllers.controller import AdaptiveController, LawController, Reference
from tracking.controllers.gain import (
    adaptation_gain,
    filtered_gains,
    gain_matrix,
    gain_vector,
    placed_gains,
)


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


@dataclass(frozen=True, slots=True, eq=False)
class Adaptive(LawController, AdaptiveController):
    """The controller of Slotine and Li with the gradient law on the base parameters.

        u = Y(q, q_dot, a, v) Theta_hat + K r,    Theta_hat_dot = Gamma Y^T r,
        r = q_tilde_dot + Lambda q_tilde,
        v = q^r_dot + Lambda q_tilde,    a = q^r_ddot + Lambda q_tilde_dot,

    so that M r_dot + (C + K) r = -Y (Theta_hat - Theta). The tracking error goes to zero (by
    Barbalat's lemma); the estimate goes to the truth only where the reference excites every
    parameter persistently. Signs are those of q_tilde = q^r - q.

    With off = Theta_hat - Theta and the true robot's M and Theta,
    V = r^T M r / 2 + q_tilde^T Lambda K q_tilde + off^T Gamma^-1 off / 2 has
    V_dot = -q_tilde_dot^T K q_tilde_dot - q_tilde^T Lambda K Lambda q_tilde
    where Lambda and K commute. V has the symmetric part of Lambda K in any case.

    Args:
        chain: The model that the estimate starts from; its kinematics are taken as exact.
        Lambda: Positive, the diagonal of Lambda, shape (n,) or () for all joints [1/s].
        K: Symmetric positive definite, (n, n), (n,) or () [N m s/rad or N s/m]; the proof needs
            one that commutes with Lambda, so that K couples only joints of equal Lambda.
        Gamma: Symmetric positive definite, (b, b), (b,) or (): how fast each parameter is learned.
        estimate: Theta_hat at the start, shape (b,); the model's own where none is given.
        motors: Whether motor inertias and viscous frictions are learned too; by default where the
            model has any.
        base: The base parameters that are learned, found from the model where none are given.
        known: Base parameters that are not learned: the model's values are taken as exact.
        known_zeros: Whether parameters that are exactly 0 in the model are known to be 0, so that
            fewer are learned: four for the planar arm, three for the cart with its pendulum.
        learned: Names of the base parameters that are learned; all where none are named.

    Raises:
        InvalidOption: A gain has the wrong shape, is not (symmetric) positive (definite), or the
            estimate has the wrong length.
        MissingInertia: The model lacks an inertia.
    """

    chain: Chain
    Lambda: Array
    K: Array
    Gamma: Array
    estimate: Array = field(default_factory=lambda: np.zeros(0))
    motors: bool | None = None
    base: BaseParameters | None = None
    known: BaseParameters | None = None
    known_zeros: bool = False
    learned: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        Lambda, K = filtered_gains(self.chain, self.Lambda, self.K)
        object.__setattr__(self, "Lambda", Lambda)
        object.__setattr__(self, "K", K)
        if self.base is None:
            self._choose_parameters()
        object.__setattr__(self, "Gamma", adaptation_gain(self.parameters.count, self.Gamma))
        given = self.estimate if np.size(self.estimate) else self.parameters.of(self.chain)
        estimate = frozen(given)
        if estimate.shape != (self.parameters.count,) or not np.isfinite(estimate).all():
            raise InvalidOption(
                f"the estimate must be {self.parameters.count} finite numbers, one for each base "
                "parameter",
                hint=f"They are: {'; '.join(self.parameters.names)}.",
            )
        object.__setattr__(self, "estimate", estimate)

    def _choose_parameters(self) -> None:
        """Set the base parameters that are learned, and those that are known.

        Raises:
            InvalidOption: A name is unknown, or none is named.
        """
        chain = self.chain
        driven = (chain.motor_inertia != 0.0) | (chain.viscous_friction != 0.0)
        driven |= chain.coulomb_friction != 0.0
        motors = bool(driven.any()) if self.motors is None else self.motors
        base = base_parameters(chain, motors=motors, known_zeros=self.known_zeros)
        chosen = list(range(base.count))
        if self.learned is not None:
            chosen = base.indices(self.learned)
            rest = [i for i in range(base.count) if i not in chosen]
            object.__setattr__(self, "known", base.select(rest))
        if not chosen:
            raise InvalidOption(
                "no base parameter is learned", hint="Name at least one, or leave `learned` out."
            )
        object.__setattr__(self, "base", base.select(chosen))

    @property
    def parameters(self) -> BaseParameters:
        """The base parameters that are estimated."""
        assert self.base is not None
        return self.base

    def with_estimate(self, estimate: Array) -> Self:
        """Controller with another estimate, shape (b,)."""
        return replace(self, estimate=estimate)

    def adaptation(self, _t: float, q: Array, qd: Array, reference: Reference, /) -> Array:
        """The gradient law Theta_hat_dot = Gamma Y^T r, shape (b,)."""
        return self.command(q, qd, reference)[1]

    def compiled_law(self, robot: Chain | None = None) -> Law:
        """The controller as arrays for the compiled loop."""
        base, known = self.parameters, self.known or self.parameters.select([])
        truth = base.of(robot or self.chain)
        estimated = Estimated(base.columns, self.Gamma, truth, known.columns, known.values)
        return law(
            Kind.ADAPTIVE,
            self.chain,
            robot,
            Kd=self.K,
            Lambda=self.Lambda,
            estimated=estimated,
        )


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
