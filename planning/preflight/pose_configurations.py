"""Configurations of a pose that a plan may end in: every branch, by the turns nearest the start.

An arm with a closed form has all its branches looked at, and a redundant one those of a grid of
its parameter; other arms are searched from random starts. What inverse kinematics finds from the
start itself is looked at too: near singularities a grid has no configuration near by. A joint that
turns further than once has several values for one pose of its link: a configuration has the nearest
of them to the start, and the next ones where that is at a limit or where there is no other way.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics.arrays import Array, Indices
from kinematics.forward import forward
from kinematics.ik.closed_form.analytic import branches, parameter
from kinematics.ik.closed_form.structure import structure
from kinematics.ik.inverse import CLOSE, parameter_grid
from kinematics.ik.numeric import numeric
from kinematics.ik.solution import IkResult
from kinematics.model.chain import Chain, JointType
from kinematics.pose import from_axis_angle, rotation_error, transform
from planning.goal_choice.goal_order import NEAR_LIMIT, motion_costs
from planning.values.preferences import GoalCosts

#: Turns below this have no axis [rad]; configurations nearer in every joint [rad or m] are one.
_SAME = 1e-3
_TURN = 2.0 * np.pi


class PoseConfigurations(NamedTuple):
    """Configurations of a pose inside the limits.

    Args:
        joints: Those whose joints have the turns nearest the start, or the next ones where those
            are at a limit; cheapest first, shape (k, n) [rad or m].
        search: Of inverse kinematics, where it was asked; it says why there are none.
    """

    joints: Array
    search: IkResult | None = None


def pose_configurations(
    chain: Chain, T: Array, start: Array, options: numeric.SearchOptions, costs: GoalCosts
) -> PoseConfigurations:
    """Configurations of a pose, whether free or not.

    Args:
        chain: The robot.
        T: T_base_tip, shape (4, 4).
        start: Where the motion begins, shape (n,) [rad or m].
        options: Tolerances and seed of inverse kinematics.
        costs: By which they are sorted; of those that need no look at the robot's place.
    """
    joints, search = _branches(chain, T, start, options), None
    if not len(joints):
        # Starts of inverse kinematics spent on them.
        how = numeric.SearchOptions(
            options.seed, 120, options.position_tolerance, options.orientation_tolerance
        )
        # Configurations that inverse kinematics looks for where an arm has no closed form.
        search = numeric.solve(chain, T, how, seed_joints=start, solutions=12)
        found = search.solutions
        # A pose has six numbers: an arm with more joints has some to spare.
        if found and chain.n > 6:
            # Solutions lie anywhere along the arm's own motions, often where these meet a limit.
            inner = with_inner_limits(chain)
            # Configurations that it looks for away from limits where the arm has joints to spare.
            found += numeric.solve(inner, T, how, seed_joints=start, solutions=36).solutions
        joints = np.array([s.joints for s in found]).reshape(-1, chain.n)
    nearest = _nearest_turns(chain, joints, start)
    joints = _distinct(
        [_near_start(chain, T, start, options), nearest, inner_turns(chain, nearest)]
    )
    joints = joints[np.argsort(motion_costs(chain, start, joints, costs), kind="stable")]
    return PoseConfigurations(joints, search)


def _near_start(chain: Chain, T: Array, start: Array, options: numeric.SearchOptions) -> Array:
    """The configuration in which the tool is led from the start to a pose, shape (1, n), or none.

    By steps along the straight way there: from afar inverse kinematics may leave the branch.
    """
    how = numeric.SearchOptions(
        options.seed, 1, options.position_tolerance, options.orientation_tolerance
    )
    T_start, q = forward(chain, start), start
    turn = rotation_error(T_start[:3, :3], T[:3, :3])
    angle = float(np.linalg.norm(turn))
    # The tool is led from the start to the pose in four steps.
    for share in np.linspace(0.0, 1.0, 5)[1:]:
        R = from_axis_angle(turn / angle, share * angle) if angle > _SAME else np.eye(3)
        way = T_start[:3, 3] + share * (T[:3, 3] - T_start[:3, 3])
        towards = T if share == 1.0 else transform(R @ T_start[:3, :3], way)
        found = numeric.solve(chain, towards, how, seed_joints=q).solutions
        if not (found and found[0].within_limits):
            return np.empty((0, chain.n))
        q = found[0].joints
    return np.asarray(q[None])


def turned_copies(chain: Chain, joints: Array, start: Array) -> tuple[Array, Indices]:
    """Copies of configurations with one joint a turn further, on the other side of the start.

    Args:
        chain: The robot.
        joints: Their joints have the turns nearest the start, shape (k, n).
        start: Shape (n,).

    Returns:
        The copies inside the limits, shape (m, n), and of which configuration each one is, (m,).
    """
    copies: list[Array] = []
    origins: list[Indices] = []
    for j in np.flatnonzero(_several_turns(chain) & ~chain.continuous):
        rows = joints.copy()
        rows[:, j] += np.where(joints[:, j] > start[j], -_TURN, _TURN)
        inside = (rows[:, j] >= chain.limits.lower[j]) & (rows[:, j] <= chain.limits.upper[j])
        copies.append(rows[inside])
        origins.append(np.flatnonzero(inside))
    if not copies:
        return joints[:0], np.zeros(0, np.int64)
    return np.concatenate(copies), np.concatenate(origins)


def with_inner_limits(chain: Chain) -> Chain:
    """The robot with limits where its joints count as at one."""
    known: Chain | None = chain.memo.get("away_from_limits")
    if known is None:
        lower, upper = chain.limits.lower, chain.limits.upper
        near = np.where(np.isfinite(upper - lower), NEAR_LIMIT * (upper - lower), 0.0)
        limits = replace(chain.limits, lower=lower + near, upper=upper - near)
        known = chain.memo["away_from_limits"] = replace(chain, limits=limits)
    return known


def _branches(chain: Chain, T: Array, start: Array, options: numeric.SearchOptions) -> Array:
    """Branches of the closed form inside the limits, shape (k, n); none where there is no form."""
    form = structure(chain)
    if form is None:
        return np.empty((0, chain.n))
    values = parameter_grid(chain, form, parameter(chain, start)) if form.redundant else None
    tolerance = min(CLOSE, options.position_tolerance, options.orientation_tolerance)
    table = branches(chain, T, seed_joints=start, parameters=values, tolerance=tolerance)
    return np.array(table.joints[table.within_limits])


def _several_turns(chain: Chain) -> NDArray[np.bool_]:
    """Joints that have several values for one pose of their link."""
    span = chain.limits.upper - chain.limits.lower
    return np.asarray((chain.joint_types == JointType.REVOLUTE) & (span >= _TURN))


def _nearest_turns(chain: Chain, joints: Array, start: Array) -> Array:
    """The copies (k, n) of configurations by whole turns nearest to the start, in each joint."""
    turns = np.round((start - joints) / _TURN)
    lower, upper = chain.limits.lower, chain.limits.upper
    turns = np.clip(turns, np.ceil((lower - joints) / _TURN), np.floor((upper - joints) / _TURN))
    return np.where(_several_turns(chain), joints + _TURN * turns, joints)


def inner_turns(chain: Chain, joints: Array) -> Array:
    """Copies of those (k, n) that a whole turn of joints takes away from limits, shape (m, n)."""
    lower, upper = chain.limits.lower, chain.limits.upper
    near = np.where(np.isfinite(upper - lower), NEAR_LIMIT * (upper - lower), 0.0)
    moved = np.where(joints - lower < near, joints + _TURN, joints)
    moved = np.where(upper - joints < near, joints - _TURN, moved)
    inside = _several_turns(chain) & (moved >= lower) & (moved <= upper)
    copies = np.where(inside, moved, joints)
    return np.asarray(copies[(copies != joints).any(axis=1)])


def _distinct(groups: list[Array]) -> Array:
    """Rows of groups (k, n) without those that are the same as one before."""
    rows = np.concatenate(groups)
    _, first = np.unique(np.round(rows / _SAME), axis=0, return_index=True)
    return np.asarray(rows[np.sort(first)])
