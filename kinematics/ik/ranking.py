"""Order of configurations of a pose, and their copies by whole turns."""

from typing import Literal, get_args

import numpy as np

from kinematics.arrays import Array, Indices
from kinematics.errors import InvalidOption
from kinematics.jacobian import geometric, manipulability
from kinematics.model.chain import Chain, JointType

Ranking = Literal["nearest", "limits", "manipulability"]
RANKINGS: tuple[Ranking, ...] = get_args(Ranking)

#: A joint this far out is rounding of the conversion to and from degrees [rad or m].
_ROUNDING = 1e-9


def order(
    chain: Chain, joints: Array, ranking: Ranking, seed: Array, link: str | None = None
) -> Indices:
    """Indices that sort configurations (k, n), best first; equals stay in their order.

    Args:
        chain: The robot.
        joints: The configurations.
        ranking: "nearest": least |q - seed|. "limits": least of the largest
            |q - middle| / half range over the joints that have limits, so that the best stays
            farthest from all of them. "manipulability": largest product of the singular values of
            the Jacobian.
        seed: Shape (n,).
        link: The link whose Jacobian counts; the tip where none is named.

    Raises:
        InvalidOption: No such ranking.
    """
    check_ranking(ranking)
    cost: Array
    if ranking == "nearest":
        cost = np.linalg.norm(joints - seed, axis=1)
    elif ranking == "limits":
        cost = margin(chain, joints)
    else:
        values = np.linalg.svd(geometric(chain, joints, link), compute_uv=False)
        cost = np.array([-manipulability(row) for row in values])
    # Costs that differ by rounding alone keep the order of the branches.
    return cost.round(12).argsort(kind="stable").astype(np.int64)


def check_ranking(ranking: Ranking) -> None:
    """Refuse what is not the name of a ranking.

    Raises:
        InvalidOption: There is no such ranking.
    """
    if ranking not in RANKINGS:
        raise InvalidOption(
            f"there is no ranking {ranking!r}", hint=f"One of: {', '.join(RANKINGS)}."
        )


def margin(chain: Chain, joints: Array) -> Array:
    """The largest |q - middle| / half range of configurations (k, n), shape (k,); 1 at a limit."""
    lower, upper = chain.limits.lower, chain.limits.upper
    bounded = np.isfinite(lower) & np.isfinite(upper) & (upper > lower)
    if not bounded.any():
        return np.zeros(len(joints))
    lower, upper = lower[bounded], upper[bounded]
    middle, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
    return np.asarray((np.abs(joints[:, bounded] - middle) / half).max(axis=1))


def whole_turns(chain: Chain, q: Array, most: int, seed: Array | None = None) -> Array:
    """All copies of a configuration by whole turns of its revolute joints inside the limits.

    Args:
        chain: The robot.
        q: Shape (n,).
        most: Largest number of solutions in the answer.
        seed: The copies are sorted by their distance from it; from ``q`` where none is given.

    Returns:
        Shape (k, n); empty where q has no copy inside the limits. A joint without limits gets one
        turn to either side.
    """
    turn = 2.0 * np.pi
    choices: list[Array] = []
    for j in range(chain.n):
        lower, upper = chain.limits.lower[j], chain.limits.upper[j]
        if chain.joint_types[j] != JointType.REVOLUTE:
            inside = lower - _ROUNDING <= q[j] <= upper + _ROUNDING
            values = np.array([q[j]] if inside else [])
        else:
            low = q[j] - turn if np.isinf(lower) else lower
            high = q[j] + turn if np.isinf(upper) else upper
            first = np.ceil((low - q[j] - _ROUNDING) / turn)
            last = np.floor((high - q[j] + _ROUNDING) / turn)
            values = q[j] + turn * np.arange(first, last + 1.0)
        choices.append(np.clip(values, lower, upper))
    near = q if seed is None else seed
    # The nearest values of every joint come first, so that a cut at ``most`` keeps the nearest.
    choices = [
        c[np.argsort(np.abs(c - x), kind="stable")] for c, x in zip(choices, near, strict=True)
    ]
    copies = np.empty((1, 0))
    for values in choices:
        k, v = len(copies), len(values)
        copies = np.column_stack([np.repeat(copies, v, axis=0), np.tile(values, k)])
        reached = copies.shape[1]
        distance = np.linalg.norm(copies - near[:reached], axis=1)
        copies = copies[np.argsort(distance, kind="stable")][:most]
    return copies


def distance(chain: Chain, a: Array, b: Array) -> float:
    """Largest difference of a joint between two configurations, whole turns left out [rad or m]."""
    d = np.abs(a - b)
    turns = chain.joint_types == JointType.REVOLUTE
    d[turns] = np.abs(np.remainder(d[turns] + np.pi, 2.0 * np.pi) - np.pi)
    return float(d.max())


def outside(chain: Chain, q: Array) -> str | None:
    """Limit violation of a configuration, in words; None inside the limits."""
    low, high = chain.limits.lower, chain.limits.upper
    for j in np.flatnonzero((q < low) | (q > high)):
        return (
            f"joint {chain.joint_names[j]!r} at {q[j]:.6g} is outside [{low[j]:.6g}, {high[j]:.6g}]"
        )
    return None
