"""Order of the configurations of a pose: the cheapest first, those at a joint limit last.

A small move stays in the branch of inverse kinematics that the arm stands in: the configuration
nearest to the start comes first wherever it takes little longer than the quickest.

The order is by straight motions. Where a plan ended at a limit all the same, its time says which
of the others are worth a plan of their own.

Report of the configuration that was chosen for a pose: its costs, and why no other one.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.ik.closed_form.analytic import branches, parameter
from kinematics.ik.closed_form.structure import structure
from kinematics.ik.numeric.numeric import ORIENTATION_TOLERANCE, POSITION_TOLERANCE
from kinematics.jacobian import geometric
from kinematics.model.chain import Chain, JointType
from kinematics.pose import rotation_error
from planning.planner import Ready
from planning.problem import PoseGoal, Problem
from planning.result import ChosenConfiguration
from planning.timing.rest_to_rest import motion_times
from planning.values.preferences import GoalCosts

#: The reason of a small move.
_OWN_BRANCH = (
    "The move is small: the configuration next to its start, which takes at most 1.2 times as long "
    "as the quickest."
)


def chosen_configuration(
    chain: Chain,
    found: Array,
    q: Array,
    start: Array,
    times: Array,
    clearance: float,
    weights: GoalCosts,
    replaced: tuple[float, float] | None = None,
) -> ChosenConfiguration:
    """Costs of one of several configurations, and why it is not another one.

    Args:
        chain: The robot.
        found: All free configurations that were found, shape (k, n) [rad or m].
        q: The one that was chosen, one of them, shape (n,).
        start: Where the motion to it begins, shape (n,).
        times: Of the straight motions from there to each of them, shape (k,) [s].
        clearance: At the one that was chosen, margins taken off [m].
        weights: Of the costs.
        replaced: Times of the motions beside a configuration at a limit, and beside this one, which
            took its place [s]; None where it took none.
    """
    k = int(np.abs(found - q).max(axis=1).argmin())
    parts = {
        "motion_time": weights.motion_time * times,
        "joint_limits": weights.joint_limits * limit_nearness(chain, found),
        "manipulability": weights.manipulability * manipulability_lacks(chain, found),
        "turns": weights.turns * turn_counts(chain, start, found),
    }
    total = np.sum(list(parts.values()), axis=0)
    shares = limit_shares(chain, found)
    stays = own_branch(chain, start, found, times) == k
    own = {name: float(values[k]) for name, values in parts.items()}
    own["clearance"] = float(weights.clearance * clearance_lacks(np.array([clearance]))[0])
    cheaper = int(np.count_nonzero(total < total[k] - 1e-9))
    return ChosenConfiguration(
        branch=branch_name(chain, q),
        limit_share=float(shares[k]),
        costs=own,
        found=len(found),
        cheaper=cheaper,
        at_limit=int(np.count_nonzero(shares < NEAR_LIMIT)),
        reason=_OWN_BRANCH
        if stays and cheaper and replaced is None
        else _reason(len(found), cheaper, bool(shares[k] < NEAR_LIMIT), replaced),
    )


def _reason(found: int, cheaper: int, at_limit: bool, replaced: tuple[float, float] | None) -> str:
    if replaced is not None:
        return (
            "In place of one within 2 % of a joint limit: the motions beside it take "
            f"{replaced[1]:.3f} s, and {replaced[0]:.3f} s with that one."
        )
    if found == 1:
        return "The only free configuration that was found."
    if at_limit:
        return (
            "Within 2 % of a joint limit: with none of the others that were planned to do the "
            "motions beside it take at most 1.2 times as long."
        )
    if not cheaper:
        return f"It costs the least of {found} free configurations."
    return (
        f"{cheaper} of {found} free configurations cost less up to here; the search expected more "
        "of the whole with them, or found no motion."
    )


def branch_name(chain: Chain, q: Array) -> str | None:
    """Name of the branch of the closed form that a configuration (n,) is of; None without one."""
    form = structure(chain)
    if form is None:
        return None
    values = np.array([parameter(chain, q)]) if form.redundant else None
    table = branches(chain, forward(chain, q), seed_joints=q, parameters=values)
    if not len(table.joints):
        return None
    off = np.abs(table.joints - q).max(axis=1)
    k = int(off.argmin())
    return table.label(k) if off[k] < 1e-4 else None


def plan_configuration(
    problem: Problem,
    ready: Ready,
    posed: Sequence[Array],
    last: Array,
    weights: GoalCosts,
    replaced: tuple[float, float] | None = None,
) -> ChosenConfiguration | None:
    """Costs of the configuration that a plan ends in, as the order of goals counts them.

    Args:
        problem: What was planned.
        ready: Its start, and the configurations that were found.
        posed: Those of them that are of poses, each (n,) [rad or m].
        last: Where the plan ends, shape (n,) [rad or m].
        weights: Of the costs.
        replaced: Times of a plan to a configuration at a limit, and of this one, which took its
            place [s]; None where it took none.

    Returns:
        None where it ends in none of a pose's configurations: goals that are joints leave no
        choice, and path constraints choose others.
    """
    if not posed:
        return None
    found = np.array(posed)
    k = int(np.abs(found - last).max(axis=1).argmin())
    # Joint values of goals come back to the last bits.
    if np.abs(found[k] - last).max() > 1e-9:
        return None
    clearance = next(own for own, q in ready.found if np.array_equal(q, found[k]))
    chain = problem.robot.chain
    return chosen_configuration(
        chain, found, found[k], ready.start, motion_times(chain, ready.start, found), clearance,
        weights, replaced,
    )  # fmt: skip


def deviation_note(problem: Problem, last: Array) -> str | None:
    """A note where a plan ends off its pose, within the goal's tolerances; None where it does not.

    Args:
        problem: What was planned. Path constraints take the tolerances as they are, and no note.
        last: Configuration of a pose that the plan ends in, shape (n,) [rad or m].
    """
    if problem.constraints is not None:
        return None
    tip, ends = forward(problem.robot.chain, last), list[tuple[float, float, float]]()
    for goal in problem.goals:
        if isinstance(goal, PoseGoal):
            away = float(np.linalg.norm(tip[:3, 3] - goal.T_base_tip[:3, 3]))
            turn = rotation_error(tip[:3, :3], goal.T_base_tip[:3, :3])
            angle = float(np.linalg.norm(turn))
            share = max(away / goal.position_tolerance, angle / goal.orientation_tolerance)
            ends.append((share, away, angle))
    _, away, angle = min(ends)
    # Right at the pose is a configuration of inverse kinematics, its last joint values rounded.
    if away <= 2.0 * POSITION_TOLERANCE and angle <= 2.0 * ORIENTATION_TOLERANCE:
        return None
    return (
        f"No configuration is right at the pose: the tip ends {away:.3g} m and {angle:.3g} rad "
        "off, within the goal's tolerances."
    )


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
