"""A walk along a trajectory that proves all pairs apart on every cell of time, the earliest first.

A cell is settled for a pair when a witness is found to hold: a direction in which the two are apart
in the middle of the cell by more than they can move along it in the cell (``planning.witness``).
Witnesses come from the cell before or from the planner's distance iteration; a wrong one proves
nothing and does no harm. What no witness settles is halved, or, where that can't help any more,
left to a referee to decide.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics.chain import Array, Indices
from kinematics.forward import forward_kernel
from kinematics.kernel import kernel
from kinematics.trajectory import Trajectory
from obstacles.gjk import STILL, separation
from obstacles.workspace import place_row
from planning.cells import (
    COLUMNS,
    MOVED,
    SURVEY_COLUMNS,
    SWAY_COLUMNS,
    VALUE,
    enclose,
    enclose_span,
    moved_along,
    outside_box,
    piece_length,
    place,
    reach,
    survey,
    sway,
)
from planning.pair_table import PairArrays
from planning.witness import direction, gap, rounding

#: A pair that moves less than this in a cell [m] is decided by its distance alone.
RESOLUTION = 1e-7
#: The clearance told is at least this share of the true one, where that is less than _ENOUGH [m].
_SHARP = 0.8
_ENOUGH = 0.05
#: Halvings of a trajectory after which time has no digits left to halve.
MAX_DEPTH = 80

#: Looking for a better direction costs as much as some thirty looks at the one there is. It is not
#: worth it where solids move so far [m] that hardly any would do, nor where the one there is parts
#: them by such a share of the motion that some halvings will do; below so small a motion [m] it is.
_HOPELESS = 0.05
_HALVES = 0.25
_WORTH = 1e-4

#: What a walk stops for.
DONE, ASKING, PAUSED = 0, 1, 2
#: Entries of its counters.
TOP, VISITS, KEPT, ASKED, DEPTH, FIRST, MIDDLE, LAST = range(8)
#: Columns of the cells waiting, beside their first and last piece and their depth.
_LOW, _HIGH = 0, 1

#: Whom a pair is with.
OBSTACLE, OWN = 0, 1


class Walk(NamedTuple):
    """Where a walk stands, in arrays that its kernel goes on from (k pairs, p pieces, n joints).

    Args:
        counters: By TOP, ...: cells waiting, cells seen, pairs left on the last one, pairs asked
            about on it, how often it was halved, its first piece of the trajectory, the one its
            middle is in, and its last.
        survey: Of the trajectory's pieces, from ``survey``.
        spans: First and last piece and depth of the cells waiting, shape (d, 3).
        ends: Their ends, where they lie in one piece, in its own time, shape (d, 2) [s].
        cell: Low end, middle and high end of the last one, in the time of its piece where it lies
            in one, else from the start, shape (3,) [s].
        active: Pairs open at each depth, shape (d, k).
        counts: How many of them, shape (d,).
        asked: Pairs asked about, shape (k,).
        bounds: How far each pair moved where it was last looked at, shape (k,) [m].
        axes: The last direction of each pair, shape (k, 3).
        joints: Of ``enclose``, in the last cell.
        frames: T_base_joint in its middle, shape (n, 4, 4).
        poses: Of the pieces, shape (p, 4, 4).
        centers: Of their balls, shape (p, 3).
        moves: Of ``sway``, shape (p, n, 8).
        stamps: The cell for which each piece was placed, -1 for none, shape (p,).
        clearance: Proved so far, from obstacles and among the robot's own, shape (2,) [m].
        closest: The pairs these belong to, -1 for none, shape (2,).
        nearest: Least distances that were met, about, shape (2,) [m].
    """

    counters: Indices
    survey: Array
    spans: Indices
    ends: Array
    cell: Array
    active: NDArray[np.int32]
    counts: Indices
    asked: Indices
    bounds: Array
    axes: Array
    joints: Array
    frames: Array
    poses: Array
    centers: Array
    moves: Array
    stamps: Indices
    clearance: Array
    closest: Indices
    nearest: Array


def walk_along(trajectory: Trajectory, model: PairArrays) -> Walk:
    """A walk at the start of a trajectory, every pair open."""
    n, depth = trajectory.n, MAX_DEPTH + 2
    k, p = len(model.pairs), len(model.joints)
    active = np.empty((depth, k), dtype=np.int32)
    active[0] = np.arange(k)
    counts = np.zeros(depth, dtype=np.int64)
    counts[0] = k
    frames = np.zeros((n, 4, 4))
    frames[:, 3, 3] = 1.0
    table = np.empty((trajectory.pieces, n, SURVEY_COLUMNS))
    survey(trajectory.breaks, trajectory.coefficients, table)
    walk = Walk(
        np.zeros(8, dtype=np.int64), table,
        np.empty((depth, 3), dtype=np.int64), np.empty((depth, 2)), np.zeros(3),
        active, counts, np.empty(k, dtype=np.int64), np.zeros(k), np.zeros((k, 3)),
        np.empty((n, COLUMNS)), frames,
        np.empty((p, 4, 4)), np.empty((p, 3)), np.zeros((p, n, SWAY_COLUMNS)),
        np.full(p, -1, dtype=np.int64),
        np.full(2, np.inf), np.full(2, -1, dtype=np.int64), np.full(2, np.inf),
    )  # fmt: skip
    push(walk, trajectory.breaks, 0, trajectory.pieces - 1, 0)
    # The start alone first: what touches there is the first violation.
    push_part(walk, 0, 0.0, 0.0, 0)
    return walk


@kernel
def go_on(
    model: PairArrays, breaks: Array, coefficients: Array, w: Walk, sharp: bool, most: int
) -> int:
    """Walk on until all is settled (DONE), a referee is ASKed, or ``most`` cells were seen.

    With ``sharp`` cells are halved until the clearance told is sharp, else only until all is free.
    """
    room = np.empty((2, coefficients.shape[2]))
    rows, space, axis = model.rows.copy(), np.empty((8, 3)), np.empty(3)
    seen = 0
    while w.counters[TOP] > 0:
        if seen >= most:
            return PAUSED
        seen += 1
        half = take(breaks, coefficients, w, room)
        look(model, w, half, sharp, rows, space, axis)
        if w.counters[ASKED] > 0:
            return ASKING
        if w.counters[KEPT] > 0:
            halve(w, breaks, True)
    return DONE


@kernel
def push(w: Walk, breaks: Array, first: int, last: int, depth: int) -> None:
    """Put whole pieces first .. last of the trajectory on top of what waits."""
    if first == last:
        push_part(w, first, 0.0, piece_length(breaks, first), depth)
        return
    top = w.counters[TOP]
    w.spans[top, 0], w.spans[top, 1], w.spans[top, 2] = first, last, depth
    w.counters[TOP] = top + 1


@kernel
def push_part(w: Walk, piece: int, low: float, high: float, depth: int) -> None:
    """Put a part of one piece of the trajectory on top of what waits, ends in its own time."""
    top = w.counters[TOP]
    w.spans[top, 0], w.spans[top, 1], w.spans[top, 2] = piece, piece, depth
    w.ends[top, _LOW], w.ends[top, _HIGH] = low, high
    w.counters[TOP] = top + 1


@kernel
def halve(w: Walk, breaks: Array, both: bool) -> None:
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
def take(breaks: Array, coefficients: Array, w: Walk, room: Array) -> float:
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
        enclose_span(coefficients, w.survey, first, last, w.counters[MIDDLE], half, w.joints)
    return float(half)


@kernel
def look(  # noqa: PLR0915  one loop: calls with many arrays cost more than they do
    model: PairArrays, w: Walk, half: float, sharp: bool, rows: Array, room: Array, axis: Array
) -> None:
    """Settle what witnesses settle of the last cell; note what is left and what is asked."""
    # Entries of a tuple cost numba a count of references each time they are named.
    types, radii, joints, pairs = model.joint_types, model.radii, model.joints, model.pairs
    kinds, sizes, columns, starts = model.kinds, model.sizes, model.columns, model.starts
    boxes, extents, margins, own_pairs = model.boxes, model.extents, model.margins, model.own
    counters, active, bounds, nearest = w.counters, w.active, w.bounds, w.nearest
    poses, centers, moves, stamps, axes = w.poses, w.centers, w.moves, w.stamps, w.axes
    clearance, closest = w.clearance, w.closest
    depth, visit = counters[DEPTH], counters[VISITS]
    kept, asked = 0, 0
    forward_kernel(types, model.offsets, w.joints[:, VALUE], w.frames)
    chain_reach = reach(types, model.offsets, w.joints)
    for entry in range(w.counts[depth]):
        pair = active[depth, entry]
        i, j = pairs[pair, 0], pairs[pair, 1]
        for k in (i, j):
            if stamps[k] != visit and (joints[k] >= 0 or stamps[k] < 0):
                stamps[k] = visit
                place(joints[k], k, w.frames, model.poses, model.centers, poses, centers)
                sway(types, w.frames, centers, k, radii[k], joints[k], w.joints, half, moves)
        own, apart, after = own_pairs[pair], margins[pair], joints[i] + 1
        lost = rounding(types.shape[0], chain_reach + extents[i] + extents[j])
        moved = moves[j, after, MOVED] + lost
        enough = min(_ENOUGH, _SHARP * nearest[own]) if sharp else -np.inf
        need = max(apart, enough)
        lower = roughly(centers, radii, boxes, poses, i, j, need + moved) - moved
        upper = np.inf
        if not (lower > apart and lower >= enough):
            u = (axes[pair, 0], axes[pair, 1], axes[pair, 2])
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
                place_row(rows, i, model.rows, w.frames, joints[i])
                place_row(rows, j, model.rows, w.frames, joints[j])
                _, _, upper = separation(
                    rows, i, rows, j, model.corners, model.tables, -np.inf, need + moved, STILL,
                    axis, room,
                )  # fmt: skip
                nearest[own] = min(nearest[own], upper)
                some, u = direction(kinds, poses, i, j, (-axis[0], -axis[1], -axis[2]))
                if some:
                    held = gap(kinds, sizes, columns, starts, poses, i, j, u)
                    along = min(moved, moved_along(moves, j, after, radii[j], half, u) + lost)
                    lower = held - along
                moved = along
            axes[pair, 0], axes[pair, 1], axes[pair, 2] = u
            enough = min(_ENOUGH, _SHARP * nearest[own]) if sharp else -np.inf
        if lower > apart and (lower >= enough or moved < RESOLUTION):
            if lower < clearance[own]:
                clearance[own], closest[own] = lower, pair
            continue
        bounds[pair] = moved
        if moved < RESOLUTION or depth == MAX_DEPTH or upper <= apart:
            w.asked[asked] = pair
            asked += 1
        else:
            active[depth + 1, kept] = pair
            kept += 1
    counters[KEPT], counters[ASKED] = kept, asked


@kernel
def sharp_enough(w: Walk, own: int) -> float:
    """Clearance beyond which a sharper bound would tell nothing [m]."""
    return float(min(_ENOUGH, _SHARP * w.nearest[own]))


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
def settle(w: Walk, own: int, pair: int, clearance: float) -> bool:
    """Note what was proved of a pair on a cell."""
    if clearance < w.clearance[own]:
        w.clearance[own] = clearance
        w.closest[own] = pair
    return True
