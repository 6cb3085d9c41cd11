"""Limits that a timed motion keeps: positions, rates, torques and tool speed at every instant.

Positions, velocities, accelerations and jerks are polynomials of time: their extrema are reached
from inside and bounded from outside (``extrema``). Torques and the tool's speed are bounded over
intervals of time (``effort``).
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from kinematics.arrays import Array
from kinematics.model.chain import Limits
from kinematics.trajectory.trajectory import Trajectory
from planning.proof.extrema import TIME, VALUE, extrema, jumps, largest_jump
from planning.proof.limits.effort import effort_uses
from planning.proof.limits.limit_uses import JUMPING, UNLIMITED, LimitUses, Violation, motion_uses
from planning.values.limits import JERK_JUMP, RATIO_TOLERANCE, MotionLimits, position_excess

#: By the order of the derivative.
QUANTITIES = ("position", "velocity", "acceleration", "jerk")
#: Largest jump of position and velocity between pieces [rad or m, rad/s or m/s].
JUMP_TOLERANCE = 1e-9
#: Roots with less of an imaginary part than this share of their size are real: two that have met
#: are told apart by half the digits.
_REAL = 1e-7
#: End of the sentence on a jerk that was not asked for.
_BUT = "; limits are proved but for jerk"
#: Share of the largest coefficient below which a leading one changes no value on a piece.
_NEGLIGIBLE = 1e-17


@dataclass(frozen=True, slots=True)
class LimitReport:
    """Use of one kind of limit.

    Args:
        worst_ratio: Largest |value| / limit of all joints; for positions, of the distance from
            the middle of the range to half the range; for torques and the tool's speed, a bound.
        joint: Joint of the largest use.
        time: Instant of the largest use [s].
    """

    worst_ratio: float
    joint: str
    time: float


def check_limits(
    trajectory: Trajectory,
    limits: Limits,
    wanted: MotionLimits,
) -> tuple[dict[str, LimitReport], list[Violation], list[Violation]]:
    """Share of each limit that is used, the violations, and what is wrong but was not asked for.

    A jerk limit that is known binds all pieces of a motion. Where the acceleration jumps between
    them jerk has no bound: that is refused where a jerk is named, else told. Of a motion that need
    not keep its jerk (``MotionLimits.holds_jerk``) all of this is told.

    Args:
        trajectory: The motion.
        limits: Limits of its joints.
        wanted: Limits in place of them.
    """
    reports: dict[str, LimitReport] = {}
    wrong: list[Violation] = []
    told: list[Violation] = []
    bounds = [wanted.bounds.get(name, getattr(limits, name)) for name in QUANTITIES[1:]]
    used = motion_uses(trajectory, np.array([limits.lower, limits.upper, *bounds]), JERK_JUMP)
    uses = used.found.uses.tolist()
    for order, limited in enumerate(used.limited.tolist()):
        if limited == UNLIMITED:
            continue
        ratio, joint, time, excess, beyond = uses[order]
        held = wrong if order < len(QUANTITIES) - 1 or wanted.holds_jerk else told
        jump = _jump_violation(trajectory, used.upper[order]) if limited == JUMPING else None
        if jump is not None:
            (held if "jerk" in wanted.bounds else told).append(jump)
        else:
            name = trajectory.joint_names[int(joint)]
            reports[QUANTITIES[order]] = LimitReport(ratio, name, time)
        if excess > RATIO_TOLERANCE:
            range_ = used.lower[order], used.upper[order]
            held.append(_violation(trajectory, order, used.found, range_, int(beyond)))
    for name, use in (effort_uses(wanted.effort, trajectory) if wanted.effort else {}).items():
        joint = trajectory.joint_names[use.joint]
        reports[name] = LimitReport(use.ratio, joint, use.time)
        if use.ratio > 1.0 + RATIO_TOLERANCE:
            what = f"the torque of joint {joint!r}" if name == "torque" else "the tool's speed"
            message = f"{what} may be {use.ratio:.6g} times its limit"
            details = {"joint": joint, "ratio": use.ratio, "reached": use.reached}
            wrong.append(Violation(name, use.time, message, details))
    for begin, end, narrower in wanted.between:
        part = trajectory if end >= trajectory.duration else trajectory.split(end)[0]
        part = part.split(begin)[1] if begin > 0.0 else part
        uses_there, more, _ = check_limits(part, limits, narrower)
        for name, there in uses_there.items():
            if name not in reports or there.worst_ratio > reports[name].worst_ratio:
                reports[name] = replace(there, time=begin + there.time)
        wrong += [replace(one, time=begin + one.time) for one in more]
    return reports, wrong, [replace(one, message=f"{one.message}{_BUT}") for one in told]


def check_continuity(trajectory: Trajectory) -> tuple[dict[str, float], list[Violation]]:
    """The largest jumps of position and velocity between pieces, and the first that is one."""
    continuity, wrong = {}, []
    for order, name in enumerate(QUANTITIES[:2]):
        continuity[name] = _largest_jump(trajectory, order)
        if continuity[name] > JUMP_TOLERANCE:
            largest = np.abs(jumps(trajectory, order)).max(axis=1)
            at = int(np.argmax(largest > JUMP_TOLERANCE))
            first = float(largest[at])
            message = f"the {name} jumps by {first:.3g} between two pieces"
            time = float(trajectory.breaks[at + 1])
            wrong.append(Violation("continuity", time, message, {"quantity": name, "jump": first}))
    return continuity, wrong


def _largest_jump(trajectory: Trajectory, order: int) -> float:
    return float(largest_jump(trajectory.breaks, trajectory.coefficients, order))


def _jump_violation(trajectory: Trajectory, limits: Array) -> Violation | None:
    """The first jump of the acceleration of a joint whose jerk is limited, by limits (n,)."""
    sizes = np.where(np.isfinite(limits), np.abs(jumps(trajectory, 2)), 0.0)
    jumping = np.flatnonzero(~(sizes.max(axis=1) <= JERK_JUMP))
    if not len(jumping):
        return None
    at = int(jumping[0])
    joint = trajectory.joint_names[int(np.argmax(sizes[at]))]
    message = (
        f"the acceleration of joint {joint!r} jumps by {sizes[at].max():.3g}, so that its jerk has "
        "no bound"
    )
    details = {"joint": joint, "jump": float(sizes[at].max())}
    return Violation("jerk", float(trajectory.breaks[at + 1]), message, details)


def _violation(
    trajectory: Trajectory, order: int, found: LimitUses, limits: tuple[Array, Array], k: int
) -> Violation:
    """The first violation of a limit, joint k's where no value is found that is one."""
    lower, upper = limits
    spare = RATIO_TOLERANCE * (1.0 if order == 0 else np.where(upper < np.inf, upper, 0.0))
    highest, lowest = found.highest[order], found.lowest[order]
    first = _first_excess(trajectory, order, lower - spare, upper + spare)
    name, high, low = QUANTITIES[order], float(highest[k, VALUE]), -float(lowest[k, VALUE])
    if order == 0:
        time, k = first or (0.0, k)
        high, low = float(highest[k, VALUE]), -float(lowest[k, VALUE])
        is_above = high - upper[k] >= lower[k] - low
        value, limit = (high, float(upper[k])) if is_above else (low, float(lower[k]))
        message = position_excess(trajectory.joint_names[k], value, limit)
    else:
        time, k = first or (float(highest[k, TIME] if high >= -low else lowest[k, TIME]), k)
        high, low = float(highest[k, VALUE]), -float(lowest[k, VALUE])
        value, limit = max(high, -low), float(upper[k])
        joint = trajectory.joint_names[k]
        message = f"joint {joint!r} has {name} {value:.6g}, its limit is {limit:.6g}"
    details = {"joint": trajectory.joint_names[k], "value": value, "limit": limit}
    return Violation(name, time, message, details)


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
