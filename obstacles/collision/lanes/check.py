"""The verdict on states, eight abreast: which of them are not free.

It is ``state_check``'s, by the same spheres and the same exact test. What that has as a number is
here a vector of eight, one state in each lane (see ``simd``). Lanes that are still open are bits of
a number; a box, a ball or a grid that clears all of them is left at once, and only what stays open
in the end is asked one by one.
"""

import numpy as np

from compiled.kernel import kernel
from compiled.simd import (
    LANES,
    bits,
    load,
    on_stack,
    store,
)
from compiled.simd_transpose import store_rows_kernel
from compiled.sincos import turns_kernel
from kinematics.arrays import Array
from kinematics.frame import move_kernel
from kinematics.simd_frames import (
    FRAME_SIZE,
    identity_lanes_kernel,
    load_frame_kernel,
)
from obstacles.collision.edge_check import FREE, ROUNDING_ERROR
from obstacles.collision.lanes.distance import (
    ball_at,
    beyond_grid,
    closer,
    enter_group,
    frame_at,
    lane_bound_from,
    moved,
    place_balls,
    sphere_at,
)
from obstacles.collision.model.brackets import AFTER, INNER, OUTER
from obstacles.collision.model.kernel_work import Workspace, place_row, workspace
from obstacles.collision.model.model_arrays import ModelArrays
from obstacles.collision.state_check import exact_verdict, verdict_in
from obstacles.distance.ball_distance import closed_form
from obstacles.distance.bvh import FIRST, LAST, SKIP, gap
from obstacles.distance.piece_set import (
    MARGIN,
    NODE_STOP,
    OWNER,
    RADIUS,
)

#: Numbers on the stack for three vectors.
_THREE = 3 * LANES
#: States from which on a check of eight costs less than one of each.
_FEW = 4


@kernel(allocates=False)
def blocked_between(
    model: ModelArrays, work: Workspace, a: Array, b: Array, margin: float, parts: int, checks: int
) -> bool:
    """Whether a state between a and b (n,) is not free that ``blocked_at`` would check.

    Args:
        model: The packed robot and scene.
        work: A workspace of the model.
        a: Start of the motion, shape (n,) [rad or m].
        b: End of the motion, shape (n,).
        margin: Asked for on top of the pairs' own margins [m].
        parts: Into which the motion is divided at first, a power of 2; 1 where the end is open.
        checks: Parts at last.
    """
    shares, count, part = on_stack(LANES), 0, 1
    while parts <= checks:
        shares[count] = part / parts
        count, part = count + 1, part + 2
        if part > parts:
            parts, part = 2 * parts, 1
        if count == LANES or parts > checks:
            write_states(work, a, b, shares, count)
            every = (1 << count) - 1
            if blocked_lanes(model, work, margin, every, every) != 0:
                return True
            count = 0
    return False


@kernel(allocates=False)
def write_states(work: Workspace, a: Array, b: Array, shares: Array, end: int) -> None:
    """Write states on the way from a to b (n,) into lanes.

    Args:
        work: The workspace, whose lanes from the end on repeat the last state.
        a: Start of the motion, shape (n,).
        b: End of the motion, shape (n,).
        shares: Shares of the way, by lanes, shape (8,).
        end: The lane behind the last that is asked about.
    """
    for number in range(end, LANES):
        shares[number] = shares[end - 1]
    share = load(shares, 0)
    for j in range(a.shape[0]):
        store(work.lanes, LANES * j, a[j] + (b[j] - a[j]) * share)


@kernel(allocates=False)
def blocked_lanes(
    model: ModelArrays, work: Workspace, margin: float, asked: int, vital: int
) -> int:
    """Verdicts on the eight states that a workspace begins with: bits of those that are not free.

    Args:
        model: The packed robot and scene.
        work: A workspace of the model, its ``lanes`` beginning with the states.
        margin: Asked for on top of the pairs' own margins [m].
        asked: States that are asked about, as bits.
        vital: States of which one that is not free will do, likewise: the others may be left open
            then.
    """
    blocked = 0
    write_frames(model.chain, work.lanes)
    for body in range(model.bodies.shape[0]):
        place_balls(model, work, model.bodies[body, 0])
        if model.bodies[body, 1] < model.bodies[body, 2]:
            blocked |= _around_body(
                model, work, body, model.margin + margin, asked & ~blocked, vital
            )
        if blocked == asked or blocked & vital != 0:
            return blocked
    apart = model.own_margin + margin
    return blocked | _self_pairs(model, work, apart, asked & ~blocked, vital)


@kernel(allocates=False)
def write_frames(chain: Array, lanes: Array) -> None:
    """Write the frames of all bodies at the states that ``lanes`` begin with."""
    n = int(chain[0, 0])
    size = LANES * n
    q, cosines, sines = lanes[:size], lanes[size : 2 * size], lanes[2 * size : 3 * size]
    turns_kernel(q, cosines, sines)
    B = identity_lanes_kernel()
    for j in range(n):
        at = LANES * j
        B = move_kernel(chain, 1 + j, load(q, at), load(cosines, at), load(sines, at), B)
        store_rows_kernel(lanes, 3 * size + FRAME_SIZE * j, LANES, B)
    turn = on_stack(_THREE)
    for k in range(int(chain[0, 2])):
        row = int(chain[0, 3]) + 2 * k
        parent, leader = int(chain[row, 13]), int(chain[row + 1, 0])
        B = identity_lanes_kernel()
        if parent >= 0:
            B = load_frame_kernel(lanes, 3 * size + FRAME_SIZE * parent)
        value = chain[row + 1, 1] * load(q, LANES * leader) + chain[row + 1, 2]
        store(turn, 0, value)
        turns_kernel(turn[:LANES], turn[LANES : 2 * LANES], turn[2 * LANES :])
        B = move_kernel(chain, row, value, load(turn, LANES), load(turn, 2 * LANES), B)
        store_rows_kernel(lanes, 3 * size + FRAME_SIZE * (n + k), LANES, B)


@kernel(allocates=False, inline="always")
def _around_body(
    model: ModelArrays, work: Workspace, body: int, extra: float, open_lanes: int,
    vital: int,
) -> int:  # fmt: skip
    """Lanes of those open where a piece of a body meets what stands around."""
    row, halfspaces = model.bodies[body, 0], model.halfspaces
    nodes, items, scene = model.nodes, model.items, model.scene
    p = ball_at(model, work, row)
    radius = model.robot[row, RADIUS]
    reach = max(radius + extra + ROUNDING_ERROR, 0.0)
    several = model.bodies[body, 2] - model.bodies[body, 1] > 1
    square, node, end, entry, stop = reach * reach, 0, nodes.shape[0], 0, 0
    halfspace, blocked, near = 0, 0, 0
    # One loop over half-spaces, nodes and what is in them: what it does is pasted in once.
    while True:
        if entry < stop:
            k = items[entry]
            entry += 1
        elif node < end:
            near = bits(gap(nodes, node, p[0], p[1], p[2]) <= square) & open_lanes
            if near == 0:
                node = int(nodes[node, SKIP])
            else:
                entry, stop = int(nodes[node, FIRST]), int(nodes[node, LAST])
                node += 1
            continue
        elif halfspace < halfspaces.shape[0]:
            k, near = halfspaces[halfspace], open_lanes
            halfspace += 1
        else:
            return blocked
        apart, meets = scene[k, MARGIN] + extra, near & ~blocked
        if several and meets != 0:
            bound = lane_bound_from(scene, k, model.corners, p)
            meets &= bits(bound <= radius + apart + ROUNDING_ERROR)
        if meets != 0:
            blocked |= _body_against(model, work, body, k, apart, meets, vital)
            if blocked == open_lanes or (blocked & vital != 0):
                return blocked


@kernel(allocates=False, inline="always")
def _body_against(
    model: ModelArrays, work: Workspace, body: int, k: int, apart: float, open_lanes: int,
    vital: int,
) -> int:  # fmt: skip
    """Lanes of those open where a piece of a body meets piece k of the scene."""
    scene, spheres, corners, lanes = model.scene, model.spheres, model.corners, work.lanes
    # What covers a part of a mesh may hold more than it: it is free, but never struck, by itself.
    exact, blocked = closed_form(scene, k) and not scene[k, NODE_STOP] > 0.0, 0
    for entry in range(model.bodies[body, 1], model.bodies[body, 2]):
        i = model.carried[entry]
        if model.skipped[i, int(scene[k, OWNER])]:
            continue
        at, left = frame_at(work, model.joints[i]), open_lanes & ~blocked
        sphere, end = model.sphere_starts[i], model.sphere_starts[i + 1]
        while sphere < end and left != 0:
            x, y, z = spheres[sphere, 0], spheres[sphere, 1], spheres[sphere, 2]
            distance = lane_bound_from(scene, k, corners, moved(lanes, at, x, y, z))
            near = spheres[sphere, OUTER] + apart + ROUNDING_ERROR
            close, after = bits(distance <= near) & left, int(spheres[sphere, AFTER])
            if sphere == model.sphere_starts[i]:
                left = close
            if exact and close != 0:
                deep = spheres[sphere, INNER] + apart - ROUNDING_ERROR
                struck = bits(distance <= deep) & close
                blocked |= struck
                left, close = left & ~struck, close & ~struck
            if blocked & vital != 0:
                return blocked
            if close == 0:
                sphere = after
                continue
            sphere += 1
            if after == sphere:
                blocked |= _ask_each(model, work, k, i, apart, close, vital)
                left &= ~close
        if blocked & vital != 0:
            return blocked
    return blocked


@kernel(allocates=False, inline="always")
def _self_pairs(
    model: ModelArrays, work: Workspace, apart: float, open_lanes: int, vital: int
) -> int:
    """Lanes of those open where a self-collision pair meets."""
    rows, groups, lanes, blocked, group = model.robot, model.groups, work.lanes, 0, 0
    while group < groups.shape[0]:
        start, stop, a, b = groups[group]
        reach = rows[a, RADIUS] + rows[b, RADIUS] + apart + ROUNDING_ERROR
        close = closer(ball_at(model, work, a), ball_at(model, work, b), reach)
        close &= open_lanes & ~blocked
        if start < 0:
            group += enter_group(model, work, group, close)
            continue
        group += 1
        if close == 0:
            continue
        for s in range(start, stop):
            i, j = model.self_pairs[s, 0], model.self_pairs[s, 1]
            one, other = model.sphere_starts[i], model.sphere_starts[j]
            reach = model.spheres[one, OUTER] + model.spheres[other, OUTER] + apart
            meets = closer(
                sphere_at(model, work, one, model.joints[i]),
                sphere_at(model, work, other, model.joints[j]), reach + ROUNDING_ERROR,
            ) & close & ~blocked  # fmt: skip
            if meets != 0 and model.grid_axes[s, 0, 2] > 0.0:
                meets = beyond_grid(model, lanes, s, apart + ROUNDING_ERROR, meets)
            if meets != 0:
                blocked |= _ask_each(model, work, -1 - i, j, apart, meets, vital)
                if blocked & vital != 0:
                    return blocked
    return blocked


@kernel(allocates=False)
def _ask_each(
    model: ModelArrays, work: Workspace, k: int, i: int, apart: float, open_lanes: int,
    vital: int,
) -> int:  # fmt: skip
    """Lanes of those open where piece i of the robot meets another, by exact tests.

    The other is piece k of the scene, or where that is below 0 piece -1 - k of the robot.
    """
    asked, blocked, other = on_stack(1).view(np.int64), 0, k
    rows = model.scene
    if k < 0:
        other, rows = -1 - k, work.placed
    for number in range(LANES):
        if open_lanes >> number & 1:
            work.stamps[-1] += 1
            _write_frame(work, model.joints[i], number)
            if k < 0:
                _write_frame(work, model.joints[other], number)
                place_row(work.placed, other, model.robot, work.frames, model.joints[other])
            verdict = exact_verdict(model, work, rows, other, i, apart, asked, 0)
            blocked |= int(verdict != FREE) << number
            if blocked & vital != 0:
                return blocked
    return blocked


@kernel(allocates=False)
def _write_frame(work: Workspace, joint: int, number: int) -> None:
    """Write the frame of a body in one lane as that of the state that is checked."""
    if joint < 0:
        return
    at, T = frame_at(work, joint) + number, work.frames[joint]
    for row in range(3):
        for column in range(4):
            T[row, column] = work.lanes[at + LANES * (4 * row + column)]


@kernel
def mark_blocked(
    model: ModelArrays, states: Array, margin: float, blocked: Array, first_only: bool
) -> bool:
    """Write which states are not free: 1 for those, 0 for the others.

    Args:
        model: The packed robot and scene.
        states: Shape (k, n) [rad or m].
        margin: Asked for on top of the pairs' own margins [m].
        blocked: Filled, shape (k,).
        first_only: Whether to leave states behind the first that is not free as they are, and some
            of those checked together with it.

    Returns:
        Whether any state is not free.
    """
    work, k, asked, is_any = workspace(model), states.shape[0], on_stack(1).view(np.int64), False
    for first in range(0, k, LANES):
        count = min(LANES, k - first)
        if count >= _FEW:
            for j in range(states.shape[1]):
                for number in range(LANES):
                    # Lanes that are not asked about hold the last state once more.
                    work.lanes[LANES * j + number] = states[first + min(number, count - 1), j]
            every = (1 << count) - 1
            found = blocked_lanes(model, work, margin, every, every if first_only else 0)
            for number in range(count):
                blocked[first + number] = float(found >> number & 1)
            is_any = is_any or found != 0
        else:
            for number in range(count):
                verdict = verdict_in(model, work, states[first + number], margin, asked)
                blocked[first + number] = 0.0 if verdict == FREE else 1.0
                is_any = is_any or verdict != FREE
                if is_any and first_only:
                    return True
        if is_any and first_only:
            return True
    return is_any
