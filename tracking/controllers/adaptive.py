"""Adaptive control: passivity-based, with the model learned on the way."""

from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from dynamics.parameters.base_parameters import BaseParameters, base_parameters
from kinematics.arrays import Array, frozen
from kinematics.errors import InvalidOption
from kinematics.model.chain import Chain
from tracking.controllers.control_law import Estimated, Kind, Law, law
from tracking.controllers.controller import AdaptiveController, LawController, Reference
from tracking.controllers.gain import adaptation_gain, filtered_gains


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
