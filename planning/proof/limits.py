"""The limits that a timed motion keeps, from the exact extrema of its polynomials.

Positions, velocities, accelerations and jerks are polynomials of time, so their extrema are exact.
Torques and the tool's speed are not: these are bounded for every instant, from above, by enclosures
over cells of time that are halved until the bound is a thousandth above what is reached.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from kinematics.arrays import Array
from kinematics.chain import Limits
from kinematics.trajectory import Trajectory
from planning.proof.violation import RATIO_TOLERANCE, Violation
from planning.timing.effort_limits import EffortLimits

#: Largest jump of position and velocity between pieces [rad or m, rad/s or m/s].
JUMP_TOLERANCE = 1e-9
#: Jump of acceleration beyond which jerk is not bounded [rad/s^2].
JERK_JUMP = 1e-6
#: Roots with less of an imaginary part than this share of their size are real: two that have met
#: are told apart by half the digits.
_REAL = 1e-7


@dataclass(frozen=True, slots=True)
class LimitReport:
    """How much of one kind of limit is used.

    Args:
        worst_ratio: Largest |value| / limit of all joints; for positions, of the distance from
            the middle of the range to half the range; for torques and the tool's speed, a bound.
        joint: Where.
        time: When [s].
    """

    worst_ratio: float
    joint: str
    time: float


def beyond(joint: str, value: float, limit: float) -> str:
    """Say by how much a joint is outside which limit of its position [rad or m]."""
    which = "above its upper" if value > limit else "below its lower"
    return f"joint {joint!r} is at {value:.9g}, {abs(value - limit):.3g} {which} limit {limit:.9g}"


def check_limits(
    trajectory: Trajectory,
    limits: Limits,
    bounds: Mapping[str, Array],
    loads: EffortLimits | None = None,
) -> tuple[dict[str, LimitReport], list[Violation]]:
    """How much of each limit is used, and what is wrong.

    Args:
        trajectory: The motion.
        limits: Of its joints.
        bounds: In place of them, by quantity; a jerk that is named here has to be bounded.
        loads: Limits of torque and tool speed.
    """
    reports, wrong = {}, []
    reports["position"], violation = _check_position(trajectory, limits)
    wrong += [violation] if violation else []
    for order, name in ((1, "velocity"), (2, "acceleration"), (3, "jerk")):
        limit = bounds.get(name, getattr(limits, name))
        if not np.isfinite(limit).any():
            continue
        if order == 3 and trajectory.continuity().acceleration > JERK_JUMP:
            wrong += [_unbounded(trajectory)] if name in bounds else []
            continue
        reports[name], violation = _check_peaks(trajectory, limit, order, name)
        wrong += [violation] if violation else []
    for name, use in (loads.uses(trajectory) if loads else {}).items():
        joint = trajectory.joint_names[use.joint]
        reports[name] = LimitReport(use.ratio, joint, use.time)
        if use.ratio > 1.0 + RATIO_TOLERANCE:
            what = f"the torque of joint {joint!r}" if name == "torque" else "the tool's speed"
            message = f"{what} may be {use.ratio:.6g} times its limit"
            details = {"joint": joint, "ratio": use.ratio, "reached": use.reached}
            wrong.append(Violation(name, use.time, message, details))
    return reports, wrong


def check_continuity(trajectory: Trajectory) -> tuple[dict[str, float], list[Violation]]:
    """The largest jumps of position and velocity between pieces, and the first that is one."""
    jumps, wrong = trajectory.continuity(), []
    continuity = {"position": jumps.position, "velocity": jumps.velocity}
    for order, (name, jump) in enumerate(continuity.items()):
        if jump > JUMP_TOLERANCE:
            jumps_at = np.abs(trajectory.jumps(order)).max(axis=1)
            at = int(np.argmax(jumps_at > JUMP_TOLERANCE))
            first = float(jumps_at[at])
            message = f"the {name} jumps by {first:.3g} between two pieces"
            time = float(trajectory.breaks[at + 1])
            wrong.append(Violation("continuity", time, message, {"quantity": name, "jump": first}))
    return continuity, wrong


def _unbounded(trajectory: Trajectory) -> Violation:
    jumps = np.abs(trajectory.jumps(2))
    at = int(np.argmax(jumps.max(axis=1) > JERK_JUMP))
    joint = trajectory.joint_names[int(np.argmax(jumps[at]))]
    message = f"the acceleration of joint {joint!r} jumps, so that its jerk has no bound"
    details = {"joint": joint, "jump": float(jumps[at].max())}
    return Violation("jerk", float(trajectory.breaks[at + 1]), message, details)


def _check_peaks(
    trajectory: Trajectory, limit: Array, order: int, name: str
) -> tuple[LimitReport, Violation | None]:
    bound = np.isfinite(limit)
    peaks = trajectory.peaks(order)
    ratios = np.where(bound, peaks.value / np.where(bound, limit, 1.0), 0.0)
    j = int(np.argmax(ratios))
    joint = trajectory.joint_names[j]
    report = LimitReport(float(ratios[j]), joint, float(peaks.time[j]))
    if report.worst_ratio <= 1.0 + RATIO_TOLERANCE:
        return report, None
    most = np.where(bound, limit, np.inf) * (1.0 + RATIO_TOLERANCE)
    time, k = _first_beyond(trajectory, order, -most, most) or (report.time, j)
    joint, value = trajectory.joint_names[k], float(peaks.value[k])
    message = f"joint {joint!r} has {name} {value:.6g}, its limit is {limit[k]:.6g}"
    return report, Violation(
        name, time, message, {"joint": joint, "value": value, "limit": float(limit[k])}
    )


def _first_beyond(
    trajectory: Trajectory, order: int, lower: Array, upper: Array
) -> tuple[float, int] | None:
    """When a derivative first leaves its bounds (n,), and of which joint; None if it does not."""
    low, high = trajectory.piece_extrema(order)
    out = (low < lower) | (high > upper)
    if not out.any():
        return None
    piece = int(np.argmax(out.any(axis=1)))
    rates = trajectory.derivative(order) if order else trajectory
    begins, ends = (float(t) for t in trajectory.breaks[piece : piece + 2])
    times = [
        (_leaves(rates.coefficients[piece, j], ends - begins, lower[j], upper[j]), int(j))
        for j in np.flatnonzero(out[piece])
    ]
    time, joint = min(times)
    return begins + time, joint


def _leaves(coefficients: Array, length: float, lower: float, upper: float) -> float:
    """When a polynomial of [0, length] first leaves its bounds."""
    value = np.polynomial.Polynomial(coefficients)
    crossings = [0.0, length]
    for bound in (lower, upper):
        if np.isfinite(bound):
            roots = (value - bound).trim().roots()
            real = roots.real[np.abs(roots.imag) <= _REAL * (1.0 + np.abs(roots))]
            crossings += [float(t) for t in real if 0.0 < t < length]
    crossings.sort()
    for a, b in pairwise(crossings):
        if not lower <= value(0.5 * (a + b)) <= upper:
            return a
    return crossings[-1]


def _check_position(trajectory: Trajectory, limits: Limits) -> tuple[LimitReport, Violation | None]:
    names: Sequence[str] = trajectory.joint_names
    lower, upper = limits.lower, limits.upper
    low, low_time, high, high_time = trajectory.extrema(0)
    half = 0.5 * (upper - lower)
    bound = np.isfinite(half) & (half > 0.0)
    middle = 0.5 * (np.where(bound, upper, 0.0) + np.where(bound, lower, 0.0))
    half = np.where(bound, half, np.inf)
    ratios = np.maximum(high - middle, middle - low) / half
    j = int(np.argmax(ratios))
    is_high = high[j] - middle[j] >= middle[j] - low[j]
    time = float(high_time[j] if is_high else low_time[j])
    report = LimitReport(float(ratios[j]), names[j], time)
    outside = np.maximum(lower - low, high - upper)
    k = int(np.argmax(outside))
    if outside[k] <= RATIO_TOLERANCE:
        return report, None
    edges = lower - RATIO_TOLERANCE, upper + RATIO_TOLERANCE
    time, k = _first_beyond(trajectory, 0, *edges) or (0.0, k)
    over = high[k] - upper[k] >= lower[k] - low[k]
    value, limit = (high[k], upper[k]) if over else (low[k], lower[k])
    message = beyond(names[k], float(value), float(limit))
    details = {"joint": names[k], "value": float(value), "limit": float(limit)}
    return report, Violation("position", time, message, details)
