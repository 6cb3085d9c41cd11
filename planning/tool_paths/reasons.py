"""Reasons why the tool can't be led on: what is in the way, by how much, and what to try."""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from kinematics.arrays import Array
from kinematics.ik.numeric import numeric
from kinematics.jacobian import geometric
from kinematics.model.chain import Chain, JointType
from planning.tool_motions.tool_path import Reason

#: What to try, by the reason.
HINTS: dict[Reason, str] = {
    "limit": "Start in another branch, turn the tool elsewhere, or move the work or the base.",
    "singularity": "Start in another branch, or lead the tool past the singularity.",
    "unreachable": "Bring what is to be reached nearer.",
    "branch": "Start in another branch, or split the way where the longest part ends.",
    "collision": "Move what is in the way, or lead the tool round it.",
    "deviation": "Allow a larger max_deviation, or give waypoints farther apart.",
    "time": "Allow more time.",
}
#: Least singular value, as part of the largest, below which an arm counts as singular.
SINGULAR = 1e-2


class Cause(NamedTuple):
    """Reason why the arm can't be at a pose, or not come to it.

    Args:
        reason: Reason in a word.
        message: One sentence.
        details: Numbers for the reason.
    """

    reason: Reason
    message: str
    details: dict[str, Any]


def endless(chain: Chain) -> Chain:
    """The chain without joint limits."""
    none = np.full(chain.n, np.inf)
    return replace(chain, limits=replace(chain.limits, lower=-none, upper=none))


def at_limit(chain: Chain, q: Array) -> Cause:
    """The joint that is farthest beyond its limits at a configuration (n,)."""
    limits = chain.limits
    beyond = np.maximum(limits.lower - q, q - limits.upper)
    j = int(np.argmax(beyond))
    limit = float(limits.lower[j] if limits.lower[j] > q[j] else limits.upper[j])
    name, excess = chain.joint_names[j], max(float(beyond[j]), 0.0)
    text = f"joint {name!r} would have to go {excess:.4g} beyond its limit {limit:.6g}"
    details = {"joint": name, "limit": limit, "value": float(q[j]), "excess": excess}
    return Cause("limit", text, details)


def nearest_turns(chain: Chain, q: Array) -> Array:
    """A configuration (n,) with whole turns that bring each joint nearest to its middle."""
    limits, turn = chain.limits, 2.0 * np.pi
    both = limits.lower + limits.upper
    turns = np.round((q - 0.5 * np.where(np.isfinite(both), both, 0.0)) / turn)
    return np.where(chain.joint_types == JointType.REVOLUTE, q - turn * turns, q)


def out_of_reach(
    chain: Chain, target: Array, options: numeric.SearchOptions, seed: Array
) -> tuple[Cause | None, Array]:
    """Reason why no configuration has the tool at a pose, and the nearest one; None if one has.

    Args:
        chain: The robot; its tip is the tool.
        target: The pose, shape (4, 4).
        options: Starts to spend, and the axes that count.
        seed: First of them, shape (n,).
    """
    found = numeric.solve(chain, target, options, seed_joints=seed)
    if found.solutions:
        return None, found.solutions[0].joints
    nearest = found.nearest
    names = ("position_error", "orientation_error")
    errors = {name: float(getattr(nearest, name)) for name in names}
    text = "the arm comes no nearer than {:.4g} m and {:.4g} rad".format(*errors.values())
    return Cause("unreachable", text, errors), nearest.joints


def relative_singular_value(chain: Chain, q: Array, rows: slice = slice(6)) -> tuple[float, float]:
    """The least singular value of the Jacobian's rows that count, and as part of the largest."""
    J = geometric(chain, q)[rows]
    # Rows of the Jacobian below this are 0: no joint moves the tool that way.
    some = J[np.linalg.norm(J, axis=1) > 1e-9]
    values = np.linalg.svd(some if len(some) else J, compute_uv=False)
    return float(values[-1]), float(values[-1]) / max(float(values[0]), 1e-300)
