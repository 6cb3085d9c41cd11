"""Configurations moved onto the joint limits where they are hardly outside."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from kinematics.arrays import Array
from kinematics.model.chain import Chain

#: A measured state may be outside a limit by this part of it: encoders and filters miss so much.
MEASURED = 1e-4
#: What is asked for, and not measured, may be outside by rounding only [rad or m].
ROUNDED = 1e-6


@dataclass(frozen=True, slots=True)
class LimitViolation:
    """A joint outside its position limits.

    Args:
        joint: Name of the joint.
        value: Position of the joint [rad or m].
        limit: Limit that the joint violates [rad or m].
    """

    joint: str
    value: float
    limit: float

    @property
    def excess(self) -> float:
        """Distance of the joint from its limit [rad or m]."""
        return abs(self.limit - self.value)

    @property
    def details(self) -> dict[str, Any]:
        """The violation as values a program can use."""
        return asdict(self) | {"excess": self.excess}


def snap_to_limits(
    chain: Chain, q: Array, tolerance: float | None
) -> tuple[Array, LimitViolation | None]:
    """Move a configuration onto the limits that it is hardly outside.

    Args:
        chain: The robot.
        q: Configuration, shape (n,) [rad or m].
        tolerance: How far outside is hardly [rad or m]; None for what a measurement may miss, a
            share `MEASURED` of the joint's larger limit.

    Returns:
        The nearest configuration inside the limits, and None; where some joint is farther outside,
        the configuration as it is, and the worst violation.
    """
    # As np.clip, which takes several times as long.
    inside = np.minimum(np.maximum(q, chain.limits.lower), chain.limits.upper)
    if inside.tolist() == q.tolist():
        return inside, None
    outside, hardly = np.abs(inside - q), np.full(len(q), tolerance, dtype=np.float64)
    if tolerance is None:
        sizes = np.abs([chain.limits.lower, chain.limits.upper])
        hardly = MEASURED * np.where(np.isfinite(sizes), sizes, 0.0).max(axis=0)
        hardly = np.maximum(hardly * (1.0 + ROUNDED), ROUNDED)
    j = int(np.argmax(np.where(outside > hardly, outside, 0.0)))
    if outside[j] <= hardly[j]:
        return inside, None
    return q, LimitViolation(chain.joint_names[j], float(q[j]), float(inside[j]))


def goal_onto_limits(
    chain: Chain, q: Array, tolerance: float | None
) -> tuple[Array, LimitViolation | None]:
    """As `snap_to_limits`, of a goal, which nobody measured: None allows for rounding only."""
    return snap_to_limits(chain, q, ROUNDED if tolerance is None else tolerance)


def rates_onto_limits(rates: Array, limits: Array) -> Array:
    """Measured velocities or accelerations, moved onto the limits that they are hardly beyond.

    Args:
        rates: Shape (n,).
        limits: Shape (n,), positive, inf for none.

    Returns:
        Shape (n,); rates that are beyond by more than a share `MEASURED` stay as they are.
    """
    hardly = np.abs(rates) <= limits * (1.0 + MEASURED * (1.0 + ROUNDED))
    return np.where(hardly, np.clip(rates, -limits, limits), rates)


def moved_note(what: str, asked: Array, taken: Array) -> tuple[str, ...]:
    """A note where something was moved onto a limit.

    Args:
        what: Its name.
        asked: As the request gives it, shape (n,).
        taken: As it is taken, shape (n,).
    """
    if taken.tolist() == asked.tolist():
        return ()
    moved = float(np.abs(taken - asked).max())
    return (f"The {what} was outside a limit by {moved:.3g} and was moved onto it.",)
