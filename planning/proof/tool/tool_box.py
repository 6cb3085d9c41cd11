"""Proof that the tool keeps to a box of tolerances about a line or an arc, for every instant.

Of the path's pose N at the tool's own place s, the deviation e of the tool's origin and the
rotation D obey, seen from the axes A that the box is along (N's own, which turn at w_N, or fixed
ones),

    e' = v - p_N',          (A^T e)' = A^T (e' - w_A x e),
    D' = A^T [w] A D,       w = w_T - w_N (N's own axes),  w = w_T - R_T R_N^T w_N (fixed axes).

Over an interval of half length h each component of e stays within |rate| h + |second derivative|
h^2 / 2 of its value in the middle; the axis z of D, which says rx, ry and the tilt, turns by at
most |w x z| h and terms of second order, all of D by |w| h and such terms. With ry = b off zero rx
and rz change 1 / cos b times as fast. Intervals are halved until the box is kept all over, or left.

Beyond an end of the path N is the pose at that end. What the place runs beyond it at most within an
interval counts along the path, and as a turn of N.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from compiled.kernel import kernel
from compiled.vec3 import Vector, cross, dot, scale, subtract
from kinematics.arrays import Array
from kinematics.model.chain import Chain
from kinematics.trajectory.trajectory import Trajectory
from planning.proof.collision.separating_direction import rounding_bound
from planning.proof.joint_frames import forward_kernel
from planning.proof.limits.limit_uses import Violation
from planning.proof.motion_bounds import JOINT_COLUMNS, VALUE, enclose, reach
from planning.proof.relative_motion import RelativeMotion, relative_motion
from planning.proof.tool.tool_curve import (
    ALONG,
    AXIS,
    CENTER,
    KIND,
    LENGTH,
    MAX_TURN,
    NORMAL,
    START,
    SWEEP,
    TURN,
    follow_angle,
    nominal_rotation,
    vector_at,
)
from planning.proof.tool.tool_deviation import Arm, pack_motion, pieces_between, tip_kernel
from planning.tool_motions.timed_tool_motions import TimedToolMotions
from planning.tool_motions.tool_tolerance import ToolTolerance

# Entries of a box as the kernel reads it.
#: Least deviations x, y, z, rx, ry, rz [m], [rad].
LOWER = 0
#: Largest deviations.
UPPER = 6
#: Largest tilt [rad].
TILT = 12
#: 1 for axes that stand still.
FIXED = 13
#: These axes, row by row.
AXES = 14
BOX_SIZE = 23
#: A bound is sharp that is at most so many times the share of the box that was found.
_SHARP = 1.25
#: Or below this share of the box.
_SMALL = 0.25
#: Halvings of a piece, after which it is not proved.
_MAX_DEPTH = 40
#: Largest ry at which rx and rz are told apart [rad].
_MAX_RY = 1.5


class Box(NamedTuple):
    """Deviations on one interval, of x, y, z [m], rx, ry, rz [rad] and the tilt [rad].

    Args:
        value: Deviation in the middle of the interval, shape (7,).
        spread: How far they can be from that all over it, shape (7,).
        T: The tool's pose in its middle, shape (3, 4).
        N: The rotation asked for there, shape (3, 3).
        A: The axes of the box there, by columns, shape (3, 3).
    """

    value: Array
    spread: Array
    T: Array
    N: Array
    A: Array


class Place(NamedTuple):
    """Deviation of position and motion along the path on one interval.

    Args:
        judged: Whether the interval is short enough to tell.
        s: Place on the motion in the middle, from 0 to 1; that of the end where the tool is beyond.
        pace: Rate of the place along the path [1/s].
        bend: Bound of the change of its rate [1/s^2].
        error: Deviation e from the place [m].
        rate: Rate of the deviation [m/s].
        second: Bound of its second derivative [m/s^2].
        onward: Direction of the path in the middle, of length 1.
        over: How much farther beyond the ends of the motion, or less far, the tool can be than in
            the middle [m].
        curved: Angle by which the path there can be off its direction in the middle [rad].
    """

    judged: bool
    s: float
    pace: float
    bend: float
    error: Vector
    rate: Vector
    second: float
    onward: Vector
    over: float
    curved: float


@dataclass(frozen=True, slots=True)
class BoxUse:
    """Largest share of its tolerances that the tool uses, over all t.

    Args:
        share: Share of the range on either side of its middle, 1 at the end of it.
        verified: Whether the tolerances are proved to be kept.
        time: Instant of the largest share, or at which a tolerance is not kept [s].
    """

    share: float
    verified: bool
    time: float


def check_tool_boxes(
    chain: Chain, trajectory: Trajectory, asked: TimedToolMotions
) -> tuple[BoxUse | None, Violation | None]:
    """Prove that the tool keeps to its tolerances, and say what is wrong where it does not.

    Args:
        chain: The robot; its tip is the tool.
        trajectory: Trajectory of all its joints, in its order.
        asked: The motions; those without a tolerance of their own are left out.
    """
    arm = Arm(chain.joint_types, chain.offsets, chain.tip.T_joint_link, chain.tip.joint)
    use = None
    for motion, begin, end, tolerance in asked.tolerant:
        use = use or BoxUse(0.0, True, begin)
        wide = tolerance.widened(asked.max_position, asked.max_orientation or math.pi)
        numbers, box, worst = pack_motion(motion), pack_box(wide), np.array([-1.0, 0.0, 0.0])
        for piece, low, high in pieces_between(trajectory, begin, end):
            worst[0] = use.share
            ends = np.array([low, high])
            kept = box_kernel(arm, trajectory.coefficients[piece], ends, numbers, box, worst)
            time = min(float(trajectory.breaks[piece] + worst[1]), trajectory.duration)
            if not kept:
                use = BoxUse(float(worst[0]), False, time)
                message = f"the tool leaves its tolerance: {use.share:.4g} times as far as allowed"
                return use, Violation("path_deviation", time, message, {"share": use.share})
            if worst[0] > use.share:
                use = BoxUse(float(worst[0]), True, time)
    return use, None


def pack_box(tolerance: ToolTolerance) -> Array:
    """A tolerance as the kernel reads it, shape (BOX_SIZE,)."""
    box = np.zeros(BOX_SIZE)
    box[LOWER:UPPER], box[UPPER:TILT], box[TILT] = tolerance.lower, tolerance.upper, tolerance.tilt
    if tolerance.axes is not None:
        box[FIXED], box[AXES:] = 1.0, tolerance.axes.ravel()
    return box


@kernel
def box_kernel(
    arm: Arm, coefficients: Array, ends: Array, m: Array, box: Array, worst: Array
) -> bool:
    """Whether the tool is proved to keep to the box on a part of one piece.

    Args:
        arm: The robot.
        coefficients: Coefficients of the piece, shape (n, k).
        ends: Ends of the part in the piece's own time, shape (2,) [s].
        m: The motion, shape (WIDTH,).
        box: The tolerance, shape (BOX_SIZE,).
        worst: The largest share of the box used, the time there in the piece [s], and the angle
            followed along an arc [rad], brought up to date, shape (3,).
    """
    n, size = coefficients.shape
    joints, shift = np.empty((n, JOINT_COLUMNS)), np.empty((2, size))
    frames = np.empty((n, 4, 4))
    stack, top = np.zeros((_MAX_DEPTH + 2, 3)), 1
    stack[0, 0], stack[0, 1] = ends[0], ends[1]
    found = Box(np.zeros(7), np.zeros(7), np.empty((3, 4)), np.empty((3, 3)), np.empty((3, 3)))
    while top > 0:
        top -= 1
        low, high, depth = stack[top, 0], stack[top, 1], stack[top, 2]
        middle = 0.5 * (low + high)
        half = max(high - middle, middle - low) * (1.0 + 4e-16)
        enclose(coefficients, middle, half, shift, joints)
        forward_kernel(arm.types, arm.offsets, joints[:, VALUE], frames)
        judged = _bound(arm, frames, joints, half, m, box, worst, found)
        now, upper = _shares(box, found) if judged else (0.0, np.inf)
        if now > 1.0 or depth >= _MAX_DEPTH:
            worst[0], worst[1] = max(now, min(upper, 1e9)), middle
            return False
        if upper <= 1.0 and upper <= max(_SMALL, _SHARP * max(now, worst[0])):
            if upper > worst[0]:
                worst[0], worst[1] = upper, middle
            continue
        stack[top, 0], stack[top, 1], stack[top, 2] = middle, high, depth + 1.0
        stack[top + 1, 0], stack[top + 1, 1], stack[top + 1, 2] = low, middle, depth + 1.0
        top += 2
    return True


@kernel
def _shares(box: Array, found: Box) -> tuple[float, float]:
    """Largest share of the box used in the middle of an interval, and its bound all over it."""
    now, upper = 0.0, 0.0
    for k in range(6):
        low, high = box[LOWER + k], box[UPPER + k]
        if not math.isfinite(low) or not math.isfinite(high):
            continue
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        off = found.value[k] - middle
        if k >= 3:
            off -= 2.0 * math.pi * math.floor(off / (2.0 * math.pi) + 0.5)
        now = max(now, abs(off) / half)
        upper = max(upper, (abs(off) + found.spread[k]) / half)
    if math.isfinite(box[TILT]):
        now = max(now, found.value[6] / box[TILT])
        upper = max(upper, (found.value[6] + found.spread[6]) / box[TILT])
    return now, upper


@kernel
def _bound(
    arm: Arm, frames: Array, joints: Array, half: float, m: Array, box: Array, worst: Array,
    found: Box,
) -> bool:  # fmt: skip
    """Write deviations in the middle of an interval and their spread; False if not judged."""
    value, spread, T, N, A = found
    tip_kernel(arm, frames, T)
    p = (T[0, 3], T[1, 3], T[2, 3])
    motion = relative_motion(arm.types, frames, p, arm.joint, -1, joints, half)
    n = arm.types.shape[0]
    lengths = reach(arm.types, arm.offsets, joints) + math.sqrt(dot(p, p))
    place = _line_place(m, p, motion, half)
    if m[KIND] != 0.0:
        place = _arc_place(m, p, motion, half, worst)
    if not place.judged:
        return False
    nominal_rotation(m, place.s, N)
    fixed = box[FIXED] != 0.0
    for i in range(3):
        for k in range(3):
            A[i, k] = box[AXES + 3 * i + k] if fixed else N[i, k]
    w_N = scale(m[TURN] * place.pace, vector_at(m, AXIS))
    N_speed = m[TURN] * (abs(place.pace) + place.bend * half)
    turning = 0.0 if fixed else N_speed
    size, speed = math.sqrt(dot(place.error, place.error)), math.sqrt(dot(place.rate, place.rate))
    fastest = speed + place.second * half
    second = place.second + 2.0 * turning * fastest
    turned = 0.0 if fixed else m[TURN] * place.bend
    second += (turning * turning + turned) * (size + fastest * half)
    rate = place.rate if fixed else subtract(place.rate, cross(w_N, place.error))
    beyond = m[TURN] * place.over / (m[LENGTH] if m[KIND] == 0.0 else m[LENGTH] * m[SWEEP])
    # The axes can stand still beyond an end, where the rates have them turn on.
    stopped = 0.0 if fixed else beyond
    lost = rounding_bound(n, lengths) + stopped * (size + fastest * half)
    turned_away = place.curved + turning * half + stopped
    for k in range(3):
        axis = (A[0, k], A[1, k], A[2, k])
        value[k] = dot(axis, place.error)
        spread[k] = abs(dot(axis, rate)) * half + 0.5 * second * half * half + lost
        spread[k] += place.over * min(1.0, abs(dot(axis, place.onward)) + turned_away)
    _bound_rotation(m, place, motion, half, fixed, beyond + rounding_bound(n, 1.0), found)
    return True


@kernel
def _bound_rotation(
    m: Array, place: Place, motion: RelativeMotion, half: float, fixed: bool, lost: float,
    found: Box,
) -> None:  # fmt: skip
    """Write rx, ry, rz and the tilt in the middle of an interval, and how far they can change."""
    value, spread, T, N, A = found
    w_N = scale(m[TURN] * place.pace, vector_at(m, AXIS))
    # M carries the axes of the box to the tool: A D. Its columns are in the base's axes.
    M = np.empty((3, 3))
    for i in range(3):
        for k in range(3):
            M[i, k] = 0.0
            for a in range(3):
                if not fixed:
                    M[i, k] = T[i, k]
                    continue
                for b in range(3):
                    M[i, k] += T[i, a] * N[b, a] * A[b, k]
    if fixed:
        seen = (0.0, 0.0, 0.0)
        y = (dot((N[0, 0], N[1, 0], N[2, 0]), w_N), dot((N[0, 1], N[1, 1], N[2, 1]), w_N),
             dot((N[0, 2], N[1, 2], N[2, 2]), w_N))  # fmt: skip
        seen = (dot((T[0, 0], T[0, 1], T[0, 2]), y), dot((T[1, 0], T[1, 1], T[1, 2]), y),
                dot((T[2, 0], T[2, 1], T[2, 2]), y))  # fmt: skip
        w = subtract(motion.turn_rate, seen)
    else:
        w = subtract(motion.turn_rate, w_N)
    D = np.empty((3, 3))
    for i in range(3):
        for k in range(3):
            D[i, k] = A[0, i] * M[0, k] + A[1, i] * M[1, k] + A[2, i] * M[2, k]
    z = (M[0, 2], M[1, 2], M[2, 2])
    speed, across = math.sqrt(dot(w, w)), cross(w, z)
    # How far the integral of w can be off w times the time, to first order and then some.
    bent = motion.turn_bend + 0.5 * m[TURN] * place.bend * half * half
    if fixed:
        bent += 0.5 * (speed * half + bent) * m[TURN] * (abs(place.pace) + place.bend * half) * half
    swung = math.sqrt(dot(across, across)) * half + bent + lost
    swung += 0.5 * speed * half * (motion.turned if not fixed else speed * half + bent)
    turned = speed * half + bent + lost
    ry = math.asin(min(1.0, max(-1.0, D[0, 2])))
    value[3] = math.atan2(-D[1, 2], D[2, 2])
    value[4] = ry
    value[5] = math.atan2(-D[0, 1], D[0, 0])
    value[6] = math.atan2(math.hypot(D[0, 2], D[1, 2]), D[2, 2])
    highest = abs(ry) + swung
    widened = 1.0 / math.cos(highest) if highest < _MAX_RY else np.inf
    spread[3], spread[4] = swung * widened, swung
    spread[5], spread[6] = turned * widened, swung


@kernel
def _line_place(m: Array, p: Vector, motion: RelativeMotion, half: float) -> Place:
    """Deviation from a line."""
    u, length = vector_at(m, ALONG), m[LENGTH]
    y = subtract(p, vector_at(m, START))
    x, speed = dot(u, y), dot(u, motion.velocity)
    rate = subtract(motion.velocity, scale(speed, u))
    travel = abs(speed) * half + motion.bend
    over = min(travel, max(0.0, travel - x, x + travel - length))
    a = motion.acceleration
    if not length > 0.0:
        return Place(False, 0.0, 0.0, 0.0, y, rate, a, u, over, 0.0)
    at = min(max(x, 0.0), length)
    error = subtract(y, scale(at, u))
    return Place(True, at / length, speed / length, a / length, error, rate, a, u, over, 0.0)


@kernel
def _arc_place(m: Array, p: Vector, motion: RelativeMotion, half: float, worst: Array) -> Place:
    """Deviation from an arc."""
    normal, first, radius = vector_at(m, NORMAL), vector_at(m, ALONG), m[LENGTH]
    side = cross(normal, first)
    y, v = subtract(p, vector_at(m, CENTER)), motion.velocity
    a, b, height = dot(first, y), dot(side, y), dot(normal, y)
    distance = math.hypot(a, b)
    fastest = math.sqrt(dot(v, v)) + motion.acceleration * half
    nearest = distance - motion.moved
    if nearest <= 0.5 * distance:
        return Place(False, 0.0, 0.0, 0.0, y, v, 0.0, normal, 0.0, 0.0)
    spoke = (
        (a * first[0] + b * side[0]) / distance,
        (a * first[1] + b * side[1]) / distance,
        (a * first[2] + b * side[2]) / distance,
    )
    ahead = cross(normal, spoke)
    across = dot(ahead, v) / distance
    faster = (motion.acceleration + 2.0 * fastest * fastest / nearest) / nearest
    travel = min(abs(across) * half + 0.5 * faster * half * half, motion.moved / nearest)
    if travel > MAX_TURN:
        return Place(False, 0.0, 0.0, 0.0, y, v, 0.0, normal, 0.0, 0.0)
    phi = follow_angle(math.atan2(b, a), worst)
    off, sweep = distance - radius, m[SWEEP]
    outwards, upwards = dot(spoke, v), dot(normal, v)
    at = min(max(phi, 0.0), sweep)
    # From the centre to the place, in the axes of the spoke: the spoke itself between the ends.
    c, s = radius * math.cos(at - phi), radius * math.sin(at - phi)
    error = (
        (distance - c) * spoke[0] - s * ahead[0] + height * normal[0],
        (distance - c) * spoke[1] - s * ahead[1] + height * normal[1],
        (distance - c) * spoke[2] - s * ahead[2] + height * normal[2],
    )
    rate = (
        outwards * spoke[0] + off * across * ahead[0] + upwards * normal[0],
        outwards * spoke[1] + off * across * ahead[1] + upwards * normal[1],
        outwards * spoke[2] + off * across * ahead[2] + upwards * normal[2],
    )
    swiftest = fastest / nearest
    second = motion.acceleration + radius * (faster + swiftest * swiftest)
    over = radius * min(travel, max(0.0, travel - phi, phi + travel - sweep))
    pace, bend = across / sweep, faster / sweep
    return Place(True, at / sweep, pace, bend, error, rate, second, ahead, over, travel)
