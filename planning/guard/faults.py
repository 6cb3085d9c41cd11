"""Faults of a motion, found soon rather than first: some instant of each kind, not the earliest.

Limits are exact, as in the proof. Of collisions states are looked at that lie close together: where
one collides it is a witness, and the proof need not look for the first one.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from kinematics.arrays import Array
from kinematics.trajectory.trajectory import Trajectory
from obstacles.collision.checker import Checker
from planning.proof.certificate import Certificate
from planning.proof.extrema import TIME, VALUE
from planning.proof.limits.limit_uses import JUMPING, LimitUses, Violation, motion_uses
from planning.proof.limits.limits import QUANTITIES, check_continuity
from planning.stops.braking import Braking, BrakingLimits
from planning.stops.certificate import Surroundings
from planning.values.limits import JERK_JUMP, RATIO_TOLERANCE, position_excess

#: States of a motion that are looked at.
_LOOKS = 33
#: Place of jerk among what has limits.
_JERK = 3
#: Halvings between a state that is free and one that is not, for the time that is told.
_HALVINGS = 6
#: Shares of the time to rest at which stops are looked at.
_SHARES = np.array([0.15, 0.3, 0.5, 0.75, 1.0])[:, None, None]


class Look(NamedTuple):
    """Faults that a motion was found to have.

    Args:
        faults: The faults.
        slower: The largest scale at which limits of rates can hold, 1 where they do; 0 where none
            helps.
        blocked: Instant from which on it is no use at any scale [s].
        fast: Instant from which on it is no use at this scale [s].
    """

    faults: tuple[Violation, ...]
    slower: float
    blocked: float
    fast: float


def look_at(motion: Trajectory, around: Surroundings, checker: Checker) -> Look:
    """Look for faults of a motion: its limits, its continuity, and states of it that collide."""
    times = np.linspace(0.0, motion.duration, _LOOKS)
    states, limits = motion.sample(times), around.robot.chain.limits
    found, slower, blocked, fast = list[Violation](), 1.0, motion.duration, motion.duration
    bounds = [around.limits.bounds.get(name, getattr(limits, name)) for name in QUANTITIES[1:]]
    rows = np.array([limits.lower, limits.upper, *bounds])
    uses = motion_uses(motion, rows, JERK_JUMP)
    for order, (ratio, _, _, excess, beyond) in enumerate(uses.found.uses.tolist()):
        if excess <= RATIO_TOLERANCE or (order == _JERK and not around.limits.holds_jerk):
            continue
        low, high = uses.lower[order], uses.upper[order]
        found.append(_beyond(motion.joint_names, uses.found, order, (low, high), int(beyond)))
        values = states if order == 0 else motion.sample(times, order)
        spare = RATIO_TOLERANCE * (np.ones_like(high) if order == 0 else high)
        out = ((values < low - spare) | (values > high + spare)).any(axis=1)
        first = float(times[int(out.argmax())]) if out.any() else found[-1].time
        fast = min(fast, first)
        if order == 0:
            blocked = min(blocked, first)
        else:
            slower = min(slower, (1.0 - 1e-9) * ratio ** (-1.0 / order))
    _, jumps = check_continuity(motion)
    if "jerk" in around.limits.bounds and uses.limited[_JERK] == JUMPING:
        message = "the acceleration jumps, so that jerk has no bound"
        jumps = [*jumps, Violation("jerk", 0.0, message, {})]
    for fault in jumps:
        slower, blocked = 0.0, min(blocked, fault.time)
    hit = first_hit(motion, times, states, checker)
    if hit is not None:
        blocked = min(blocked, hit.time)
    found += [*jumps, *([] if hit is None else [hit])]
    return Look(tuple(found), slower, blocked, min(fast, blocked))


def _beyond(
    names: tuple[str, ...], found: LimitUses, order: int, limits: tuple[Array, Array], j: int
) -> Violation:
    """The largest excess of joint j over limits of an order."""
    (lower, upper), highest, lowest = limits, found.highest[order, j], found.lowest[order, j]
    high, low = float(highest[VALUE]), -float(lowest[VALUE])
    above = high - upper[j] >= lower[j] - low
    value, limit = (high, float(upper[j])) if above else (low, float(lower[j]))
    time = float((highest if above else lowest)[TIME])
    if order == 0:
        message = position_excess(names[j], value, limit)
    else:
        value, limit = abs(value), float(upper[j])
        message = (
            f"joint {names[j]!r} has {QUANTITIES[order]} {value:.6g}, its limit is {limit:.6g}"
        )
    details = {"joint": names[j], "value": value, "limit": limit}
    return Violation(QUANTITIES[order], time, message, details)


def first_hit(
    motion: Trajectory, times: Array, states: Array, checker: Checker
) -> Violation | None:
    """The first collision of states (k, n) at times (k,), with pair and depth; None for none."""
    if checker.all_valid(states):
        return None
    valid = checker.each_valid(states)
    at = int(np.argmin(valid))
    low, high = float(times[max(at - 1, 0)]), float(times[at])
    for _ in range(_HALVINGS if at > 0 else 0):
        middle = 0.5 * (low + high)
        free = checker.valid(motion.sample([middle])[0])
        low, high = (middle, high) if free else (low, middle)
    return hit_at(motion.sample([high])[0], high, checker)


def hit_at(q: Array, time: float, checker: Checker) -> Violation | None:
    """The collision of a configuration (n,) at an instant [s]; None where it is free."""
    near = checker.gradient(q, 0.0)
    if not near.distances.size:
        return None
    least = int(near.distances.argmin())
    pair, short = checker.model.pair_name(int(near.pairs[least])), float(near.distances[least])
    message = f"{pair[0]!r} and {pair[1]!r} are {-short:.6g} m nearer than allowed"
    return Violation("collision", time, message, {"pair": list(pair), "depth": -short})


def sound_stops(
    states: Array, limits: BrakingLimits, around: Surroundings, checker: Checker
) -> Array:
    """Whether stops with all joints braking look free and within limits, shape (k,).

    Args:
        states: Positions, velocities and accelerations to brake from, shape (3, k, n).
        limits: Limits that the joints brake at.
        around: Robot and limits.
        checker: The checker.
    """
    braking, bounds = Braking.of(states[1], states[2], limits), around.robot.chain.limits
    ways = states[0] + braking.moved(_SHARES * braking.duration.max(axis=-1)[:, None])
    count, n = ways.shape[1:]
    within = (ways >= bounds.lower - RATIO_TOLERANCE) & (ways <= bounds.upper + RATIO_TOLERANCE)
    # A joint that accelerates by a still gains a^2 / 2J until its jerk has turned that round.
    jerk = np.where(braking.jerk > 0.0, braking.jerk, np.inf)
    gained = np.abs(states[1]) + np.where(
        states[1] * states[2] > 0.0, states[2] ** 2 / (2.0 * jerk), 0.0
    )
    velocity = np.asarray(around.limits.bounds.get("velocity", bounds.velocity))
    fast = gained > np.where(np.isnan(velocity), np.inf, velocity) * (1.0 + RATIO_TOLERANCE)
    free = checker.each_valid(ways.reshape(-1, n)).reshape(-1, count)
    return np.asarray(within.all(axis=(0, 2)) & ~fast.any(axis=1) & free.all(axis=0))


def first_fault(proof: Certificate, by: float) -> Violation:
    """The violation of a proof that failed, later by so much [s], with its depth."""
    first = proof.violation
    if first is None:
        return Violation("unproved", 0.0, "; ".join(proof.proved.reasons), {})
    details = dict(first.details)
    if "distance" in details:
        details["depth"] = details.get("margin", 0.0) - details["distance"]
    return replace(first, time=first.time + by, details=details)


def shifted(faults: Sequence[Violation], by: float) -> tuple[Violation, ...]:
    """Faults with other times, later by so much [s]."""
    return tuple(replace(fault, time=fault.time + by) for fault in faults)
