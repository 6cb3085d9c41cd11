"""State of the proof's sweep over time: intervals that wait, pairs open on them, what was proved.

Plain arrays, so that the sweep's kernels can stop for the referee and go on. Intervals lie on a
stack, the earliest on top; pairs that are open on an interval lie behind those of the interval that
it is half of.
"""

from typing import Any, NamedTuple

import numpy as np

from compiled.kernel import kernel
from kinematics.arrays import Array, Indices
from planning.proof.collision.displacement import MOVE_COLUMNS
from planning.proof.collision.proposals import Proposal, empty_proposal
from planning.proof.motion_bounds import (
    JOINT_COLUMNS,
    PIECE_COLUMNS,
    RADIUS,
    enclose,
    enclose_span,
    piece_bounds,
    piece_length,
)

#: Pairs there is room for at first.
_PAIRS = 512
#: Elements that wait while those below one are looked at: two trees, each halved at every step, and
#: one sibling for each.
_WAITING = 256
#: Motions of all joints together to either side of an interval's middle in which it is halved at
#: once [rad or m]: hardly any pair is settled on it.
_FAR = 0.8
#: Halvings of a trajectory after which time has no digits left to halve.
MAX_DEPTH = 80

# Counters of a sweep.
#: Intervals that wait.
TOP = 0
#: Intervals that were looked at.
VISITS = 1
#: Pairs left open on the last one.
OPEN = 2
#: Pairs of it that the referee has to decide.
REFERRED = 3
#: How often it was halved.
DEPTH = 4
#: The trajectory's piece that it begins in.
FIRST = 5
#: The piece that its middle is in.
MIDDLE = 6
#: The piece that it ends in.
LAST = 7
#: 1 while intervals are halved until the clearance told is sharp, 0 until all is free.
SHARP = 8
#: 1 where the last one is looked at for nothing but how near things come in it.
PROBE = 9
COUNTERS = 10

# Columns of the last interval: in the time of its piece where it lies in one, else from the start.
#: Where it begins [s].
BEGIN = 0
#: Its middle [s].
CENTER = 1
#: Where it ends [s].
END = 2
#: Half its length, rounded up [s].
HALF = 3
#: Size of the numbers that the joints' frames are summed from [m].
REACH = 4
INTERVAL_COLUMNS = 5

# What a pair is with.
#: An obstacle.
OBSTACLE = 0
#: Another body of the robot.
OWN = 1


class Sweep(NamedTuple):
    """State of a sweep (c pairs, e elements, r of them the robot's, b bodies, d depths).

    Args:
        counters: Counters by TOP to PROBE, shape (COUNTERS,).
        piece_bounds: Bounds of the trajectory's pieces, from ``motion_bounds.piece_bounds``.
        spans: First and last piece of the intervals that wait, depth, and 1 for a probe, (d, 4).
        ends: Begin and end of the intervals, if they lie in one piece, in its own time, shape (d,
            2) [s].
        interval: The last one, by BEGIN to REACH, shape (INTERVAL_COLUMNS,).
        pairs: Elements open on the intervals that wait, those of each depth behind those of the
            one before, shape (c, 2).
        directions: The direction to try first for each of them, 0 for none, shape (c, 3).
        starts: First pair of each depth, shape (d,).
        counts: How many these are, shape (d,).
        referred: Pairs for the referee, shape (c, 2).
        referred_moves: How far each of these moves in the last interval, shape (c,) [m].
        joints: Joints of ``motion_bounds.enclose``, and of those that follow, in the last interval.
        frames: T_base_body in its middle, shape (b, 4, 4).
        poses: Poses of the elements in the middle of the interval, shape (e, 4, 4).
        centers: Centres of the elements' balls, shape (e, 3) [m].
        moves: Bounds of ``displacement_bounds``, for each element that moves, (r, b, MOVE_COLUMNS).
        stamps: The visit for which each element was placed, -1 for none, shape (e,).
        clearance: Proved so far, by OBSTACLE and OWN, shape (2,) [m].
        closest: The pairs these belong to, -1 for none, shape (2, 2).
        nearest: Least distances that were met, about, shape (2,) [m].
        shift: Scratch of ``enclose``, shape (2, k).
        proposal: Memory of ``propose``.
        waiting: Scratch: pairs below one that is opened.
    """

    counters: Indices
    piece_bounds: Array
    spans: Indices
    ends: Array
    interval: Array
    pairs: Indices
    directions: Array
    starts: Indices
    counts: Indices
    referred: Indices
    referred_moves: Array
    joints: Array
    frames: Array
    poses: Array
    centers: Array
    moves: Array
    stamps: Indices
    clearance: Array
    closest: Indices
    nearest: Array
    shift: Array
    proposal: Proposal
    waiting: Indices


@kernel
def start_kernel(
    breaks: Array, coefficients: Array, roots: Indices, sizes: tuple[int, int, int]
) -> Sweep:
    """A sweep at the start of a trajectory, every pair open.

    Args:
        breaks: Breaks of the trajectory, shape (m + 1,) [s].
        coefficients: Coefficients of the trajectory, shape (m, n, k).
        roots: Pairs of elements to begin with, shape (r, 2).
        sizes: Bodies, elements, and elements that move.
    """
    bodies, elements, moving = sizes
    depths, k, (m, n, powers) = MAX_DEPTH + 2, roots.shape[0], coefficients.shape
    capacity = max(_PAIRS, 4 * k)
    pairs, directions = np.empty((capacity, 2), np.int64), np.empty((capacity, 3))
    pairs[:k], directions[:k] = roots, 0.0
    starts, counts = np.zeros(depths, np.int64), np.zeros(depths, np.int64)
    counts[0] = k
    frames = np.zeros((bodies, 4, 4))
    frames[:, 3, 3] = 1.0
    bounds = np.empty((m, n, PIECE_COLUMNS))
    piece_bounds(breaks, coefficients, bounds)
    sweep = Sweep(
        np.zeros(COUNTERS, np.int64),
        bounds,
        np.zeros((depths, 4), np.int64),
        np.empty((depths, 2)),
        np.zeros(INTERVAL_COLUMNS),
        pairs,
        directions,
        starts,
        counts,
        np.empty((capacity, 2), np.int64),
        np.empty(capacity),
        np.empty((bodies, JOINT_COLUMNS)),
        frames,
        np.empty((elements, 4, 4)),
        np.empty((elements, 3)),
        np.empty((moving, bodies, MOVE_COLUMNS)),
        np.full(elements, -1, np.int64),
        np.full(2, np.inf),
        np.full((2, 2), -1, np.int64),
        np.full(2, np.inf),
        np.empty((2, powers)),
        empty_proposal(),
        np.empty((_WAITING, 2), np.int64),
    )
    push_pieces(sweep, breaks, 0, m - 1, 0)
    # The end, for how sharp a bound has to be: motions often come nearest to something there.
    end = piece_length(breaks, m - 1)
    push_part(sweep, m - 1, end, end, 0)
    sweep.spans[sweep.counters[TOP] - 1, 3] = 1
    # The start alone first: what touches there is the first violation.
    push_part(sweep, 0, 0.0, 0.0, 0)
    return sweep


def enlarge(sweep: Sweep) -> Sweep:
    """A copy of a sweep with room for twice as many pairs."""
    twice: dict[str, Any] = {
        name: np.concatenate([getattr(sweep, name), np.zeros_like(getattr(sweep, name))])
        for name in ("pairs", "directions", "referred", "referred_moves")
    }
    return sweep._replace(**twice)


@kernel(allocates=False)
def push_pieces(w: Sweep, breaks: Array, first: int, last: int, depth: int) -> None:
    """Put whole pieces first .. last of the trajectory on top of the intervals that wait."""
    if first == last:
        push_part(w, first, 0.0, piece_length(breaks, first), depth)
        return
    top = w.counters[TOP]
    w.spans[top, 0], w.spans[top, 1], w.spans[top, 2], w.spans[top, 3] = first, last, depth, 0
    w.counters[TOP] = top + 1


@kernel(allocates=False)
def push_part(w: Sweep, piece: int, begin: float, end: float, depth: int) -> None:
    """Put a part of one piece on top of the intervals that wait, ends in its own time."""
    top = w.counters[TOP]
    w.spans[top, 0], w.spans[top, 1], w.spans[top, 2], w.spans[top, 3] = piece, piece, depth, 0
    w.ends[top, BEGIN], w.ends[top, 1] = begin, end
    w.counters[TOP] = top + 1


@kernel(allocates=False)
def push_halves(w: Sweep, breaks: Array, both: bool) -> None:
    """Let the halves of the last interval wait, or the first alone, with the pairs open on it."""
    depth = w.counters[DEPTH] + 1
    w.counts[depth] = w.counters[OPEN]
    first, middle, last = w.counters[FIRST], w.counters[MIDDLE], w.counters[LAST]
    if first < last:
        if both:
            push_pieces(w, breaks, middle, last, depth)
        push_pieces(w, breaks, first, middle - 1, depth)
        return
    if both:
        push_part(w, first, w.interval[CENTER], w.interval[END], depth)
    push_part(w, first, w.interval[BEGIN], w.interval[CENTER], depth)


@kernel(allocates=False)
def pass_on(w: Sweep, breaks: Array) -> None:
    """Put the halves of the last interval in its place, with the pairs open before it."""
    depth = w.counters[DEPTH]
    w.starts[depth + 1], w.counters[OPEN] = w.starts[depth], w.counts[depth]
    push_halves(w, breaks, True)


@kernel(allocates=False)
def pop_interval(breaks: Array, coefficients: Array, w: Sweep) -> None:
    """Take the interval on top and enclose the joints of the chain on it."""
    top = w.counters[TOP] - 1
    w.counters[TOP] = top
    w.counters[VISITS] += 1
    first, last, depth = w.spans[top, 0], w.spans[top, 1], w.spans[top, 2]
    w.counters[FIRST], w.counters[LAST], w.counters[DEPTH] = first, last, depth
    w.counters[MIDDLE], w.counters[PROBE] = first, w.spans[top, 3]
    if first == last:
        begin, end = w.ends[top, BEGIN], w.ends[top, 1]
        middle = 0.5 * (begin + end)
    else:
        begin, end = breaks[first], breaks[last + 1]
        cut = first + 1
        while cut < last and 2.0 * breaks[cut] < begin + end:
            cut += 1
        middle = breaks[cut]
        w.counters[MIDDLE] = cut
    half = max(end - middle, middle - begin) * (1.0 + 4e-16)
    w.interval[BEGIN], w.interval[CENTER], w.interval[END] = begin, middle, end
    w.interval[HALF] = half
    if first == last:
        enclose(coefficients[first], middle, half, w.shift, w.joints)
    else:
        enclose_span(coefficients, w.piece_bounds, first, last, w.counters[MIDDLE], half, w.joints)


@kernel(allocates=False)
def moves_far(w: Sweep) -> bool:
    """Whether the joints move so far in the last interval that a look at it would settle little."""
    far = 0.0
    for j in range(w.piece_bounds.shape[1]):  # those of the chain: what follows is not enclosed yet
        far += w.joints[j, RADIUS]
    return bool(far > _FAR and w.counters[DEPTH] < MAX_DEPTH)


@kernel(allocates=False)
def note_clearance(w: Sweep, against: int, i: int, j: int, clearance: float) -> bool:
    """Note what was proved of the distance of elements i and j on an interval [m]."""
    if clearance < w.clearance[against]:
        w.clearance[against] = clearance
        w.closest[against, 0], w.closest[against, 1] = i, j
    return True
