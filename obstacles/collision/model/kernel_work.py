"""Workspace of the kernels: buffers, and the robot at one configuration or on one interval."""

import math
from typing import NamedTuple

import numpy as np

from compiled.kernel import kernel
from compiled.simd import LANES
from compiled.simd_transpose import aligned_kernel
from compiled.vec3 import Vector, load, store
from kinematics.arrays import Array, Indices
from kinematics.forward import frames_kernel
from kinematics.simd_frames import FRAME_SIZE
from obstacles.collision.model.model_arrays import ModelArrays
from obstacles.collision.model.pair_groups import PARTED
from obstacles.distance.gjk import Drift
from obstacles.distance.piece_set import CENTER, POSE, RADIUS
from obstacles.distance.triangles.distance import STACK

#: Entries and intervals that buffers hold at first.
_ENTRIES, _INTERVALS = 1024, 256
#: Place in ``Workspace.tally`` of the body that met something in the last state that collides.
LAST_MET = 4
#: Place of one more than the number of the group of self-collision pairs that did, 0 where
#: something else did; -1 where no group is parted.
LAST_GROUP = 5
#: Place of whether it was that group twice in turn: then it is asked first.
MET_TWICE = 6
#: Factor by which buffers grow.
_WIDER = 4
#: Numbers of a ball's middle in lanes.
BALL_SIZE = 3 * LANES


class Workspace(NamedTuple):
    """Buffers for n joints, b bodies and p pieces of the robot; one for each thread.

    Args:
        joints: A configuration, how far each joint deviates from it at most, how far it goes to
            first order, and the rest that the first order leaves out; shape (4, n).
        frames: T_base_body, shape (b, 4, 4).
        twists: How far each body turns (3) and its point at the origin goes (3) to first order, and
            how far all revolute joints up to it deviate; row 0 is the base, shape (b + 1, 7).
        placed: Rows of the robot's pieces, in the base frame, shape (p, WIDTH).
        shifts: Displacement bounds of piece i, seen from body k - 1 on its way to the base: how far
            any of its points gets; the same with levers as long as they can become, and the second
            order; shape (p, 3 (b + 1)).
        stamps: The visit at which each piece was placed, and that at which its ball was, by itself;
            the number of visits last; shape (2 p + 1,).
        buffer: Vectors of the distance iteration, shape (9, 3).
        stack: Buffer of ``surface_distance``.
        tally: Result on an interval (4), and the pairs that met something last, shape (7,).
        entries: Pairs left, on two levels by turns, shape (2, e, 2).
        hints: Separating axes of the pairs, and none for the roots, shape (3, e, 3).
        spans: Intervals left, shape (2, s, 2).
        lists: First and number of the entries of each, shape (2, s, 2).
        lanes: Values of eight states, a vector each: their joints, the cosines and sines of these,
            the frames of bodies, and the middles of the bodies' balls; of eight stretches also how
            far bodies get on them, seen from the base and from each body; flat.
    """

    joints: Array
    frames: Array
    twists: Array
    placed: Array
    shifts: Array
    stamps: Indices
    buffer: Array
    stack: Array
    tally: Array
    entries: Indices
    hints: Array
    spans: Array
    lists: Indices
    lanes: Array


@kernel
def workspace(model: ModelArrays) -> Workspace:
    """Workspace for kernels on a model."""
    n, p = int(model.chain[0, 0]), model.joints.shape[0]
    bodies = n + int(model.chain[0, 2])
    stamps = np.full(2 * p + 1, -1, dtype=np.int64)
    stamps[2 * p] = 0
    tally = np.zeros(MET_TWICE + 1)
    tally[LAST_GROUP] = -1.0
    for group in range(model.groups.shape[0]):
        if model.groups[group, PARTED] < 0:
            tally[LAST_GROUP] = 0.0
            break
    return Workspace(
        np.empty((4, n)),
        np.empty((bodies, 4, 4)),
        np.empty((bodies + 1, 7)),
        model.robot.copy(),
        np.zeros((p, 3 * (bodies + 1))),
        stamps,
        np.empty((9, 3)),
        np.empty(STACK),
        tally,
        np.empty((2, _ENTRIES, 2), dtype=np.int64),
        _hints(model.roots.shape[0], _ENTRIES),
        np.empty((2, _INTERVALS, 2)),
        np.empty((2, _INTERVALS, 2), dtype=np.int64),
        aligned_kernel(
            3 * LANES * n
            + FRAME_SIZE * bodies
            + BALL_SIZE * (p - model.skipped.shape[0])
            + LANES * bodies * (bodies + 1)
        ),
    )


@kernel(inline="always")
def _hints(roots: int, entries: int) -> Array:
    hints = np.empty((3, max(entries, roots), 3))
    hints[2, :roots] = 0.0
    return hints


@kernel(inline="always")
def widened(model: ModelArrays, work: Workspace) -> Workspace:
    """A workspace like another, with larger buffers for pairs and intervals that are left."""
    entries, intervals = _WIDER * work.entries.shape[1], _WIDER * work.spans.shape[1]
    return Workspace(
        work.joints,
        work.frames,
        work.twists,
        work.placed,
        work.shifts,
        work.stamps,
        work.buffer,
        work.stack,
        work.tally,
        np.empty((2, entries, 2), dtype=np.int64),
        _hints(model.roots.shape[0], entries),
        np.empty((2, intervals, 2)),
        np.empty((2, intervals, 2), dtype=np.int64),
        work.lanes,
    )


@kernel(allocates=False)
def visit(model: ModelArrays, work: Workspace) -> None:
    """Bring frames and twists to the configuration and motion in ``work.joints``."""
    n = int(model.chain[0, 0])
    frames, twists = work.frames, work.twists
    frames_kernel(model.chain, work.joints[0], frames)
    work.stamps[-1] += 1
    for column in range(7):
        twists[0, column] = 0.0
    for j in range(n):
        delta, u = work.joints[1, j], work.joints[2, j]
        zx, zy, zz = u * frames[j, 0, 2], u * frames[j, 1, 2], u * frames[j, 2, 2]
        if model.chain[1 + j, 0] == 0.0:
            x, y, z = frames[j, 0, 3], frames[j, 1, 3], frames[j, 2, 3]
            twists[j + 1, 0] = twists[j, 0] + zx
            twists[j + 1, 1] = twists[j, 1] + zy
            twists[j + 1, 2] = twists[j, 2] + zz
            twists[j + 1, 3] = twists[j, 3] + y * zz - z * zy
            twists[j + 1, 4] = twists[j, 4] + z * zx - x * zz
            twists[j + 1, 5] = twists[j, 5] + x * zy - y * zx
            twists[j + 1, 6] = twists[j, 6] + delta
        else:
            for column in range(7):
                twists[j + 1, column] = twists[j, column]
            twists[j + 1, 3] += zx
            twists[j + 1, 4] += zy
            twists[j + 1, 5] += zz
    if model.chain[0, 2] > 0.0:
        _twist_mimic_joints(model.chain, work)


@kernel(allocates=False, inline="always")
def _twist_mimic_joints(chain: Array, work: Workspace) -> None:
    """``visit``'s twists of bodies on mimic joints: each is its parent's and its own joint's."""
    n, first = int(chain[0, 0]), int(chain[0, 3])
    for k in range(int(chain[0, 2])):
        row = first + 2 * k
        F, before = work.frames[n + k], work.twists[int(chain[row, 13]) + 1]
        twist = work.twists[n + k + 1]
        leader, multiplier = int(chain[row + 1, 0]), chain[row + 1, 1]
        u = multiplier * work.joints[2, leader]
        zx, zy, zz = u * F[0, 2], u * F[1, 2], u * F[2, 2]
        for column in range(7):
            twist[column] = before[column]
        if chain[row, 0] == 0.0:
            x, y, z = F[0, 3], F[1, 3], F[2, 3]
            twist[0] += zx
            twist[1] += zy
            twist[2] += zz
            zx, zy, zz = y * zz - z * zy, z * zx - x * zz, x * zy - y * zx
            twist[6] += abs(multiplier) * work.joints[1, leader]
        twist[3] += zx
        twist[4] += zy
        twist[5] += zz


@kernel(allocates=False)
def place(model: ModelArrays, work: Workspace, i: int) -> None:
    """Bring pose, ball and shifts of piece i up to date with the visit."""
    now = work.stamps[-1]
    joint = model.joints[i]
    if work.stamps[i] == now or joint < 0:
        return
    work.stamps[i] = now
    place_row(work.placed, i, model.robot, work.frames, joint)
    _write_shifts(
        model.chain, work.frames, work.twists, work.joints, work.placed, joint, work.shifts, i
    )


@kernel(allocates=False)
def place_row(placed: Array, i: int, rows: Array, frames: Array, joint: int) -> None:
    """Write pose and ball of piece i in the base frame; of what stands still they are there."""
    if joint < 0:
        return
    x, y, z = rows[i, CENTER], rows[i, CENTER + 1], rows[i, CENTER + 2]
    for row in range(3):
        f0, f1, f2 = frames[joint, row, 0], frames[joint, row, 1], frames[joint, row, 2]
        f3 = frames[joint, row, 3]
        placed[i, CENTER + row] = f0 * x + f1 * y + f2 * z + f3
        for column in range(POSE, POSE + 4):
            moved = f0 * rows[i, column] + f1 * rows[i, column + 4] + f2 * rows[i, column + 8]
            placed[i, column + 4 * row] = moved
        placed[i, POSE + 3 + 4 * row] += f3


@kernel(allocates=False, inline="always")
def _write_shifts(
    chain: Array, frames: Array, twists: Array, joints: Array, placed: Array, last: int,
    shifts: Array, i: int,
) -> None:  # fmt: skip
    """Write how far piece i gets while the joints from each one on move; see ``motion``."""
    radius, n = placed[i, RADIUS], int(chain[0, 0])
    cx, cy, cz = placed[i, CENTER], placed[i, CENTER + 1], placed[i, CENTER + 2]
    moved, first, second, j = 0.0, 0.0, 0.0, last
    while j >= 0:
        parent, row, leader, share = j - 1, 1 + j, j, 1.0
        if j >= n:
            row = int(chain[0, 3]) + 2 * (j - n)
            parent, leader, share = int(chain[row, 13]), int(chain[row + 1, 0]), chain[row + 1, 1]
            share = abs(share)
        delta = share * joints[1, leader]
        if delta > 0.0:
            before = twists[parent + 1, 6]
            if chain[row, 0] == 0.0:
                x, y, z = cx - frames[j, 0, 3], cy - frames[j, 1, 3], cz - frames[j, 2, 3]
                along = x * frames[j, 0, 2] + y * frames[j, 1, 2] + z * frames[j, 2, 2]
                square = x * x + y * y + z * z - along * along
                lever = math.sqrt(max(square, 0.0)) + radius + moved
                moved += lever * delta
                first += lever * delta
                second += lever * (share * joints[3, leader] + delta * (0.5 * delta + before))
            else:
                moved += delta
                first += delta
                second += share * joints[3, leader] + delta * before
        at = 3 * (parent + 1)
        shifts[i, at], shifts[i, at + 1], shifts[i, at + 2] = moved, first, second
        j = parent


@kernel(allocates=False)
def meeting_body(chain: Array, a: int, b: int) -> int:
    """The last body that both a and b hang on, or one of them where the other hangs on it.

    Bodies have smaller numbers than what hangs on them; -1 is the base.
    """
    n, first = int(chain[0, 0]), int(chain[0, 3])
    while a != b:
        if a > b:
            a, b = b, a
        b = b - 1 if b < n else int(chain[first + 2 * (b - n), 13])
    return a


@kernel(allocates=False)
def drift(twists: Array, placed: Array, shifts: Array, j: int, last: int, still: int) -> Drift:
    """The motion of piece j, carried by joint ``last``, seen from joint ``still``'s body."""
    base, last = still + 1, last + 1
    x, y, z = placed[j, CENTER], placed[j, CENTER + 1], placed[j, CENTER + 2]
    wx, wy = twists[last, 0] - twists[base, 0], twists[last, 1] - twists[base, 1]
    wz = twists[last, 2] - twists[base, 2]
    return (
        twists[last, 3] - twists[base, 3] + wy * z - wz * y,
        twists[last, 4] - twists[base, 4] + wz * x - wx * z,
        twists[last, 5] - twists[base, 5] + wx * y - wy * x,
        wx,
        wy,
        wz,
        placed[j, RADIUS],
        shifts[j, 3 * base + 2] - twists[base, 6] * shifts[j, 3 * base + 1],
        shifts[j, 3 * base],
    )


@kernel(allocates=False, inline="always")
def pair_shift(chain: Array, joints: Indices, shifts: Array, i: int, j: int) -> float:
    """How far points of pieces i and j of the robot get towards each other at most [m].

    With -1 for i that is how far piece j gets. Where one hangs on the other, it is how far that one
    gets seen from the other; else both do, seen from the body that both hang on.
    """
    still, last = joints[i] if i >= 0 else -1, joints[j]
    if last < int(chain[0, 0]):
        return float(shifts[j, 3 * still + 3])
    meeting = meeting_body(chain, still, last)
    both = shifts[j, 3 * meeting + 3]
    return float(both if meeting == still else both + shifts[i, 3 * meeting + 3])


@kernel(allocates=False, inline="always")
def pair_drift(
    chain: Array, joints: Indices, twists: Array, placed: Array, shifts: Array, i: int, j: int
) -> Drift:
    """The motion of piece j of the robot seen from the body of its piece i, or from the base (-1).

    Where neither hangs on the other, with p and r points of the two, c and d their centres, seen
    from the body that both hang on: along n these get apart by
    n . (v_c - v_d) + n . (w_c x (p - c)) - n . (w_d x (r - d)) to first order, the last at most
    r_d |w_d|, and the second orders add up.
    """
    still, last = joints[i] if i >= 0 else -1, joints[j]
    if last < int(chain[0, 0]):
        return drift(twists, placed, shifts, j, last, still)
    meeting = meeting_body(chain, still, last)
    v = drift(twists, placed, shifts, j, last, meeting)
    if meeting == still:
        return v
    u = drift(twists, placed, shifts, i, still, meeting)
    turned = u[6] * math.sqrt(u[3] * u[3] + u[4] * u[4] + u[5] * u[5])
    return (
        v[0] - u[0], v[1] - u[1], v[2] - u[2], v[3], v[4], v[5], v[6],
        v[7] + u[7] + turned, v[8] + u[8],
    )  # fmt: skip


@kernel(allocates=False)
def place_ball(rows: Array, i: int, frames: Array, joint: int, placed: Array) -> None:
    """Bring the middle of row i into the base frame."""
    store(placed[i], CENTER, moved(frames, joint, load(rows[i], CENTER)))


@kernel(allocates=False, inline="code")
def moved(frames: Array, joint: int, p: Vector) -> Vector:
    """A point of a body in the base frame."""
    T = frames[joint]
    return (
        T[0, 0] * p[0] + T[0, 1] * p[1] + T[0, 2] * p[2] + T[0, 3],
        T[1, 0] * p[0] + T[1, 1] * p[1] + T[1, 2] * p[2] + T[1, 3],
        T[2, 0] * p[0] + T[2, 1] * p[1] + T[2, 2] * p[2] + T[2, 3],
    )


@kernel(allocates=False, inline="code")
def place_ball_once(model: ModelArrays, work: Workspace, i: int) -> None:
    """Bring the middle of the ball of row i into the base frame if it is not there yet."""
    joint, stamp = model.joints[i], model.joints.shape[0] + i
    if joint >= 0 and work.stamps[stamp] != work.stamps[-1]:
        work.stamps[stamp] = work.stamps[-1]
        place_ball(model.robot, i, work.frames, joint, work.placed)
