"""Motions that pass waypoints at given times with bounded jerk, leg by leg from state to state."""

from collections.abc import Mapping, Sequence

import numpy as np

from kinematics.arrays import Array
from kinematics.errors import InvalidOption, InvalidTrajectory
from kinematics.model.chain import Chain, Limits
from kinematics.trajectory.trajectory import Trajectory, concatenate
from planning.proof.certificate import certify_limits
from planning.retiming.retimed import PathToTime, Retimed
from planning.timing.choice import chosen_parametrization, require_limits, required_limits
from planning.timing.jerk.state_to_state import JointState, state_to_state
from planning.timing.method import timing_method
from planning.timing.options import TimingFailed, TimingOptions
from planning.timing.parametrization import TimingReport
from planning.timing.spline.spline import spline_trajectory

#: Waypoints with times of one motion: each leg takes some milliseconds.
MAX_PASSAGES = 1000
# Shares of a spline's velocities that waypoints without one are passed with, in turn.
_SHARES = (1.0, 0.75, 0.5, 0.25, 0.0)
# Part of a velocity limit that is left for rounding [-].
_HAIR = 1e-9


def time_passages(
    path: PathToTime,
    timing: TimingOptions,
    overrides: Mapping[str, Array],
    chain: Chain | None = None,
) -> Retimed:
    """The motion that passes each waypoint at its time, with bounded jerk, its limits certified.

    Each leg leads from state to state, all joints arriving together, with no acceleration at the
    waypoints. Waypoints whose velocity is not given are passed at a share of that of a cubic spline
    of time through all of them, the largest share of a few with which every leg can be had.

    Args:
        path: Waypoints.
        timing: Options, with times and perhaps velocities.
        overrides: Limits (n,) by quantity, in place of the robot's.
        chain: The robot; without one the limits have to be given.

    Raises:
        MissingLimit: A limit that is needed is not known; the message names the joints.
        InvalidTrajectory: Waypoints and times do not fit.
        InvalidOption: Options do not go together.
        TimingFailed: A leg takes longer than its times allow; the details say how long at least.
    """
    names, points = path.joint_names, path.points
    _refuse_others(path, timing)
    if chain is None:
        require_limits(required_limits(timing_method("jerk_limited")), names, overrides)
    limits = Limits.unlimited(len(names)) if chain is None else chain.limits
    by = chosen_parametrization(timing, names, limits, overrides, chain)
    if by.loads is not None:
        raise InvalidOption(
            "timing.times of jerk_limited do not go with limits of torque and tool speed",
            hint="Leave one of them out, or ask for the method spline.",
        )
    times = np.asarray(timing.times, dtype=np.float64)
    given = _given_velocities(timing, points)
    over = np.argwhere(np.abs(given) > by.velocity)
    if len(over):
        i, j = over[0].tolist()
        raise InvalidOption(
            f"timing.velocities[{i}] is {given[i, j]:.9g} for joint {names[j]!r}, its limit is "
            f"{by.velocity[j]:.9g}",
            hint="No motion with this velocity keeps the limit: change one of the two.",
        )
    motion = _motion(names, points, times - times[0], given, by.jerk_bounds)
    certificate = certify_limits(motion, chain, by.motion_limits)
    if certificate.violation is not None:
        raise TimingFailed(
            f"no motion was proved: {certificate.violation.message}",
            hint="Give velocities that lead less far, or more waypoints.",
        )
    report = TimingReport("jerk_limited", None, by.bounds, by.ruled)
    return Retimed(motion, certificate, 1.0, 1.0, (), float(times[0]), report)


def _refuse_others(path: PathToTime, timing: TimingOptions) -> None:
    """Refuse options of a motion along a path, which is not followed between its waypoints."""
    others = {
        "path.tolerance": path.tolerance,
        "path.knots": path.knots,
        "limits_at": path.limits_at or None,
        "timing.blend_tolerance": timing.blend_tolerance,
        "timing.interpolation": timing.interpolation,
        "timing.start_velocity": timing.start_velocity,
        "timing.end_velocity": timing.end_velocity,
    }
    for name, value in others.items():
        if value is not None:
            raise InvalidOption(
                f"{name} does not go with timing.times of jerk_limited, which leave the path",
                hint="Leave it out; timing.velocities are those at the waypoints.",
            )


def _given_velocities(timing: TimingOptions, points: Array) -> Array:
    """Velocities at the waypoints (k, n), NaN where none are given; rest at the ends.

    Raises:
        InvalidTrajectory: Times or velocities do not fit the waypoints.
    """
    k, n = points.shape
    times = np.asarray(timing.times, dtype=np.float64)
    if not 2 <= k <= MAX_PASSAGES or times.shape != (k,) or not (np.diff(times) > 0.0).all():
        raise InvalidTrajectory(
            f"timing.times are {times.size} for {k} waypoint(s), or do not increase",
            hint=f"Give one for each of 2 to {MAX_PASSAGES} waypoints, increasing.",
        )
    rows = timing.velocities or [None] * k
    if len(rows) != k or any(row is not None and np.shape(row) != (n,) for row in rows):
        raise InvalidTrajectory(
            f"timing.velocities are not {k} rows of {n} numbers",
            hint="Give a row or null for each waypoint.",
        )
    found = np.array([np.full(n, np.nan) if row is None else row for row in rows])
    for end in (0, -1):
        found[end] = np.nan_to_num(found[end])
    return found


def _motion(
    names: Sequence[str], points: Array, times: Array, given: Array, bounds: Array
) -> Trajectory:
    """The motion, its legs at the first shares of a spline's velocities that they can be had with.

    Raises:
        TimingFailed: A leg takes longer: the first one of the best attempt.
    """
    free, farthest = np.isnan(given), (-1, 0.0)
    ends = given[0], given[-1]
    led = spline_trajectory(names, points, times, "clamped", ends).sample(times, 1)
    most = bounds[0] * (1.0 - _HAIR)
    for share in _SHARES if free.any() else (1.0,):
        velocities = np.where(free, np.clip(share * led, -most, most), given)
        states = [JointState(*rows) for rows in zip(points, velocities, strict=True)]
        legs: list[Trajectory] = []
        try:
            for i, duration in enumerate(np.diff(times)):
                legs.append(
                    state_to_state(names, states[i], states[i + 1], bounds, "time", duration)
                )
        except TimingFailed as error:
            reached = (len(legs), -float(error.details.get("least_duration", np.inf)))
            if reached > farthest:
                farthest, failure, at = reached, error, velocities
            continue
        return concatenate(legs)
    between = [farthest[0], farthest[0] + 1]
    raise TimingFailed(
        f"between waypoints {between[0]} and {between[1]}: {failure.message}",
        hint="Give later times, higher limits, or other velocities.",
        waypoints=between,
        velocities=at[between].tolist(),
        **failure.details,
    )
