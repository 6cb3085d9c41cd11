"""Certified motion: a stretch of joint motion is proved free for every instant, not at samples.

Over an interval, joint j deviates at most delta_j from its value in the middle. A point at distance
rho_j from axis j then moves by at most rho_j delta_j (a slide: delta_j); moved joint by joint,
from the one that carries the point down to the base, with what it moved so far added to rho,

    B <- B + (rho_j + B) delta_j      (revolute),      B <- B + delta_j      (prismatic).

What counts is motion along the normal n of a plane that parts a pair, and there joints make up
for each other. With v and w the velocities of the ball's centre and of the body, r its radius,
L_j = rho_j + B the lever of joint j at most, and e_j what is not linear in its motion, Taylor's
theorem gives

    D = |n . v| + r |n x w| + sum_j L_j (e_j + delta_j (delta_j / 2 + sum_(k < j) delta_k)),

with k over revolute joints, because |d2p / dq_j dq_k| <= L_max(j, k). Where a plane proves a
distance in the middle that exceeds the smaller of B and D and the margin, the pair is free all over
the interval; what is left is halved, without the share around the middle that was proved for all
pairs. Pairs settled on an interval are not checked again inside it.

Obstacles are met from the top of a tree of boxes, many self-collision pairs from the top of their
groups. A node or a group stands for all pairs below it: to part it pays once the motion over an
interval is no longer than it is, and until then it waits among the entries. Intervals are checked
from the longest to the shortest, so that a motion that collides is refused early.
Source: "Adaptive dynamic collision checking for single and multiple articulated robots in complex
environments", IEEE Transactions on Robotics, 2005, for B and the halving.
"""

import math
from typing import NamedTuple

import numpy as np

from compiled.kernel import kernel
from kinematics.arrays import Array, Indices
from obstacles.collision.model.kernel_work import (
    Workspace,
    pair_drift,
    pair_shift,
    place,
    visit,
    widened,
    workspace,
)
from obstacles.collision.model.model_arrays import ModelArrays
from obstacles.collision.model.pair_grid import grid_bound
from obstacles.collision.model.pair_groups import BALL, FIRST_PAIR, GROUP_SIZE, OTHER_BALL, PARTED
from obstacles.distance.bounds import balls_apart, quick_bound
from obstacles.distance.bvh import EXTENT, FIRST, LAST, SKIP, gap
from obstacles.distance.gjk import BETWEEN, CLOSER, FARTHER, STILL, allowance, separation
from obstacles.distance.piece_set import CENTER, MARGIN, NODE_STOP, OWNER, RADIUS, Pair, Shapes
from obstacles.distance.triangles.distance import CHECKS as COMPARED
from obstacles.distance.triangles.motion import surface_share

FREE = 0
COLLIDING = 1
UNDECIDED = 2
#: Verdict where the workspace is too small.
TOO_SMALL = -1
_MAX_DEPTH = 40
#: Intervals checked before an edge is given up as undecided.
MAX_INTERVALS = 20_000
#: Pairs of parts of meshes that cost about what an interval does.
_CHECKS_AN_INTERVAL = 32.0
#: A bound this small [m] that still does not separate a pair is contact within its margin.
_RESOLUTION = 1e-6
#: Share of a pair's proved surroundings of the middle that is used: the rest is clearance left.
_TRUSTED = 0.9
#: A cover that is apart by less than this share of the motion hardly is.
_GRAZING = 0.1
#: What floating point may have cost a distance of a few metres [m], with room to spare.
ROUNDING_ERROR = 1e-9
#: A node is entered once the motion is less than this many times its size: above, halving the
#: interval settles more than going down.
COARSE = 1.0
# Places in Workspace.tally: of an interval, but for the last, checks of parts of meshes on an edge.
CLEARANCE, SHARE, STOPPED, CHECKS = 0, 1, 2, 3


class Cubic(NamedTuple):
    """A curve q(s) = b0 + b1 s + b2 s^2 + b3 s^3 for 0 <= s <= 1.

    Args:
        b0: Start of the curve, shape (n,) [rad or m].
        b1: Coefficients of s, shape (n,).
        b2: Coefficients of s^2, shape (n,).
        b3: Coefficients of s^3, shape (n,).
    """

    b0: Array
    b1: Array
    b2: Array
    b3: Array


class Entries(NamedTuple):
    """Pairs that are not settled yet.

    Args:
        pairs: Pairs as ``ModelArrays.roots`` has them, shape (e, 2).
        axes: Axes across which they part, 0 where none is known, shape (e, 3).
    """

    pairs: Indices
    axes: Array


# In two parts an edge check took half as long again (31 us for 20 us).
@kernel(allocates=False)
def _examine(  # noqa: C901, PLR0912, PLR0915
    model: ModelArrays, work: Workspace, margin: float, given: Entries, first: int, count: int,
    left: Entries, kept: int,
) -> tuple[int, int]:  # fmt: skip
    """Count of the entries ``left`` (-1: the buffer is full), and the pair that touches, or -1."""
    entries, axes, hints = left.pairs, left.axes, given.axes
    joints, scene, nodes, items = model.joints, model.scene, model.nodes, model.items
    skipped, placed, shifts, tally = model.skipped, work.placed, work.shifts, work.tally
    p, m = skipped.shape[0], scene.shape[0]
    extra, apart = model.margin + margin, model.own_margin + margin
    for entry in range(first, first + count):
        i, k = given.pairs[entry, 0], given.pairs[entry, 1]
        if kept == entries.shape[0]:
            return -1, -1
        if i < 0 or i >= p:
            group, after = -1 - i, -i
            if i < 0 and model.groups[group, PARTED] < 0:
                after = group + model.groups[group, GROUP_SIZE]
            while group < after:
                if i < 0 and model.groups[group, PARTED] < 0:
                    group, kept = next_group(model, work, margin, group, after, left, kept)
                    if kept < 0:
                        return -1, -1
                    continue
                start, stop, reach = i - p, i - p + 1, np.inf
                if i < 0:
                    start, stop, a, b = model.groups[group]
                    place(model, work, a)
                    place(model, work, b)
                    reach = pair_shift(model.chain, joints, shifts, a, b) + apart
                    proved = balls_apart(placed, a, b) - reach
                    if proved > ROUNDING_ERROR:
                        tally[CLEARANCE] = min(tally[CLEARANCE], proved)
                        stop = start
                for s in range(start, stop):
                    a, b = model.self_pairs[s, 0], model.self_pairs[s, 1]
                    place(model, work, a)
                    place(model, work, b)
                    proved = self_bound(model, work, s, reach, apart)
                    if proved > ROUNDING_ERROR:
                        tally[CLEARANCE] = min(tally[CLEARANCE], proved)
                        continue
                    if kept == entries.shape[0]:
                        return -1, -1
                    for row in range(3):
                        axes[kept, row] = 0.0 if i < 0 else hints[entry, row]
                    pair = Pair(placed, a, placed, b)
                    verdict = compare_pair(model, work, pair, True, apart, axes, kept)
                    if verdict == CLOSER:
                        return kept, p * m + s
                    if verdict != FARTHER:
                        entries[kept, 0], entries[kept, 1] = p + s, k
                        kept += 1
                group += 1
            continue
        place(model, work, i)
        x, y, z = placed[i, CENTER], placed[i, CENTER + 1], placed[i, CENTER + 2]
        most, node, after = shifts[i, 0], 0, 1
        reach = placed[i, RADIUS] + extra + most + ROUNDING_ERROR
        if k < 0:
            node = -1 - k
            after = int(nodes[node, SKIP])
        while node < after:
            start, stop = 0, 1
            if k < 0:
                square = gap(nodes, node, x, y, z)
                if square > reach * reach:
                    free = math.sqrt(square) - reach
                    tally[CLEARANCE] = min(tally[CLEARANCE], free)
                    node = int(nodes[node, SKIP])
                    continue
                start, stop = int(nodes[node, FIRST]), int(nodes[node, LAST])
                if start < 0:
                    if most > COARSE * nodes[node, EXTENT]:
                        if kept == entries.shape[0]:
                            return -1, -1
                        entries[kept, 0], entries[kept, 1] = i, -1 - node
                        kept += 1
                        tally[SHARE] = 0.0
                        node = int(nodes[node, SKIP])
                    else:
                        node += 1
                    continue
            node += 1
            for item in range(start, stop):
                piece = items[item] if k < 0 else k
                if skipped[i, int(scene[piece, OWNER])]:
                    continue
                if kept == entries.shape[0]:
                    return -1, -1
                for row in range(3):
                    axes[kept, row] = 0.0 if k < 0 else hints[entry, row]
                pair, near = Pair(scene, piece, placed, i), scene[piece, MARGIN] + extra
                verdict = compare_pair(model, work, pair, False, near, axes, kept)
                if verdict == CLOSER:
                    return kept, i * m + piece
                if verdict != FARTHER:
                    entries[kept, 0], entries[kept, 1] = i, piece
                    kept += 1
    return kept, -1


@kernel(allocates=False, inline="always")
def _write_interval(work: Workspace, curve: Cubic, middle: float, half: float) -> None:
    """Write the configuration in the middle of an interval, and how far joints deviate there."""
    b0, b1, b2, b3 = curve
    for j in range(b0.shape[0]):
        slope = b1[j] + (2.0 * b2[j] + 3.0 * b3[j] * middle) * middle
        bend = abs(b2[j] + 3.0 * b3[j] * middle) + abs(b3[j]) * half
        work.joints[0, j] = b0[j] + (b1[j] + (b2[j] + b3[j] * middle) * middle) * middle
        work.joints[1, j] = (abs(slope) + bend * half) * half
        work.joints[2, j] = slope * half
        work.joints[3, j] = bend * half * half


@kernel(allocates=False)
def certify_in(
    model: ModelArrays, work: Workspace, curve: Cubic, margin: float, most: int, outcome: Array
) -> int:
    """``certify_curve`` in a workspace of the caller's, given up after so many intervals' work."""
    verdict = _certify(model, work, curve, margin, most, outcome)
    if verdict == TOO_SMALL:
        verdict = _certify_in_larger(model, work, curve, margin, most, outcome)
    return verdict


@kernel
def _certify_in_larger(
    model: ModelArrays, work: Workspace, curve: Cubic, margin: float, most: int, outcome: Array
) -> int:
    """``certify_in`` once more, in a workspace as large as it takes."""
    wider, verdict = work, TOO_SMALL
    while verdict == TOO_SMALL:
        wider = widened(model, wider)
        verdict = _certify(model, wider, curve, margin, most, outcome)
    return verdict


@kernel(allocates=False, inline="always")
def _certify(
    model: ModelArrays, work: Workspace, curve: Cubic, margin: float, most: int, outcome: Array
) -> int:
    """``certify_in``, or TOO_SMALL where the workspace is too small for what is left open."""
    spans, lists, count = work.spans[0], work.lists[0], model.roots.shape[0]
    spans[0, 0], spans[0, 1], lists[0, 0], lists[0, 1] = 0.0, 1.0, 0, count
    entries = Entries(model.roots, work.hints[2])
    return certify_spans(model, work, curve, margin, most, entries, 1, outcome)


@kernel(allocates=False)
def certify_spans(
    model: ModelArrays, work: Workspace, curve: Cubic, margin: float, most: int, entries: Entries,
    open_spans: int, outcome: Array,
) -> int:  # fmt: skip
    """``certify_in`` on intervals of a curve, each with the pairs that are not settled there.

    Args:
        model: The packed robot and scene.
        work: A workspace of the model; its first ``spans`` and ``lists`` are the intervals.
        curve: The curve.
        margin: Asked for on top of the pairs' own margins [m].
        most: Intervals' work after which it is given up.
        entries: The pairs.
        open_spans: How many intervals there are.
        outcome: Outcome as of ``certify_curve``.

    Returns:
        The verdict, or TOO_SMALL where the workspace is too small for what is left open.
    """
    spans, lists, visits, tally = work.spans[0], work.lists[0], 0, work.tally
    tally[CLEARANCE], tally[CHECKS] = np.inf, 0.0
    outcome[0], outcome[1] = 0.0, -1.0
    for level in range(_MAX_DEPTH):
        # What a level leaves is written beside what it reads.
        side = (level + 1) % 2
        left = Entries(work.entries[side], work.hints[side])
        halves, lists_left = work.spans[side], work.lists[side]
        if 2 * open_spans > halves.shape[0]:
            return TOO_SMALL
        new_spans, kept = 0, 0
        for span in range(open_spans):
            low, high = spans[span, 0], spans[span, 1]
            middle, half = 0.5 * (low + high), 0.5 * (high - low)
            _write_interval(work, curve, middle, half)
            visit(model, work)
            visits += 1
            begin = kept
            tally[SHARE], tally[STOPPED] = 1.0, 0.0
            first, count = lists[span, 0], lists[span, 1]
            kept, hit = _examine(model, work, margin, entries, first, count, left, begin)
            if kept < 0:
                return TOO_SMALL
            spent = visits + int(tally[CHECKS] / _CHECKS_AN_INTERVAL)
            outcome[2] = spent
            if hit >= 0:
                outcome[0], outcome[1], outcome[3] = middle, hit, -np.inf
                return COLLIDING
            if kept == begin:
                continue
            if tally[STOPPED] > 0.0 or spent >= most:
                outcome[0], outcome[1] = middle, pair_of(model, left.pairs[begin])
                outcome[3] = tally[CLEARANCE] + margin
                return UNDECIDED
            proved = half * tally[SHARE]
            halves[new_spans, 0], halves[new_spans, 1] = low, middle - proved
            halves[new_spans + 1, 0], halves[new_spans + 1, 1] = middle + proved, high
            for at in (new_spans, new_spans + 1):
                lists_left[at, 0], lists_left[at, 1] = begin, kept - begin
            new_spans += 2
        outcome[3] = tally[CLEARANCE] + margin
        if new_spans == 0:
            return FREE
        entries, spans, lists, open_spans = left, halves, lists_left, new_spans
    outcome[0], outcome[1] = spans[0, 0], pair_of(model, entries.pairs[lists[0, 0]])
    return UNDECIDED


@kernel
def certify_curve(
    model: ModelArrays, b0: Array, b1: Array, b2: Array, b3: Array, margin: float, outcome: Array
) -> int:
    """Prove that q(s) = b0 + b1 s + b2 s^2 + b3 s^3 keeps all pairs apart for 0 <= s <= 1.

    Args:
        model: The packed robot and scene.
        b0: Start of the curve, shape (n,) [rad or m].
        b1: Coefficients of s, shape (n,).
        b2: Coefficients of s^2, shape (n,).
        b3: Coefficients of s^3, shape (n,).
        margin: Asked for on top of the pairs' own margins [m].
        outcome: Filled, shape (4,): where on the curve it stopped (s), the pair that stopped it or
            -1, intervals checked, parts of meshes counted in by their time, and the clearance
            proved so far, the pairs' own margins taken off [m].

    Returns:
        FREE (proved), COLLIDING (a configuration was found with a pair at most its margin apart) or
        UNDECIDED (a pair comes within a millionth of a metre of its margin).
    """
    curve = Cubic(b0, b1, b2, b3)
    return certify_in(model, workspace(model), curve, margin, MAX_INTERVALS, outcome)


@kernel(allocates=False, inline="always")
def compare_pair(
    model: ModelArrays, work: Workspace, pair: Pair, own: bool, apart: float, axes: Array, at: int
) -> int:
    """Compare a pair of pieces on the interval visited.

    Args:
        model: The packed robot and scene.
        work: The workspace, its second piece placed.
        pair: The pieces; the second is one of ``work.placed``.
        own: Whether the first is the robot's too, and not of the scene.
        apart: Margin of the pair [m].
        axes: Axes across which pairs part, shape (e, 3).
        at: The row of this pair's.

    Returns:
        FARTHER (apart all over it), CLOSER (at most ``apart`` in the middle) or BETWEEN.
    """
    a, i, placed, j = pair
    twists, shifts, tally, seen = work.twists, work.shifts, work.tally, i if own else -1
    enough, most = apart + ROUNDING_ERROR, pair_shift(model.chain, model.joints, shifts, seen, j)
    lower, n = quick_bound(a, i, placed, j, enough + most)
    lost, verdict = most, FARTHER
    if not lower > enough + most:
        moving = STILL
        if most > 0.0:
            moving = pair_drift(model.chain, model.joints, twists, placed, shifts, seen, j)
        if lower > enough:
            lost = allowance(n, moving)
        if not lower > enough + lost:
            axis = axes[at]
            if axis[0] == 0.0 and axis[1] == 0.0 and axis[2] == 0.0:
                axis[0], axis[1], axis[2] = n
            verdict, lower, _ = separation(
                pair, model.corners, model.tables, apart, enough, moving, axis, work.buffer
            )
            lost = allowance((axis[0], axis[1], axis[2]), moving)
            # A cover that touches proves nothing: its triangles decide, as where halving ends.
            touching = verdict == CLOSER or lower - enough < _GRAZING * lost or lost < _RESOLUTION
            covers = a[i, NODE_STOP] > 0.0 or placed[j, NODE_STOP] > 0.0
            if verdict != FARTHER and touching and covers:
                apart_in_middle, share = surface_share(
                    pair, Shapes(model.corners, model.tables, model.surfaces), apart, enough,
                    moving, axis, work.buffer, work.stack,
                )  # fmt: skip
                tally[CHECKS] += work.stack[0, COMPARED]
                verdict = CLOSER if not apart_in_middle else FARTHER if share >= 1.0 else BETWEEN
                lower, lost = enough + share * most, most
    if verdict == BETWEEN:
        share = _TRUSTED * max(lower - enough, 0.0) / lost if lost > 0.0 else 0.0
        tally[SHARE] = min(tally[SHARE], share)
        tally[STOPPED] += lost < _RESOLUTION
        lost *= share
    if verdict == FARTHER or (verdict == BETWEEN and lost > 0.0):
        tally[CLEARANCE] = min(tally[CLEARANCE], lower - lost - apart)
    return verdict


@kernel(allocates=False, inline="always")
def self_bound(model: ModelArrays, work: Workspace, s: int, reach: float, apart: float) -> float:
    """Lower bound of the distance of pair s of the robot over the interval, margins off [m].

    Args:
        model: The packed robot and scene.
        work: The workspace, both pieces placed.
        s: The pair.
        reach: How far balls about them shift, and their margin, inf where that is not known [m].
        apart: Margin of the pair [m].
    """
    a, b = model.self_pairs[s, 0], model.self_pairs[s, 1]
    proved = balls_apart(work.placed, a, b) - reach  # no piece shifts as far as what it is part of
    if not proved > ROUNDING_ERROR and model.grid_axes[s, 0, 2] > 0.0:
        still = model.joints[a]
        proved = grid_bound(
            model.grid_axes, model.grid_starts, model.grid_values, s, still, work.joints
        )
        proved -= work.shifts[b, 3 * still + 3] + apart
    return proved


@kernel(allocates=False)
def pair_of(model: ModelArrays, entry: Indices) -> int:
    """A pair that an entry stands for."""
    p, m = model.skipped.shape[0], model.scene.shape[0]
    i, k = entry[0], entry[1]
    if i < 0:
        group = -1 - i
        while model.groups[group, PARTED] < 0:
            group += 1
        return int(p * m + model.groups[group, FIRST_PAIR])
    if i >= p:
        return int(p * m + i - p)
    if k >= 0:
        return int(i * m + k)
    node = -1 - k
    while model.nodes[node, FIRST] < 0.0:
        node += 1
    return int(i * m + model.items[int(model.nodes[node, FIRST])])


@kernel(allocates=False, inline="always")
def next_group(
    model: ModelArrays, work: Workspace, margin: float, group: int, after: int, left: Entries,
    kept: int,
) -> tuple[int, int]:  # fmt: skip
    """The next of some groups that no other parts, without those that are apart or wait.

    Args:
        model: The packed robot and scene.
        work: The workspace, at an interval.
        margin: Asked for on top of the pairs' own margins [m].
        group: The first group.
        after: The one behind the last.
        left: Stack of groups that wait.
        kept: How many entries wait there.

    Returns:
        The group, ``after`` where there is none, and how many wait then, -1 for a full buffer.
    """
    placed, tally, extra = work.placed, work.tally, model.own_margin + margin
    while group < after and model.groups[group, PARTED] < 0:
        a, b = model.groups[group, BALL], model.groups[group, OTHER_BALL]
        place(model, work, a)
        place(model, work, b)
        most = pair_shift(model.chain, model.joints, work.shifts, a, b)
        proved = balls_apart(placed, a, b) - most - extra
        if proved > ROUNDING_ERROR:
            tally[CLEARANCE] = min(tally[CLEARANCE], proved)
        elif most > COARSE * max(placed[a, RADIUS], placed[b, RADIUS]):
            if kept == left.pairs.shape[0]:
                return after, -1
            left.pairs[kept, 0], left.pairs[kept, 1] = -1 - group, 0
            kept += 1
            tally[SHARE] = 0.0
        else:
            group += 1
            continue
        group += model.groups[group, GROUP_SIZE]
    return group, kept
