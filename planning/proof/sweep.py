"""A walk along a trajectory that proves all pairs apart on every cell of time, the earliest first.

A cell is settled for a pair when a witness is found to hold: a direction in which the two are apart
in the middle of the cell by more than they can move along it in the cell
(``separating_direction``).
Witnesses come from the cell before or from the planner's distance iteration; a wrong one proves
nothing and does no harm. What no witness settles is halved, or, where that can't help any more,
left to a referee to decide.
"""

import math
from typing import NamedTuple

import numpy as np

from kinematics.arrays import Array, Indices
from kinematics.compiled.kernel import kernel
from kinematics.forward import forward_kernel
from kinematics.trajectory import Trajectory
from obstacles.gjk import STILL, separation
from obstacles.piece_set import CENTER, KIND, POSE, ROUNDING, START, STOP, WIDTH, CoreKind
from planning.proof.motion_bounds import (
    COLUMNS,
    MOVED,
    SURVEY_COLUMNS,
    SWAY_COLUMNS,
    VALUE,
    displacement_bounds,
    enclose,
    enclose_span,
    moved_along,
    outside_box,
    piece_bounds,
    piece_length,
    place,
    reach,
)
from planning.proof.pair_table import PairArrays
from planning.proof.separating_direction import direction, gap, rounding

#: A pair that moves less than this in a cell [m] is decided by its distance alone.
RESOLUTION = 1e-7
#: The clearance told is at least this share of the true one, where that is less than _ENOUGH [m].
_SHARP = 0.8
_ENOUGH = 0.05
#: Where the covers of parts of meshes are so far apart [m], that is told for the parts' distance.
_COVERED = 0.001
#: Covers are opened when they move less than this [m], and are not parted by this share of what
#: they move: before, halving time parts them sooner than a look at all that they cover.
_OPENED = 0.01
_PARTED = 0.02
#: Pairs there is room for at first, and elements that wait while those below one are looked at: two
#: trees, each halved at every step, and one sibling for each.
_ENTRIES, _WAITING = 512, 256
#: Halvings of a trajectory after which time has no digits left to halve.
MAX_DEPTH = 80

#: Looking for a better direction costs as much as some thirty looks at the one there is. It is not
#: worth it where solids move so far [m] that hardly any would do, nor where the one there is parts
#: them by such a share of the motion that some halvings will do; below so small a motion [m] it is.
_HOPELESS = 0.05
_HALVES = 0.25
_WORTH = 1e-4

#: What a walk stops for.
DONE, ASKING, PAUSED, FULL = 0, 1, 2, 3
#: Entries of its counters.
TOP, VISITS, KEPT, ASKED, DEPTH, FIRST, MIDDLE, LAST = range(8)
#: Columns of the cells waiting, beside their first and last piece and their depth.
_LOW, _HIGH = 0, 1

POLYTOPE = int(CoreKind.POLYTOPE)
_BALL = int(CoreKind.POINT)
#: Whom a pair is with.
OBSTACLE, OWN = 0, 1


class Sweep(NamedTuple):
    """Where a walk stands, in arrays that its kernel goes on from (c pairs, p elements, n joints).

    Args:
        counters: By TOP, ...: cells waiting, cells seen, pairs left on the last one, pairs asked
            about on it, how often it was halved, its first piece of the trajectory, the one its
            middle is in, and its last.
        survey: Of the trajectory's pieces, from ``piece_bounds``.
        spans: First and last piece and depth of the cells waiting, shape (d, 3).
        ends: Their ends, where they lie in one piece, in its own time, shape (d, 2) [s].
        cell: Low end, middle and high end of the last one, in the time of its piece where it lies
            in one, else from the start, shape (3,) [s].
        entries: Pairs of elements open on the cells that wait, those of each depth behind those
            of the one before, shape (c, 2).
        axes: Where to look first for each of them, none where 0, shape (c, 3).
        starts: Where those of each depth start, shape (d,).
        counts: How many of them, shape (d,).
        asked: Pairs asked about, shape (c, 2).
        bounds: How far each of these moves in the last cell, shape (c,) [m].
        joints: Of ``enclose``, in the last cell.
        frames: T_base_joint in its middle, shape (n, 4, 4).
        poses: Of the pieces, shape (p, 4, 4).
        centers: Of their balls, shape (p, 3).
        moves: Of ``displacement_bounds``, of the elements that move, shape (m, n, 8).
        stamps: The cell for which each piece was placed, -1 for none, shape (p,).
        clearance: Proved so far, from obstacles and among the robot's own, shape (2,) [m].
        closest: The pairs these belong to, -1 for none, shape (2, 2).
        nearest: Least distances that were met, about, shape (2,) [m].
    """

    counters: Indices
    piece_bounds: Array
    spans: Indices
    ends: Array
    cell: Array
    entries: Indices
    axes: Array
    starts: Indices
    counts: Indices
    asked: Indices
    bounds: Array
    joints: Array
    frames: Array
    poses: Array
    centers: Array
    moves: Array
    stamps: Indices
    clearance: Array
    closest: Indices
    nearest: Array


def walk_along(trajectory: Trajectory, model: PairArrays) -> Sweep:
    """A walk at the start of a trajectory, every pair open."""
    n, depth = trajectory.n, MAX_DEPTH + 2
    k, p = len(model.roots), len(model.joints)
    room = max(_ENTRIES, 4 * k)
    entries, axes = np.empty((room, 2), dtype=np.int64), np.zeros((room, 3))
    entries[:k] = model.roots
    starts, counts = np.zeros(depth, dtype=np.int64), np.zeros(depth, dtype=np.int64)
    counts[0] = k
    frames = np.zeros((n, 4, 4))
    frames[:, 3, 3] = 1.0
    table = np.empty((trajectory.pieces, n, SURVEY_COLUMNS))
    piece_bounds(trajectory.breaks, trajectory.coefficients, table)
    walk = Sweep(
        np.zeros(8, dtype=np.int64), table,
        np.empty((depth, 3), dtype=np.int64), np.empty((depth, 2)), np.zeros(3),
        entries, axes, starts, counts, np.empty((room, 2), dtype=np.int64), np.zeros(room),
        np.empty((n, COLUMNS)), frames,
        np.empty((p, 4, 4)), np.empty((p, 3)), np.empty((model.moving, n, SWAY_COLUMNS)),
        np.full(p, -1, dtype=np.int64),
        np.full(2, np.inf), np.full((2, 2), -1, dtype=np.int64), np.full(2, np.inf),
    )  # fmt: skip
    push(walk, trajectory.breaks, 0, trajectory.pieces - 1, 0)
    # The start alone first: what touches there is the first violation.
    push_part(walk, 0, 0.0, 0.0, 0)
    return walk


def roomier(walk: Sweep) -> Sweep:
    """The same walk with room for twice as many pairs."""
    twice = {
        name: np.concatenate([getattr(walk, name), np.zeros_like(getattr(walk, name))])
        for name in ("entries", "axes", "asked", "bounds")
    }
    return walk._replace(**twice)


@kernel
def go_on(
    model: PairArrays, breaks: Array, coefficients: Array, w: Sweep, sharp: bool, most: int
) -> int:
    """Walk on until all is settled (DONE), a referee is ASKed, or ``most`` cells were seen.

    FULL asks for more room: the cell is looked at again.

    With ``sharp`` cells are halved until the clearance told is sharp, else only until all is free.
    """
    room = np.empty((2, coefficients.shape[2]))
    rows, space, axis = np.empty((2, WIDTH)), np.empty((8, 3)), np.empty(3)
    stack = np.empty((_WAITING, 2), dtype=np.int64)
    seen = 0
    while w.counters[TOP] > 0:
        if seen >= most:
            return PAUSED
        seen += 1
        half = take(breaks, coefficients, w, room)
        if not look(model, w, half, sharp, rows, space, axis, stack):
            w.counters[TOP] += 1
            w.counters[VISITS] -= 1
            return FULL
        if w.counters[ASKED] > 0:
            return ASKING
        if w.counters[KEPT] > 0:
            halve(w, breaks, True)
    return DONE


@kernel
def push(w: Sweep, breaks: Array, first: int, last: int, depth: int) -> None:
    """Put whole pieces first .. last of the trajectory on top of what waits."""
    if first == last:
        push_part(w, first, 0.0, piece_length(breaks, first), depth)
        return
    top = w.counters[TOP]
    w.spans[top, 0], w.spans[top, 1], w.spans[top, 2] = first, last, depth
    w.counters[TOP] = top + 1


@kernel
def push_part(w: Sweep, piece: int, low: float, high: float, depth: int) -> None:
    """Put a part of one piece of the trajectory on top of what waits, ends in its own time."""
    top = w.counters[TOP]
    w.spans[top, 0], w.spans[top, 1], w.spans[top, 2] = piece, piece, depth
    w.ends[top, _LOW], w.ends[top, _HIGH] = low, high
    w.counters[TOP] = top + 1


@kernel
def halve(w: Sweep, breaks: Array, both: bool) -> None:
    """Let the halves of the last cell wait, or the first alone, with the pairs left on it."""
    depth = w.counters[DEPTH] + 1
    w.counts[depth] = w.counters[KEPT]
    first, middle, last = w.counters[FIRST], w.counters[MIDDLE], w.counters[LAST]
    if first < last:
        if both:
            push(w, breaks, middle, last, depth)
        push(w, breaks, first, middle - 1, depth)
        return
    if both:
        push_part(w, first, w.cell[1], w.cell[2], depth)
    push_part(w, first, w.cell[0], w.cell[1], depth)


@kernel
def take(breaks: Array, coefficients: Array, w: Sweep, room: Array) -> float:
    """Take the cell on top and enclose the joints on it; half its length [s]."""
    top = w.counters[TOP] - 1
    w.counters[TOP] = top
    w.counters[VISITS] += 1
    first, last, depth = w.spans[top, 0], w.spans[top, 1], w.spans[top, 2]
    w.counters[FIRST], w.counters[LAST], w.counters[DEPTH] = first, last, depth
    w.counters[MIDDLE] = first
    if first == last:
        low, high = w.ends[top, _LOW], w.ends[top, _HIGH]
        middle = 0.5 * (low + high)
    else:
        low, high = breaks[first], breaks[last + 1]
        cut = first + 1
        while cut < last and 2.0 * breaks[cut] < low + high:
            cut += 1
        middle = breaks[cut]
        w.counters[MIDDLE] = cut
    half = max(high - middle, middle - low) * (1.0 + 4e-16)
    w.cell[0], w.cell[1], w.cell[2] = low, middle, high
    if first == last:
        enclose(coefficients[first], middle, half, room, w.joints)
    else:
        enclose_span(coefficients, w.piece_bounds, first, last, w.counters[MIDDLE], half, w.joints)
    return float(half)


@kernel
def look(
    model: PairArrays, w: Sweep, half: float, sharp: bool, rows: Array, room: Array, axis: Array,
    stack: Indices,
) -> bool:  # fmt: skip
    """Settle what witnesses settle of the last cell; note what is left and what is asked.

    Returns:
        False where there is no room for what is left.
    """
    # Entries of a tuple cost numba a count of references each time they are named.
    types, radii, joints, skipped = model.joint_types, model.radii, model.joints, model.skipped
    kinds, sizes, columns, starts = model.kinds, model.sizes, model.columns, model.starts
    boxes, extents, margins, parts = model.boxes, model.extents, model.margins, model.parts
    below, kids, moving, margin = model.below, model.kids, model.moving, model.margin
    counters, entries, nearest, given = w.counters, w.entries, w.nearest, w.axes
    poses, centers, moves, stamps = w.poses, w.centers, w.moves, w.stamps
    clearance, closest = w.clearance, w.closest
    depth, visit = counters[DEPTH], counters[VISITS]
    first, last = w.starts[depth], w.starts[depth] + w.counts[depth]
    w.starts[depth + 1] = last
    kept, asked = 0, 0
    forward_kernel(types, model.offsets, w.joints[:, VALUE], w.frames)
    chain_reach = reach(types, model.offsets, w.joints)
    for entry in range(first, last):
        stack[0, 0], stack[0, 1], top = entries[entry, 0], entries[entry, 1], 1
        while top > 0:
            top -= 1
            i, j = stack[top, 0], stack[top, 1]
            own = OWN if i < moving else OBSTACLE
            if own == OBSTACLE and parts[i] >= 0 and skipped[parts[j], parts[i]]:
                continue
            for k in (i, j):
                if stamps[k] != visit and (joints[k] >= 0 or stamps[k] < 0):
                    stamps[k] = visit
                    place(joints[k], k, w.frames, model.poses, model.centers, poses, centers)
                    if k < moving:
                        displacement_bounds(
                            types, w.frames, centers, k, radii[k], joints[k], w.joints, half, moves
                        )
            apart = margins[i] + margin if own == OBSTACLE else 0.0
            after = joints[i] + 1
            lost = rounding(types.shape[0], chain_reach + extents[i] + extents[j])
            moved = moves[j, after, MOVED] + lost
            holds = below[i + 1] - below[i] + below[j + 1] - below[j] > 0
            enough = sharp_enough(nearest[own], sharp)
            need = max(apart, enough)
            lower = roughly(centers, radii, boxes, poses, i, j, need + moved) - moved
            upper, parted = np.inf, False
            u = (0.0, 0.0, 0.0)
            if kinds[i] >= 0 and kinds[j] >= 0 and not (lower > apart and lower >= enough):
                if i == entries[entry, 0] and j == entries[entry, 1]:
                    u = (given[entry, 0], given[entry, 1], given[entry, 2])
                if u[0] == 0.0 and u[1] == 0.0 and u[2] == 0.0:
                    u = (
                        centers[j, 0] - centers[i, 0],
                        centers[j, 1] - centers[i, 1],
                        centers[j, 2] - centers[i, 2],
                    )
                some, u = direction(kinds, poses, i, j, u)
                held, along = -np.inf, moved
                if some:
                    held = gap(kinds, sizes, columns, starts, poses, i, j, u)
                    along = min(moved, moved_along(moves, j, after, radii[j], half, u) + lost)
                lower = held - along
                settled = lower > apart and lower >= enough
                by_halving = moved > _HOPELESS or held - need > _HALVES * along
                if not settled and (moved <= _WORTH or not by_halving):
                    axis[0], axis[1], axis[2] = -u[0], -u[1], -u[2]
                    _row(model, rows, 0, i, poses, centers)
                    _row(model, rows, 1, j, poses, centers)
                    _, _, upper = separation(
                        rows, 0, rows, 1, model.corners, model.tables, -np.inf, need + moved,
                        STILL, axis, room,
                    )  # fmt: skip
                    some, u = direction(kinds, poses, i, j, (-axis[0], -axis[1], -axis[2]))
                    if some:
                        held = gap(kinds, sizes, columns, starts, poses, i, j, u)
                        along = min(moved, moved_along(moves, j, after, radii[j], half, u) + lost)
                        lower = held - along
                    moved = along
                    if not holds or upper > _COVERED:
                        nearest[own] = min(nearest[own], upper)
                        enough = sharp_enough(nearest[own], sharp)
                parted = held - max(apart, enough) > _PARTED * moved
            if lower > apart and (lower >= enough or (moved < RESOLUTION and not holds)):
                if lower < clearance[own]:
                    clearance[own], closest[own, 0], closest[own, 1] = lower, i, j
                continue
            if holds:
                # What holds others is opened once it hardly moves, the larger one of two.
                side = 0
                if below[i + 1] == below[i] or (below[j + 1] > below[j] and radii[j] > radii[i]):
                    side = 1
                opened = j if side == 1 else i
                still = _OPENED if kinds[opened] >= 0 else radii[opened]
                if (moved <= still and not parted) or moved < RESOLUTION or depth == MAX_DEPTH:
                    for kid in range(below[opened], below[opened + 1]):
                        stack[top, 0], stack[top, 1] = i, j
                        stack[top, side] = kids[kid]
                        top += 1
                    continue
            if last + kept + asked >= entries.shape[0]:
                return False
            if not holds and (moved < RESOLUTION or depth == MAX_DEPTH or upper <= apart):
                w.asked[asked, 0], w.asked[asked, 1], w.bounds[asked] = i, j, moved
                asked += 1
            else:
                entries[last + kept, 0], entries[last + kept, 1] = i, j
                given[last + kept, 0], given[last + kept, 1], given[last + kept, 2] = u
                kept += 1
    counters[KEPT], counters[ASKED] = kept, asked
    return True


@kernel
def sharp_enough(nearest: float, sharp: bool) -> float:
    """Clearance beyond which a sharper bound would tell nothing [m]."""
    if not sharp:
        return -np.inf
    return float(min(_ENOUGH, _SHARP * nearest))


@kernel
def _row(model: PairArrays, rows: Array, k: int, i: int, poses: Array, centers: Array) -> None:
    """Write element i, placed, as row k for the planner's distance iteration."""
    given = model.row[i]
    for column in range(WIDTH):
        rows[k, column] = model.rows[given, column]
    if model.first[i] >= 0:
        rows[k, KIND], rows[k, ROUNDING] = POLYTOPE, 0.0
        rows[k, START], rows[k, STOP] = model.first[i], model.first[i] + 3
    for row in range(3):
        rows[k, CENTER + row] = centers[i, row]
        for column in range(4):
            rows[k, POSE + 4 * row + column] = poses[i, row, column]
        if rows[k, KIND] == _BALL:
            # Where its centre is: a point of a cloud lies off the cloud's frame.
            rows[k, POSE + 4 * row + 3] = centers[i, row]


@kernel
def roughly(
    centers: Array, radii: Array, boxes: Array, poses: Array, i: int, j: int, wanted: float
) -> float:
    """What balls and boxes prove of the distance of two pieces, no more than is wanted [m]."""
    x, y = centers[i, 0] - centers[j, 0], centers[i, 1] - centers[j, 1]
    z = centers[i, 2] - centers[j, 2]
    lower = math.sqrt(x * x + y * y + z * z) - radii[i] - radii[j]
    if lower <= wanted:
        lower = max(lower, outside_box(centers, j, boxes, poses, i) - radii[j])
    if lower <= wanted:
        lower = max(lower, outside_box(centers, i, boxes, poses, j) - radii[i])
    return float(lower)


@kernel
def settle(w: Sweep, own: int, i: int, j: int, clearance: float) -> bool:
    """Note what was proved of a pair on a cell."""
    if clearance < w.clearance[own]:
        w.clearance[own] = clearance
        w.closest[own, 0], w.closest[own, 1] = i, j
    return True
