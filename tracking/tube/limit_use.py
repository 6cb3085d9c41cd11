"""Use of a robot's limits by a tracked motion."""

from typing import NamedTuple

import numpy as np

from kinematics.arrays import Array
from kinematics.model.chain import Limits
from tracking.tube.motion_bounds import MotionBounds, Quantity


class LimitUse(NamedTuple):
    """Largest use of one kind of limit.

    Args:
        ratio: Largest |value| / limit of all joints; for positions of the distance from the middle
            of the range to half the range. 1 is at the limit.
        joint: Index of the joint.
    """

    ratio: float
    joint: int


def limit_uses(bounds: MotionBounds, limits: Limits) -> dict[str, LimitUse]:
    """Use of the position, velocity and torque limits that are finite.

    Positions and velocities are bounded over every step of the integrator; so are torques of a
    simulation with a tube, which are those at the samples otherwise.
    """
    rows = bounds.visited_cells()
    lower, upper = bounds.lower[rows], bounds.upper[rows]
    if not len(rows):
        return {}
    low = lower[:, Quantity.POSITION].min(axis=0) - bounds.global_error[0]
    high = upper[:, Quantity.POSITION].max(axis=0) + bounds.global_error[0]
    limited = np.isfinite(limits.lower) & np.isfinite(limits.upper)
    least, greatest = np.where(limited, limits.lower, 0.0), np.where(limited, limits.upper, 0.0)
    middle, half = 0.5 * (greatest + least), 0.5 * (greatest - least)
    off = np.maximum(high - middle, middle - low)
    velocity = bounds.global_error[1] + np.maximum(
        upper[:, Quantity.VELOCITY].max(axis=0), -lower[:, Quantity.VELOCITY].min(axis=0)
    )
    values = {
        "position": (off, half),
        "velocity": (velocity, limits.velocity),
        "torque": (bounds.peak_torque, limits.effort),
    }
    uses = {name: _largest(value, limit) for name, (value, limit) in values.items()}
    return {name: use for name, use in uses.items() if use is not None}


def _largest(value: Array, limit: Array) -> LimitUse | None:
    """The joint with the largest value / limit; None where no limit is finite and positive."""
    known = np.isfinite(limit) & (limit > 0.0)
    if not known.any():
        return None
    ratio = np.where(known, value / np.where(known, limit, 1.0), -np.inf)
    joint = int(np.argmax(ratio))
    return LimitUse(float(ratio[joint]), joint)
