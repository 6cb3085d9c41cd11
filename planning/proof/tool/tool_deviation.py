"""Deviation of the tool from lines, arcs and corners, bounded for every instant of a motion.

On an interval of time of half length h the tool's place is p + s v + r with |r| <= a h^2 / 2, its
orientation turns at w, both from ``relative_motion``. Of a line, the deviation e across it changes
at e', the part of v across it, and stays below max |e +- h e'| + |r|. On an arc
e = (distance from the axis - radius, height), whose second derivative adds |p'|^2 / distance. An
angle between two orientations changes at most by their relative angular velocity. Intervals are
halved until the bound is sharp or a deviation beyond what is allowed is found. Of corners see
``planning.proof.tool.corner_deviation``.

The angle about an arc's axis is followed from interval to interval, so that whole turns count: only
intervals are judged in which it changes by little. Planners measure deviations by
``planning.tool_paths.tool_deviation``, and a fault there must not be believed here.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from compiled.kernel import kernel
from compiled.vec3 import dot, scale, subtract
from kinematics.arrays import Array, Indices
from kinematics.model.chain import Chain
from kinematics.trajectory.trajectory import Trajectory
from planning.proof.collision.separating_direction import rounding_bound
from planning.proof.joint_frames import forward_kernel
from planning.proof.limits.limit_uses import Violation
from planning.proof.motion_bounds import JOINT_COLUMNS, OUTWARD, VALUE, enclose, reach
from planning.proof.relative_motion import relative_motion
from planning.proof.tool.corner_deviation import corner_deviation, pack_corner
from planning.proof.tool.tool_curve import (
    ALONG,
    AXIS,
    CENTER,
    KIND,
    LENGTH,
    NORMAL,
    ROTATION,
    START,
    SWEEP,
    TURN,
    WIDTH,
    Deviations,
    angle_to_nominal,
    arc_deviation,
    line_deviation,
    vector_at,
)
from planning.tool_motions.timed_tool_motions import TimedToolMotions
from planning.tool_motions.tool_corner import ToolCorner, ToolCurve
from planning.tool_motions.tool_motion import ToolMotion

#: A bound is sharp that is at most so many times what was found.
_SHARP = 1.25
#: Or below this share of what is allowed.
_SMALL = 0.1
#: Halvings of a piece, after which its bound is what it is.
_MAX_DEPTH = 40
#: Ends of motions may miss the breaks of the trajectory by what sums of times round off [relative].
_TIME_ROUNDING = 1e-12


@dataclass(frozen=True, slots=True)
class PathDeviation:
    """Largest deviation of the tool from its motions, over all t.

    Args:
        position: Largest distance from the line, arc or corner [m].
        orientation: Largest angle to the orientation at the same place of it [rad]; None where it
            is free.
        verified: Whether these are proved and within what was asked for.
        time: Instant of the largest deviation, or at which it is too large [s].
        max_position: Allowed distance [m].
        max_orientation: Allowed angle [rad]; None where it is free.
    """

    position: float
    orientation: float | None
    verified: bool
    time: float
    max_position: float
    max_orientation: float | None


class Arm(NamedTuple):
    """Arrays of a robot for the kernels (n joints).

    Args:
        types: Types of the joints, shape (n,).
        offsets: T_(i-1)_i of every joint at 0, shape (n, 4, 4).
        T_joint_tip: The tip in the frame of the joint that carries it, shape (4, 4).
        joint: Joint that carries the tool, -1 for the base.
    """

    types: Indices
    offsets: Array
    T_joint_tip: Array
    joint: int


class Worst(NamedTuple):
    """The largest deviations so far.

    Args:
        bounds: Position [m] and orientation [rad], shape (2,).
        place: Share of what is allowed, the time in its piece [s], the angle followed [rad], (3,).
    """

    bounds: Array
    place: Array


def check_tool_motions(
    chain: Chain, trajectory: Trajectory, asked: TimedToolMotions
) -> tuple[PathDeviation, Violation | None]:
    """Bound how far the tool is off its motions, and say what is wrong if that is too far.

    Args:
        chain: The robot; its tip is the tool.
        trajectory: Trajectory of all its joints, in its order.
        asked: The motions, in turn, with their times and what is allowed.
    """
    deviation = path_deviation(chain, trajectory, asked)
    if deviation.verified:
        return deviation, None
    message = f"the tool is {deviation.position:.6g} m off its motion"
    if deviation.orientation is not None:
        message += f", or turned off it by {deviation.orientation:.6g} rad"
    details = {"position": deviation.position, "orientation": deviation.orientation}
    return deviation, Violation("path_deviation", deviation.time, message, details)


def path_deviation(chain: Chain, trajectory: Trajectory, asked: TimedToolMotions) -> PathDeviation:
    """Deviation of a robot's tool from its motions, bounded for every instant.

    Args:
        chain: The robot; its tip is the tool.
        trajectory: Trajectory of all its joints, in its order.
        asked: The motions, in turn, with their times and what is allowed.
    """
    is_free = asked.max_orientation is None
    allowed = np.array([asked.max_position, np.inf if is_free else asked.max_orientation])
    arm = Arm(chain.joint_types, chain.offsets, chain.tip.T_joint_link, chain.tip.joint)
    worst, verified, time, highest = np.zeros(2), True, 0.0, -1.0
    for motion, begin, end in asked.exact:
        numbers, angle = pack_curve(motion), 0.0
        for piece, low, high in pieces_between(trajectory, float(begin), float(end)):
            part = Worst(np.zeros(2), np.array([-1.0, 0.0, angle]))
            fine = deviation_kernel(
                arm, trajectory.coefficients[piece], np.array([low, high]), numbers, allowed, part
            )
            worst = np.maximum(worst, part.bounds)
            angle = float(part.place[2])
            # The first that is too far, else where the largest share of what is allowed is used.
            if verified and (not fine or part.place[0] > highest):
                highest = float(part.place[0])
                time = float(trajectory.breaks[piece] + part.place[1])
            verified = verified and bool(fine)
    return PathDeviation(
        position=float(worst[0]),
        orientation=None if is_free else float(worst[1]),
        verified=verified,
        time=min(time, trajectory.duration),
        max_position=asked.max_position,
        max_orientation=asked.max_orientation,
    )


def pieces_between(
    trajectory: Trajectory, begin: float, end: float
) -> list[tuple[int, float, float]]:
    """The pieces between two times, and the part of each in its own time."""
    breaks, slack = trajectory.breaks, _TIME_ROUNDING * trajectory.duration
    first = int(np.searchsorted(breaks, begin + slack, side="right")) - 1
    last = int(np.searchsorted(breaks, end - slack, side="left")) - 1
    first = min(max(first, 0), trajectory.pieces - 1)
    parts = []
    for piece in range(first, max(last, first) + 1):
        length = float(breaks[piece + 1] - breaks[piece]) * OUTWARD
        low = max(begin - float(breaks[piece]), 0.0) if piece == first else 0.0
        high = length if end >= breaks[piece + 1] - slack else end - float(breaks[piece])
        low = 0.0 if low <= slack else low
        parts.append((piece, low, max(low, high)))
    return parts


def pack_curve(curve: ToolCurve) -> Array:
    """A motion of any kind as the kernels read it, shape (WIDTH,) or (CORNER_WIDTH,)."""
    if not isinstance(curve, ToolCorner):
        return pack_motion(curve)
    return pack_corner(pack_motion(curve.first), pack_motion(curve.second), curve.slope)


def pack_motion(motion: ToolMotion) -> Array:
    """A line or an arc as the kernels read it, shape (WIDTH,)."""
    m, start = np.zeros(WIDTH), motion.T_start[:3, 3]
    turn = motion.turn
    angle = float(np.linalg.norm(turn))
    m[START : START + 3], m[ROTATION:] = start, motion.T_start[:3, :3].ravel()
    if angle > 0.0:
        m[AXIS : AXIS + 3], m[TURN] = turn / angle, angle
    if motion.kind == "lin":
        way = motion.T_end[:3, 3] - start
        length = float(np.linalg.norm(way))
        if length > 0.0:
            m[ALONG : ALONG + 3], m[LENGTH] = way / length, length
        return m
    m[KIND], m[NORMAL : NORMAL + 3], m[CENTER : CENTER + 3] = 1.0, motion.normal, motion.center
    m[ALONG : ALONG + 3] = (start - motion.center) / motion.radius
    m[LENGTH], m[SWEEP] = motion.radius, motion.sweep
    return m


@kernel
def deviation_kernel(
    arm: Arm, coefficients: Array, ends: Array, m: Array, allowed: Array, worst: Worst
) -> bool:
    """Bound the deviation on a part of one piece; whether it is proved to be allowed.

    Args:
        arm: The robot.
        coefficients: Coefficients of the piece, shape (n, k).
        ends: Ends of the part in the piece's own time, shape (2,) [s].
        m: The motion, shape (WIDTH,) or (CORNER_WIDTH,).
        allowed: Deviations [m], [rad], infinite where it is free, shape (2,).
        worst: Raised; its angle is where the part before has left it.
    """
    n, size = coefficients.shape
    joints, shift = np.empty((n, JOINT_COLUMNS)), np.empty((2, size))
    frames = np.empty((n, 4, 4))
    stack, top = np.zeros((_MAX_DEPTH + 2, 3)), 1
    stack[0, 0], stack[0, 1] = ends[0], ends[1]
    now, upper, found = np.zeros(2), np.zeros(2), np.zeros(2)
    deviations = Deviations(now, upper, np.empty((3, 4)))
    while top > 0:
        top -= 1
        low, high, depth = stack[top, 0], stack[top, 1], stack[top, 2]
        middle = 0.5 * (low + high)
        half = max(high - middle, middle - low) * (1.0 + 4e-16)
        enclose(coefficients, middle, half, shift, joints)
        forward_kernel(arm.types, arm.offsets, joints[:, VALUE], frames)
        judged = _bound(arm, frames, joints, half, m, worst.place, deviations)
        beyond = judged and (now[0] > allowed[0] or now[1] > allowed[1])
        within, sharp = judged, judged
        for k in range(2):
            found[k] = max(found[k], now[k]) if judged else found[k]
            within = within and upper[k] <= allowed[k]
            sharp = sharp and upper[k] <= max(_SMALL * allowed[k], _SHARP * found[k])
        if beyond or depth >= _MAX_DEPTH:
            value = now if beyond else upper
            for k in range(2):
                worst.bounds[k] = max(worst.bounds[k], value[k])
            worst.place[0], worst.place[1] = np.inf, middle
            return False
        if within and sharp:
            share = max(upper[0] / allowed[0], upper[1] / allowed[1])
            if share > worst.place[0]:
                worst.place[0], worst.place[1] = share, middle
            for k in range(2):
                worst.bounds[k] = max(worst.bounds[k], upper[k])
            continue
        stack[top, 0], stack[top, 1], stack[top, 2] = middle, high, depth + 1.0
        stack[top + 1, 0], stack[top + 1, 1], stack[top + 1, 2] = low, middle, depth + 1.0
        top += 2
    return True


@kernel
def _bound(
    arm: Arm, frames: Array, joints: Array, half: float, m: Array, place: Array, found: Deviations
) -> bool:
    """Write deviations in the middle of an interval and bounds all over it; False if not judged."""
    now, upper, T = found
    tip_kernel(arm, frames, T)
    p = (T[0, 3], T[1, 3], T[2, 3])
    spread = relative_motion(arm.types, frames, p, arm.joint, -1, joints, half)
    lengths = reach(arm.types, arm.offsets, joints) + math.sqrt(dot(p, p))
    lost, n = rounding_bound(arm.types.shape[0], lengths), arm.types.shape[0]
    if m[KIND] == 2.0:
        corner_deviation(m, p, spread, half, found)
        upper[0] += lost
        upper[1] += rounding_bound(n, 1.0)
        return True
    if m[KIND] == 0.0:
        judged, s, pace, bend = line_deviation(m, p, spread, half, place, found)
    else:
        judged, s, pace, bend = arc_deviation(m, p, spread, half, place, found)
    upper[0] += lost
    if not judged:
        return False
    axis = vector_at(m, AXIS)
    now[1] = angle_to_nominal(m, s, T)
    relative = subtract(spread.turn_rate, scale(m[TURN] * pace, axis))
    upper[1] = now[1] + math.sqrt(dot(relative, relative)) * half + spread.turn_bend
    upper[1] += 0.5 * m[TURN] * bend * half * half + rounding_bound(n, 1.0)
    if m[KIND] == 0.0 and m[LENGTH] == 0.0:
        # A turn on the spot is not to go beyond its ends.
        swept = abs(pace) * half
        now[1] += max(0.0, -s, s - 1.0) * m[TURN]
        upper[1] += max(0.0, swept - s, s + swept - 1.0) * m[TURN]
    return True


@kernel(allocates=False)
def tip_kernel(arm: Arm, frames: Array, T: Array) -> None:
    """Write the tip's pose into T (3, 4)."""
    for row in range(3):
        for column in range(4):
            if arm.joint < 0:
                T[row, column] = arm.T_joint_tip[row, column]
                continue
            T[row, column] = frames[arm.joint, row, 3] if column == 3 else 0.0
            for k in range(3):
                T[row, column] += frames[arm.joint, row, k] * arm.T_joint_tip[k, column]
