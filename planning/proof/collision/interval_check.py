"""Check of one interval of time: which open pairs stay apart all over it.

A pair is settled when a direction is found along which the two elements are apart in the middle of
the interval by more than they can move along it in the interval (``separating_direction``). The
direction comes from the interval before or from GJK (``proposals``); a wrong one proves nothing and
does no harm. What nothing settles stays open for the halves, or is left to a referee where halving
can't help any more.
"""

import math
from typing import NamedTuple

import numpy as np

from compiled.kernel import kernel
from kinematics.arrays import Array, Indices
from planning.proof.collision.displacement import (
    MOVED,
    TWIST,
    displacement_along,
    displacement_bounds,
    lowest,
    meeting_body,
)
from planning.proof.collision.pair_table import PairArrays
from planning.proof.collision.proposals import propose, propose_deepest
from planning.proof.collision.separating_direction import Vector, direction, gap, rounding_bound
from planning.proof.collision.sweep_state import (
    CENTER,
    DEPTH,
    FIRST,
    HALF,
    LAST,
    MAX_DEPTH,
    OBSTACLE,
    OPEN,
    OWN,
    REACH,
    REFERRED,
    SHARP,
    VISITS,
    Sweep,
    note_clearance,
)
from planning.proof.joint_frames import forward_kernel, mimic_frames
from planning.proof.motion_bounds import (
    TYPE,
    VALUE,
    enclose_mimic_joints,
    outside_box,
    place,
    reach,
)

#: A pair that moves less than this in an interval [m] is decided by its distance alone.
RESOLUTION = 1e-7
#: The clearance told is at least this share of the true one, where that is less than _ENOUGH.
_SHARP_SHARE = 0.95
#: Clearance beyond which a sharper bound is of no interest [m].
_ENOUGH = 0.18
#: Where the covers of parts of meshes are this far apart [m], that is told for the parts' distance.
COVERED = 0.001
#: Covers are opened only when they move less than this [m]: before, halving time parts them sooner
#: than a look at all that they cover.
_OPENED = 0.01
#: And only when they are not parted by this share of what they move.
_PARTED = 0.02
# A better direction costs as much as some thirty looks at the one there is.
#: It is not asked for where elements move farther than this [m]: hardly any direction would do.
_HOPELESS = 0.05
#: Nor where the direction there is parts them by this share of the motion: some halvings will do.
_HALVES = 0.2
#: Below so small a motion it is always worth it [m].
_WORTH = 1e-4

#: Depths are told within this [m], and within this share of them.
_DEPTH_WITHIN = 5e-5
_DEPTH_SHARE = 0.05

#: Bounds of a pair on an interval: lower bound of its distance [m]; what GJK says it is at most
#: [m]; how far the two move, and how far along the direction [m]; clearance that needs no sharper
#: bound [m]; whether halving parts them; the direction.
PairBounds = tuple[float, float, tuple[float, float], float, bool, Vector]


@kernel(allocates=False)
def check_interval(model: PairArrays, w: Sweep) -> bool:
    """Settle what directions settle of the last interval; note what stays open or is referred.

    Returns:
        False where there is no room for what stays open.
    """
    counters = w.counters
    depth = counters[DEPTH]
    first, last = w.starts[depth], w.starts[depth] + w.counts[depth]
    w.starts[depth + 1] = last
    counters[OPEN], counters[REFERRED] = 0, 0
    _place_bodies(model, w)
    for entry in range(first, last):  # noqa: SIM110  numba compiles no generator here
        if not _check_pair(model, w, entry, last):
            return False
    return True


@kernel(allocates=False, inline="code")
def _place_bodies(model: PairArrays, w: Sweep) -> None:
    """Place all bodies in the middle of the interval, and enclose those that follow others."""
    enclose_mimic_joints(model.leaders, model.leads, w.joints)
    types, n = model.bodies[TYPE], model.bodies.shape[1] - model.leaders.shape[0]
    forward_kernel(types, model.offsets, w.joints[:n, VALUE], w.frames)
    mimic_frames(model.bodies, model.offsets, n, w.joints[:, VALUE], w.frames)
    w.interval[REACH] = reach(types, model.offsets, w.joints)


@kernel(allocates=False)
def sharp_enough(nearest: float, sharp: bool) -> float:
    """Clearance beyond which a sharper bound would tell nothing [m]."""
    if not sharp:
        return -np.inf
    return float(min(_ENOUGH, _SHARP_SHARE * nearest))


@kernel(allocates=False, inline="code")
def _check_pair(model: PairArrays, w: Sweep, entry: int, last: int) -> bool:
    """Settle an open pair and all below it; False where there is no room for what stays open.

    Args:
        model: The pairs.
        w: The sweep.
        entry: Number of the pair among ``w.pairs``.
        last: Place in ``w.pairs`` of the next pair that stays open.
    """
    stack = w.waiting
    stack[0, 0], stack[0, 1], top = w.pairs[entry, 0], w.pairs[entry, 1], 1
    while top > 0:
        top -= 1
        i, j = stack[top, 0], stack[top, 1]
        against = OWN if i < model.moving else OBSTACLE
        if against == OBSTACLE and _may_touch(model, i, j):
            continue
        _place_element(model, w, i)
        _place_element(model, w, j)
        apart = model.margins[i] + model.margin if against == OBSTACLE else 0.0
        known = i == w.pairs[entry, 0] and j == w.pairs[entry, 1]
        u = (0.0, 0.0, 0.0)
        if known:
            u = (w.directions[entry, 0], w.directions[entry, 1], w.directions[entry, 2])
        lower, upper, (most, moved), enough, parted, u = _bound_pair(model, w, i, j, apart, u)
        holds = _holds_others(model, i) or _holds_others(model, j)
        if lower > apart and (lower >= enough or (moved < RESOLUTION and not holds)):
            note_clearance(w, against, i, j, lower)
            continue
        finest = moved < RESOLUTION or w.counters[DEPTH] == MAX_DEPTH
        if holds:
            side = 0
            # The larger one of two that hold others is opened.
            if not _holds_others(model, i) or (
                _holds_others(model, j) and model.radii[j] > model.radii[i]
            ):
                side = 1
            opened = j if side == 1 else i
            still = _OPENED if model.kinds[opened] >= 0 else model.radii[opened]
            if finest or (moved <= still and not parted):
                for kid in range(model.below[opened], model.below[opened + 1]):
                    stack[top, 0], stack[top, 1] = i, j
                    stack[top, side] = model.kids[kid]
                    top += 1
                continue
        if last + w.counters[OPEN] + w.counters[REFERRED] >= w.pairs.shape[0]:
            return False
        if not holds and (finest or upper <= apart):
            # By all their motion: the direction is GJK's, and the referee has another.
            _refer(w, i, j, most)
        else:
            _keep_open(w, last, i, j, u)
    return True


@kernel(allocates=False, inline="code")
def _may_touch(model: PairArrays, i: int, j: int) -> bool:
    """Whether the robot's element j may touch the scene's element i."""
    return bool(model.parts[i] >= 0 and model.skipped[model.parts[j], model.parts[i]])


@kernel(allocates=False, inline="code")
def _holds_others(model: PairArrays, i: int) -> bool:
    return bool(model.below[i + 1] > model.below[i])


@kernel(allocates=False, inline="code")
def _refer(w: Sweep, i: int, j: int, moved: float) -> None:
    """Leave a pair that moves by ``moved`` [m] in the interval to the referee."""
    k = w.counters[REFERRED]
    w.referred[k, 0], w.referred[k, 1], w.referred_moves[k] = i, j, moved
    w.counters[REFERRED] = k + 1


@kernel(allocates=False, inline="code")
def _keep_open(w: Sweep, last: int, i: int, j: int, u: Vector) -> None:
    """Keep a pair open for the halves of the interval, with the direction to try first."""
    k = last + w.counters[OPEN]
    w.pairs[k, 0], w.pairs[k, 1] = i, j
    w.directions[k, 0], w.directions[k, 1], w.directions[k, 2] = u
    w.counters[OPEN] += 1


@kernel(allocates=False, inline="code")
def _place_element(model: PairArrays, w: Sweep, k: int) -> None:
    """Place an element in the middle of the interval, and bound its motion, once an interval."""
    joint, visit = model.joints[k], w.counters[VISITS]
    if w.stamps[k] == visit or (joint < 0 and w.stamps[k] >= 0):
        return
    w.stamps[k] = visit
    place(joint, k, w.frames, model.poses, model.centers, w.poses, w.centers)
    if k < model.moving:
        center = (w.centers[k, 0], w.centers[k, 1], w.centers[k, 2])
        displacement_bounds(
            model.bodies,
            w.frames,
            (center, model.radii[k]),
            joint,
            w.joints,
            w.interval[HALF],
            model.asked[k],
            w.moves[k],
        )


@kernel(allocates=False, inline="code")
def _bound_pair(model: PairArrays, w: Sweep, i: int, j: int, apart: float, u: Vector) -> PairBounds:
    """Bound the distance of two elements over the interval, from below.

    Args:
        model: The pairs.
        w: The sweep, both elements placed.
        i: One element.
        j: The other, which moves against the first.
        apart: Distance that the elements have to keep [m].
        u: The direction to try first, 0 for none.
    """
    against = OWN if i < model.moving else OBSTACLE
    after, sharp = _seen_from(model, i, j), w.counters[SHARP] == 1
    lengths = w.interval[REACH] + model.extents[i] + model.extents[j]
    lost = rounding_bound(model.bodies.shape[1], lengths)
    most = w.moves[j, after, MOVED] + lost
    if model.joints[i] >= after:
        most += w.moves[i, after, MOVED]
    moved = most
    enough = sharp_enough(w.nearest[against], sharp)
    need = max(apart, enough)
    lower = _bounding_distance(model, w, i, j, need + moved) - moved
    if model.kinds[i] < 0 or model.kinds[j] < 0 or (lower > apart and lower >= enough):
        return lower, np.inf, (most, moved), enough, False, (0.0, 0.0, 0.0)
    if u[0] == 0.0 and u[1] == 0.0 and u[2] == 0.0:
        u = (
            w.centers[j, 0] - w.centers[i, 0],
            w.centers[j, 1] - w.centers[i, 1],
            w.centers[j, 2] - w.centers[i, 2],
        )
    parts, u = direction(model.kinds, w.poses, i, j, u)
    separation, lower, upper = -np.inf, -np.inf, np.inf
    if parts:
        separation, lower, _ = _bound_along(model, w, i, j, u, (most, lost, need))
    settled = lower > apart and lower >= enough
    by_halving = moved > _HOPELESS or separation - need > _HALVES * (separation - lower)
    if not settled and (moved <= _WORTH or not by_halving):
        axis = w.proposal.axis
        axis[0], axis[1], axis[2] = -u[0], -u[1], -u[2]
        upper = propose(model.proposals, i, j, w.poses, w.centers, need + moved, w.proposal)
        parts, u = direction(model.kinds, w.poses, i, j, (-axis[0], -axis[1], -axis[2]))
        if parts:
            separation, lower, moved = _bound_along(model, w, i, j, u, (most, lost, need))
        if upper > COVERED or not (_holds_others(model, i) or _holds_others(model, j)):
            w.nearest[against] = min(w.nearest[against], upper)
            enough = sharp_enough(w.nearest[against], sharp)
    parted = separation - max(apart, enough) > _PARTED * moved
    return lower, upper, (most, moved), enough, parted, u


@kernel(allocates=False, inline="code")
def _bound_along(
    model: PairArrays, w: Sweep, i: int, j: int, u: Vector, known: tuple[float, float, float]
) -> tuple[float, float, float]:
    """Gap of two elements along a unit direction, the least all over the interval, and the motion.

    Args:
        model: The pairs.
        w: The sweep, both elements placed.
        i: One element.
        j: The other.
        u: The direction.
        known: How far they move at most, what rounding can have done, and what lower bound is
            enough [m].
    """
    most, lost, need = known
    separation, top = gap(model.kinds, model.sizes, model.columns, model.starts, w.poses, i, j, u)
    moves, after, half, other = w.moves[j], _seen_from(model, i, j), w.interval[HALF], 0.0
    if model.joints[i] >= after:  # the first moves too
        other = displacement_along(w.moves[i], after, model.radii[i], half, u)
    moved = min(most, displacement_along(moves, after, model.radii[j], half, u) + other + lost)
    lower = separation - moved
    if lower <= need < separation and moves[after, TWIST] < np.inf:
        size = (model.sizes[j, 0], model.sizes[j, 1], model.sizes[j, 2])
        span = (model.starts[j], model.starts[j + 1])
        center = (w.centers[j, 0], w.centers[j, 1], w.centers[j, 2])
        way = (center, moves, after, half)
        bottom = lowest(model.kinds[j], size, model.columns, span, w.poses, j, u, way)
        # It turns directions to others of up to four times the length.
        lower = max(lower, bottom - top - other - 4.0 * lost)
    return separation, lower, moved


@kernel(allocates=False, inline="code")
def _seen_from(model: PairArrays, i: int, j: int) -> int:
    """The number after that of the body from which the motion of elements i and j is bounded.

    It is that of element i where j's body hangs on it. Where neither hangs on the other it is the
    last body that both hang on; then the first moves too, and both bounds add up.
    """
    still, last = model.joints[i], model.joints[j]
    if last < model.bodies.shape[1] - model.leaders.shape[0]:
        return int(still + 1)
    return int(meeting_body(model.bodies, still, last) + 1)


@kernel(allocates=False, inline="code")
def _bounding_distance(model: PairArrays, w: Sweep, i: int, j: int, most: float) -> float:
    """Lower bound of the distance of two elements from balls and boxes; ``most`` [m] is enough."""
    centers: Array = w.centers
    x, y = centers[i, 0] - centers[j, 0], centers[i, 1] - centers[j, 1]
    z = centers[i, 2] - centers[j, 2]
    lower = math.sqrt(x * x + y * y + z * z) - model.radii[i] - model.radii[j]
    if lower <= most:
        lower = max(lower, outside_box(centers, j, model.boxes, w.poses, i) - model.radii[j])
    if lower <= most:
        lower = max(lower, outside_box(centers, i, model.boxes, w.poses, j) - model.radii[i])
    return float(lower)


class AllowedRows(NamedTuple):
    """Pairs of elements that may touch, and how deep they are known to be.

    Args:
        elements: Pairs of solid elements, the second moves against the first, shape (k, 2).
        owner: The pair of bodies that each is of, shape (k,).
        limits: How deep the pieces of each pair of bodies may overlap, shape (g,) [m].
        known: The deepest overlap of them at any instant looked at, shape (g,) [m].
        bounds: The deepest they can be, where that is proved, shape (g,) [m].
        beyond: The first instant looked at when they were deeper than they may, shape (g,) [s].
    """

    elements: Indices
    owner: Indices
    limits: Array
    known: Array
    bounds: Array
    beyond: Array


@kernel
def check_overlaps(model: PairArrays, breaks: Array, rows: AllowedRows, w: Sweep) -> bool:
    """Bound the depth of allowed pairs on the last interval; what is not sharp stays open.

    Along any direction u, the overlap of two convex solids is at most h_A(u) + h_B(-u): it is less
    their gap, and bounds of gaps over an interval are bounds of depths.

    Args:
        model: The pairs, all motions asked for.
        breaks: Breaks of the trajectory, shape (m + 1,) [s].
        rows: The allowed pairs; the sweep's pairs are numbers of these.
        w: The sweep.

    Returns:
        False where there is no room for what stays open.
    """
    counters = w.counters
    depth = counters[DEPTH]
    first, last = w.starts[depth], w.starts[depth] + w.counts[depth]
    w.starts[depth + 1] = last
    counters[OPEN], counters[REFERRED] = 0, 0
    _place_bodies(model, w)
    time = w.interval[CENTER]
    if counters[FIRST] == counters[LAST]:
        time += breaks[counters[FIRST]]
    for entry in range(first, last):
        row = w.pairs[entry, 0]
        u = (w.directions[entry, 0], w.directions[entry, 1], w.directions[entry, 2])
        bound, u = _bound_depth(model, rows, w, row, u, time)
        if bound >= 0.0:
            owner = rows.owner[row]
            rows.bounds[owner] = max(rows.bounds[owner], bound)
            continue
        if last + counters[OPEN] >= w.pairs.shape[0]:
            return False
        _keep_open(w, last, row, 0, u)
    return True


@kernel
def _bound_depth(
    model: PairArrays, rows: AllowedRows, w: Sweep, row: int, u: Vector, time: float
) -> tuple[float, Vector]:
    """The deepest overlap of a pair over the interval [m], -1 where it is not sharp yet.

    Args:
        model: The pairs.
        rows: The allowed pairs.
        w: The sweep.
        row: Number of the pair.
        u: The direction to try first, 0 for none.
        time: The middle of the interval [s].

    Returns:
        The bound, and the direction to try on the halves.
    """
    i, j, owner = rows.elements[row, 0], rows.elements[row, 1], rows.owner[row]
    _place_element(model, w, i)
    _place_element(model, w, j)
    lengths = w.interval[REACH] + model.extents[i] + model.extents[j]
    lost = rounding_bound(model.bodies.shape[1], lengths)
    still, after, most = model.joints[i] == model.joints[j], 0, lost
    if not still:
        after = _seen_from(model, i, j)
        most += w.moves[j, after, MOVED]
        if model.joints[i] >= after:
            most += w.moves[i, after, MOVED]
    if _bounding_distance(model, w, i, j, most) > most:
        return 0.0, u
    finest = still or most < RESOLUTION or w.counters[DEPTH] == MAX_DEPTH
    parts, u = direction(model.kinds, w.poses, i, j, u)
    overlap = np.inf
    if parts:
        known = most, lost, -_sharp_depth(rows, owner)
        overlap, bound = _overlap_along(model, w, i, j, u, known, still)
        if bound <= _sharp_depth(rows, owner):
            return max(bound, 0.0), u
    if finest or most <= _WORTH or overlap > _sharp_depth(rows, owner):
        axis = w.proposal.axis
        for k in range(3):
            axis[k] = w.centers[i, k] - w.centers[j, k]
        depth = -propose_deepest(model.proposals, i, j, w.poses, w.centers, w.proposal)
        rows.known[owner] = max(rows.known[owner], depth)
        if depth > rows.limits[owner]:
            rows.beyond[owner] = min(rows.beyond[owner], time)
        parts, u = direction(model.kinds, w.poses, i, j, (-axis[0], -axis[1], -axis[2]))
        if parts:
            known = most, lost, -_sharp_depth(rows, owner)
            overlap, bound = _overlap_along(model, w, i, j, u, known, still)
            if finest or bound <= _sharp_depth(rows, owner):
                return max(bound, 0.0), u
    return -1.0, u


@kernel(allocates=False)
def _overlap_along(
    model: PairArrays,
    w: Sweep,
    i: int,
    j: int,
    u: Vector,
    known: tuple[float, float, float],
    still: bool,
) -> tuple[float, float]:
    """Overlap of two elements along a unit direction in the middle of the interval, and all over.

    Args:
        model: The pairs.
        w: The sweep, both elements placed.
        i: One element.
        j: The other.
        u: The direction.
        known: Bound that is known, as in ``_bound_along``.
        still: Whether they do not move against each other.
    """
    if still:
        apart, _ = gap(model.kinds, model.sizes, model.columns, model.starts, w.poses, i, j, u)
        return -apart, known[1] - apart
    apart, least, _ = _bound_along(model, w, i, j, u, known)
    return -apart, -least


@kernel(allocates=False)
def _sharp_depth(rows: AllowedRows, owner: int) -> float:
    """The depth of a pair of bodies up to which a bound is sharp [m]."""
    known, limit = rows.known[owner], rows.limits[owner]
    enough = known + max(_DEPTH_WITHIN, _DEPTH_SHARE * known)
    return float(min(enough, limit) if known <= limit else enough)
