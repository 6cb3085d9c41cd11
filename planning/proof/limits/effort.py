"""Bounds of torque and tool speed over a whole motion, by the proof's own code.

Intervals of time are halved until the bound over each is a thousandth above what is reached, and
until it is clear whether the limit is kept.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from dynamics.model.body import Bodies, bodies
from kinematics.arrays import Array
from kinematics.model.chain import Chain
from kinematics.trajectory.trajectory import Trajectory
from planning.proof.limits.effort_bounds import HALF, JET, MIDDLE, PIECE, effort_bounds_kernel
from planning.proof.motion_bounds import OUTWARD
from planning.values.limits import RATIO_TOLERANCE, EffortLimits

#: A bound is sharp that is at most this much above what is reached [relative].
_SHARP = 1e-3
#: Nor need it be any sharper below this share of a limit.
_NEGLIGIBLE = 1e-6
#: Intervals looked at for one answer, at most: about a second of work.
_MAX_INTERVALS = 100_000


class EffortUse(NamedTuple):
    """Largest use of a limit by a motion.

    Args:
        ratio: Never exceeded at any instant.
        reached: Reached at some instant, a thousandth less as a rule.
        joint: Index of the joint; of the tool's speed it means nothing.
        time: Approximate time of the largest use [s].
    """

    ratio: float
    reached: float
    joint: int
    time: float


#: Ratios to limits in the middle of each interval, and upper bounds all over it, both (c, k).
_Ratios = Callable[[Array], tuple[Array, Array]]


def effort_uses(limits: EffortLimits, trajectory: Trajectory) -> dict[str, EffortUse]:
    """Largest use of each limit by a motion, by "torque" and "tool_speed".

    Args:
        limits: Limits of the robot that moves.
        trajectory: Trajectory of all its joints, in its order.

    Raises:
        MissingInertia: Torques are limited, and no link has an inertia.
    """
    uses = {}
    if limits.effort is not None:
        uses["torque"] = torque_use(limits.chain, trajectory, limits.effort)
    if limits.tool_speed is not None:
        uses["tool_speed"] = tool_speed_use(limits.chain, trajectory, limits.tool_speed)
    return uses


def torque_use(chain: Chain, trajectory: Trajectory, effort: Array) -> EffortUse:
    """The largest |torque| / limit of all joints over all of a motion.

    Args:
        chain: The robot with all that it carries.
        trajectory: Trajectory of the joints.
        effort: Limits, shape (n,), inf where there is none [N m or N].

    Raises:
        MissingInertia: No link that a joint carries has an inertia.
    """
    bounds = _Bounds(bodies(chain), np.zeros(3), trajectory)

    def ratios(intervals: Array) -> tuple[Array, Array]:
        torques, _ = bounds(intervals)
        value, slope, curvature, error = np.moveaxis(torques, -1, 0)
        half = intervals[:, HALF, None]
        upper = np.abs(value) + np.abs(slope) * half + 0.5 * curvature * half**2 + error
        return (np.abs(value) - error) / effort, upper * OUTWARD / effort

    return _largest(ratios, trajectory)


def tool_speed_use(chain: Chain, trajectory: Trajectory, speed: float) -> EffortUse:
    """The largest speed of the tip's origin over a limit, over all of a motion.

    |v(s)| is convex in v, so that its linear part is longest at an end of the interval.

    Args:
        chain: The robot; its tip is the tool.
        trajectory: Trajectory of the joints.
        speed: The limit [m/s].
    """
    n = chain.tip.joint + 1
    if n == 0:
        return EffortUse(0.0, 0.0, 0, 0.0)
    none = np.zeros(n)
    massless = Bodies(
        chain.joint_types[:n],
        chain.offsets[:n],
        none,
        np.zeros((n, 3)),
        np.zeros((n, 3, 3)),
        none,
        none,
        np.zeros(3),
        np.zeros((1, 1)),
    )
    bounds = _Bounds(massless, np.array(chain.tip.T_joint_link[:3, 3]), trajectory)

    def ratios(intervals: Array) -> tuple[Array, Array]:
        _, velocities = bounds(intervals)
        value, slope, curvature, error = np.moveaxis(velocities, -1, 0)
        half = intervals[:, HALF, None]
        ends = [np.linalg.norm(value + sign * slope * half, axis=1) for sign in (1.0, -1.0)]
        rest = np.linalg.norm(0.5 * curvature * half**2 + error, axis=1)
        reached = np.linalg.norm(value, axis=1) - np.linalg.norm(error, axis=1)
        upper = (np.maximum(*ends) + rest) * OUTWARD
        return reached[:, None] / speed, upper[:, None] / speed

    return _largest(ratios, trajectory)


class _Bounds:
    """Jets of torques and tip velocity of one motion."""

    def __init__(self, packed: Bodies, tip: Array, trajectory: Trajectory) -> None:
        self._bodies, self._tip = packed, tip
        c = trajectory.coefficients[:, : len(packed.types)]
        self._derivatives = np.zeros((3, *c.shape))
        for order in range(3):
            self._derivatives[order, :, :, : c.shape[2]] = c
            c = c[:, :, 1:] * np.arange(1.0, c.shape[2])

    def __call__(self, intervals: Array) -> tuple[Array, Array]:
        """Jets of torques (c, n, JET) and of the tip's velocity (c, 3, JET)."""
        torques = np.empty((len(intervals), len(self._bodies.types), JET))
        velocities = np.empty((len(intervals), 3, JET))
        effort_bounds_kernel(
            self._bodies,
            self._tip,
            self._derivatives,
            np.ascontiguousarray(intervals),
            torques,
            velocities,
        )
        return torques, velocities


def _largest(ratios: _Ratios, trajectory: Trajectory) -> EffortUse:
    """The largest ratio over a motion, bounded from above and below."""
    half = 0.5 * np.diff(trajectory.breaks) * OUTWARD
    intervals = np.column_stack([np.arange(len(half)), half, half])
    reached, bound, joint, time, looked_at = 0.0, 0.0, 0, 0.0, 0
    while len(intervals):
        looked_at += len(intervals)
        middle, upper = ratios(intervals)
        k, j = np.unravel_index(int(np.argmax(middle)), middle.shape)
        if middle[k, j] > reached:
            reached, joint = float(middle[k, j]), int(j)
            piece = int(intervals[k, PIECE])
            time = float(trajectory.breaks[piece] + intervals[k, MIDDLE])
        highest = upper.max(axis=1)
        decided = (highest <= 1.0 + RATIO_TOLERANCE) | (reached > 1.0 + RATIO_TOLERANCE)
        sharp = highest <= max((1.0 + _SHARP) * reached, _NEGLIGIBLE)
        settled = sharp & decided
        if looked_at > _MAX_INTERVALS:
            settled[:] = True
        bound = max(bound, float(highest[settled].max(initial=0.0)))
        intervals = _halves(intervals[~settled])
    return EffortUse(bound, reached, joint, min(time, trajectory.duration))


def _halves(intervals: Array) -> Array:
    """Both halves of each interval, shape (2 c, 3)."""
    first, second = intervals.copy(), intervals.copy()
    half = 0.5 * intervals[:, HALF]
    first[:, HALF] = second[:, HALF] = half * OUTWARD
    first[:, MIDDLE] -= half
    second[:, MIDDLE] += half
    return np.concatenate([first, second])
