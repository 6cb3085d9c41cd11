"""Options of the simulation of a closed loop."""

import math
from dataclasses import dataclass

from kinematics.errors import InvalidOption
from tracking.simulation.joint_stop import JointStops


@dataclass(frozen=True, slots=True)
class SimulationOptions:
    """Options of integration and recording.

    Args:
        duration: [s]; the trajectory's own where none is given, longer to watch it settle.
        sample_period: Time between two samples of the result [s].
        control_period: Time for which the torque is held [s]; None for a continuous controller.
        relative_tolerance: Relative tolerance of each step of the integrator.
        absolute_tolerance: Absolute tolerance of each step [rad, m, rad/s, m/s].
        saturate: Cut the torque off at the robot's effort limits; all must then be known.
        settling_tolerance: Largest tracking error of a settled robot [rad or m].
        stops: Stops of the joints at their position limits; none where none are given, so that
            joints pass their limits.
        tube: Whether bounds are kept in cells of time, with the integrator's errors carried along,
            for ``tracking.tube.tube``; a simulation takes about twice as long.
        max_evaluations: Evaluations of the robot's dynamics before giving up.

    Raises:
        InvalidOption: A value is not positive, or a tolerance is not within 1e-13 to 1e-2.
    """

    duration: float | None = None
    sample_period: float = 0.01
    control_period: float | None = None
    relative_tolerance: float = 1e-8
    absolute_tolerance: float = 1e-10
    saturate: bool = True
    settling_tolerance: float = 1e-3
    max_evaluations: int = 1_000_000
    stops: JointStops | None = None
    tube: bool = False

    def __post_init__(self) -> None:
        for name in ("duration", "sample_period", "control_period", "settling_tolerance"):
            value = getattr(self, name)
            if value is not None and not 0.0 < value < math.inf:
                raise InvalidOption(f"{name} is {value}", hint="Give a positive finite number.")
        for name in ("relative_tolerance", "absolute_tolerance"):
            value = getattr(self, name)
            # Below 1e-13 rounding errors alone exceed it; above 1e-2 the answer means nothing.
            if not 1e-13 <= value <= 1e-2:
                raise InvalidOption(f"{name} is {value}", hint="Give one from 1e-13 to 1e-2.")
        if self.max_evaluations < 1:
            raise InvalidOption(
                f"max_evaluations is {self.max_evaluations}", hint="Give at least 1."
            )
