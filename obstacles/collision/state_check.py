"""The verdict on one configuration: free, colliding, exact where a sphere bracket can't decide.

A body's ball walks the tree of what stands around; what it meets is met by each of its pieces, from
one sphere about the piece down to the finest ones, at distances in closed form. A piece whose outer
spheres are all clear of a solid is free of it; where an inner one meets it, it collides. Pairs that
neither settles take the exact test: the distance iteration (`gjk`) on their covers, then their
triangles. A self-collision pair is looked up on its grid first; where there are many, groups of
them are parted by balls, and the group that collided twice in turn comes first: where a search is
stuck, or a robot is built so, it is that again. Poses of whole pieces are only worked out for the
exact test.
"""

import math
from typing import NamedTuple

import numpy as np

from compiled.kernel import kernel
from compiled.vec3 import Vector, dot, row, subtract
from kinematics.arrays import Array, Indices
from kinematics.forward import frames_kernel
from obstacles.collision.edge_check import COLLIDING, FREE, ROUNDING_ERROR, UNDECIDED
from obstacles.collision.model.brackets import AFTER, INNER, OUTER
from obstacles.collision.model.kernel_work import (
    LAST_GROUP,
    LAST_MET,
    MET_TWICE,
    Workspace,
    moved,
    place_ball,
    place_ball_once,
    place_row,
    workspace,
)
from obstacles.collision.model.model_arrays import ModelArrays
from obstacles.collision.model.pair_grid import grid_bound
from obstacles.collision.model.pair_groups import (
    BALL,
    FIRST_PAIR,
    GROUP_SIZE,
    LAST_PAIR,
    OTHER_BALL,
    PARTED,
)
from obstacles.distance.ball_distance import bound_from, closed_form
from obstacles.distance.bounds import balls_apart, quick_bound
from obstacles.distance.bvh import FIRST, LAST, SKIP, gap
from obstacles.distance.gjk import CLOSER, FARTHER, STILL, separation
from obstacles.distance.piece_set import CENTER, MARGIN, NODE_STOP, OWNER, RADIUS, Pair, Shapes
from obstacles.distance.triangles.distance import surface_distance


class _Spheres(NamedTuple):
    """The spheres of one piece of the robot.

    Args:
        first: The first of them.
        end: The one behind the last.
        joint: The joint that carries them, -1 for the base.
    """

    first: int
    end: int
    joint: int


@kernel(allocates=False)
def verdict_in(model: ModelArrays, work: Workspace, q: Array, margin: float, asked: Indices) -> int:
    """The verdict on configuration q (n,).

    Args:
        model: The packed robot and scene.
        work: A workspace of the model.
        q: Shape (n,).
        margin: Asked for on top of the pairs' own margins [m].
        asked: Filled with how many pairs the brackets left open, and as many of them as fit,
            shape (1 + r,). Where any fits (r > 0) they are flagged and not asked.

    Returns:
        FREE, COLLIDING, or UNDECIDED: a pair comes within a millionth of a metre of its margin, or
        is flagged.
    """
    asked[0] = 0
    work.stamps[-1] += 1
    for joint in range(q.shape[0]):
        work.joints[0, joint] = q[joint]
    frames_kernel(model.chain, q, work.frames)
    verdict = FREE
    # The body that met something last comes first: where a search is stuck, it is that again.
    last, count = int(work.tally[LAST_MET]), model.bodies.shape[0]
    if last >= count:  # of a model with more bodies, as a workspace may be shared by parts of one
        last = 0
    many, apart = work.tally[LAST_GROUP] >= 0.0, model.own_margin + margin
    if many:
        # The group that met twice in turn, if one did, comes first of all.
        group = int(work.tally[LAST_GROUP]) - 1
        # A workspace may be shared by parts of a model, whose groups have other numbers.
        if group < 0 or group >= model.groups.shape[0] or model.groups[group, PARTED] < 0:
            work.tally[LAST_GROUP], work.tally[MET_TWICE] = 0.0, 0.0
        elif work.tally[MET_TWICE] != 0.0:
            verdict = _whole_verdict(model, work, group, apart, asked)
            if verdict == COLLIDING:
                return verdict
    for turn in range(count):
        body = last if turn == 0 else turn - 1 if turn <= last else turn
        found = _around_body(model, work, body, model.margin + margin, asked)
        if found == COLLIDING:
            work.tally[LAST_MET] = body
            if many:
                work.tally[LAST_GROUP] = 0.0
            return found
        verdict = max(verdict, found)
    found = group_verdict(model, work, apart, asked)
    return found if found == COLLIDING else max(verdict, found)


@kernel(allocates=False, inline="always")
def _around_body(
    model: ModelArrays, work: Workspace, body: int, extra: float, asked: Indices
) -> int:
    """The verdict on all pieces of a body against what stands around."""
    row, halfspaces = model.bodies[body, 0], model.halfspaces
    nodes, items, rows = model.nodes, model.items, model.robot
    place_ball(rows, row, work.frames, model.joints[row], work.placed)
    placed, verdict, halfspace = work.placed, FREE, 0
    x, y, z = placed[row, CENTER], placed[row, CENTER + 1], placed[row, CENTER + 2]
    reach = max(rows[row, RADIUS] + extra + ROUNDING_ERROR, 0.0)
    square, node, end, entry, stop = reach * reach, 0, nodes.shape[0], 0, 0
    # One loop over half-spaces, nodes and what is in them: what it does is pasted in once.
    while True:
        if entry < stop:
            k = items[entry]
            entry += 1
        elif node < end:
            if gap(nodes, node, x, y, z) > square:
                node = int(nodes[node, SKIP])
            else:
                entry, stop = int(nodes[node, FIRST]), int(nodes[node, LAST])
                node += 1
            continue
        elif halfspace < halfspaces.shape[0]:
            k = halfspaces[halfspace]
            halfspace += 1
        else:
            return verdict
        found = _body_against(model, work, body, k, extra, asked)
        if found == COLLIDING:
            return found
        verdict = max(verdict, found)


@kernel(allocates=False, inline="always")
def _body_against(
    model: ModelArrays, work: Workspace, body: int, k: int, extra: float, asked: Indices
) -> int:
    """The verdict on all pieces of a body against piece k of the scene."""
    row, first, last = model.bodies[body, 0], model.bodies[body, 1], model.bodies[body, 2]
    scene, placed = model.scene, work.placed
    apart = scene[k, MARGIN] + extra
    x, y, z = placed[row, CENTER], placed[row, CENTER + 1], placed[row, CENTER + 2]
    if last - first > 1:
        bound = bound_from(scene, k, model.corners, x, y, z)
        if bound > model.robot[row, RADIUS] + apart + ROUNDING_ERROR:
            return FREE
    verdict = FREE
    for entry in range(first, last):
        i = model.carried[entry]
        if model.skipped[i, int(scene[k, OWNER])]:
            continue
        found = _bracket(model, work, i, k, apart)
        if found == UNDECIDED:
            found = exact_verdict(model, work, scene, k, i, apart, asked, i * scene.shape[0] + k)
        if found == COLLIDING:
            return found
        verdict = max(verdict, found)
    return verdict


@kernel(allocates=False, inline="always")
def _bracket(model: ModelArrays, work: Workspace, i: int, k: int, apart: float) -> int:
    """The verdict of the spheres of piece i of the robot on piece k of the scene.

    Returns:
        FREE, COLLIDING, or UNDECIDED: the exact test is to be asked.
    """
    spheres, frames, joint = model.spheres, work.frames, model.joints[i]
    sphere, end = model.sphere_starts[i], model.sphere_starts[i + 1]
    rows, corners = model.scene, model.corners
    # What covers a part of a mesh may hold more than it: it is free, but never struck, by itself.
    exact = closed_form(rows, k) and not rows[k, NODE_STOP] > 0.0
    while sphere < end:
        x, y, z = moved(frames, joint, row(spheres, sphere))
        distance = bound_from(rows, k, corners, x, y, z)
        if distance > spheres[sphere, OUTER] + apart + ROUNDING_ERROR:
            sphere = int(spheres[sphere, AFTER])
            continue
        if exact and distance <= spheres[sphere, INNER] + apart - ROUNDING_ERROR:
            return COLLIDING
        sphere += 1
        if spheres[sphere - 1, AFTER] == sphere:
            return UNDECIDED
    return FREE


@kernel(allocates=False)
def _bracket_pair(
    spheres: Array, one: _Spheres, other: _Spheres, frames: Array, apart: float, deep: bool
) -> int:
    """``_bracket`` of two pieces of the robot: the finest spheres of one that come near the other.

    Links are built close together: below the first spheres (``deep``) the exact test is done
    sooner. Inner radii below 0 prove what they say too: with s and t the signed distances from the
    pieces, these are at most |c - d| + s(c) + t(d) apart.
    """
    a, a_end, a_joint = one
    b, b_end, b_joint = other
    middle, far = _moved(spheres, b, frames, b_joint), spheres[b, OUTER] + apart + ROUNDING_ERROR
    while a < a_end:
        center = _moved(spheres, a, frames, a_joint)
        away = subtract(center, middle)
        if dot(away, away) > (spheres[a, OUTER] + far) ** 2:
            a = int(spheres[a, AFTER])
            continue
        if not deep:
            return UNDECIDED
        a += 1
        if spheres[a - 1, AFTER] != a:
            continue
        k, reach = b, spheres[a - 1, OUTER] + apart + ROUNDING_ERROR
        while k < b_end:
            away = subtract(center, _moved(spheres, k, frames, b_joint))
            distance = math.sqrt(dot(away, away))
            if distance > spheres[k, OUTER] + reach:
                k = int(spheres[k, AFTER])
                continue
            overlap = spheres[a - 1, INNER] + spheres[k, INNER] + apart - ROUNDING_ERROR
            if distance <= overlap:
                return COLLIDING
            k += 1
            if spheres[k - 1, AFTER] == k:
                return UNDECIDED
    return FREE


@kernel(allocates=False)
def _moved(spheres: Array, k: int, frames: Array, joint: int) -> Vector:
    """The centre of a sphere in the base frame."""
    p = row(spheres, k)
    return p if joint < 0 else moved(frames, joint, p)


@kernel(allocates=False)
def blocked_at(
    model: ModelArrays, work: Workspace, a: Array, b: Array, margin: float,
    parts: int, checks: int, asked: Indices,
) -> float:  # fmt: skip
    """Share of the straight motion from a to b (n,) at which a state is not free, else -1.

    States cost a tenth of a proof: most motions that collide are refused by them. First comes the
    end (in one part), then the middle, the quarters and so on.

    Args:
        model: The packed robot and scene.
        work: A workspace of the model.
        a: Start of the motion, shape (n,) [rad or m].
        b: End of the motion, shape (n,).
        margin: Asked for on top of the pairs' own margins [m].
        parts: Into which the motion is divided at first, a power of 2; 1 where the end is open.
        checks: Parts at last.
        asked: Room, shape (1,).
    """
    q = work.joints[1]
    while parts <= checks:
        # Of all n / parts those that were not checked before: odd n, and the end itself.
        for part in range(1, parts + 1, 2):
            share = part / parts
            for joint in range(q.shape[0]):
                q[joint] = a[joint] + (b[joint] - a[joint]) * share
            if verdict_in(model, work, q, margin, asked) != FREE:
                return share
        parts *= 2
    return -1.0


@kernel
def verdict_on(model: ModelArrays, q: Array, margin: float) -> int:
    """``verdict_in`` in a workspace of its own."""
    return verdict_in(model, workspace(model), q, margin, np.empty(1, dtype=np.int64))


@kernel(allocates=False)
def group_verdict(model: ModelArrays, work: Workspace, apart: float, asked: Indices) -> int:
    """The verdict on all groups but the one that ``verdict_in`` asked first."""
    groups, group, verdict, tally = model.groups, 0, FREE, work.tally
    asked_before = int(tally[LAST_GROUP]) - 1 if tally[MET_TWICE] > 0.0 else -1
    while group < groups.shape[0]:
        here, parted = group, groups[group, PARTED] < 0
        one, other = groups[here, BALL], groups[here, OTHER_BALL]
        place_ball_once(model, work, one)
        place_ball_once(model, work, other)
        if balls_apart(work.placed, one, other) > apart + ROUNDING_ERROR:
            group += groups[here, GROUP_SIZE] if parted else 1
            continue
        group += 1
        if parted or here == asked_before:
            continue
        found = _whole_verdict(model, work, here, apart, asked)
        if found == COLLIDING:
            if tally[LAST_GROUP] >= 0.0:
                tally[MET_TWICE] = 1.0 if tally[LAST_GROUP] == here + 1 else 0.0
                tally[LAST_GROUP] = here + 1
            return found
        verdict = max(verdict, found)
    return verdict


@kernel(allocates=False)
def _whole_verdict(
    model: ModelArrays, work: Workspace, group: int, apart: float, asked: Indices
) -> int:
    """The verdict on pairs of a group that is not parted, by balls, grids, spheres and solids."""
    first_pair, verdict = model.skipped.shape[0] * model.scene.shape[0], FREE
    for s in range(model.groups[group, FIRST_PAIR], model.groups[group, LAST_PAIR]):
        i, j = model.self_pairs[s, 0], model.self_pairs[s, 1]
        place_ball_once(model, work, i)
        place_ball_once(model, work, j)
        if balls_apart(work.placed, i, j) > apart + ROUNDING_ERROR:
            continue
        if model.grid_axes[s, 0, 2] > 0.0:
            proved = grid_bound(
                model.grid_axes, model.grid_starts, model.grid_values, s, model.joints[i],
                work.joints,
            )  # fmt: skip
            if proved > apart + ROUNDING_ERROR:
                continue
        found = _bracket_pair(
            model.spheres,
            _Spheres(model.sphere_starts[i], model.sphere_starts[i + 1], model.joints[i]),
            _Spheres(model.sphere_starts[j], model.sphere_starts[j + 1], model.joints[j]),
            work.frames, apart, asked.shape[0] > 1,
        )  # fmt: skip
        if found == UNDECIDED:
            place_whole(model, work, i)
            found = exact_verdict(model, work, work.placed, i, j, apart, asked, first_pair + s)
        if found == COLLIDING:
            return found
        verdict = max(verdict, found)
    return verdict


@kernel(allocates=False)
def exact_verdict(
    model: ModelArrays, work: Workspace, rows: Array, k: int, i: int, apart: float, asked: Indices,
    number: int,
) -> int:  # fmt: skip
    """The exact verdict on piece i of the robot and piece k of ``rows``, or a flag for it."""
    asked[0] += 1
    if asked.shape[0] > 1:
        if asked[0] < asked.shape[0]:
            asked[asked[0]] = number
        return UNDECIDED
    place_whole(model, work, i)
    enough, axis = apart + ROUNDING_ERROR, work.buffer[8]
    pair = Pair(rows, k, work.placed, i)
    lower, n = quick_bound(rows, k, work.placed, i, enough)
    if lower > enough:
        return FREE
    axis[0], axis[1], axis[2] = n
    verdict, _, _ = separation(
        pair, model.corners, model.tables, apart, enough, STILL, axis, work.buffer
    )
    if verdict != FARTHER and (rows[k, NODE_STOP] > 0.0 or work.placed[i, NODE_STOP] > 0.0):
        shapes = Shapes(model.corners, model.tables, model.surfaces)
        verdict, _ = surface_distance(pair, shapes, apart, enough, axis, work.buffer, work.stack)
    if verdict == FARTHER:
        return FREE
    return COLLIDING if verdict == CLOSER else UNDECIDED


@kernel(allocates=False)
def place_whole(model: ModelArrays, work: Workspace, i: int) -> None:
    """Bring piece i into the base frame if it is not there yet."""
    if work.stamps[i] != work.stamps[-1]:
        work.stamps[i] = work.stamps[-1]
        place_row(work.placed, i, model.robot, work.frames, model.joints[i])
