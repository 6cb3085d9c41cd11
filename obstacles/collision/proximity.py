"""Distances of the closest pair, and of all near pairs with their gradients.

With n the unit direction from piece i to piece j along which their signed distance d is measured,
p the point of j that is nearest (or deepest), and z_k, o_k axis and origin of joint k,

    dd/dq_k = n . (z_k x (p - o_k))   (revolute),   n . z_k   (prismatic)

for the joints between the two, 0 for all others.
"""

import math
from typing import NamedTuple

import numpy as np

from compiled.kernel import kernel
from compiled.simd import LANES, on_stack
from compiled.vec3 import Vector
from kinematics.arrays import Array, Indices
from kinematics.model.chain import MAX_JOINTS
from obstacles.collision.lanes.check import blocked_lanes, write_states
from obstacles.collision.model.kernel_work import (
    Workspace,
    meeting_body,
    place,
    place_ball_once,
    visit,
    workspace,
)
from obstacles.collision.model.model_arrays import ModelArrays
from obstacles.collision.model.pair_groups import GROUP_SIZE, PARTED
from obstacles.distance.bounds import balls_apart, quick_bound
from obstacles.distance.bvh import FIRST, LAST, SKIP, gap
from obstacles.distance.epa import contact
from obstacles.distance.gjk import BETWEEN, CLOSER, FARTHER, STILL, separation
from obstacles.distance.piece_set import CENTER, MARGIN, NODE_STOP, OWNER, RADIUS, Pair, Shapes
from obstacles.distance.triangles.distance import DESK, surface_distance

#: Nodes that wait while a tree is walked, whose depth is the binary logarithm of its leaves.
_DEEPEST = 128
#: How deep the hollows of a mesh are thought to be at first [m].
_DEPTH = 0.01


@kernel(allocates=False)
def stand_in(model: ModelArrays, work: Workspace, q: Array) -> None:
    """Let the robot stand still in ``q`` in a workspace whose joints do not deviate."""
    for joint in range(q.shape[0]):
        work.joints[0, joint] = q[joint]
    visit(model, work)
    # Pieces, and balls about bodies: those about parts of them are placed where one is checked.
    placed = model.skipped.shape[0] + work.frames.shape[0] + 1
    for i in range(min(placed, model.joints.shape[0])):
        place(model, work, i)


@kernel(allocates=False)
def _closer(
    pair: Pair, shapes: Shapes, buffer: Array, stack: Array, apart: float, best: float, exact: bool
) -> float:
    """The lesser of ``best`` and the distance of two pieces beyond ``apart`` [m].

    Args:
        pair: The pieces.
        shapes: Corners, tables and trees of both.
        buffer: Workspace, shape (9, 3).
        stack: Workspace, shape STACK.
        apart: Margin of the pair [m].
        best: The least distance so far [m].
        exact: Whether triangles decide where covers touch.
    """
    a, i, b, j = pair
    lower, n = quick_bound(a, i, b, j, best + apart)
    if lower - apart >= best:
        return best
    axis = buffer[8]
    axis[0], axis[1], axis[2] = n
    verdict, lower, _ = separation(
        pair, shapes.corners, shapes.tables, -np.inf, best + apart, STILL, axis, buffer
    )
    if exact and verdict != FARTHER and (a[i, NODE_STOP] > 0.0 or b[j, NODE_STOP] > 0.0):
        verdict, lower = surface_distance(pair, shapes, -np.inf, best + apart, axis, buffer, stack)
        lower = min(lower, 0.0) if verdict == CLOSER else lower
    return best if verdict == FARTHER else min(best, lower - apart)


@kernel(allocates=False, inline="always")
def _closest_obstacle(
    model: ModelArrays, work: Workspace, i: int, best: float, exact: bool
) -> tuple[float, int]:
    """Least distance of piece i from what is in the tree, if less than ``best``; the piece."""
    nodes, placed, scene = model.nodes, work.placed, model.scene
    x, y, z = placed[i, CENTER], placed[i, CENTER + 1], placed[i, CENTER + 2]
    shapes = Shapes(model.corners, model.tables, model.surfaces)
    stack, gaps = on_stack(_DEEPEST).view(np.int64), on_stack(_DEEPEST)
    stack[0], gaps[0], top, closest = 0, gap(nodes, 0, x, y, z), 1, -1
    while top > 0:
        top -= 1
        node = stack[top]
        if np.sqrt(gaps[top]) - placed[i, RADIUS] - model.margin >= best:
            continue
        if nodes[node, FIRST] < 0.0:
            # The nearer one of the two comes first.
            left, right = node + 1, int(nodes[node + 1, SKIP])
            near, far = gap(nodes, left, x, y, z), gap(nodes, right, x, y, z)
            if far < near:
                left, right, near, far = right, left, far, near
            stack[top], gaps[top], stack[top + 1], gaps[top + 1] = right, far, left, near
            top += 2
            continue
        for entry in range(int(nodes[node, FIRST]), int(nodes[node, LAST])):
            k = model.items[entry]
            if model.skipped[i, int(scene[k, OWNER])]:
                continue
            distance = _closer(
                Pair(scene, k, placed, i), shapes, work.buffer, work.stack,
                scene[k, MARGIN] + model.margin, best, exact,
            )  # fmt: skip
            if distance < best:
                best, closest = distance, k
    return best, closest


@kernel
def closest_pair(model: ModelArrays, q: Array) -> tuple[float, int]:
    """Least distance [m] over all pairs, margins taken off, and the pair it belongs to.

    Overlap is answered as 0 or below, without its depth.
    """
    work = workspace(model)
    work.joints[:] = 0.0
    return closest_of(model, work, q)


@kernel(allocates=False)
def closest_of(model: ModelArrays, work: Workspace, q: Array) -> tuple[float, int]:
    """``closest_pair`` in a workspace whose joints do not deviate."""
    stand_in(model, work, q)
    best, closest = closest_in(model, work, np.inf, model.surfaces.shape[0] == 0)
    if model.surfaces.shape[0] == 0 or closest < 0:
        return best, closest
    # Triangles are checked where their covers are near, and that is known now.
    reach, closest = max(best, 0.0) + _DEPTH, -1
    while closest < 0:
        best, closest = closest_in(model, work, reach, True)
        reach *= 4.0
    return best, closest


@kernel
def closest_state(model: ModelArrays, states: Array, within: float) -> tuple[float, int, int]:
    """Least distance [m] of ``closest_pair`` over states (k, n), the state and the pair.

    By their covers the closest state is found first: what is closer by triangles in another one is
    hardly anything then, and a check of it is short.

    Args:
        model: The packed robot and scene.
        states: Shape (k, n).
        within: Distance below which a closer pair is searched; else it is the answer, state and
            pair -1 [m].
    """
    work, covers = workspace(model), model.surfaces.shape[0] == 0
    work.joints[:] = 0.0
    best, closest, pair = within, -1, -1
    for k in range(states.shape[0]):
        stand_in(model, work, states[k])
        distance, found = closest_in(model, work, best, covers)
        if found >= 0:
            best, closest, pair = distance, k, found
    if covers or closest < 0:
        return best, closest, pair
    # That state takes the turn of the first one, which comes in its place.
    first, best, closest, pair = closest, within, -1, -1
    for turn in range(states.shape[0]):
        k = first if turn == 0 else 0 if turn == first else turn
        stand_in(model, work, states[k])
        distance, found = closest_in(model, work, best, True)
        if found >= 0:
            best, closest, pair = distance, k, found
    return best, closest, pair


@kernel(allocates=False)
def closest_in(model: ModelArrays, work: Workspace, best: float, exact: bool) -> tuple[float, int]:
    """The closest pair if it is closer than ``best`` [m], by triangles or else by covers."""
    m = model.scene.shape[0]
    shapes, placed = Shapes(model.corners, model.tables, model.surfaces), work.placed
    buffer, stack = work.buffer, work.stack
    closest = -1
    for root in range(model.roots.shape[0]):
        i, k = model.roots[root, 0], model.roots[root, 1]
        if i < 0:
            best, closest = _closest_in_groups(model, work, -1 - i, best, closest, exact)
            continue
        if k >= 0:
            apart = model.scene[k, MARGIN] + model.margin
            facing = Pair(model.scene, k, placed, i)
            distance = _closer(facing, shapes, buffer, stack, apart, best, exact)
            pair = i * m + k
        else:
            distance, k = _closest_obstacle(model, work, i, best, exact)
            pair = i * m + k
        if distance < best:
            best, closest = distance, pair
    return best, closest


@kernel(allocates=False, inline="always")
def _closest_in_groups(
    model: ModelArrays, work: Workspace, top: int, best: float, closest: int, exact: bool
) -> tuple[float, int]:
    """``best`` and ``closest``, or those of a group and what parts it if it holds a closer pair."""
    shapes, placed = Shapes(model.corners, model.tables, model.surfaces), work.placed
    own, group, after = model.own_margin, top, _group_after(model, top)
    first_pair = model.skipped.shape[0] * model.scene.shape[0]
    while group < after:
        first, last, a, b = model.groups[group]
        place_ball_once(model, work, a)
        place_ball_once(model, work, b)
        if balls_apart(placed, a, b) - own >= best:
            group = _group_after(model, group)
            continue
        group += 1
        for s in range(first, last if first >= 0 else first):
            a, b = model.self_pairs[s, 0], model.self_pairs[s, 1]
            # Most pairs of a robot of many pieces: a call would cost ten times as much.
            if balls_apart(placed, a, b) - own >= best:
                continue
            pair = Pair(placed, a, placed, b)
            distance = _closer(pair, shapes, work.buffer, work.stack, own, best, exact)
            if distance < best:
                best, closest = distance, first_pair + s
    return best, closest


@kernel(allocates=False, inline="always")
def _group_after(model: ModelArrays, group: int) -> int:
    """The group behind a group and all that part it."""
    return int(group + (model.groups[group, GROUP_SIZE] if model.groups[group, PARTED] < 0 else 1))


class NearPairs(NamedTuple):
    """Answer of ``near_pairs``, for r of them at most.

    Args:
        numbers: The pairs, shape (r,).
        distances: Signed distances of the pairs, margins taken off, shape (r,) [m].
        gradients: dd/dq, shape (r, n).
    """

    numbers: Indices
    distances: Array
    gradients: Array


class _Asked(NamedTuple):
    """A pair whose distance is asked for.

    Args:
        a: Rows of the first piece, shape (p, WIDTH).
        i: Row of the first piece.
        still: The joint that carries it, -1 for the base.
        j: Row of the second piece, one of the robot's.
        apart: Margin of the pair [m].
        number: Number of the pair.
    """

    a: Array
    i: int
    still: int
    j: int
    apart: float
    number: int


@kernel(allocates=False)
def _add_near_pair(
    model: ModelArrays, work: Workspace, asked: _Asked, within: float, near: NearPairs, count: int
) -> int:
    """Write a pair to row ``count`` if it is near; how many there are then."""
    a, i, still, j, apart, number = asked
    far, b = within + apart, work.placed
    lower, n = quick_bound(a, i, b, j, far)
    if lower > far:
        return count
    axis = work.buffer[8]
    axis[0], axis[1], axis[2] = n
    distance, normal, point = contact(a, i, b, j, model.corners, model.tables, axis)
    if distance <= far and (a[i, NODE_STOP] > 0.0 or b[j, NODE_STOP] > 0.0):
        verdict, _ = surface_distance(
            Pair(a, i, b, j), Shapes(model.corners, model.tables, model.surfaces), -np.inf,
            max(far, 0.0), axis, work.buffer, work.stack,
        )  # fmt: skip
        # Where they touch, the depth is that of the covers: the way out is no longer.
        if verdict == FARTHER:
            return count
        if verdict == BETWEEN:
            desk = work.stack[DESK : DESK + 2]
            axis[0], axis[1], axis[2] = normal
            distance, normal, point = contact(desk, 0, desk, 1, model.corners, model.tables, axis)
    if distance > far:
        return count
    if count < near.numbers.shape[0]:
        near.numbers[count], near.distances[count] = number, distance - apart
        distance_gradient(
            model.chain, work.frames, still, model.joints[j], normal, point, near.gradients[count]
        )
    return count + 1


@kernel
def near_pairs(
    model: ModelArrays, q: Array, within: float, found: Indices, distances: Array, gradients: Array
) -> int:
    """Find the pairs whose distance, margins taken off, is at most ``within`` [m].

    Args:
        model: The packed robot and scene.
        q: Shape (n,).
        within: [m].
        found: Filled with the pairs as far as they fit, shape (r,).
        distances: Filled with their signed distances, margins taken off, shape (r,) [m].
        gradients: Filled with dd/dq, shape (r, n).

    Returns:
        How many there are, which can be more than fit.
    """
    work = workspace(model)
    work.joints[:] = 0.0
    stand_in(model, work, q)
    return near_pairs_in(model, work, within, NearPairs(found, distances, gradients))


@kernel(allocates=False)
def near_pairs_in(model: ModelArrays, work: Workspace, within: float, near: NearPairs) -> int:
    """``near_pairs`` where the robot stands in a workspace."""
    count, m = 0, model.scene.shape[0]
    for root in range(model.roots.shape[0]):
        i, k = model.roots[root, 0], model.roots[root, 1]
        if i < 0:
            count = _add_near_groups(model, work, -1 - i, within, near, count)
        elif k >= 0:
            apart = model.scene[k, MARGIN] + model.margin
            asked = _Asked(model.scene, k, -1, i, apart, i * m + k)
            count = _add_near_pair(model, work, asked, within, near, count)
        else:
            count = _add_near_obstacles(model, work, i, within, near, count)
    return count


@kernel(allocates=False, inline="always")
def _add_near_groups(
    model: ModelArrays, work: Workspace, top: int, within: float, near: NearPairs, count: int
) -> int:
    """``near_pairs`` of a group and of what parts it."""
    placed, own, p, m = work.placed, model.own_margin, model.skipped.shape[0], model.scene.shape[0]
    group, after = top, _group_after(model, top)
    while group < after:
        first, last, a, b = model.groups[group]
        place_ball_once(model, work, a)
        place_ball_once(model, work, b)
        if balls_apart(placed, a, b) - own > within:
            group = _group_after(model, group)
            continue
        group += 1
        for s in range(first, last if first >= 0 else first):
            a, b = model.self_pairs[s, 0], model.self_pairs[s, 1]
            asked = _Asked(placed, a, model.joints[a], b, own, p * m + s)
            count = _add_near_pair(model, work, asked, within, near, count)
    return count


@kernel(allocates=False, inline="always")
def _add_near_obstacles(
    model: ModelArrays, work: Workspace, i: int, within: float, near: NearPairs, count: int
) -> int:
    """``near_pairs`` of piece i with what is in the tree."""
    nodes, items, scene = model.nodes, model.items, model.scene
    row = work.placed[i]
    reach = max(row[RADIUS] + model.margin + within, 0.0)
    node = 0
    while node < nodes.shape[0]:
        if gap(nodes, node, row[CENTER], row[CENTER + 1], row[CENTER + 2]) > reach * reach:
            node = int(nodes[node, SKIP])
            continue
        first, last = max(int(nodes[node, FIRST]), 0), max(int(nodes[node, LAST]), 0)
        for entry in range(first, last):
            k = items[entry]
            if not model.skipped[i, int(scene[k, OWNER])]:
                apart = scene[k, MARGIN] + model.margin
                asked = _Asked(scene, k, -1, i, apart, i * scene.shape[0] + k)
                count = _add_near_pair(model, work, asked, within, near, count)
        node += 1
    return count


@kernel(allocates=False)
def line_deficit(
    model: ModelArrays, work: Workspace, a: Array, b: Array, spacing: float, most: float
) -> float:
    """Mean clearance deficit of the straight motion from a to b, both (n,) [m].

    The motion is divided into parts of equal length, the middles of which are checked. A state
    that keeps all margins lacks nothing; one that does not, the most that a pair of it lacks.

    Args:
        model: The packed robot and scene, with the margins.
        work: A workspace of the model.
        a: Start of the motion, shape (n,) [rad or m].
        b: End of the motion, shape (n,).
        spacing: Length of a part at most, Euclidean in joint space.
        most: Distance beyond which the answer is infinite: fewer states are checked then [m].
    """
    n, square = a.shape[0], 0.0
    for j in range(n):
        square += (b[j] - a[j]) ** 2
    parts = max(1, math.ceil(math.sqrt(square) / spacing))
    q, shares, total = on_stack(MAX_JOINTS)[:n], on_stack(LANES), 0.0
    for first in range(0, parts, LANES):
        count = min(LANES, parts - first)
        for number in range(count):
            shares[number] = (first + number + 0.5) / parts
        write_states(work, a, b, shares, count)
        near = blocked_lanes(model, work, 0.0, (1 << count) - 1, 0)
        for number in range(count):
            if near >> number & 1 == 0:
                continue
            for j in range(n):
                q[j] = a[j] + shares[number] * (b[j] - a[j])
            work.joints[:] = 0.0
            stand_in(model, work, q)
            nearest, _ = closest_in(model, work, 0.0, True)
            total -= nearest
            if total > most * parts:
                return np.inf
    return total / parts


@kernel(allocates=False, inline="always")
def distance_gradient(
    chain: Array, frames: Array, still: int, joint: int, n: Vector, p: Vector, gradient: Array
) -> None:
    """Write dd/dq (n,) of a pair.

    Args:
        chain: ``Chain.model``.
        frames: Frames of the joints, shape (n, 4, 4).
        still: The joint that carries the first piece, -1 for the base.
        joint: The joint that carries the second piece, beyond ``still``, or its body.
        n: Unit direction from the second piece to the first.
        p: The point of the second piece.
        gradient: Filled, shape (n,).
    """
    gradient[:] = 0.0
    # From both bodies to the one that both hang on; what joints before that do moves neither.
    meeting = meeting_body(chain, still, joint)
    for side in range(2):
        body, sign = (joint, -1.0) if side == 0 else (still, 1.0)
        while body != meeting:
            leader, parent, row, share, F = body, body - 1, 1 + body, sign, frames[body]
            if body >= gradient.shape[0]:
                row = int(chain[0, 3]) + 2 * (body - gradient.shape[0])
                parent, leader = int(chain[row, 13]), int(chain[row + 1, 0])
                share *= chain[row + 1, 1]
            zx, zy, zz = F[0, 2], F[1, 2], F[2, 2]
            if chain[row, 0] == 0.0:
                x, y, z = p[0] - F[0, 3], p[1] - F[1, 3], p[2] - F[2, 3]
                zx, zy, zz = zy * z - zz * y, zz * x - zx * z, zx * y - zy * x
            gradient[leader] += share * (n[0] * zx + n[1] * zy + n[2] * zz)
            body = parent
