"""Limits that a timed motion keeps: positions, rates, torques and tool speed at every instant.

Positions, velocities, accelerations and jerks are polynomials of time: their extrema are reached
from inside and bounded from outside (``extrema``). Torques and the tool's speed are bounded over
intervals of time (``effort``).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from kinematics.arrays import Array
from kinematics.chain import Limits
from kinematics.trajectory import Trajectory
from planning.limits import JERK_JUMP, RATIO_TOLERANCE, MotionLimits, position_excess
from planning.proof.effort import effort_uses
from planning.proof.extrema import extrema, jumps
from planning.proof.violation import Violation

#: Largest jump of position and velocity between pieces [rad or m, rad/s or m/s].
JUMP_TOLERANCE = 1e-9
#: Roots with less of an imaginary part than this share of their size are real: two that have met
#: are told apart by half the digits.
_REAL = 1e-7
#: Share of the largest coefficient below which a leading one changes no value on a piece.
_NEGLIGIBLE = 1e-17


@dataclass(frozen=True, slots=True)
class LimitReport:
    """Use of one kind of limit.

    Args:
        worst_ratio: Largest |value| / limit of all joints; for positions, of the distance from
            the middle of the range to half the range; for torques and the tool's speed, a bound.
        joint: Where.
        time: When [s].
    """

    worst_ratio: float
    joint: str
    time: float


def check_limits(
    trajectory: Trajectory,
    limits: Limits,
    wanted: MotionLimits,
) -> tuple[dict[str, LimitReport], list[Violation]]:
    """Share of each limit that is used, and the violations.

    Args:
        trajectory: The motion.
        limits: Limits of its joints.
        wanted: Limits in place of them; a jerk that is named here has to be bounded.
    """
    reports, wrong = {}, []
    reports["position"], violation = _check_position(trajectory, limits)
    wrong += [violation] if violation else []
    for order, name in ((1, "velocity"), (2, "acceleration"), (3, "jerk")):
        limit = wanted.bounds.get(name, getattr(limits, name))
        if not np.isfinite(limit).any():
            continue
        if order == 3 and np.abs(jumps(trajectory, 2)).max(initial=0.0) > JERK_JUMP:
            wrong += [_jump_violation(trajectory)] if name in wanted.bounds else []
            continue
        reports[name], violation = _check_peaks(trajectory, limit, order, name)
        wrong += [violation] if violation else []
    for name, use in (effort_uses(wanted.effort, trajectory) if wanted.effort else {}).items():
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
    continuity, wrong = {}, []
    for order, name in enumerate(("position", "velocity")):
        largest = np.abs(jumps(trajectory, order)).max(axis=1, initial=0.0)
        continuity[name] = float(largest.max(initial=0.0))
        if continuity[name] > JUMP_TOLERANCE:
            at = int(np.argmax(largest > JUMP_TOLERANCE))
            first = float(largest[at])
            message = f"the {name} jumps by {first:.3g} between two pieces"
            time = float(trajectory.breaks[at + 1])
            wrong.append(Violation("continuity", time, message, {"quantity": name, "jump": first}))
    return continuity, wrong


def _jump_violation(trajectory: Trajectory) -> Violation:
    sizes = np.abs(jumps(trajectory, 2))
    at = int(np.argmax(sizes.max(axis=1) > JERK_JUMP))
    joint = trajectory.joint_names[int(np.argmax(sizes[at]))]
    message = f"the acceleration of joint {joint!r} jumps, so that its jerk has no bound"
    details = {"joint": joint, "jump": float(sizes[at].max())}
    return Violation("jerk", float(trajectory.breaks[at + 1]), message, details)


def _check_peaks(
    trajectory: Trajectory, limit: Array, order: int, name: str
) -> tuple[LimitReport, Violation | None]:
    is_limited = np.isfinite(limit)
    ends = extrema(trajectory.breaks, trajectory.coefficients, order)
    is_high = ends.maximum >= -ends.minimum
    peaks = np.where(is_high, ends.maximum, -ends.minimum)
    times = np.where(is_high, ends.time_of_maximum, ends.time_of_minimum)
    over = np.where(is_limited, limit, 1.0)
    ratios = np.where(is_limited, peaks / over, 0.0)
    bounds = np.where(is_limited, np.maximum(ends.upper, -ends.lower) / over, 0.0)
    j = int(np.argmax(ratios))
    report = LimitReport(float(ratios[j]), trajectory.joint_names[j], float(times[j]))
    if bounds.max() <= 1.0 + RATIO_TOLERANCE:
        return report, None
    k = int(np.argmax(bounds))
    most = np.where(is_limited, limit, np.inf) * (1.0 + RATIO_TOLERANCE)
    time, k = _first_excess(trajectory, order, -most, most) or (float(times[k]), k)
    joint, value = trajectory.joint_names[k], float(peaks[k])
    message = f"joint {joint!r} has {name} {value:.6g}, its limit is {limit[k]:.6g}"
    return report, Violation(
        name, time, message, {"joint": joint, "value": value, "limit": float(limit[k])}
    )


def _first_excess(
    trajectory: Trajectory, order: int, lower: Array, upper: Array
) -> tuple[float, int] | None:
    """First time and joint at which a derivative leaves its bounds (n,); None if none does."""
    breaks, coefficients = trajectory.breaks, trajectory.coefficients
    for i in range(trajectory.pieces):
        ends = extrema(breaks[i : i + 2], coefficients[i : i + 1], order)
        outside = np.flatnonzero((ends.minimum < lower) | (ends.maximum > upper))
        if len(outside):
            length = float(breaks[i + 1] - breaks[i])
            time, joint = min(
                (_leaves(coefficients[i, j], order, length, (lower[j], upper[j])), int(j))
                for j in outside
            )
            return float(breaks[i]) + time, joint
    return None


def _leaves(coefficients: Array, order: int, length: float, bounds: tuple[float, float]) -> float:
    """First time in [0, length] at which a polynomial's derivative leaves its bounds."""
    value = np.polynomial.Polynomial(coefficients).deriv(order)
    # In parts of the length, where terms that add nothing can be told and left out: a leading
    # coefficient next to 0 has roots beyond all numbers.
    terms = np.asarray(value.coef, dtype=np.float64)
    scaled = np.polynomial.Polynomial(terms * length ** np.arange(len(terms)))
    crossings = [0.0, length]
    for bound in bounds:
        if np.isfinite(bound):
            excess = scaled - bound
            roots = excess.trim(_NEGLIGIBLE * float(np.abs(excess.coef).max())).roots()
            real = roots.real[np.abs(roots.imag) <= _REAL * (1.0 + np.abs(roots))]
            crossings += [length * float(part) for part in real if 0.0 < part < 1.0]
    crossings.sort()
    for a, b in pairwise(crossings):
        if not bounds[0] <= value(0.5 * (a + b)) <= bounds[1]:
            return a
    return crossings[-1]


def _check_position(trajectory: Trajectory, limits: Limits) -> tuple[LimitReport, Violation | None]:
    names: Sequence[str] = trajectory.joint_names
    lower, upper = limits.lower, limits.upper
    ends = extrema(trajectory.breaks, trajectory.coefficients, 0)
    half = 0.5 * (upper - lower)
    is_limited = np.isfinite(half) & (half > 0.0)
    middle = 0.5 * (np.where(is_limited, upper, 0.0) + np.where(is_limited, lower, 0.0))
    half = np.where(is_limited, half, np.inf)
    above, below = ends.maximum - middle, middle - ends.minimum
    ratios = np.maximum(above, below) / half
    j = int(np.argmax(ratios))
    time = float((ends.time_of_maximum if above[j] >= below[j] else ends.time_of_minimum)[j])
    report = LimitReport(float(ratios[j]), names[j], time)
    outside = np.maximum(lower - ends.lower, ends.upper - upper)
    k = int(np.argmax(outside))
    if outside[k] <= RATIO_TOLERANCE:
        return report, None
    edges = lower - RATIO_TOLERANCE, upper + RATIO_TOLERANCE
    time, k = _first_excess(trajectory, 0, *edges) or (0.0, k)
    is_above = ends.maximum[k] - upper[k] >= lower[k] - ends.minimum[k]
    value, limit = (ends.maximum[k], upper[k]) if is_above else (ends.minimum[k], lower[k])
    message = position_excess(names[k], float(value), float(limit))
    details = {"joint": names[k], "value": float(value), "limit": float(limit)}
    return report, Violation("position", time, message, details)
