"""Time-optimal motions along a line with bounded jerk, by the ruckig package.

Never with intermediate waypoints: the community's version sends those to a remote service.
"""

import numpy as np
from numpy.typing import ArrayLike
from ruckig import InputParameter, Result, Ruckig, Trajectory

from kinematics.arrays import Array
from planning.timing.failure import TimingFailed


def line_phases(
    length: float, limits: ArrayLike, start_speed: float = 0.0, end_speed: float = 0.0
) -> Array:
    """The fastest motion along a line of some length, at most seven phases of constant jerk.

    Args:
        length: Length of the line, positive.
        limits: Limits of speed (inf for none), acceleration and jerk along it, shape (3,).
        start_speed: Start speed along the line, not negative.
        end_speed: End speed along the line; the acceleration is 0 at both ends.

    Returns:
        (place, speed, acceleration / 2, jerk / 6, duration) of each phase, shape (m, 5).

    Raises:
        TimingFailed: There is no such motion, say since the line is too short to slow down on.
    """
    v, a, j = (float(value) for value in np.asarray(limits, dtype=np.float64))
    # The package's tolerances are absolute: it is asked in units of the line and of its own time.
    time = max((length / j) ** (1.0 / 3.0), (length / a) ** 0.5)
    speed = length / time
    line = InputParameter(1)
    line.current_position, line.target_position = [0.0], [1.0]
    line.current_velocity, line.target_velocity = [start_speed / speed], [end_speed / speed]
    line.max_velocity, line.max_acceleration = [v / speed], [a * time / speed]
    line.max_jerk = [j * time**2 / speed]
    profile = _solve(line).profiles[0][0]
    phases, place, pace, rate = [], 0.0, start_speed, 0.0
    for duration, jerk in zip(profile.t, profile.j, strict=True):
        # Phases shorter than this part of the motion are rounding: they would be pieces of no
        # length.
        if duration <= 1e-12 * sum(profile.t):
            continue
        t, third = duration * time, jerk * speed / time**2
        phases.append([place, pace, 0.5 * rate, third / 6.0, t])
        place += (pace + (0.5 * rate + third * t / 6.0) * t) * t
        pace += (rate + 0.5 * third * t) * t
        rate += third * t
    return np.array(phases)


def _solve(line: InputParameter) -> Trajectory:
    motion = Trajectory(1)
    try:
        result = Ruckig(1).calculate(line, motion)
    except Exception as error:  # noqa: BLE001  its own kind of error is no part of its interface
        raise _failure(type(error).__name__) from None
    if result not in {Result.Working, Result.Finished} or not np.isfinite(motion.duration):
        raise _failure(str(result))
    return motion


def _failure(reason: str) -> TimingFailed:
    return TimingFailed(
        f"ruckig found no motion along a line: {reason}",
        hint="Boundary velocities must be inside the velocity limits, and leave room to brake.",
    )
