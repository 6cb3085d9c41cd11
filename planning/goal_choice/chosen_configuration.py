"""The configuration that was chosen for a pose, what it costs, and why it is not another one."""

import numpy as np

from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.ik.closed_form.analytic import branches, parameter
from kinematics.ik.closed_form.structure import structure
from kinematics.model.chain import Chain
from planning.preflight.goal_order import (
    NEAR_LIMIT,
    clearance_lacks,
    limit_nearness,
    limit_shares,
    manipulability_lacks,
    own_branch,
    turn_counts,
)
from planning.result import ChosenConfiguration
from planning.values.goal_costs import GoalCosts

#: A configuration is of a branch that differs by no more than this in a joint [rad or m].
_SAME = 1e-4
#: The reason of a small move.
_OWN_BRANCH = (
    "The move is small: the configuration next to its start, which takes at most 1.2 times as long "
    "as the quickest."
)
#: Costs that differ by less are equal.
_EQUAL = 1e-9


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
    cheaper = int(np.count_nonzero(total < total[k] - _EQUAL))
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
    return table.label(k) if off[k] < _SAME else None
