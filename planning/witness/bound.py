"""Bound of the gap of two solids over a cell of time, along a direction that stands still.

With q_m the joints in the cell's middle and d(t) = q(t) - q_m, a point p that joints l carry is at

    w.p(t)  =  w.p + sum_l d_l(t) (w x z_l).(p - o_l)  +  rest,

so all points of a solid are bounded at once by its support along w + sum_l d_l(t) (w x z_l), and
that over time by the Bernstein coefficients of d. The rest is of second order in d. A checker
derives the same bound with balls for numbers (docs/witness.md); here it only chooses directions.
"""

import math
from typing import NamedTuple

import numpy as np

from compiled.kernel import kernel
from compiled.vec3 import Vector, cross, dot
from kinematics.arrays import Array, Indices
from obstacles.convex.piece import PieceKind
from planning.proof.collision.proposals import Proposal, ProposalRows, empty_proposal, propose
from planning.proof.collision.separating_direction import height
from planning.proof.motion_bounds import PARENT, TYPE, place

_HALFSPACE = int(PieceKind.HALFSPACE)
# What is known of a pair on a cell.
#: No direction that was tried settles it.
OPEN = 0
#: A direction settles it.
SETTLED = 1
#: The solids are as near as they must not be: no direction can.
TOUCHING = 2
#: A better direction is asked for where motion takes less than this [m] ...
_HOPELESS = 0.15
#: ... and no more than so many times what the first one leaves.
_HALVES = 4.0
#: Lengths of the directions that are told, in whole numbers: short ones where they do.
_COARSE, _FINE = 1e2, 1e9
#: What is left to checkers, whose bounds are a little wider [m].
_SPARE = 1e-8


class Solids(NamedTuple):
    """Solids of a robot and a scene (b bodies, e solids, v vertices), as ``PieceArrays``.

    Args:
        bodies: Rows TYPE and PARENT, shape (2, b).
        body: The body that carries each solid, -1 for what stands still, shape (e,).
        kinds: Kinds of the cores, as ``PieceKind``, shape (e,).
        starts: Vertices of solid i are ``columns[:, starts[i]:starts[i + 1]]``, shape (e + 1,).
        columns: Vertices, shape (3, v) [m].
        sizes: Radius, half height, rounding, shape (e, 3) [m].
        poses: Frame of each solid in that of its body, shape (e, 4, 4).
        centers: Centres of the bounding balls in the frames of the bodies, shape (e, 3) [m].
        radii: Radii of these balls, shape (e,) [m].
        proposals: The solids as GJK reads them.
    """

    bodies: Indices
    body: Indices
    kinds: Indices
    starts: Indices
    columns: Array
    sizes: Array
    poses: Array
    centers: Array
    radii: Array
    proposals: ProposalRows


class Motion(NamedTuple):
    """Motion of all bodies over a cell of time (s stretches of polynomials of k coefficients).

    Args:
        frames: T_base_body in the middle, shape (b, 4, 4).
        steps: Bernstein coefficients of the joints' way from there, shape (s, k, b) [rad or m].
        most: The largest absolute value of these, shape (b,) [rad or m].
        poses: Filled: poses of the solids in the middle, shape (e, 4, 4).
        centers: Filled: centres of the solids' balls, shape (e, 3) [m].
    """

    frames: Array
    steps: Array
    most: Array
    poses: Array
    centers: Array


class Scratch(NamedTuple):
    """Workspace of ``_reach``.

    Args:
        tilts: Turn of the direction and the offset by each joint, shape (b, 4).
        joints: The joints of these rows, shape (b,).
        heights: Sum of both solids' supports, shape (s, k) [m].
    """

    tilts: Array
    joints: Indices
    heights: Array


@kernel
def settle(solids: Solids, motion: Motion, pairs: Indices, needs: Array, way: Array) -> Indices:
    """Settle pairs of solids on a cell of time, SETTLED, OPEN or TOUCHING for each, shape (m,).

    Args:
        solids: The solids.
        motion: Motion of their bodies over the cell.
        pairs: Pairs of solids; no first one is a half-space, shape (m, 2).
        needs: Distance that each pair has to keep, shape (m,) [m].
        way: Direction to try first, 0 for none, in the frame of the body where the two solids'
            bodies meet; overwritten by the one that settles the pair, of any length, shape (m, 3).
    """
    found, proposal = np.zeros(pairs.shape[0], dtype=np.int64), empty_proposal()
    b = motion.frames.shape[0]
    scratch = Scratch(
        np.empty((b, 4)), np.empty(b, dtype=np.int64), np.empty(motion.steps.shape[:2])
    )
    for e in range(solids.kinds.shape[0]):
        place(
            solids.body[e], e, motion.frames, solids.poses, solids.centers, motion.poses,
            motion.centers,
        )  # fmt: skip
    for m in range(pairs.shape[0]):
        found[m] = _settle_pair(
            solids, motion, (pairs[m, 0], pairs[m, 1]), needs[m], way[m], (scratch, proposal)
        )
    return found


@kernel(allocates=False)
def _settle_pair(
    solids: Solids,
    motion: Motion,
    pair: tuple[int, int],
    need: float,
    way: Array,
    work: tuple[Scratch, Proposal],
) -> int:
    (a, b), (scratch, proposal), centers = pair, work, motion.centers
    meeting = _meeting(solids.bodies, solids.body[a], solids.body[b])
    if solids.kinds[b] == _HALFSPACE:
        T = motion.poses
        u = (-T[b, 0, 2], -T[b, 1, 2], -T[b, 2, 2])
        gap, loss = _gap(solids, motion, pair, meeting, u, scratch, need)
        return SETTLED if gap - loss > need + _SPARE else TOUCHING if gap <= need else OPEN
    u = (
        centers[b, 0] - centers[a, 0], centers[b, 1] - centers[a, 1], centers[b, 2] - centers[a, 2],
    )  # fmt: skip
    if way[0] != 0.0 or way[1] != 0.0 or way[2] != 0.0:
        u = _turned(motion.frames, meeting, (way[0], way[1], way[2]))
    gap, loss = _try(solids, motion, pair, meeting, u, scratch, (need, _COARSE), way)
    if gap - loss > need + _SPARE:
        return SETTLED
    if loss > _HOPELESS or loss > _HALVES * max(gap - need, 1e-3):
        return OPEN
    axis = proposal.axis
    axis[0], axis[1], axis[2] = -u[0], -u[1], -u[2]
    upper = propose(
        solids.proposals, a, b, motion.poses, centers, need + 2.0 * loss + 1e-3, proposal
    )
    u = (-axis[0], -axis[1], -axis[2])
    for digits in (_COARSE, _FINE):
        gap, loss = _try(solids, motion, pair, meeting, u, scratch, (need, digits), way)
        if gap - loss > need + _SPARE:
            return SETTLED
    return TOUCHING if upper <= need else OPEN


@kernel(allocates=False)
def _try(
    solids: Solids,
    motion: Motion,
    pair: tuple[int, int],
    meeting: int,
    u: Vector,
    scratch: Scratch,
    wanted: tuple[float, float],
    way: Array,
) -> tuple[float, float]:
    """Try a direction, rounded in the frame of the body where both meet, and write it there."""
    need, digits = wanted
    length = math.sqrt(dot(u, u))
    if not length > 0.0:
        return -np.inf, 0.0
    if meeting >= 0:
        R = motion.frames[meeting]
        u = (
            R[0, 0] * u[0] + R[1, 0] * u[1] + R[2, 0] * u[2],
            R[0, 1] * u[0] + R[1, 1] * u[1] + R[2, 1] * u[2],
            R[0, 2] * u[0] + R[1, 2] * u[1] + R[2, 2] * u[2],
        )
    for k in range(3):
        way[k] = np.rint(u[k] / length * digits)
    w = _turned(motion.frames, meeting, (way[0], way[1], way[2]))
    length = math.sqrt(dot(w, w))
    w = (w[0] / length, w[1] / length, w[2] / length)
    return _gap(solids, motion, pair, meeting, w, scratch, need)


@kernel(allocates=False)
def _turned(frames: Array, body: int, u: Vector) -> Vector:
    """A vector in the base's axes, given in those of a body."""
    if body < 0:
        return u
    R, (x, y, z) = frames[body], u
    return (
        R[0, 0] * x + R[0, 1] * y + R[0, 2] * z,
        R[1, 0] * x + R[1, 1] * y + R[1, 2] * z,
        R[2, 0] * x + R[2, 1] * y + R[2, 2] * z,
    )


@kernel(allocates=False)
def _meeting(bodies: Indices, a: int, b: int) -> int:
    """The last body that two bodies both hang on, one of them it may be; -1 for the base."""
    while a != b:
        if a > b:
            a = bodies[PARENT, a]
        else:
            b = bodies[PARENT, b]
    return a


@kernel(allocates=False)
def _gap(
    solids: Solids,
    motion: Motion,
    pair: tuple[int, int],
    meeting: int,
    u: Vector,
    scratch: Scratch,
    need: float,
) -> tuple[float, float]:
    """Gap of two solids along a unit direction in the middle, and how much less it can be [m]."""
    (a, b), heights, back = pair, scratch.heights, (-u[0], -u[1], -u[2])
    middle = -_height(solids, motion, a, u) - _height(solids, motion, b, back)
    heights[:, :] = 0.0
    rest = 0.0
    for k, w in ((a, u), (b, back)):
        rest += _add_reach(solids, motion, k, meeting, w, scratch, middle - rest > need)
        if middle - rest <= need:
            return middle, rest
    highest = -np.inf
    for s in range(heights.shape[0]):
        for i in range(heights.shape[1]):
            highest = max(highest, heights[s, i])
    return middle, middle + highest + rest


@kernel(allocates=False)
def _height(solids: Solids, motion: Motion, k: int, w: Vector) -> float:
    """Support of solid k in the middle along a unit direction [m]; of a half-space its plane."""
    T = motion.poses
    rounding = solids.sizes[k, 2]
    if solids.kinds[k] == _HALFSPACE:
        return float(T[k, 0, 3] * w[0] + T[k, 1, 3] * w[1] + T[k, 2, 3] * w[2] + rounding)
    size, (first, last) = (solids.sizes[k, 0], solids.sizes[k, 1], 0.0), _span(solids, k)
    along = height(solids.kinds[k], size, solids.columns, first, last, T, k, w)
    return float(along + rounding)


@kernel(allocates=False)
def _span(solids: Solids, k: int) -> tuple[int, int]:
    return solids.starts[k], solids.starts[k + 1]


@kernel(allocates=False)
def _add_reach(
    solids: Solids,
    motion: Motion,
    k: int,
    meeting: int,
    w: Vector,
    scratch: Scratch,
    whole: bool,
) -> float:
    """Add the supports of solid k to ``scratch.heights``, if asked; bound of the rest [m]."""
    bodies, frames, tilts, heights = solids.bodies, motion.frames, scratch.tilts, scratch.heights
    center = (motion.centers[k, 0], motion.centers[k, 1], motion.centers[k, 2])
    body, count, far, rest = solids.body[k], 0, 0.0, 0.0
    while body != meeting:
        F, most = frames[body], motion.most[body]
        z = (F[0, 2], F[1, 2], F[2, 2])
        if bodies[TYPE, body] == 1:
            tilts[count, 0], tilts[count, 1], tilts[count, 2] = 0.0, 0.0, 0.0
            tilts[count, 3] = dot(w, z)
            far += most
        else:
            o = (F[0, 3], F[1, 3], F[2, 3])
            tilt = cross(w, z)
            tilts[count, 0], tilts[count, 1], tilts[count, 2] = tilt
            tilts[count, 3] = -dot(tilt, o)
            arm = cross((center[0] - o[0], center[1] - o[1], center[2] - o[2]), z)
            lever = math.sqrt(dot(arm, arm)) + solids.radii[k] - solids.sizes[k, 2] + far
            rest += most * (far + 0.5 * lever * most)
            far += lever * most
        scratch.joints[count] = body
        count += 1
        body = bodies[PARENT, body]
    if not whole:
        return rest
    if count == 0:
        heights += _height(solids, motion, k, w)
        return rest
    size, (first, last) = (solids.sizes[k, 0], solids.sizes[k, 1], 0.0), _span(solids, k)
    for s in range(heights.shape[0]):
        for i in range(heights.shape[1]):
            x, y, z0 = w
            shift = solids.sizes[k, 2]
            for row in range(count):
                step = motion.steps[s, i, scratch.joints[row]]
                x += step * tilts[row, 0]
                y += step * tilts[row, 1]
                z0 += step * tilts[row, 2]
                shift += step * tilts[row, 3]
            heights[s, i] += shift + height(
                solids.kinds[k], size, solids.columns, first, last, motion.poses, k, (x, y, z0)
            )
    return rest
