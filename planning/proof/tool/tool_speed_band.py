"""Share of a tool's path on which its speed is proved to be within a band.

On an interval of half length h the speed is within |v| +- a h, with v the velocity of the tool in
its middle and a the largest acceleration, from ``relative_motion``. Intervals are halved until that
lies inside the band or outside, or they are shorter than a share of the whole; those that are left
count as outside.

The way of the tool on an interval is at least what its ends are apart, measured along u = v / |v|.
The speed across u is at most a |s|, that along it at least |v| - a h, so that the way is longer
than that by at most

    int (a s)^2 / (2 (|v| - a h)) ds = a^2 h^3 / (3 (|v| - a h)).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from compiled.kernel import kernel
from compiled.vec3 import Vector, dot
from kinematics.arrays import Array
from kinematics.model.chain import Chain
from kinematics.trajectory.trajectory import Trajectory
from planning.proof.joint_frames import forward_kernel
from planning.proof.limits.limit_uses import Violation
from planning.proof.motion_bounds import JOINT_COLUMNS, VALUE, enclose
from planning.proof.relative_motion import relative_motion
from planning.proof.tool.tool_deviation import Arm, pieces_between, tip_kernel
from planning.tool_motions.timed_tool_motions import SpeedBand

#: Halvings of an interval: what is undecided then is a thousandth of a piece.
_MAX_DEPTH = 10
#: Change of the speed within an interval up to which its length counts as known, as part of it.
_SHARP = 0.02
#: The upper end of the band counts as kept up to this part more: timing aims at the end itself.
_ROUNDING = 1e-9
# Entries of the totals.
#: Length of path that is proved to be within the band, at least [m].
_WITHIN = 0
#: Length of path, at most [m].
_LENGTH = 1
#: Least speed found [m/s].
_LEAST = 2
#: Bound of the largest speed [m/s].
_MOST = 3
#: Time of the first interval that is proved to be above the band [s].
_ABOVE = 4
_TOTALS = 5


@dataclass(frozen=True, slots=True)
class SpeedUse:
    """Speed of the tool along the parts of its path that have a band of speed.

    Args:
        share: Share of the path's length, on which the speed is proved to be within the band.
        least: Least speed found in the middle of an interval, starts and stops left out [m/s].
        most: Largest speed, a bound for all t [m/s].
        low: Least speed asked for [m/s].
        high: Largest speed asked for [m/s].
        verified: Whether the speed is proved to be below the upper end of the band at all t.
        length: Length of the path, at most [m].
        bands: Use of each band, where there are several; they differ in speed.
    """

    share: float
    least: float
    most: float
    low: float
    high: float
    verified: bool
    length: float
    bands: "tuple[SpeedUse, ...]" = ()


def check_speed_bands(
    chain: Chain, trajectory: Trajectory, bands: Sequence[SpeedBand]
) -> tuple[SpeedUse | None, Violation | None]:
    """Prove that the tool is nowhere faster than its bands, and where it is within them.

    Args:
        chain: The robot; its tip is the tool.
        trajectory: Trajectory of all its joints, in its order.
        bands: Speeds, and when each is asked for.

    Returns:
        None and None without bands; else the use of all of them, and the first violation.
    """
    if not bands:
        return None, None
    arm = Arm(chain.joint_types, chain.offsets, chain.tip.T_joint_link, chain.tip.joint)
    uses, wrong = [], []
    for band in bands:
        use, violation = _check_band(arm, trajectory, band)
        uses.append(use)
        wrong += [violation] if violation is not None else []
    first = min(wrong, key=lambda violation: violation.time) if wrong else None
    return (uses[0] if len(uses) == 1 else _joined(uses)), first


def _joined(uses: Sequence[SpeedUse]) -> SpeedUse:
    length = sum(use.length for use in uses)
    within = sum(use.share * use.length for use in uses)
    return SpeedUse(
        within / length if length > 0.0 else 1.0,
        min(use.least for use in uses),
        max(use.most for use in uses),
        min(use.low for use in uses),
        max(use.high for use in uses),
        all(use.verified for use in uses),
        length,
        tuple(uses),
    )


def _check_band(
    arm: Arm, trajectory: Trajectory, band: SpeedBand
) -> tuple[SpeedUse, Violation | None]:
    totals = np.array([0.0, 0.0, np.inf, 0.0, np.inf])
    speeds = np.array([band.low, band.high * (1.0 + _ROUNDING)])
    for begin, end in band.spans:
        for piece, low, high in pieces_between(trajectory, begin, end):
            before = totals[_ABOVE]
            ends = np.array([low, high])
            speed_kernel(arm, trajectory.coefficients[piece], ends, speeds, totals)
            if totals[_ABOVE] < before:
                totals[_ABOVE] += trajectory.breaks[piece]
                break
    is_slow = bool(totals[_MOST] <= speeds[1])
    length = float(totals[_LENGTH])
    share = float(totals[_WITHIN]) / length if length > 0.0 else 1.0
    least = float(totals[_LEAST]) if totals[_LEAST] < np.inf else 0.0
    use = SpeedUse(share, least, float(totals[_MOST]), band.low, band.high, is_slow, length)
    if is_slow:
        return use, None
    time = float(totals[_ABOVE]) if totals[_ABOVE] < np.inf else float(band.spans[0][0])
    message = f"the tool moves at up to {use.most:.6g} m/s, above its {band.high:.6g} m/s"
    return use, Violation("tool_speed", time, message, {"speed": use.most, "limit": band.high})


@kernel
def speed_kernel(arm: Arm, coefficients: Array, ends: Array, speeds: Array, totals: Array) -> None:
    """Bring the totals up to date by a part of one piece.

    Args:
        arm: The robot.
        coefficients: Coefficients of the piece, shape (n, k).
        ends: Ends of the part in the piece's own time, shape (2,) [s].
        speeds: The band, shape (2,) [m/s].
        totals: Shape (5,).
    """
    n, size = coefficients.shape
    joints, shift = np.empty((n, JOINT_COLUMNS)), np.empty((2, size))
    frames, T = np.empty((n, 4, 4)), np.empty((3, 4))
    stack, top = np.zeros((_MAX_DEPTH + 2, 3)), 1
    stack[0, 0], stack[0, 1] = ends[0], ends[1]
    while top > 0:
        top -= 1
        low, high, depth = stack[top, 0], stack[top, 1], stack[top, 2]
        middle = 0.5 * (low + high)
        half = max(high - middle, middle - low) * (1.0 + 4e-16)
        enclose(coefficients, middle, half, shift, joints)
        forward_kernel(arm.types, arm.offsets, joints[:, VALUE], frames)
        tip_kernel(arm, frames, T)
        p = (T[0, 3], T[1, 3], T[2, 3])
        motion = relative_motion(arm.types, frames, p, arm.joint, -1, joints, half)
        speed, change = math.sqrt(dot(motion.velocity, motion.velocity)), motion.acceleration * half
        is_sharp = change <= _SHARP * speed
        is_within = is_sharp and speed - change >= speeds[0] and speed + change <= speeds[1]
        is_outside = is_sharp and speed + change < speeds[0]
        is_above = is_sharp and speed - change > speeds[1]
        if is_above:
            totals[_ABOVE] = min(totals[_ABOVE], middle)
        if is_within or is_outside or is_above or depth >= _MAX_DEPTH:
            totals[_MOST] = max(totals[_MOST], speed + change)
            totals[_LEAST] = min(totals[_LEAST], speed)
            if is_within:
                way = _way(arm, coefficients, (low, high), motion.velocity, joints, frames, T)
                way /= speed
                totals[_WITHIN] += (1.0 - _ROUNDING) * way
                longer = half * change * change / (3.0 * (speed - change))
                totals[_LENGTH] += (1.0 + _ROUNDING) * way + longer
            else:
                totals[_LENGTH] += 2.0 * half * (speed + 0.5 * change)
            continue
        stack[top, 0], stack[top, 1], stack[top, 2] = middle, high, depth + 1.0
        stack[top + 1, 0], stack[top + 1, 1], stack[top + 1, 2] = low, middle, depth + 1.0
        top += 2


@kernel
def _way(
    arm: Arm,
    coefficients: Array,
    ends: tuple[float, float],
    velocity: Vector,
    joints: Array,
    frames: Array,
    T: Array,
) -> float:
    """Way of the tip between two times along a velocity, times its size; the rest is memory."""
    q, way = joints[:, VALUE], 0.0
    for end in range(2):
        for j in range(q.shape[0]):
            q[j] = 0.0
            for k in range(coefficients.shape[1] - 1, -1, -1):
                q[j] = q[j] * ends[end] + coefficients[j, k]
        forward_kernel(arm.types, arm.offsets, q, frames)
        tip_kernel(arm, frames, T)
        sign = -1.0 if end == 0 else 1.0
        for row in range(3):
            way += sign * velocity[row] * T[row, 3]
    return way
