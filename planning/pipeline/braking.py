"""Braking of a start that moves: what it touches, however hard all its joints brake at once."""

from dataclasses import dataclass

import numpy as np

from kinematics.arrays import Array
from obstacles.collision.checker import Checker

#: Shares are told in hundredths.
_HUNDRED = 100


@dataclass(frozen=True, slots=True)
class Touch:
    """A contact while all joints brake as hard as they can.

    Args:
        pair: The link and what it meets.
        time: When, from the start on [s].
        distance: Between the two at the start, margins taken off [m].
        share: With this share of the velocity braking meets nothing; 0 where none was found.
    """

    pair: tuple[str, str]
    time: float
    distance: float
    share: float


def first_touch(
    checker: Checker, start: Array, velocity: Array, acceleration: Array, jerk: Array | None = None
) -> Touch | None:
    """First contact of a start that moves while all joints brake as hard as they can, if any.

    Acceleration begins at 0 where jerk is limited, else braking is at full strength at once. Joints
    keep to their own ways: another motion may get around what is met.

    Args:
        checker: The robot in its scene with its margins.
        start: Shape (n,).
        velocity: At the start, shape (n,) [rad/s or m/s].
        acceleration: Limits, shape (n,) [rad/s^2 or m/s^2].
        jerk: Limits, shape (n,), inf where there is none; None where jerk is not limited.
    """
    limits = acceleration, np.full_like(acceleration, np.inf) if jerk is None else jerk
    times, states = _braking(start, velocity, *limits)
    valid = checker.each_valid(states)
    if valid.all():
        return None
    at = int(np.argmin(valid))
    pair = checker.clearance(states[at])[1]
    if pair is None:
        return None
    near = checker.gradient(start, np.inf)
    names = [checker.model.pair_name(int(k)) for k in near.pairs]
    apart = [d for d, name in zip(near.distances.tolist(), names, strict=True) if name == pair]
    low, high = 0.0, 1.0
    # Halvings that find the share of the velocity with which braking is in time.
    for _ in range(8):
        middle = 0.5 * (low + high)
        slower = _braking(start, middle * velocity, *limits)[1]
        low, high = (middle, high) if checker.each_valid(slower).all() else (low, middle)
    share = np.floor(_HUNDRED * low) / _HUNDRED
    return Touch(pair, float(times[at]), max(min(apart, default=0.0), 0.0), float(share))


def _braking(start: Array, velocity: Array, a: Array, j: Array) -> tuple[Array, Array]:
    """Instants (k,) and states (k, n) of braking, each joint as hard as it can.

    The acceleration grows to its limit, or as far as the velocity lets it, stays and falls to 0.
    """
    speed = np.abs(velocity)
    ramp = np.minimum(a / j, np.sqrt(speed / j))
    stop = ramp + np.where(ramp > 0.0, np.maximum(speed / a, ramp), speed / a)
    # Instants of a braking motion that are looked at.
    times = np.linspace(0.0, float(stop.max()), 200)
    since = [np.maximum(times[:, None] - t, 0.0) for t in (0.0, ramp, stop - ramp, stop)]
    begun, full, eased, ended = since
    with np.errstate(invalid="ignore"):
        bounded = j / 6.0 * (begun**3 - full**3 - eased**3 + ended**3)
    braked = np.where(np.isfinite(j), bounded, 0.5 * a * (begun**2 - ended**2))
    return times, start + velocity * times[:, None] - np.sign(velocity) * braked
