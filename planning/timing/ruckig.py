"""The ruckig package: from state to state in the least time with bounded jerk.

Never with intermediate waypoints: those the community's version sends to a remote service.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from ruckig import InputParameter, Result, Ruckig, Synchronization
from ruckig import Trajectory as _Motion

from kinematics.arrays import Array
from kinematics.errors import InvalidTrajectory
from kinematics.trajectory import REST, Trajectory, stay
from planning.timing.failure import TimingFailed
from planning.timing.time_scaling import ScaledTime, checked_limits, dilate

# Phases shorter than this part of the motion are rounding: they would be pieces of no length.
_NOTHING = 1e-12
# Joints whose way is a smaller part of their coordinates stand still.
_SAME = 1e-15


def line_phases(
    length: float, limits: ArrayLike, start_speed: float = 0.0, end_speed: float = 0.0
) -> Array:
    """The fastest motion along a line of some length, at most seven phases of constant jerk.

    Args:
        length: Of the line, positive.
        limits: Of speed (inf for none), acceleration and jerk along it, shape (3,).
        start_speed: Along the line, not negative.
        end_speed: Likewise; the acceleration is 0 at both ends.

    Returns:
        (place, speed, acceleration / 2, jerk / 6, duration) of each phase, shape (m, 5).

    Raises:
        TimingFailed: There is no such motion, say since the line is too short to slow down on.
    """
    v, a, j = (float(value) for value in np.asarray(limits, dtype=np.float64))
    # The package's tolerances are absolute: it is asked in units of the line and of its own time.
    time = max((length / j) ** (1.0 / 3.0), (length / a) ** 0.5)
    speed = length / time
    asked = _input([0.0], [1.0], [start_speed / speed], [end_speed / speed])
    _limit(asked, [v / speed], [a * time / speed], [j * time**2 / speed])
    profile = _solve(asked, 1).profiles[0][0]
    phases, place, pace, rate = [], 0.0, start_speed, 0.0
    for duration, jerk in zip(profile.t, profile.j, strict=True):
        if duration <= _NOTHING * sum(profile.t):
            continue
        t, third = duration * time, jerk * speed / time**2
        phases.append([place, pace, 0.5 * rate, third / 6.0, t])
        place += (pace + (0.5 * rate + third * t / 6.0) * t) * t
        pace += (rate + 0.5 * third * t) * t
        rate += third * t
    return np.array(phases)


def state_to_state(
    joint_names: Sequence[str],
    start: ArrayLike,
    end: ArrayLike,
    velocity: ArrayLike,
    acceleration: ArrayLike,
    jerk: ArrayLike,
    start_velocity: ArrayLike | None = None,
    end_velocity: ArrayLike | None = None,
) -> ScaledTime:
    """From one state to another in the least time.

    From rest to rest it is the straight line, run through in phase. (The package leaves the line
    where one joint's velocity and another one's acceleration or jerk decide; so it is asked for the
    line itself.) With other velocities at the ends the joints arrive together.

    Args:
        joint_names: n names.
        start: Shape (n,).
        end: Shape (n,).
        velocity: Limits, shape (n,), inf where there is none.
        acceleration: Limits, shape (n,).
        jerk: Limits, shape (n,).
        start_velocity: Shape (n,), at rest where none is given.
        end_velocity: Likewise.

    Raises:
        InvalidOption: A limit is not positive.
        InvalidTrajectory: The states are malformed.
        TimingFailed: The package found no motion.
    """
    names = tuple(joint_names)
    states = [
        np.zeros(len(names)) if values is None else np.asarray(values, dtype=np.float64)
        for values in (start, end, start_velocity, end_velocity)
    ]
    if any(state.shape != (len(names),) or not np.isfinite(state).all() for state in states):
        raise InvalidTrajectory(f"the states must be {len(names)} finite numbers each")
    limits = [
        checked_limits(values, name, len(names))
        for values, name in ((velocity, "velocity"), (acceleration, "acceleration"), (jerk, "jerk"))
    ]
    if (states[0] == states[1]).all() and not states[2].any() and not states[3].any():
        return ScaledTime(stay(names, states[0], REST), 1.0)
    if not states[2].any() and not states[3].any():
        return dilate(_straight(names, states[0], states[1], limits), *limits)
    asked = _input(*states)
    _limit(asked, *limits)
    motion = _solve(asked, len(names))
    return dilate(_merge_phases(names, motion, states[0], states[2]), *limits)


def _straight(
    names: tuple[str, ...], start: Array, end: Array, limits: Sequence[Array]
) -> Trajectory:
    """The line from rest to rest, its share run through as s goes from 0 to 1."""
    way = end - start
    with np.errstate(divide="ignore"):
        phases = line_phases(1.0, [float((limit / np.abs(way)).min()) for limit in limits])
    coefficients = way[None, :, None] * phases[:, None, :4]
    coefficients[:, :, 0] += start
    return Trajectory(names, np.concatenate([[0.0], np.cumsum(phases[:, 4])]), coefficients)


def _input(start: ArrayLike, end: ArrayLike, before: ArrayLike, after: ArrayLike) -> InputParameter:
    values = [np.asarray(value, dtype=np.float64).tolist() for value in (start, end, before, after)]
    asked = InputParameter(len(values[0]))
    asked.current_position, asked.target_position = values[:2]
    asked.current_velocity, asked.target_velocity = values[2:]
    asked.synchronization = Synchronization.Phase
    return asked


def _limit(
    asked: InputParameter, velocity: ArrayLike, acceleration: ArrayLike, jerk: ArrayLike
) -> None:
    asked.max_velocity = np.asarray(velocity, dtype=np.float64).tolist()
    asked.max_acceleration = np.asarray(acceleration, dtype=np.float64).tolist()
    asked.max_jerk = np.asarray(jerk, dtype=np.float64).tolist()


def _solve(asked: InputParameter, n: int) -> _Motion:
    motion = _Motion(n)
    try:
        result = Ruckig(n).calculate(asked, motion)
    except Exception as error:  # noqa: BLE001  its own kind of error is no part of its interface
        raise _failure(type(error).__name__) from None
    if result not in {Result.Working, Result.Finished} or not np.isfinite(motion.duration):
        raise _failure(str(result))
    return motion


def _failure(reason: str) -> TimingFailed:
    return TimingFailed(
        f"ruckig found no motion from state to state: {reason}",
        hint="Boundary velocities must be inside the velocity limits, and leave room to brake.",
    )


def _merge_phases(
    names: tuple[str, ...], motion: _Motion, start: Array, before: Array
) -> Trajectory:
    """All joints' phases on common breaks, integrated from the start."""
    profiles = motion.profiles[0]
    ends = [np.cumsum([*_brake(p)[0], *p.t]) for p in profiles]
    times = np.unique(np.concatenate([[0.0, motion.duration], *ends]))
    times = times[(times >= 0.0) & (times <= motion.duration)]
    keep = np.append(True, np.diff(times) > _NOTHING * motion.duration)
    times = times[keep]
    times[-1] = motion.duration
    middles = 0.5 * (times[1:] + times[:-1])
    coefficients = np.zeros((len(middles), len(names), 4))
    q, v = start.copy(), before.copy()
    a = np.zeros(len(names))
    for i, h in enumerate(np.diff(times)):
        j = np.array([_jerk_at(p, end, middles[i]) for p, end in zip(profiles, ends, strict=True)])
        coefficients[i] = np.column_stack([q, v, 0.5 * a, j / 6.0])
        q = q + (v + (0.5 * a + j * h / 6.0) * h) * h
        v = v + (a + 0.5 * j * h) * h
        a = a + j * h
    return Trajectory(names, times, coefficients)


def _brake(profile: object) -> tuple[list[float], list[float]]:
    brake = profile.brake  # type: ignore[attr-defined]
    return list(brake.t), list(brake.j)


def _jerk_at(profile: object, ends: Array, time: float) -> float:
    jerks = [*_brake(profile)[1], *profile.j]  # type: ignore[attr-defined]
    i = int(np.searchsorted(ends, time))
    return float(jerks[i]) if i < len(jerks) else 0.0
