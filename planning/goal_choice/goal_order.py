"""Order of the configurations of a pose: the cheapest first, those at a joint limit last.

A small move stays in the branch of inverse kinematics that the arm stands in: the configuration
nearest to the start comes first wherever it takes little longer than the quickest.

The order is by straight motions. Where a plan ended at a limit all the same, its time says which
of the others are worth a plan of their own.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.jacobian import geometric
from kinematics.model.chain import Chain, JointType
from kinematics.pose import rotation_error
from planning.timing.rest_to_rest import motion_times
from planning.values.goal_costs import GoalCosts

#: Share of a joint's range from a limit below which a configuration is at the limit [-].
NEAR_LIMIT = 0.02
#: A configuration at a limit is left out where another takes at most this many times its time.
MAX_LONGER = 1.2
#: Configurations at most that motions of their own are planned to in place of one at a limit.
MAX_PLANNED = 6
#: Edges that the search for a motion to one of these may check.
MAX_EDGES = 2000
#: Clearance beyond which clearance costs nothing [m].
FAR_FROM_OBSTACLES = 0.05
#: A small move may take this many times the time of the quickest and stay in its branch.
MAX_LONGER_IN_BRANCH = 1.2


def order_goals(
    chain: Chain,
    start: Array,
    goals: Sequence[Array],
    clearances: Sequence[float],
    costs: GoalCosts,
) -> tuple[list[Array], int]:
    """Sort goal configurations by what they cost, those at a joint limit last.

    A configuration is at a limit where a joint is within 2 % of its range from one. It stays in
    its place where every other one takes more than 1.2 times its time. Of a small move the nearest
    one comes first, see ``own_branch``.

    Args:
        chain: The robot.
        start: Where the motion begins, shape (n,) [rad or m].
        goals: Configurations (n,).
        clearances: Of each of them, margins taken off [m].
        costs: The weights.

    Returns:
        The goals, and how many of them are about as good as the first.
    """
    joints = np.array(goals)
    times, shares = motion_times(chain, start, joints), limit_shares(chain, joints)
    total = (
        motion_costs(chain, start, joints, costs)
        + costs.manipulability * manipulability_lacks(chain, joints)
        + costs.clearance * clearance_lacks(np.array(clearances))
    )
    inside = shares >= NEAR_LIMIT
    quickest = float(times[inside].min()) if inside.any() else np.inf
    avoided = ~inside & (quickest <= MAX_LONGER * times)
    order = np.lexsort((total, avoided))
    # Configurations that cost at most this many times the least count as equally good.
    alike = ~avoided & (total <= 1.25 * total[order[0]])
    stays = own_branch(chain, start, joints, times)
    if stays is not None and not avoided[stays]:
        others = [k for k in order if k != stays]
        return [goals[stays], *(goals[k] for k in others)], 1
    return [goals[k] for k in order], max(int(np.count_nonzero(alike)), 1)


def own_branch(chain: Chain, start: Array, joints: Array, times: Array) -> int | None:
    """The configuration that a small move stays in its branch with; None where there is none.

    That is the nearest one, where the motion to it takes at most 1.2 times as long as to the
    quickest. A move is small that turns no joint by more than half a radian, or leads the tool no
    further than 5 cm and a quarter of a radian.

    Args:
        chain: The robot.
        start: Where the motion begins, shape (n,) [rad or m].
        joints: Configurations, shape (k, n).
        times: Of the straight motions to them, shape (k,) [s].
    """
    turns = np.abs(joints - start).max(axis=1)
    nearest = int(turns.argmin())
    if times[nearest] > MAX_LONGER_IN_BRANCH * times.min():
        return None
    # A move is small in which no joint turns further [rad or m], or of the tool no further [m],
    # [rad].
    small, small_way, small_turn = 0.5, 0.05, 0.25
    if turns[nearest] <= small:
        return nearest
    here, there = forward(chain, np.array([start, joints[nearest]]))
    way = float(np.linalg.norm(there[:3, 3] - here[:3, 3]))
    turn = float(np.linalg.norm(rotation_error(here[:3, :3], there[:3, :3])))
    return nearest if way <= small_way and turn <= small_turn else None


def ends_off_limits(
    chain: Chain,
    start: Array,
    goals: Sequence[Array],
    last: Array,
    duration: float,
    limits: tuple[Array, Array] | None = None,
) -> list[Array]:
    """Configurations that may be reached in little longer than one at a joint limit, soonest first.

    Args:
        chain: The robot.
        start: Where the motion begins, shape (n,) [rad or m].
        goals: Configurations (n,) of poses.
        last: The one that a motion ends in, shape (n,).
        duration: Of that motion [s].
        limits: Of velocity and acceleration (n,), in place of the robot's.

    Returns:
        None where ``last`` is away from limits or is none of the goals.
    """
    if not goals or limit_shares(chain, last[None])[0] >= NEAR_LIMIT:
        return []
    joints = np.array(goals)
    # A motion ends in a configuration that differs by no more than this in a joint [rad or m].
    if np.abs(joints - last).max(axis=1).min() > 1e-9:
        return []
    times, shares = motion_times(chain, start, joints, limits), limit_shares(chain, joints)
    order = np.argsort(times, kind="stable")
    worth = (shares >= NEAR_LIMIT) & (times <= MAX_LONGER * duration)
    # Configurations at most that plans of their own are made to.
    return [goals[k] for k in order if worth[k]][:MAX_PLANNED]


def motion_costs(chain: Chain, start: Array, goals: Array, costs: GoalCosts) -> Array:
    """Costs of the way to configurations (k, n) and of their nearness to limits, shape (k,).

    The costs that need no look at the robot's place.
    """
    return np.asarray(
        costs.motion_time * motion_times(chain, start, goals)
        + costs.joint_limits * limit_nearness(chain, goals)
        + costs.turns * turn_counts(chain, start, goals)
    )


def configuration_costs(
    chain: Chain, joints: Array, costs: GoalCosts, clearances: Array | None = None
) -> Array:
    """Costs of configurations (k, n) whatever comes before and after them, shape (k,).

    Args:
        chain: The robot.
        joints: Shape (k, n) [rad or m].
        costs: Weights of the costs.
        clearances: Clearances with margins taken off, shape (k,) [m]; None leaves their cost out.
    """
    total = costs.joint_limits * limit_nearness(chain, joints)
    total = total + costs.manipulability * manipulability_lacks(chain, joints)
    if clearances is not None:
        total = total + costs.clearance * clearance_lacks(clearances)
    return np.asarray(total)


def limit_nearness(chain: Chain, joints: Array) -> Array:
    """Nearness of configurations (k, n) to a joint limit: 1 at it, 0 from 15 % of the range."""
    # Share of a joint's range from a limit beyond which the limit costs nothing [-].
    return np.asarray(np.clip(1.0 - limit_shares(chain, joints) / 0.15, 0.0, 1.0))


def turn_counts(chain: Chain, start: Array, goals: Array) -> Array:
    """Joints that turn by more than half a turn on the way to configurations (k, n), shape (k,)."""
    revolute = chain.joint_types == JointType.REVOLUTE
    return np.asarray((np.abs(goals - start)[:, revolute] > np.pi).sum(axis=1))


def clearance_lacks(clearances: Array) -> Array:
    """Nearness of obstacles at clearances (k,) [m]: 1 in contact, 0 from 5 cm."""
    return np.asarray(np.clip(1.0 - clearances / FAR_FROM_OBSTACLES, 0.0, 1.0))


def limit_shares(chain: Chain, joints: Array) -> Array:
    """Distance of configurations (k, n) from a joint limit as a share of the joint's range, (k,).

    Of the joint for which that is least. Joints without two limits do not count; 0.5 is the middle
    of all ranges.
    """
    lower, upper = chain.limits.lower, chain.limits.upper
    bounded = np.isfinite(lower) & np.isfinite(upper) & (upper > lower) & ~chain.continuous
    gap = np.minimum(joints - lower, upper - joints)[:, bounded] / (upper - lower)[bounded]
    return np.asarray(gap.min(axis=1, initial=0.5))


def is_at_limit(chain: Chain, joints: Array) -> NDArray[np.bool_]:
    """Whether configurations (k, n) are within 2 % of a joint's range from its limit, (k,)."""
    return np.asarray(limit_shares(chain, joints) < NEAR_LIMIT)


def manipulability_lacks(chain: Chain, joints: Array) -> Array:
    """Lack of manipulability of configurations (k, n): 1 at a singularity, 0 at the best of them.

    The manipulability is the product of the singular values of the Jacobian.
    """
    J = geometric(chain, joints)
    gram = J @ J.swapaxes(1, 2) if chain.n >= len(J[0]) else J.swapaxes(1, 2) @ J
    skills = np.sqrt(np.maximum(np.linalg.det(gram), 0.0))
    return np.asarray(1.0 - skills / max(float(skills.max(initial=0.0)), np.finfo(float).tiny))
