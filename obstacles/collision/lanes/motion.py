"""A straight motion, eight stretches abreast: which pairs of pieces may meet on each.

``check`` is about states. Here a lane is a stretch of the motion: the state in its middle, and
how far a body gets from there at most, the B of ``edge_check``. The ball of a body, grown by that,
walks the tree of what stands around; then the spheres of its pieces, each grown by as much. What
none of them clears is left to ``edge_check``, with the stretch that it may meet on.
"""

import math

from compiled.kernel import kernel
from compiled.simd import LANES, Lanes, bits, fill, lane, load, on_stack, store
from kinematics.arrays import Array, Indices
from kinematics.simd_frames import load_frame_kernel
from obstacles.collision.edge_check import ROUNDING_ERROR
from obstacles.collision.lanes.check import write_frames, write_states
from obstacles.collision.lanes.distance import (
    ball_at,
    cell_of,
    closer,
    frame_at,
    lane_bound_from,
    moved,
    place_balls,
    sphere_at,
)
from obstacles.collision.model.brackets import AFTER, OUTER
from obstacles.collision.model.kernel_work import LAST_GROUP, Workspace, meeting_body
from obstacles.collision.model.model_arrays import ModelArrays
from obstacles.distance.bvh import FIRST, LAST, SKIP, gap
from obstacles.distance.piece_set import MARGIN, OWNER, RADIUS

#: Length of a stretch, Euclidean in joint space; a motion is divided into eight at least, and so
#: many times eight at most.
_STRETCH, _MAX_BATCHES = 0.1, 8
#: Self-collision pairs that may be left open; where there are more, their groups are checked.
_MAX_SELF_PAIRS = 64
#: Factor by which what waits names a piece of the scene: below it are the lanes, as bits.
_LANE_BITS = 1 << LANES


@kernel(allocates=False, inline="always")
def open_stretches(
    model: ModelArrays, work: Workspace, start: Array, end: Array, margin: float
) -> int:
    """Write the stretches of a straight motion on which pairs are not proved apart.

    Args:
        model: The packed robot and scene.
        work: A workspace of the model, filled as ``certify_spans`` reads it: a stretch with what
            may meet on it, and the whole motion with the robot's self-collision pairs that may.
        start: Start of the motion, shape (n,) [rad or m].
        end: End of the motion, shape (n,).
        margin: Asked for on top of the pairs' own margins [m].

    Returns:
        How many intervals there are; -1 where there is no room, or the motion is not finite.
    """
    entries, axes, waiting = work.entries[0], work.hints[0], work.entries[1]
    own, kept, count, batches, square = 0, _MAX_SELF_PAIRS, 0, 1, 0.0
    for j in range(start.shape[0]):
        square += (end[j] - start[j]) ** 2
    while batches < _MAX_BATCHES and (batches * LANES * _STRETCH) ** 2 < square:
        batches += 1
    small = entries.shape[0] < 2 * _MAX_SELF_PAIRS or work.spans.shape[1] <= _MAX_BATCHES * LANES
    if small or not square < math.inf:  # what is no number is beyond no distance
        return -1
    many = work.tally[LAST_GROUP] >= 0.0
    if many:
        own = _copy_self_roots(model, entries)
        kept = max(own, kept)
    parts, shares = batches * LANES, on_stack(LANES)
    for j in range(start.shape[0]):
        work.joints[1, j] = abs(end[j] - start[j]) * (0.5 / parts)
    for batch in range(batches):
        for number in range(LANES):
            shares[number] = (LANES * batch + number + 0.5) / parts
        write_states(work, start, end, shares, LANES)
        place_stretches(model, work)
        if not many:
            own = _open_self_pairs(model, work, margin, entries, own)
            many = own < 0
            if many:
                own = _copy_self_roots(model, entries[:_MAX_SELF_PAIRS])
        found = _open_pairs(model, work, margin, waiting)
        if own < 0 or found < 0:
            return -1
        for number in range(LANES if found > 0 else 0):
            begin, part = kept, LANES * batch + number
            kept = _copy_lane(waiting, found, number, entries, axes, begin)
            if kept < 0:
                return -1
            count = _add_interval(work, part / parts, (part + 1) / parts, begin, kept, count)
    axes[:own] = 0.0
    return _add_interval(work, 0.0, 1.0, 0, own, count)


@kernel(allocates=False)
def _copy_self_roots(model: ModelArrays, entries: Indices) -> int:
    """Write the groups of self-collision pairs; how many there are, -1 where there is no room."""
    kept = 0
    for root in range(model.roots.shape[0]):
        if model.roots[root, 0] < 0:
            if kept == entries.shape[0]:
                return -1
            entries[kept, 0], entries[kept, 1] = model.roots[root, 0], model.roots[root, 1]
            kept += 1
    return kept


@kernel(allocates=False)
def _copy_lane(
    waiting: Indices, found: int, number: int, entries: Indices, axes: Array, kept: int
) -> int:
    """Write what waits in a lane behind the first ``kept`` entries; how many there are then."""
    for pair in range(found):
        if waiting[pair, 1] >> number & 1:
            if kept == entries.shape[0]:
                return -1
            entries[kept, 0], entries[kept, 1] = waiting[pair, 0], waiting[pair, 1] // _LANE_BITS
            axes[kept, 0], axes[kept, 1], axes[kept, 2] = 0.0, 0.0, 0.0
            kept += 1
    return kept


@kernel(allocates=False)
def _add_interval(
    work: Workspace, low: float, high: float, first: int, after: int, count: int
) -> int:
    """Write an interval behind the first ``count`` if it has any pairs; how many there are then."""
    if after == first:
        return count
    spans, lists = work.spans[0], work.lists[0]
    spans[count, 0], spans[count, 1] = low, high
    lists[count, 0], lists[count, 1] = first, after - first
    return count + 1


@kernel(allocates=False, inline="always")
def place_stretches(model: ModelArrays, work: Workspace) -> None:
    """Bring frames, balls and shifts of all moving bodies to the stretches.

    Args:
        model: The packed robot and scene.
        work: A workspace of the model, its ``lanes`` beginning with the states in the middles, and
            row 1 of ``joints`` how far each joint shifts from them.
    """
    write_frames(model.chain, work.lanes)
    for body in range(model.bodies.shape[0]):
        row = model.bodies[body, 0]
        place_balls(model, work, row)
        _write_shifts(model, work, row)


@kernel(allocates=False)
def _write_shifts(model: ModelArrays, work: Workspace, row: int) -> None:
    """Write how far a body with this ball gets while the joints from each one on move."""
    chain, lanes, joint = model.chain, work.lanes, model.joints[row]
    n, radius, c = int(chain[0, 0]), model.robot[row, RADIUS], ball_at(model, work, row)
    shift, at = fill(0.0), shifts_of(work, joint)
    while joint >= 0:
        parent, place, leader, share = joint - 1, 1 + joint, joint, 1.0
        if joint >= n:
            place = int(chain[0, 3]) + 2 * (joint - n)
            parent, leader = int(chain[place, 13]), int(chain[place + 1, 0])
            share = abs(chain[place + 1, 1])
        delta = share * work.joints[1, leader]
        if delta > 0.0:
            if chain[place, 0] == 0.0:
                F = load_frame_kernel(lanes, frame_at(work, joint))
                x, y, z = c[0] - F[3], c[1] - F[7], c[2] - F[11]
                along = x * F[2] + y * F[6] + z * F[10]
                square = x * x + y * y + z * z - along * along
                shift += (math.sqrt(max(square, 0.0)) + radius + shift) * delta
            else:
                shift += delta
        store(lanes, at + LANES * (parent + 1), shift)
        joint = parent


@kernel(allocates=False, inline="code")
def shifts_of(work: Workspace, joint: int) -> int:
    """Place in ``work.lanes`` of a body's shifts, seen from the base and from each body."""
    bodies = work.frames.shape[0]
    return int(work.lanes.shape[0] - LANES * (bodies + 1) * (bodies - joint))


@kernel(allocates=False, inline="always")
def _open_pairs(model: ModelArrays, work: Workspace, margin: float, waiting: Indices) -> int:
    """Write the pairs of a piece and something around that are not proved apart on stretches.

    Args:
        model: The packed robot and scene.
        work: A workspace of the model, after ``place_stretches``.
        margin: Asked for on top of the pairs' own margins [m].
        waiting: Filled with pieces of the robot, and those of the scene times ``_LANE_BITS`` with
            the lanes as bits, shape (e, 2).

    Returns:
        How many pairs there are; -1 where there is no room.
    """
    count, extra = 0, model.margin + margin + ROUNDING_ERROR
    for body in range(model.bodies.shape[0]):
        if model.bodies[body, 1] < model.bodies[body, 2] and count >= 0:
            count = _around_body(model, work, body, extra, waiting, count)
    return count


@kernel(allocates=False, inline="always")
def _around_body(
    model: ModelArrays, work: Workspace, body: int, extra: float, waiting: Indices, count: int
) -> int:
    """Write what a body may meet behind the first ``count`` pairs; how many there are then."""
    row, halfspaces = model.bodies[body, 0], model.halfspaces
    nodes, items, scene, corners = model.nodes, model.items, model.scene, model.corners
    shift = load(work.lanes, shifts_of(work, model.joints[row]))
    p, reach = ball_at(model, work, row), max(shift + (model.robot[row, RADIUS] + extra), 0.0)
    several = model.bodies[body, 2] - model.bodies[body, 1] > 1
    square, node, end, entry, stop = reach * reach, 0, nodes.shape[0], 0, 0
    halfspace, near = 0, 0
    # One loop over half-spaces, nodes and what is in them: what it does is pasted in once.
    while True:
        if entry < stop:
            k = items[entry]
            entry += 1
        elif node < end:
            near = bits(gap(nodes, node, p[0], p[1], p[2]) <= square)
            if near == 0:
                node = int(nodes[node, SKIP])
            else:
                entry, stop = int(nodes[node, FIRST]), int(nodes[node, LAST])
                node += 1
            continue
        elif halfspace < halfspaces.shape[0]:
            k, near = halfspaces[halfspace], _LANE_BITS - 1
            halfspace += 1
        else:
            return count
        meets, apart = near, scene[k, MARGIN]
        if several:
            meets &= bits(lane_bound_from(scene, k, corners, p) <= reach + apart)
        if meets == 0:
            continue
        around = shift + (extra + apart)
        for carried in range(model.bodies[body, 1], model.bodies[body, 2]):
            i = model.carried[carried]
            if model.skipped[i, int(scene[k, OWNER])]:
                continue
            found = _near_spheres(model, work, i, k, around, meets)
            if found != 0:
                if count == waiting.shape[0]:
                    return -1
                waiting[count, 0], waiting[count, 1] = i, k * _LANE_BITS + found
                count += 1


@kernel(allocates=False, inline="always")
def _near_spheres(
    model: ModelArrays, work: Workspace, i: int, k: int, apart: Lanes, open_lanes: int
) -> int:
    """Lanes of those open where piece i of the robot is not ``apart`` from piece k of the scene."""
    spheres, at, left, near = model.spheres, frame_at(work, model.joints[i]), open_lanes, 0
    first, stop = model.sphere_starts[i], model.sphere_starts[i + 1]
    sphere = first
    while sphere < stop and left != 0:
        x, y, z = spheres[sphere, 0], spheres[sphere, 1], spheres[sphere, 2]
        distance = lane_bound_from(model.scene, k, model.corners, moved(work.lanes, at, x, y, z))
        close = bits(distance <= spheres[sphere, OUTER] + apart) & left
        after = int(spheres[sphere, AFTER])
        if sphere == first:
            left = close
        sphere = sphere + 1 if close != 0 else after
        if close != 0 and after == sphere:
            near |= close
            left &= ~close
    return near


@kernel(allocates=False, inline="always")
def _open_self_pairs(
    model: ModelArrays, work: Workspace, margin: float, waiting: Indices, count: int
) -> int:
    """Write the robot's self-collision pairs that are not proved apart on all of the stretches.

    Args:
        model: The packed robot and scene, none of whose groups is parted.
        work: A workspace of the model, after ``place_stretches``.
        margin: Asked for on top of the pairs' own margins [m].
        waiting: Filled behind the first ``count`` with the numbers of pairs, as in
            ``ModelArrays.roots``, those left out that are there already, shape (e, 2).
        count: How many are there.

    Returns:
        How many there are then; -1 where there is no room.
    """
    rows, groups, p = model.robot, model.groups, model.skipped.shape[0]
    apart = model.own_margin + margin + ROUNDING_ERROR
    for group in range(groups.shape[0]):
        start, stop, a, b = groups[group]
        shift = _shift_between(model, work, model.joints[a], model.joints[b])
        reach = shift + (rows[a, RADIUS] + rows[b, RADIUS] + apart)
        if closer(ball_at(model, work, a), ball_at(model, work, b), reach) == 0:
            continue
        for s in range(start, stop):
            known = 0
            while known < count and waiting[known, 0] != p + s:
                known += 1
            if known < count or not _may_meet(model, work, s, shift + apart):
                continue
            if count == _MAX_SELF_PAIRS:
                return -1
            waiting[count, 0], waiting[count, 1] = p + s, 0
            count += 1
    return count


@kernel(allocates=False)
def _shift_between(model: ModelArrays, work: Workspace, one: int, other: int) -> Lanes:
    """``pair_shift`` of two bodies, the second of which moves seen from the first."""
    lanes, meeting = work.lanes, one
    if other >= int(model.chain[0, 0]):
        meeting = meeting_body(model.chain, one, other)
    shift = load(lanes, shifts_of(work, other) + LANES * (meeting + 1))
    if meeting != one:
        shift += load(lanes, shifts_of(work, one) + LANES * (meeting + 1))
    return shift


@kernel(allocates=False, inline="always")
def _may_meet(model: ModelArrays, work: Workspace, s: int, apart: Lanes) -> bool:
    """Whether pair s of the robot is not proved ``apart`` on some stretch."""
    i, j = model.self_pairs[s, 0], model.self_pairs[s, 1]
    one, other = model.sphere_starts[i], model.sphere_starts[j]
    close = closer(
        sphere_at(model, work, one, model.joints[i]),
        sphere_at(model, work, other, model.joints[j]),
        apart + (model.spheres[one, OUTER] + model.spheres[other, OUTER]),
    )  # fmt: skip
    if close == 0 or model.grid_axes[s, 0, 2] == 0.0:
        return close != 0
    cell, inside = cell_of(model, work.lanes, s, close)
    start = model.grid_starts[s]
    for number in range(LANES):
        if close >> number & 1 and (
            not inside >> number & 1
            or not model.grid_values[start + int(lane(cell, number))] > lane(apart, number)
        ):
            return True
    return False
