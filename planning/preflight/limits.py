"""Configurations moved onto the joint limits where they are hardly outside."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from kinematics.arrays import Array
from kinematics.chain import Chain


@dataclass(frozen=True, slots=True)
class LimitViolation:
    """The joint that is farthest outside its limits.

    Args:
        joint: Name of the joint.
        value: Where it is [rad or m].
        limit: The limit that it is beyond [rad or m].
        excess: How far beyond [rad or m].
    """

    joint: str
    value: float
    limit: float
    excess: float

    @property
    def details(self) -> dict[str, Any]:
        """The violation as values a program can use."""
        return {
            "joint": self.joint,
            "value": self.value,
            "limit": self.limit,
            "excess": self.excess,
        }


def snap_to_limits(chain: Chain, q: Array, tolerance: float) -> tuple[Array, LimitViolation | None]:
    """Move a configuration onto the limits that it is hardly outside.

    Args:
        chain: The robot.
        q: Configuration, shape (n,) [rad or m].
        tolerance: How far outside is hardly [rad or m].

    Returns:
        The nearest configuration inside the limits, and None; where some joint is farther outside,
        the configuration as it is, and the worst violation.
    """
    # As np.clip, which takes several times as long.
    inside = np.minimum(np.maximum(q, chain.limits.lower), chain.limits.upper)
    if inside.tolist() == q.tolist():
        return inside, None
    j = int(np.argmax(np.abs(inside - q)))
    excess = float(abs(q[j] - inside[j]))
    if excess <= tolerance:
        return inside, None
    return q, LimitViolation(chain.joint_names[j], float(q[j]), float(inside[j]), excess)
