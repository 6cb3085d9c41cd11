"""Paths to be timed and timed paths, as values."""

from dataclasses import dataclass

import numpy as np

from kinematics.arrays import Array
from kinematics.errors import InvalidTrajectory
from kinematics.trajectory.trajectory import Trajectory
from planning.proof.certificate import Certificate
from planning.retiming.limits_at import Stretch
from planning.stops.certificate import StopCertificate
from planning.timing.parametrization import TimingReport


@dataclass(frozen=True, slots=True, eq=False)
class PathToTime:
    """A path whose motion is wanted.

    Args:
        joint_names: n names.
        waypoints: Shape (k, n), k >= 1 [rad or m].
        knots: Knots of a spline through them, shape (k,); by distance in joint space where none are
            given. Times, for the method "spline" [s].
        tolerance: How far any joint may be from straight lines through them, at every place, for
            the motion to have the fewest corners [rad or m]; None for none.
        limits_at: Limits along stretches of it, beside those of the whole motion. A stretch that
            begins or ends where a corner is rounded takes in the whole curve.
    """

    joint_names: tuple[str, ...]
    waypoints: Array
    knots: Array | None = None
    tolerance: float | None = None
    limits_at: tuple[Stretch, ...] = ()

    @property
    def points(self) -> Array:
        """The waypoints as an array, shape (k, n).

        Raises:
            InvalidTrajectory: They have another shape.
        """
        points = np.asarray(self.waypoints, dtype=np.float64)
        if points.ndim != 2 or len(points) < 1 or points.shape[1] != len(self.joint_names):
            raise InvalidTrajectory(
                f"a path of shape {points.shape} does not have {len(self.joint_names)} joint(s)",
                hint=f"The joints are: {', '.join(self.joint_names)}; give one value for each.",
            )
        return points


@dataclass(frozen=True, slots=True, eq=False)
class Retimed:
    """A timed path.

    Args:
        trajectory: The motion.
        certificate: Proof of its limits; not verified where times given break them.
        factor: How many times as long as asked the motion is: times given were stretched by it.
        needed_factor: How many times as long the motion would have to be to keep all limits; 1
            where it does, None where no slowing down cures it: outside a joint's range, or a jump.
        notes: Notes on the path: waypoints left out, stops.
        begins: Time at which the motion begins, the first of given times [s].
        timing: Method and limits that it was timed by.
        stops: The proof of its stops along the path, where these were asked for.
    """

    trajectory: Trajectory
    certificate: Certificate
    factor: float
    needed_factor: float | None
    notes: tuple[str, ...]
    begins: float = 0.0
    timing: TimingReport | None = None
    stops: StopCertificate | None = None

    @property
    def lower_bound(self) -> float:
        """Time that no motion along the same way undercuts, but for jerk, torque and tool [s]."""
        return 0.0 if self.timing is None else self.timing.lower_bound(self.trajectory)

    @property
    def peaks(self) -> dict[str, Array]:
        """Exact largest |velocity|, |acceleration| and |jerk| of each joint, each (n,)."""
        return {
            name: np.asarray(self.trajectory.peaks(order).value)
            for order, name in enumerate(("velocity", "acceleration", "jerk"), start=1)
        }
