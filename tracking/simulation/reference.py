"""A trajectory as the reference of a controller, extended by rest after its end."""

from dataclasses import dataclass, field

import numpy as np

from kinematics.arrays import Array
from kinematics.trajectory.trajectory import Trajectory
from tracking.controllers.controller import Reference


@dataclass(frozen=True, slots=True, eq=False)
class ReferenceSignal:
    """Position, velocity and acceleration of a trajectory, piece by piece.

    An integrator must see one smooth piece at a time: at a break where the acceleration jumps,
    the piece decides which of the two is meant. The robot rests at the end in the piece after
    the last.

    Args:
        trajectory: Trajectory to follow.
    """

    trajectory: Trajectory
    rates: tuple[Array, Array, Array] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        orders = (self.trajectory.derivative(order).coefficients for order in range(3))
        object.__setattr__(self, "rates", tuple(orders))

    def piece(self, t: float) -> int:
        """Index of the piece that begins at, or contains, time ``t`` [s]."""
        return int(np.searchsorted(self.trajectory.breaks, t, side="right")) - 1

    def arrays(self) -> tuple[Array, Array]:
        """Breaks (m + 1,) and coefficients (m + 1, n, k); the last piece is the rest at the end."""
        m, n, k = self.trajectory.coefficients.shape
        coefficients = np.zeros((m + 1, n, k))
        coefficients[:m] = self.trajectory.coefficients
        coefficients[m, :, 0] = self.trajectory.end
        return np.array(self.trajectory.breaks), coefficients

    def breaks(self, duration: float) -> list[float]:
        """Times within (0, duration) at which a piece ends [s]."""
        return [float(t) for t in self.trajectory.breaks[1:] if t < duration]

    def at(self, t: float, piece: int | None = None) -> Reference:
        """The reference at time ``t`` [s], in a given piece where its neighbour's may differ."""
        i = self.piece(t) if piece is None else piece
        if i >= self.trajectory.pieces:
            rest = np.zeros(self.trajectory.n)
            return Reference(self.trajectory.end, rest, rest)
        powers = (t - self.trajectory.breaks[i]) ** np.arange(self.trajectory.degree + 1.0)
        return Reference(*(c[i] @ powers[: c.shape[2]] for c in self.rates))
