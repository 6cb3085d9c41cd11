"""Room for the kernels to work in, and what they know of the robot at one configuration."""

import math
from typing import NamedTuple

import numpy as np

from kinematics.arrays import Array, Indices
from kinematics.compiled.kernel import kernel
from kinematics.forward import frames_kernel
from obstacles.gjk import Drift
from obstacles.mesh_distance import STACK
from obstacles.model_arrays import ModelArrays
from obstacles.piece_set import CENTER, POSE, RADIUS

#: Entries and intervals there is room for at first.
_ENTRIES, _INTERVALS = 1024, 256
#: Factor by which room grows.
_WIDER = 4


class Workspace(NamedTuple):
    """Room for n joints and p pieces of the robot; one for each thread.

    Args:
        joints: A configuration, how far each joint strays from it at most, how far it goes to first
            order, and the rest that the first order leaves out; shape (4, n).
        frames: T_base_joint, shape (n, 4, 4).
        twists: How far each body turns (3) and its point at the origin goes (3) to first order, and
            how far all revolute joints up to it stray; row 0 is the base, shape (n + 1, 7).
        placed: Rows of the robot's pieces, in the base frame, shape (p, WIDTH).
        strays: Of piece i when only joints >= k move: how far any of its points gets; the same with
            levers as long as they can become, and the second order; shape (p, 3 (n + 1)).
        stamps: The visit at which each piece was placed; the number of visits last, shape (p + 1,).
        room: Shape (9, 3).
        stack: Room for ``surface_distance``.
        tally: What was found on an interval, shape (4,).
        entries: Pairs left, on two levels by turns, shape (2, e, 2).
        hints: Their separating axes, and none for the roots, shape (3, e, 3).
        spans: Intervals left, shape (2, s, 2).
        lists: First and number of the entries of each, shape (2, s, 2).
    """

    joints: Array
    frames: Array
    twists: Array
    placed: Array
    strays: Array
    stamps: Indices
    room: Array
    stack: Array
    tally: Array
    entries: Indices
    hints: Array
    spans: Array
    lists: Indices


@kernel
def workspace(model: ModelArrays) -> Workspace:
    """Room for the kernels that look at ``model``."""
    n, p = int(model.chain[0, 0]), model.joints.shape[0]
    stamps = np.full(p + 1, -1, dtype=np.int64)
    stamps[p] = 0
    return Workspace(
        np.empty((4, n)),
        np.empty((n, 4, 4)),
        np.empty((n + 1, 7)),
        model.robot.copy(),
        np.zeros((p, 3 * (n + 1))),
        stamps,
        np.empty((9, 3)),
        np.empty(STACK),
        np.empty(4),
        np.empty((2, _ENTRIES, 2), dtype=np.int64),
        _hints(model.roots.shape[0], _ENTRIES),
        np.empty((2, _INTERVALS, 2)),
        np.empty((2, _INTERVALS, 2), dtype=np.int64),
    )


@kernel
def _hints(roots: int, entries: int) -> Array:
    hints = np.empty((3, max(entries, roots), 3))
    hints[2, :roots] = 0.0
    return hints


@kernel
def widened(model: ModelArrays, work: Workspace) -> Workspace:
    """A workspace like another, with more room for pairs and intervals that are left."""
    entries, intervals = _WIDER * work.entries.shape[1], _WIDER * work.spans.shape[1]
    return Workspace(
        work.joints,
        work.frames,
        work.twists,
        work.placed,
        work.strays,
        work.stamps,
        work.room,
        work.stack,
        work.tally,
        np.empty((2, entries, 2), dtype=np.int64),
        _hints(model.roots.shape[0], entries),
        np.empty((2, intervals, 2)),
        np.empty((2, intervals, 2), dtype=np.int64),
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


@kernel(allocates=False)
def place(model: ModelArrays, work: Workspace, i: int) -> None:
    """Bring pose, ball and strays of piece i up to date with the visit."""
    now = work.stamps[-1]
    joint = model.joints[i]
    if work.stamps[i] == now or joint < 0:
        return
    work.stamps[i] = now
    place_row(work.placed, i, model.robot, work.frames, joint)
    _write_strays(
        model.chain, work.frames, work.twists, work.joints, work.placed, joint, work.strays, i
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


@kernel(allocates=False)
def _write_strays(
    chain: Array, frames: Array, twists: Array, joints: Array, placed: Array, last: int,
    strays: Array, i: int,
) -> None:  # fmt: skip
    """Write how far piece i gets while the joints from each one on move; see ``motion``."""
    radius = placed[i, RADIUS]
    cx, cy, cz = placed[i, CENTER], placed[i, CENTER + 1], placed[i, CENTER + 2]
    moved, first, second = 0.0, 0.0, 0.0
    for j in range(last, -1, -1):
        delta = joints[1, j]
        if delta > 0.0:
            before = twists[j, 6]
            if chain[1 + j, 0] == 0.0:
                x, y, z = cx - frames[j, 0, 3], cy - frames[j, 1, 3], cz - frames[j, 2, 3]
                along = x * frames[j, 0, 2] + y * frames[j, 1, 2] + z * frames[j, 2, 2]
                square = x * x + y * y + z * z - along * along
                lever = math.sqrt(max(square, 0.0)) + radius + moved
                moved += lever * delta
                first += lever * delta
                second += lever * (joints[3, j] + delta * (0.5 * delta + before))
            else:
                moved += delta
                first += delta
                second += joints[3, j] + delta * before
        strays[i, 3 * j], strays[i, 3 * j + 1], strays[i, 3 * j + 2] = moved, first, second


@kernel(allocates=False)
def drift(twists: Array, placed: Array, strays: Array, j: int, last: int, still: int) -> Drift:
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
        strays[j, 3 * base + 2] - twists[base, 6] * strays[j, 3 * base + 1],
        strays[j, 3 * base],
    )
