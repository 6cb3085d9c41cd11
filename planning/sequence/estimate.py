"""Least times of motions from rest to rest, which the search is led by."""

import numpy as np

from kinematics.arrays import Array
from kinematics.model.chain import Chain
from planning.options import Options

#: Speed of a joint whose limit is not known [rad/s or m/s].
_ANY_SPEED = 1.0


def travel_times(chain: Chain, start: Array, ends: Array, options: Options | None = None) -> Array:
    """Least time of the slowest joint from rest to rest, for many ends [s].

    A joint that goes d takes d/v + v/a, or 2 sqrt(d/a) where it does not get to its speed v.

    Args:
        chain: The robot.
        start: Shape (n,) [rad or m].
        ends: Shape (k, n) [rad or m].
        options: Limits in place of the robot's, and the shares of them that a motion uses.

    Returns:
        Shape (k,).
    """
    d = np.abs(ends - start)
    options = options or Options()
    v, a = _limit(chain, "velocity", options), _limit(chain, "acceleration", options)
    v = np.where(v > 0.0, v, _ANY_SPEED)
    a = np.where(np.isfinite(a) & (a > 0.0), a, np.inf)
    with np.errstate(invalid="ignore"):
        ramp = np.where(np.isinf(a), 0.0, v / a)
        quick = np.where(np.isinf(a), 0.0, 2.0 * np.sqrt(d / a))
    times: Array = np.where(d >= v * ramp, d / v + ramp, quick).max(axis=-1, initial=0.0)
    return times


def passing_time(chain: Chain, start: Array, end: Array, options: Options, slack: float) -> float:
    """Least time of the slowest joint where neither end is at rest: (d - slack) / v [s].

    Args:
        chain: The robot.
        start: Shape (n,) [rad or m].
        end: Shape (n,) [rad or m].
        options: As in ``travel_times``.
        slack: How far from its ends the motion may be passed, in all [rad or m].
    """
    v = _limit(chain, "velocity", options)
    v = np.where(v > 0.0, v, _ANY_SPEED)
    return float((np.maximum(np.abs(end - start) - slack, 0.0) / v).max(initial=0.0))


def _limit(chain: Chain, name: str, options: Options) -> Array:
    """A limit of all joints with the share of it that a motion uses, shape (n,)."""
    limit = options.limits.get(name, getattr(chain.limits, name))
    share: float = getattr(options.timing, f"{name}_scaling")
    return np.asarray(limit, dtype=np.float64) * share
