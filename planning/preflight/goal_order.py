"""Order of the configurations of a pose: the cheapest first, those at a joint limit last."""

from collections.abc import Sequence

import numpy as np

from kinematics.arrays import Array
from kinematics.chain import Chain, JointType
from kinematics.jacobian import geometric, manipulability
from planning.goal_costs import GoalCosts

#: Share of a joint's range from a limit below which a configuration is at the limit [-].
NEAR_LIMIT = 0.02
#: A configuration at a limit is left out where another takes at most this many times its time.
_MAX_LONGER = 1.2
#: Share of a joint's range from a limit beyond which the limit costs nothing [-].
_FAR_FROM_LIMIT = 0.15
#: Clearance beyond which clearance costs nothing [m].
_FAR_FROM_OBSTACLES = 0.05
#: Configurations that cost at most this many times the least count as equally good.
_ALIKE = 1.25
#: Speed of a joint whose limit is not known [rad/s or m/s].
_ANY_SPEED = 1.0


def order_goals(
    chain: Chain,
    start: Array,
    goals: Sequence[Array],
    clearances: Sequence[float],
    costs: GoalCosts,
) -> tuple[list[Array], int]:
    """Sort goal configurations by what they cost, those at a joint limit last.

    A configuration is at a limit where a joint is within 2 % of its range from one. It stays in
    its place where every other one takes more than 1.2 times its time.

    Args:
        chain: The robot.
        start: Where the motion begins, shape (n,) [rad or m].
        goals: Configurations (n,).
        clearances: Of each of them, margins taken off [m].
        costs: The weights.

    Returns:
        The goals, and how many of them are about as good as the first.
    """
    times = np.array([motion_time(chain, start, q) for q in goals])
    shares = np.array([limit_share(chain, q) for q in goals])
    skills = np.array([_manipulability(chain, q) for q in goals])
    turns = np.array(
        [np.sum(np.abs(q - start)[chain.joint_types == JointType.REVOLUTE] > np.pi) for q in goals]
    )
    lack = 1.0 - skills / max(float(skills.max()), np.finfo(float).tiny)
    total = (
        costs.motion_time * times
        + costs.joint_limits * np.clip(1.0 - shares / _FAR_FROM_LIMIT, 0.0, 1.0)
        + costs.manipulability * lack
        + costs.clearance * np.clip(1.0 - np.array(clearances) / _FAR_FROM_OBSTACLES, 0.0, 1.0)
        + costs.turns * turns
    )
    inside = shares >= NEAR_LIMIT
    quickest = float(times[inside].min()) if inside.any() else np.inf
    avoided = ~inside & (quickest <= _MAX_LONGER * times)
    order = np.lexsort((total, avoided))
    alike = ~avoided & (total <= _ALIKE * total[order[0]])
    return [goals[k] for k in order], max(int(np.count_nonzero(alike)), 1)


def motion_time(chain: Chain, start: Array, goal: Array) -> float:
    """Least time of the slowest joint from rest to rest, both configurations (n,) [s].

    A joint that goes d takes d/v + v/a, or 2 sqrt(d/a) where it does not get to its speed v.
    """
    d = np.abs(goal - start)
    v, a = chain.limits.velocity, chain.limits.acceleration
    v = np.where(np.isfinite(v) & (v > 0.0), v, _ANY_SPEED)
    a = np.where(np.isfinite(a) & (a > 0.0), a, np.inf)
    with np.errstate(invalid="ignore"):
        ramp = np.where(np.isinf(a), 0.0, v / a)
        quick = np.where(np.isinf(a), 0.0, 2.0 * np.sqrt(d / a))
    return float(np.where(d >= v * ramp, d / v + ramp, quick).max(initial=0.0))


def limit_share(chain: Chain, q: Array) -> float:
    """Distance of q (n,) from its nearest joint limit as a share of that joint's range [-].

    Joints without two limits do not count; 0.5 is the middle of all ranges.
    """
    lower, upper = chain.limits.lower, chain.limits.upper
    bounded = np.isfinite(lower) & np.isfinite(upper) & (upper > lower) & ~chain.continuous
    gap = np.minimum(q - lower, upper - q)[bounded] / (upper - lower)[bounded]
    return float(gap.min(initial=0.5))


def _manipulability(chain: Chain, q: Array) -> float:
    return manipulability(
        np.array(np.linalg.svd(geometric(chain, q), compute_uv=False), dtype=np.float64)
    )
