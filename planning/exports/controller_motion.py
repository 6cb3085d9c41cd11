"""The motion that a controller makes of exported points, as a trajectory that can be proved."""

from collections.abc import Sequence

import numpy as np

from kinematics.arrays import Array
from kinematics.trajectory.interpolation import interpolate
from kinematics.trajectory.trajectory import Trajectory
from planning.exports.options import Rule
from planning.exports.points import ExportPoints


def controller_motion(joint_names: Sequence[str], points: ExportPoints) -> Trajectory:
    """The motion between exported points by their rule.

    Quintics through positions, velocities and accelerations, cubics through positions and
    velocities, and straight lines are what joint_trajectory_controller of ros2_control
    interpolates by, as each point has them. The straight legs of a path go from rest to rest,
    q(u) = a + (3 u^2 - 2 u^3) (b - a); any other timing of a leg passes the same configurations.

    Args:
        joint_names: n names.
        points: Points as the file has them.
    """
    rows = points.derivatives
    if points.rule == Rule.STRAIGHT_LEGS:
        return interpolate(joint_names, points.times, rows[0], "cubic", np.zeros_like(rows[0]))
    return interpolate(joint_names, points.times, rows[0], points.rule.value, *rows[1:])


def joint_deviation(motion: Trajectory, other: Trajectory) -> Array:
    """Largest |q(t) - p(t)| of each joint over all t of both motions, shape (n,) [rad or m].

    The differences are polynomials between the breaks of both; their extrema are exact to rounding.

    Args:
        motion: Motion of n joints.
        other: Other motion of the same joints.
    """
    end = min(motion.duration, other.duration)
    breaks = np.unique(np.concatenate([motion.breaks, other.breaks]))
    breaks = breaks[breaks < end]
    # Breaks apart by rounding alone make no piece of their own.
    keep = np.diff(breaks, append=np.inf) > 1e-12 * end
    breaks = breaks[keep]
    first, second = (_coefficients(one, breaks, end) for one in (motion, other))
    size = max(first.shape[2], second.shape[2])
    difference = _padded(first, size) - _padded(second, size)
    ends = Trajectory(motion.joint_names, np.append(breaks, end), difference).extrema()
    return np.asarray(np.maximum(np.abs(ends.minimum), np.abs(ends.maximum)))


def _coefficients(motion: Trajectory, starts: Array, end: float) -> Array:
    """Coefficients of a motion about the starts of pieces that do not cross its breaks."""
    middles = 0.5 * (starts + np.append(starts[1:], end))
    pieces = np.clip(np.searchsorted(motion.breaks, middles, "right") - 1, 0, motion.pieces - 1)
    c: Array = motion.coefficients[pieces].copy()
    shift = (starts - motion.breaks[pieces])[:, None]
    for first in range(c.shape[2] - 1):
        for i in range(c.shape[2] - 2, first - 1, -1):
            c[:, :, i] += shift * c[:, :, i + 1]
    return c


def _padded(c: Array, size: int) -> Array:
    return np.pad(c, ((0, 0), (0, 0), (0, size - c.shape[2])))
