"""Results of closed-loop simulations."""

from dataclasses import dataclass, fields
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from kinematics.arrays import Array, frozen
from tracking.tube.motion_bounds import MotionBounds


class SimulationOutcome(Enum):
    """Outcome of a simulation; the value says what it means and what to try."""

    COMPLETED = "the whole motion was simulated"
    DIVERGED = (
        "the closed loop is unstable: lower the gains, shorten the control period, "
        "or check the model against the robot"
    )
    EXHAUSTED = (
        "the evaluations allowed were spent before the end: lower the gains, "
        "loosen the tolerances, or allow more evaluations"
    )


@dataclass(frozen=True, slots=True, eq=False)
class SimulationResult:
    """A closed-loop motion at m instants, up to where it broke off if it did.

    Args:
        outcome: Outcome of the simulation.
        times: Shape (m,) [s].
        position: q, shape (m, n) [rad or m].
        velocity: Shape (m, n) [rad/s or m/s].
        reference_position: q^r, shape (m, n).
        reference_velocity: Shape (m, n).
        torque: Applied by the motors, after saturation, shape (m, n) [N m or N].
        saturated: Whether more torque was asked than applied, shape (m, n).
        lyapunov: V of the controller's stability proof, with the true robot's M and parameters,
            shape (m,).
        lyapunov_rate: Rate V_dot of V along this motion, shape (m,); NaN for a controller without.
        estimate: Parameters of an adaptive controller, shape (m, p); p = 0 for the others.
        max_tracking_error: Largest |q^r - q| of each joint at any instant, bounded over every step
            of the integrator, shape (n,) [rad or m].
        bounds: Least and largest errors, positions and velocities over small cells of time.
        settling_time: First sample from which on the tracking error stays within the settling
            tolerance [s]; None where it does not at the end.
        evaluations: Evaluations of the robot's dynamics that it took.
        steps: Steps of the explicit method.
        implicit_steps: Steps of the implicit method, which a stiff loop is gone on with.
    """

    outcome: SimulationOutcome
    times: Array
    position: Array
    velocity: Array
    reference_position: Array
    reference_velocity: Array
    torque: Array
    saturated: NDArray[np.bool_]
    lyapunov: Array
    lyapunov_rate: Array
    estimate: Array
    max_tracking_error: Array
    bounds: MotionBounds
    settling_time: float | None
    evaluations: int
    steps: int = 0
    implicit_steps: int = 0

    def __post_init__(self) -> None:
        self.saturated.setflags(write=False)
        for item in fields(self):
            value = getattr(self, item.name)
            if isinstance(value, np.ndarray) and value.dtype == np.float64:
                object.__setattr__(self, item.name, frozen(value))

    @property
    def tracking_error(self) -> Array:
        """The error q_tilde = q^r - q, shape (m, n) [rad or m]."""
        return np.asarray(self.reference_position - self.position)

    @property
    def settled(self) -> bool:
        """Whether the motion was completed and ended within the settling tolerance."""
        return self.outcome is SimulationOutcome.COMPLETED and self.settling_time is not None


def settling_time(times: Array, error: Array, tolerance: float) -> float | None:
    """First of ``times`` (m,) from which on all of ``error`` (m, n) stays within ``tolerance``."""
    outside = np.flatnonzero(np.abs(error).max(axis=1) > tolerance)
    if len(outside) == 0:
        return float(times[0])
    last = int(outside[-1])
    return None if last == len(times) - 1 else float(times[last + 1])
