"""Certified motion: a stretch of joint motion is proved free for every instant, not at samples.

Over an interval, joint j strays at most delta_j from its value in the middle. A point at distance
rho_j from axis j then moves by at most rho_j delta_j (a slide: delta_j); moved joint by joint,
from the one that carries the point down to the base, with what it moved so far added to rho,

    B <- B + (rho_j + B) delta_j      (revolute),      B <- B + delta_j      (prismatic).

Where a pair's distance in the middle exceeds its bound B and the margin, the pair is free all
over the interval; what is left is halved. Pairs settled on an interval are not looked at again
inside it. Source: "Adaptive dynamic collision checking for single and multiple articulated
robots in complex environments", IEEE Transactions on Robotics, 2005.
"""

import math

import numpy as np

from kinematics.chain import Array
from kinematics.forward import forward_kernel
from kinematics.kernel import kernel
from obstacles.collision_model import ModelArrays
from obstacles.gjk import CLOSER, FARTHER, separation

FREE = 0
COLLIDING = 1
UNDECIDED = 2

_MAX_DEPTH = 40
#: Intervals looked at before an edge is given up as undecided.
_MAX_INTERVALS = 20_000
#: A bound this small [m] that still does not separate a pair is contact within its margin.
_RESOLUTION = 1e-6
#: What floating point may have cost a distance of a few metres [m], with room to spare.
_ROUNDING_ERROR = 1e-9


@kernel
def place_piece(model: ModelArrays, frames: Array, i: int, poses: Array, centers: Array) -> None:
    """Write the pose (4, 4) and the ball's centre (3,) of piece i in the base frame."""
    joint = model.joints[i]
    P = model.poses[i]
    c = model.centers[i]
    if joint < 0:
        for row in range(3):
            centers[i, row] = c[row]
            for column in range(4):
                poses[i, row, column] = P[row, column]
        return
    F = frames[joint]
    for row in range(3):
        f0, f1, f2, f3 = F[row, 0], F[row, 1], F[row, 2], F[row, 3]
        centers[i, row] = f0 * c[0] + f1 * c[1] + f2 * c[2] + f3
        for column in range(4):
            poses[i, row, column] = f0 * P[0, column] + f1 * P[1, column] + f2 * P[2, column]
        poses[i, row, 3] += f3


@kernel
def motion_bounds(
    model: ModelArrays, frames: Array, center: Array, i: int, delta: Array, bounds: Array
) -> None:
    """Write how far any point of piece i can move when only joints >= j move, at bounds[j]."""
    radius = model.radii[i]
    total = 0.0
    for j in range(model.joints[i], -1, -1):
        if delta[j] > 0.0:
            if model.joint_types[j] == 0:
                x = center[0] - frames[j, 0, 3]
                y = center[1] - frames[j, 1, 3]
                z = center[2] - frames[j, 2, 3]
                zx, zy, zz = frames[j, 0, 2], frames[j, 1, 2], frames[j, 2, 2]
                along = x * zx + y * zy + z * zz
                square = x * x + y * y + z * z - along * along
                rho = math.sqrt(max(square, 0.0)) + radius
                total += (rho + total) * delta[j]
            else:
                total += delta[j]
        bounds[j] = total


@kernel
def _ball_to_box(center: Array, radius: float, box: Array, T: Array) -> float:
    """Lower bound of the distance between a ball and a piece's box of frame T."""
    x, y, z = center[0] - T[0, 3], center[1] - T[1, 3], center[2] - T[2, 3]
    square = 0.0
    for k in range(3):
        local = x * T[0, k] + y * T[1, k] + z * T[2, k] - box[k]
        out = abs(local) - box[3 + k]
        if out > 0.0:
            square += out * out
    return float(math.sqrt(square) - radius)


@kernel
def quick_bound(model: ModelArrays, i: int, j: int, poses: Array, centers: Array) -> float:
    """A cheap lower bound [m] of the distance of pieces i and j from their balls and boxes."""
    if model.kinds[i] == 3:
        x = centers[j, 0] - poses[i, 0, 3]
        y = centers[j, 1] - poses[i, 1, 3]
        z = centers[j, 2] - poses[i, 2, 3]
        height = x * poses[i, 0, 2] + y * poses[i, 1, 2] + z * poses[i, 2, 2]
        return float(height - model.radii[j])
    bound = _ball_to_box(centers[j], model.radii[j], model.boxes[i], poses[i])
    other = _ball_to_box(centers[i], model.radii[i], model.boxes[j], poses[j])
    return max(bound, other)


@kernel
def ball_bound(model: ModelArrays, i: int, j: int, centers: Array) -> float:
    """Lower bound [m] of the distance of pieces i and j from their balls alone."""
    x = centers[i, 0] - centers[j, 0]
    y = centers[i, 1] - centers[j, 1]
    z = centers[i, 2] - centers[j, 2]
    return float(math.sqrt(x * x + y * y + z * z) - model.radii[i] - model.radii[j])


@kernel
def look_along_centers(i: int, j: int, centers: Array, axis: Array) -> None:
    """Start a pair's search along the line between its balls' centres."""
    for row in range(3):
        axis[row] = centers[i, row] - centers[j, row]


@kernel
def certify_curve(
    model: ModelArrays, b0: Array, b1: Array, b2: Array, b3: Array, margin: float, found: Array
) -> int:
    """Prove that q(s) = b0 + b1 s + b2 s^2 + b3 s^3 keeps all pairs apart for 0 <= s <= 1.

    Args:
        model: The packed robot and scene.
        b0: Coefficients of the curve, shape (n,), as are the next three.
        b1: Of s.
        b2: Of s^2.
        b3: Of s^3.
        margin: Asked for on top of the pairs' own margins [m].
        found: Filled with what was found, shape (4,): where on the curve it stopped (s), the pair
            that stopped it or -1, intervals looked at, and the clearance proved so far [m].

    Returns:
        FREE (proved), COLLIDING (a configuration was found with a pair at most its margin apart) or
        UNDECIDED (a pair comes within a millionth of a metre of its margin).
    """
    n, p, k = b0.shape[0], model.joints.shape[0], model.pairs.shape[0]
    q, delta = np.empty(n), np.empty(n)
    frames = np.empty((n, 4, 4))
    poses, centers = np.empty((p, 4, 4)), np.empty((p, 3))
    bounds = np.empty((p, n))
    stamp = np.full(p, -1, dtype=np.int64)
    axes = np.zeros((k, 3))
    S, scratch = np.empty((4, 3)), np.empty((4, 3))
    active = np.empty((_MAX_DEPTH + 1, k), dtype=np.int32)
    counts = np.empty(_MAX_DEPTH + 1, dtype=np.int64)
    lows, highs = np.empty(_MAX_DEPTH + 2), np.empty(_MAX_DEPTH + 2)
    depths = np.empty(_MAX_DEPTH + 2, dtype=np.int64)
    counts[0] = k
    for pair in range(k):
        active[0, pair] = pair
    lows[0], highs[0], depths[0] = 0.0, 1.0, 0
    top, visits = 1, 0
    clearance = np.inf
    found[0], found[1] = 0.0, -1.0
    while top > 0:
        top -= 1
        low, high, depth = lows[top], highs[top], depths[top]
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        for j in range(n):
            q[j] = b0[j] + (b1[j] + (b2[j] + b3[j] * middle) * middle) * middle
            slope = b1[j] + (2.0 * b2[j] + 3.0 * b3[j] * middle) * middle
            bend = abs(b2[j] + 3.0 * b3[j] * middle) + abs(b3[j]) * half
            delta[j] = (abs(slope) + bend * half) * half
        forward_kernel(model.joint_types, model.offsets, q, frames)
        visits += 1
        kept, widest = 0, 0.0
        for entry in range(counts[depth]):
            pair = active[depth, entry]
            i, j = model.pairs[pair, 0], model.pairs[pair, 1]
            for piece in (i, j):
                # Nothing that stands still has to be placed twice.
                if stamp[piece] != visits and (stamp[piece] < 0 or model.joints[piece] >= 0):
                    stamp[piece] = visits
                    place_piece(model, frames, piece, poses, centers)
                    motion_bounds(model, frames, centers[piece], piece, delta, bounds[piece])
            bound = bounds[j, model.joints[i] + 1]
            apart = model.margins[pair] + margin
            far = apart + bound + _ROUNDING_ERROR
            lower = ball_bound(model, i, j, centers)
            if lower <= far:
                lower = max(lower, quick_bound(model, i, j, poses, centers))
            if lower <= far:
                if axes[pair, 0] == 0.0 and axes[pair, 1] == 0.0 and axes[pair, 2] == 0.0:
                    look_along_centers(i, j, centers, axes[pair])
                verdict, lower, _ = separation(
                    model.kinds, model.starts, model.vertices, model.sizes,
                    i, poses[i], j, poses[j], apart, far, axes[pair], S, scratch,
                )  # fmt: skip
                if verdict == CLOSER:
                    found[0], found[1], found[2], found[3] = middle, pair, visits, -np.inf
                    return COLLIDING
                if verdict != FARTHER:
                    active[depth + 1, kept] = pair
                    kept += 1
                    widest = max(widest, bound)
                    if bound < _RESOLUTION:
                        found[0], found[1], found[2] = middle, pair, visits
                        found[3] = clearance
                        return UNDECIDED
                    continue
            clearance = min(clearance, lower - bound - model.margins[pair])
        if kept == 0:
            continue
        if depth + 2 > _MAX_DEPTH or visits >= _MAX_INTERVALS:
            found[0], found[1], found[2] = middle, active[depth + 1, 0], visits
            found[3] = clearance
            return UNDECIDED
        counts[depth + 1] = kept
        lows[top], highs[top], depths[top] = middle, high, depth + 1
        lows[top + 1], highs[top + 1], depths[top + 1] = low, middle, depth + 1
        top += 2
    found[2], found[3] = visits, clearance
    return FREE


@kernel
def certify_path(
    model: ModelArrays, waypoints: Array, margin: float, found: Array
) -> tuple[int, int]:
    """``certify_curve`` along every leg of a polyline (m, n); the verdict and the leg it is on."""
    zero = np.zeros(waypoints.shape[1])
    for leg in range(waypoints.shape[0] - 1):
        step = waypoints[leg + 1] - waypoints[leg]
        verdict = certify_curve(model, waypoints[leg], step, zero, zero, margin, found)
        if verdict != FREE:
            return verdict, leg
    return FREE, waypoints.shape[0] - 1


@kernel
def closest_pair(model: ModelArrays, q: Array) -> tuple[float, int]:
    """Least distance [m] over all pairs, margins taken off, and the pair it belongs to.

    Overlap is told as 0 or below, but not how deep it is.
    """
    n, p, k = q.shape[0], model.joints.shape[0], model.pairs.shape[0]
    frames = np.empty((n, 4, 4))
    poses, centers = np.empty((p, 4, 4)), np.empty((p, 3))
    axis = np.empty(3)
    S, scratch = np.empty((4, 3)), np.empty((4, 3))
    forward_kernel(model.joint_types, model.offsets, q, frames)
    for piece in range(p):
        place_piece(model, frames, piece, poses, centers)
    best, best_pair = np.inf, -1
    for pair in range(k):
        i, j = model.pairs[pair, 0], model.pairs[pair, 1]
        apart = model.margins[pair]
        if ball_bound(model, i, j, centers) - apart >= best:
            continue
        if quick_bound(model, i, j, poses, centers) - apart >= best:
            continue
        look_along_centers(i, j, centers, axis)
        verdict, lower, _ = separation(
            model.kinds, model.starts, model.vertices, model.sizes,
            i, poses[i], j, poses[j], -np.inf, best + apart, axis, S, scratch,
        )  # fmt: skip
        if verdict != FARTHER and lower - apart < best:
            best, best_pair = lower - apart, pair
    return best, best_pair
