"""A motion while it is optimised: control points and a duration."""

from dataclasses import dataclass

import numpy as np

from kinematics.arrays import Array
from kinematics.trajectory.trajectory import Trajectory
from planning.optimize.spline import SplineSpace
from planning.optimize.task import End


@dataclass(frozen=True, slots=True, eq=False)
class Iterate:
    """A spline of normalised time run through in a duration.

    Args:
        space: Degree and knots.
        points: Control points, shape (N, n).
        duration: T [s].
    """

    space: SplineSpace
    points: Array
    duration: float

    def sample(self, places: Array, derivative: int = 0) -> Array:
        """q, or a derivative with respect to u = t / T, at places u (K,), shape (K, n)."""
        first, basis = self.space.basis(places, derivative)
        rows = first[:, None] + np.arange(self.space.degree + 1)
        return np.asarray(np.einsum("ki,kin->kn", basis, self.points[rows]))

    def trajectory(self, joint_names: tuple[str, ...]) -> Trajectory:
        """The motion in time."""
        return self.space.trajectory(joint_names, self.points, self.duration)

    def with_ends(self, start: End, end: End) -> "Iterate":
        """With the control points at both ends moved so that they are exactly as given."""
        points = self.points.copy()
        set_ends(self.space, points, self.duration, start, end)
        return Iterate(self.space, points, self.duration)

    def toward(self, other: "Iterate", share: float) -> "Iterate":
        """Part of the way to another iterate of the same space."""
        points = self.points + share * (other.points - self.points)
        duration = self.duration + share * (other.duration - self.duration)
        return Iterate(self.space, points, duration)


def set_ends(space: SplineSpace, points: Array, duration: float, start: End, end: End) -> None:
    """Write the control points (N, n) that position and derivatives at the ends decide."""
    for place, given, inwards in ((0, start, 1), (-1, end, -1)):
        points[place] = given.position
        for order, value in enumerate(given.derivatives[1:], start=1):
            row = space.differences[order - 1][place]
            at = place + inwards * order
            rest = row @ points - row[at] * points[at]
            points[at] = (value * duration**order - rest) / row[at]
