"""Motions from state to state in the least time with bounded jerk, by the ruckig package.

A state is position, velocity and acceleration of each joint. Each joint runs through phases of
constant jerk, so the motion is a cubic of time in each piece. It begins with exactly the state
asked for; it is never slowed down afterwards, since that would change its boundary velocities.

Never with intermediate waypoints: the community's version sends those to a remote service.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from ruckig import InputParameter, Result, Ruckig
from ruckig import Synchronization as RuckigSynchronization
from ruckig import Trajectory as Phases

from kinematics.arrays import Array, frozen
from kinematics.errors import InvalidOption, InvalidTrajectory
from kinematics.trajectory.trajectory import REST, Trajectory, stay
from planning.timing.options import TimingFailed

#: Joints in phase on a straight line where the states allow one, or arriving together only.
Synchronization = Literal["phase", "time"]

# Phases shorter than this part of the motion are rounding: they would be pieces of no length [-].
_NO_LENGTH = 1e-12
# A state may exceed a limit by what adding and multiplying round off [-].
_ROUNDING = 1e-12
# Newton's steps that bring the end of the phases to the target: its tolerance of 1e-8 takes two.
_STEPS = 3
#: Joints with at most this part of their limits of speed or acceleration rest: what rounding leaves
#: [-]. A motion that goes on from there meets it within what counts as no jump.
AT_REST = 1e-10
# Phases end in position, velocity and acceleration to this, else they are none [rad or m, and s].
_SAME_STATE = np.array([[1e-9], [1e-9], [1e-6]])


@dataclass(frozen=True, slots=True, eq=False)
class JointState:
    """Position, velocity and acceleration of all joints.

    Args:
        position: Shape (n,) [rad or m].
        velocity: Shape (n,) [rad/s or m/s]; at rest where None.
        acceleration: Shape (n,) [rad/s^2 or m/s^2]; zero where None.

    Raises:
        InvalidTrajectory: The rows are not finite numbers of one length.
    """

    position: Array
    velocity: Array | None = None
    acceleration: Array | None = None

    def __post_init__(self) -> None:
        position = _row(self.position, "position")
        object.__setattr__(self, "position", position)
        for name in ("velocity", "acceleration"):
            given = getattr(self, name)
            row = _row(np.zeros_like(position) if given is None else given, name)
            if row.shape != position.shape:
                raise InvalidTrajectory(
                    f"a state has {len(position)} position(s) and {len(row)} {name} value(s)",
                    hint="Give one value for each joint.",
                )
            object.__setattr__(self, name, row)

    @property
    def rows(self) -> Array:
        """Position, velocity and acceleration, shape (3, n)."""
        assert self.velocity is not None
        assert self.acceleration is not None
        return np.stack([self.position, self.velocity, self.acceleration])


def state_to_state(
    joint_names: Sequence[str],
    start: JointState,
    end: JointState,
    limits: ArrayLike,
    synchronization: Synchronization = "phase",
    duration: float | None = None,
) -> Trajectory:
    """The motion from one state to another in the least time, all joints arriving together.

    Args:
        joint_names: n names.
        start: State at time 0.
        end: State at the end.
        limits: Limits of velocity (inf for none), acceleration and jerk, shape (3, n).
        synchronization: "phase" for a straight line in joint space where the states allow one,
            else as "time"; "time" for a common duration only.
        duration: Duration of the motion [s]; None for the least.

    Raises:
        InvalidTrajectory: States and joints do not fit.
        InvalidOption: A limit is not positive, or a state can't be kept within the limits.
        TimingFailed: The package found no motion, or none that takes as long as asked.
    """
    names = tuple(joint_names)
    bounds = np.asarray(limits, dtype=np.float64)
    _check(names, start, end, bounds)
    states = without_rounding(start.rows, bounds), without_rounding(end.rows, bounds)
    if (states[0] == states[1]).all() and not states[0][1:].any():
        return stay(names, start.position, duration or REST)
    scales = _scales(states, bounds)
    # Part of each limit that the package may use: what is left covers the rounding of its roots,
    # and is far below the tolerance of the certificate [-].
    wanted = _input(states, bounds * (1.0 - 1e-10), scales, synchronization)
    if duration is None:
        phases = _solve(wanted)
        return _trajectory(names, phases, states, scales, float(phases.duration) * scales[1])
    wanted.minimum_duration = duration / scales[1]
    phases = _solve(wanted)
    # Durations that differ by less than this part are the same [-].
    if float(phases.duration) * scales[1] > duration * (1.0 + 1e-9):
        wanted.minimum_duration = None
        least = float(_solve(wanted).duration) * scales[1]
        later = f", or {float(phases.duration) * scales[1]:.9g} s" if least < duration else ""
        raise TimingFailed(
            f"the motion takes at least {least:.9g} s{later}, and is to take {duration:.9g} s",
            hint="Give a longer duration, or higher limits.",
            least_duration=least,
        )
    return _trajectory(names, phases, states, scales, duration)


def _row(values: ArrayLike, name: str) -> Array:
    row = frozen(values)
    if row.ndim != 1 or not len(row) or not np.isfinite(row).all():
        raise InvalidTrajectory(f"the {name} of a state is not a list of finite numbers")
    return row


def _check(names: tuple[str, ...], start: JointState, end: JointState, bounds: Array) -> None:
    """Refuse limits that bind nothing, and states that no motion keeps within them."""
    n = len(names)
    if bounds.shape != (3, n) or not (bounds > 0.0).all() or not np.isfinite(bounds[1:]).all():
        raise InvalidOption(
            f"limits of velocity, acceleration and jerk must be 3 x {n} positive numbers",
            hint="Only velocities may be unlimited.",
        )
    for label, state, sign in (("from", start, 1.0), ("to", end, -1.0)):
        rows = state.rows
        if rows.shape[1] != n:
            raise InvalidTrajectory(f"{label} has {rows.shape[1]} joint(s), not {n}")
        turned = _turned(rows[1], rows[2], bounds[2], sign)
        for name, values, most in (
            ("velocity", rows[1], bounds[0]),
            ("acceleration", rows[2], bounds[1]),
            ("velocity that the acceleration leads to", turned, bounds[0]),
        ):
            over = np.flatnonzero(np.abs(values) > most * (1.0 + _ROUNDING))
            if len(over):
                j = int(over[0])
                raise InvalidOption(
                    f"{label}: the {name} of joint {names[j]!r} is {values[j]:.9g}, its limit is "
                    f"{most[j]:.9g}",
                    hint="No motion with this state keeps the limit: change one of the two.",
                    joint=names[j],
                    value=float(values[j]),
                    limit=float(most[j]),
                )


def without_rounding(rows: Array, bounds: Array) -> Array:
    """A state (3, n) without speeds and accelerations that only rounding leaves.

    Args:
        rows: Position, velocity and acceleration, shape (3, n).
        bounds: Bounds of velocity, acceleration and jerk, shape (3, n).
    """
    rest = AT_REST * np.where(np.isfinite(bounds[:2]), bounds[:2], 0.0)
    return np.concatenate([rows[:1], np.where(np.abs(rows[1:]) <= rest, 0.0, rows[1:])])


def _turned(velocity: ArrayLike, acceleration: ArrayLike, jerk: ArrayLike, sign: float) -> Array:
    """Velocities where the largest jerk has brought accelerations to zero, shape (n,).

    Args:
        velocity: Shape (n,).
        acceleration: Shape (n,).
        jerk: Limits, shape (n,).
        sign: 1 for what follows a state, -1 for what goes before it.
    """
    a = np.asarray(acceleration)
    return np.asarray(np.asarray(velocity) + sign * a * np.abs(a) / (2.0 * np.asarray(jerk)))


def _scales(states: tuple[Array, Array], bounds: Array) -> tuple[Array, float]:
    """Units of each joint (n,) and of time for the package, whose tolerances are absolute."""
    way = np.abs(states[1][0] - states[0][0])
    speed = np.maximum(np.abs(states[0][1]), np.abs(states[1][1]))
    push = np.maximum(np.abs(states[0][2]), np.abs(states[1][2]))
    times = [
        np.cbrt(way / bounds[2]),
        np.sqrt(way / bounds[1]),
        speed / bounds[1],
        np.sqrt(speed / bounds[2]),
        push / bounds[2],
    ]
    time = float(np.max(times))
    within_limits = np.min([bounds[0] * time, bounds[1] * time**2, bounds[2] * time**3], axis=0)
    # A joint's unit is at least this part of the way that its limits allow in the time: one that
    # rests but for rounding would have limits of 1e12 units else, which the package finds no phases
    # for [-].
    length = [way, speed * time, push * time**2, 0.01 * within_limits]
    return np.asarray(np.max(length, axis=0)), time


def _input(
    states: tuple[Array, Array],
    bounds: Array,
    scales: tuple[Array, float],
    synchronization: Synchronization,
) -> InputParameter:
    length, time = scales
    units = length / time ** np.arange(4.0)[:, None]
    origin = states[0][0]
    (p0, v0, a0), (p1, v1, a1) = (
        (np.stack([rows[0] - origin, rows[1], rows[2]]) / units[:3]).tolist() for rows in states
    )
    wanted = InputParameter(len(length))
    wanted.current_position, wanted.target_position = p0, p1
    wanted.current_velocity, wanted.target_velocity = v0, v1
    wanted.current_acceleration, wanted.target_acceleration = a0, a1
    limits = (bounds / units[1:]).tolist()
    # A boundary value on its limit stays inside, and so does the velocity that it leads to: the
    # package would brake first, or refuse.
    after, before = _turned(v0, a0, limits[2], 1.0), _turned(v1, a1, limits[2], -1.0)
    ends = np.stack([np.array(v0), np.array(v1), after, before])
    largest = np.abs(ends).max(axis=0) * (1.0 + _ROUNDING)
    wanted.max_velocity = np.maximum(limits[0], largest).tolist()
    wanted.max_acceleration = np.maximum(limits[1], np.abs([a0, a1]).max(axis=0)).tolist()
    wanted.max_jerk = limits[2]
    phase, time_only = RuckigSynchronization.Phase, RuckigSynchronization.Time
    wanted.synchronization = phase if synchronization == "phase" else time_only
    return wanted


def _solve(wanted: InputParameter) -> Phases:
    n = wanted.degrees_of_freedom
    motion = Phases(n)
    try:
        result = Ruckig(n).calculate(wanted, motion)
    except Exception as error:  # noqa: BLE001  its own kind of error is no part of its interface
        raise _failure(type(error).__name__) from None
    if result not in {Result.Working, Result.Finished} or not np.isfinite(motion.duration):
        raise _failure(str(result))
    return motion


def _failure(reason: str) -> TimingFailed:
    return TimingFailed(
        f"ruckig found no motion from state to state: {reason}",
        hint="Boundary velocities and accelerations must be inside their limits, and leave room to "
        "brake.",
    )


def _trajectory(
    names: tuple[str, ...],
    phases: Phases,
    states: tuple[Array, Array],
    scales: tuple[Array, float],
    total: float,
) -> Trajectory:
    """All joints' phases on common breaks, each joint integrated from its start."""
    length, unit = scales
    joints = []
    for k, profile in enumerate(phases.profiles[0]):
        durations, scaled = np.array(profile.t), np.array(profile.j)
        long_enough = durations > _NO_LENGTH * (total / unit)
        jerks = scaled[long_enough] * length[k] / unit**3
        given = durations[long_enough] * unit
        joints.append((_polish(given, jerks, states[0][:, k], states[1][:, k]), jerks))
    ends = [np.cumsum(durations) for durations, _ in joints]
    times = np.unique(np.concatenate([[0.0], *ends]))
    times = times[times <= total * (1.0 - _NO_LENGTH)]
    times = np.append(times[np.append(True, np.diff(times) > _NO_LENGTH * total)], total)
    middles = 0.5 * (times[1:] + times[:-1])
    # After its last phase a joint has no jerk.
    jerks_at = np.array(
        [np.append(js, 0.0)[end.searchsorted(middles)]
         for (_, js), end in zip(joints, ends, strict=True)]
    )  # fmt: skip
    coefficients = np.empty((len(middles), len(names), 4))
    q, v, a = states[0]
    for i, h in enumerate(np.diff(times)):
        j = jerks_at[:, i]
        coefficients[i] = np.column_stack([q, v, 0.5 * a, j / 6.0])
        q = q + (v + (0.5 * a + j * h / 6.0) * h) * h
        v = v + (a + 0.5 * j * h) * h
        a = a + j * h
    missing = np.abs(np.stack([q, v, a]) - states[1])
    if not (missing <= _SAME_STATE * (1.0 + np.abs(states[1]))).all():
        raise _failure(f"its phases end {missing.max():.3g} off")
    return Trajectory(names, times, coefficients)


def _polish(durations: Array, jerks: Array, start: Array, end: Array) -> Array:
    """Durations with which phases end in their target to rounding: Newton's method.

    The derivative of the end with respect to a phase's duration is the rate at that phase's end,
    carried on through the rest. The sum stays.

    Args:
        durations: Shape (m,), positive [s].
        jerks: Jerks of the phases, shape (m,).
        start: Position, velocity and acceleration, shape (3,).
        end: State to be reached, shape (3,).
    """
    if not len(durations):
        return durations
    total = float(durations.sum())
    scale = total ** np.arange(3.0)
    for _ in range(_STEPS):
        state, rates = start, []
        for t, j in zip(durations, jerks, strict=True):
            q, v, a = state
            state = np.array(
                [q + (v + (0.5 * a + j * t / 6.0) * t) * t, v + (a + 0.5 * j * t) * t, a + j * t]
            )
            rates.append([state[1], state[2], j])
        rest = total - np.cumsum(durations)
        v, a, j = np.array(rates).T
        columns = np.stack([v + (a + 0.5 * j * rest) * rest, a + j * rest, j])
        matrix = np.vstack([columns * scale[:, None], np.ones(len(rest))])
        missing = np.append((end - state) * scale, total - float(durations.sum()))
        size = np.abs(matrix).max(axis=1)
        size[size == 0.0] = 1.0
        # Directions in which durations change nothing by more than this part are left alone [-].
        step = np.linalg.lstsq(matrix / size[:, None], missing / size, rcond=1e-10)[0]
        durations = durations + np.clip(step, -0.5 * durations, None)
    return durations
