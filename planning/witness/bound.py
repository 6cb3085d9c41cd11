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
from compiled.vec3 import Vector, cross, dot, rotate, turned_back
from kinematics.arrays import Array, Indices
from obstacles.convex.piece import PieceKind
from planning.proof.collision.displacement import meeting_body
from planning.proof.collision.proposals import Proposal, ProposalRows, empty_proposal, propose
from planning.proof.collision.separating_direction import height
from planning.proof.joint_frames import forward_kernel, mimic_frames
from planning.proof.motion_bounds import PARENT, TYPE, place

_HALFSPACE = int(PieceKind.HALFSPACE)
# What is known of a pair on a cell.
#: No direction that was tried settles it.
OPEN = 0
#: A direction settles it.
SETTLED = 1
#: The solids are as near as they must not be: no direction can.
TOUCHING = 2
#: No direction is asked for where motion takes more than this [m]: halves will have better ones.
_HOPELESS = 0.2
#: Nor is any tried where motion of second order takes more than this share of the way between both.
_FAR_SHARE = 0.7
#: Supports are not looked at where balls about the solids take so many times what there is.
_TOO_FAR = 2.0
#: Pairs that are looked at before it is asked what time it is.
_AT_ONCE = 20_000
#: Lengths of the directions that are told, in whole numbers: short ones where they do.
_COARSE, _FINE = 63.0, 1e9
#: What is left to checkers, whose bounds are a little wider [m].
_SPARE = 1e-8


class Solids(NamedTuple):
    """Solids of a robot and a scene (b bodies, e solids, v vertices), as ``PieceArrays``.

    Args:
        bodies: Rows TYPE and PARENT, shape (2, b).
        offsets: Frames of the joints at 0 in those of the bodies before, shape (b, 4, 4).
        leads: Multiplier and offset of the joints that follow others, shape (f, 2).
        leaders: Joints that these follow, shape (f,).
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
    offsets: Array
    leads: Array
    leaders: Indices
    body: Indices
    kinds: Indices
    starts: Indices
    columns: Array
    sizes: Array
    poses: Array
    centers: Array
    radii: Array
    proposals: ProposalRows


class Cells(NamedTuple):
    """Workspace: motion of all bodies over a cell of time (s stretches of k coefficients).

    Args:
        rise: C(i, m) / C(k - 1, m) for coefficients i and powers m, shape (k, k).
        steps: Bernstein coefficients of the joints' way from the middle, shape (s k, b) [rad or m].
        most: The largest absolute value of these, shape (b,) [rad or m].
        middle: Positions of the joints in the middle, shape (b,) [rad or m].
        frames: T_base_body in the middle, shape (b, 4, 4).
        poses: Poses of the solids in the middle, shape (e, 4, 4).
        centers: Centres of the solids' balls, shape (e, 3) [m].
        far: How far a solid moves to first order, seen from a body (the base is 0), (e, b + 1) [m].
        rests: Bound of all that is left, likewise [m].
        twists: Turn and shift of each body, the base first, to first order: a point p that is fixed
            to it goes by turn x p + shift, shape (b + 1, 6, s k).
        heights: Sum of both solids' supports, shape (s k,) [m].
    """

    rise: Array
    steps: Array
    most: Array
    middle: Array
    frames: Array
    poses: Array
    centers: Array
    far: Array
    rests: Array
    twists: Array
    heights: Array


class Search(NamedTuple):
    """State of a search: all cells of one depth are looked at together, each with its open pairs.

    Args:
        depth: How often time was halved.
        numbers: Cell of each open pair, counted in its depth, ascending, shape (m,).
        rows: The open pairs, shape (m,).
        ways: Direction to try first for each, 0 for none, shape (m, 3).
        cells: Cells with facts, begin and end as shares of the motion, shape (c, 2).
        facts: Two solids, cell, direction in the frame of the body where the two solids' bodies
            meet, and SETTLED or another state, shape (f, 7).
        told: How many facts there are, and cells.
    """

    depth: int
    numbers: Indices
    rows: Indices
    ways: Array
    cells: Array
    facts: Indices
    told: tuple[int, int]


@kernel
def search(
    solids: Solids,
    motion: tuple[Array, Array],
    pairs: Indices,
    needs: Array,
    begun: Search,
    last: int,
) -> Search:
    """Search directions that settle pairs on more levels of cells, and tell them.

    Args:
        solids: The solids.
        motion: Breaks and coefficients of the trajectory.
        pairs: Pairs of solids; no first one is a half-space, shape (p, 2).
        needs: Distance that each pair has to keep, shape (p,) [m].
        begun: The search so far.
        last: Depth at which all that is left is told as open.
    """
    work, looked = (_workspace(solids, motion[1]), empty_proposal()), 0
    while looked < _AT_ONCE and begun.depth <= last and len(begun.rows) > 0:
        looked += len(begun.rows)
        begun = _search_level(solids, motion, (pairs, needs), begun, last, work)
    return begun


@kernel
def _search_level(
    solids: Solids,
    motion: tuple[Array, Array],
    asked: tuple[Indices, Array],
    begun: Search,
    last: int,
    work: tuple[Cells, Proposal],
) -> Search:
    (pairs, needs), (w, proposal) = asked, work
    depth, numbers, rows, ways, cells, facts, (f, c) = begun
    left = np.empty(len(rows), dtype=np.int64)
    whole, share = motion[0][-1], 0.5**depth
    entered, used, count, k = -1, False, 0, 0
    for m in range(len(rows)):
        if numbers[m] != entered:
            entered, used = numbers[m], False
            begin, end = whole * (entered * share), whole * ((entered + 1) * share)
            count = _enter(solids, motion, begin, end, w)
        row = rows[m]
        pair = pairs[row, 0], pairs[row, 1]
        state = _settle_pair(solids, w, count, pair, needs[row], ways[m], proposal)
        if state == OPEN and depth < last:
            left[k] = m
            k += 1
            continue
        if f == len(facts):
            facts = np.concatenate((facts, np.empty_like(facts)))
        if c == len(cells):
            cells = np.concatenate((cells, np.empty_like(cells)))
        if not used:
            cells[c, 0], cells[c, 1] = entered * share, (entered + 1) * share
            used = True
            c += 1
        facts[f, 0], facts[f, 1], facts[f, 2], facts[f, 6] = pair[0], pair[1], c - 1, state
        for i in range(3):
            facts[f, 3 + i] = int(ways[m, i])
        f += 1
    return _halved(begun, left[:k], (cells, facts, (f, c)))


@kernel
def _halved(begun: Search, left: Indices, told: tuple[Array, Indices, tuple[int, int]]) -> Search:
    """The halves of all cells, with the pairs ``left`` open, those of one half together."""
    numbers, rows = np.empty(2 * len(left), np.int64), np.empty(2 * len(left), np.int64)
    ways, first, at = np.empty((2 * len(left), 3)), 0, 0
    while first < len(left):
        stop, number = first, begun.numbers[left[first]]
        while stop < len(left) and begun.numbers[left[stop]] == number:
            stop += 1
        for half in range(2):
            for m in range(first, stop):
                numbers[at], rows[at] = 2 * number + half, begun.rows[left[m]]
                ways[at] = begun.ways[left[m]]
                at += 1
        first = stop
    return Search(begun.depth + 1, numbers, rows, ways, told[0], told[1], told[2])


@kernel
def _workspace(solids: Solids, coefficients: Array) -> Cells:
    pieces, _, k = coefficients.shape
    b, e = solids.bodies.shape[1], solids.kinds.shape[0]
    rise = np.zeros((k, k))
    for i in range(k):
        rise[i, 0] = 1.0
        for m in range(1, i + 1):
            rise[i, m] = rise[i, m - 1] * (i - m + 1) / (k - m)
    w = Cells(
        rise, np.zeros((pieces * k, b)), np.empty(b), np.empty(b), np.zeros((b, 4, 4)),
        np.zeros((e, 4, 4)), np.zeros((e, 3)), np.zeros((e, b + 1)), np.zeros((e, b + 1)),
        np.zeros((b + 1, 6, pieces * k)), np.empty(pieces * k),
    )  # fmt: skip
    for i in range(e):
        if solids.body[i] < 0:
            place(-1, i, w.frames, solids.poses, solids.centers, w.poses, w.centers)
    return w


@kernel(allocates=False)
def _enter(solids: Solids, motion: tuple[Array, Array], begin: float, end: float, w: Cells) -> int:
    """Move all bodies over a cell, and tell how many Bernstein coefficients there are."""
    (breaks, c), middle = motion, 0.5 * (begin + end)
    n, k, b = c.shape[1], c.shape[2], w.most.shape[0]
    first = 0
    while breaks[first + 1] <= begin:
        first += 1
    last = used = first
    while breaks[last + 1] < end:
        last += 1
        used = last if breaks[last] <= middle else used
    for j in range(n):
        w.middle[j] = 0.0
        for i in range(k - 1, -1, -1):
            w.middle[j] = w.middle[j] * (middle - breaks[used]) + c[used, j, i]
    for f in range(b - n):
        w.middle[n + f] = solids.leads[f, 0] * w.middle[solids.leaders[f]] + solids.leads[f, 1]
    w.most[:] = 0.0
    for i in range(first, last + 1):
        s = max(begin - breaks[i], 0.0)
        h = min(end, breaks[i + 1]) - breaks[i] - s
        at = (i - first) * k
        for j in range(n):
            _add_steps(c[i, j], s, h, w, j, at)
        for f in range(b - n):
            for row in range(at, at + k):
                w.steps[row, n + f] = solids.leads[f, 0] * w.steps[row, solids.leaders[f]]
    count = (last - first + 1) * k
    for row in range(count):
        for j in range(b):
            w.most[j] = max(w.most[j], abs(w.steps[row, j]))
    forward_kernel(solids.bodies[TYPE], solids.offsets, w.middle[:n], w.frames)
    mimic_frames(solids.bodies, solids.offsets, n, w.middle, w.frames)
    for j in range(b):
        _twist(solids, w, j, count)
    for e in range(solids.kinds.shape[0]):
        if solids.body[e] >= 0:
            place(solids.body[e], e, w.frames, solids.poses, solids.centers, w.poses, w.centers)
            _bound_moves(solids, w, e)
    return int(count)


@kernel(allocates=False, inline="code")
def _add_steps(c: Array, s: float, h: float, w: Cells, j: int, at: int) -> None:
    """Write the Bernstein coefficients of joint j on [s, s + h] from row ``at`` on."""
    k, a = c.shape[0], w.heights
    for i in range(k):
        a[i] = c[i]
    for low in range(k - 1):
        for i in range(k - 2, low - 1, -1):
            a[i] += s * a[i + 1]
    a[0] -= w.middle[j]
    power = 1.0
    for i in range(k):
        a[i] *= power
        power *= h
    for i in range(k):
        total = 0.0
        for m in range(i + 1):
            total += w.rise[i, m] * a[m]
        w.steps[at + i, j] = total


@kernel(allocates=False, inline="code")
def _twist(solids: Solids, w: Cells, j: int, count: int) -> None:
    """Write the twist of body j, by that of the body before it."""
    F, own, before = w.frames[j], w.twists[j + 1], w.twists[solids.bodies[PARENT, j] + 1]
    z, o, turn = (F[0, 2], F[1, 2], F[2, 2]), (F[0, 3], F[1, 3], F[2, 3]), (0.0, 0.0, 0.0)
    shift = z
    if solids.bodies[TYPE, j] == 0:
        turn, shift = z, cross(o, z)
    for axis in range(3):
        for i in range(count):
            own[axis, i] = before[axis, i] + w.steps[i, j] * turn[axis]
            own[3 + axis, i] = before[3 + axis, i] + w.steps[i, j] * shift[axis]


@kernel(allocates=False, inline="code")
def _bound_moves(solids: Solids, w: Cells, e: int) -> None:
    """Bound how far solid e moves, seen from each body that it hangs on."""
    far, rest, body, center = 0.0, 0.0, solids.body[e], w.centers[e]
    radius = solids.radii[e] - solids.sizes[e, 2]
    while True:
        w.far[e, body + 1], w.rests[e, body + 1] = far, rest
        if body < 0:
            return
        F, most = w.frames[body], w.most[body]
        if solids.bodies[TYPE, body] == 1:
            far += most
        else:
            z = (F[0, 2], F[1, 2], F[2, 2])
            arm = cross((center[0] - F[0, 3], center[1] - F[1, 3], center[2] - F[2, 3]), z)
            lever = math.sqrt(dot(arm, arm)) + radius + far
            rest += most * (far + 0.5 * lever * most)
            far += lever * most
        body = solids.bodies[PARENT, body]


@kernel(allocates=False, inline="code")
def _settle_pair(
    solids: Solids,
    w: Cells,
    count: int,
    pair: tuple[int, int],
    need: float,
    way: Array,
    proposal: Proposal,
) -> int:
    (a, b), centers, T = pair, w.centers, w.poses
    meeting = meeting_body(solids.bodies, solids.body[a], solids.body[b])
    known = (count, meeting, need)
    if solids.kinds[b] == _HALFSPACE:
        u = (-T[b, 0, 2], -T[b, 1, 2], -T[b, 2, 2])
        gap, loss = _gap(solids, w, pair, known, u)
        return SETTLED if gap - loss > need + _SPARE else TOUCHING if gap <= need else OPEN
    u = (
        centers[b, 0] - centers[a, 0], centers[b, 1] - centers[a, 1], centers[b, 2] - centers[a, 2],
    )  # fmt: skip
    if way[0] != 0.0 or way[1] != 0.0 or way[2] != 0.0:
        u = _turned(w.frames, meeting, (way[0], way[1], way[2]))
    elif w.rests[a, meeting + 1] + w.rests[b, meeting + 1] > _FAR_SHARE * math.sqrt(dot(u, u)):
        return OPEN
    gap, loss = _try(solids, w, pair, known, u, _COARSE, way)
    if gap - loss > need + _SPARE:
        return SETTLED
    if loss > _HOPELESS:
        way[:] = 0.0
        return OPEN
    axis = proposal.axis
    axis[0], axis[1], axis[2] = -u[0], -u[1], -u[2]
    upper = propose(solids.proposals, a, b, T, centers, need + 2.0 * loss + 1e-3, proposal)
    u = (-axis[0], -axis[1], -axis[2])
    for digits in (_COARSE, _FINE):
        gap, loss = _try(solids, w, pair, known, u, digits, way)
        if gap - loss > need + _SPARE:
            return SETTLED
    return TOUCHING if upper <= need else OPEN


@kernel(allocates=False, inline="code")
def _try(
    solids: Solids,
    w: Cells,
    pair: tuple[int, int],
    known: tuple[int, int, float],
    u: Vector,
    digits: float,
    way: Array,
) -> tuple[float, float]:
    """Try a direction, rounded in the frame of the body where both meet, and write it there."""
    length, meeting = math.sqrt(dot(u, u)), known[1]
    if not length > 0.0:
        return -np.inf, 0.0
    if meeting >= 0:
        u = turned_back(w.frames[meeting], u)
    for k in range(3):
        way[k] = np.rint(u[k] / length * digits)
    u = _turned(w.frames, meeting, (way[0], way[1], way[2]))
    length = math.sqrt(dot(u, u))
    return _gap(solids, w, pair, known, (u[0] / length, u[1] / length, u[2] / length))


@kernel(allocates=False)
def _turned(frames: Array, body: int, u: Vector) -> Vector:
    """A vector in the base's axes, given in those of a body."""
    return u if body < 0 else rotate(frames[body], u)


@kernel(allocates=False, inline="code")
def _gap(
    solids: Solids, w: Cells, pair: tuple[int, int], known: tuple[int, int, float], u: Vector
) -> tuple[float, float]:
    """Gap of two solids along a unit direction in the middle, and how much less it can be [m].

    Cheap bounds come first: of the solids' balls, then of how far they move whichever way, then of
    how far their balls move along the direction. Each is below the next one.
    """
    (a, b), (count, meeting, need), back = pair, known, (-u[0], -u[1], -u[2])
    rest = w.rests[a, meeting + 1] + w.rests[b, meeting + 1]
    most = rest + w.far[a, meeting + 1] + w.far[b, meeting + 1]
    c, wanted = w.centers, need + _SPARE
    if solids.kinds[b] != _HALFSPACE:
        middle = dot(u, (c[b, 0] - c[a, 0], c[b, 1] - c[a, 1], c[b, 2] - c[a, 2]))
        middle -= solids.radii[a] + solids.radii[b]
        if middle - most > wanted:
            return middle, most
    middle = -_height(solids, w, a, u) - _height(solids, w, b, back)
    if middle - most > wanted:
        return middle, most
    if middle - rest <= need:
        return middle, rest
    w.heights[:count] = 0.0
    for k, way in ((a, u), (b, back)):
        if solids.body[k] != meeting:
            _add_ball(solids, w, k, known, way)
    loss = rest + _highest(w.heights, count)
    if middle - loss > wanted or loss - rest > _TOO_FAR * (middle - rest - need):
        return middle, loss
    w.heights[:count] = middle
    for k, way in ((a, u), (b, back)):
        if solids.body[k] != meeting:
            _add_reach(solids, w, k, known, way)
        else:
            still = _height(solids, w, k, way)
            for i in range(count):
                w.heights[i] += still
    return middle, rest + _highest(w.heights, count)


@kernel(allocates=False, inline="code")
def _highest(heights: Array, count: int) -> float:
    """Largest of the first heights: ``max`` of a part of an array counts references."""
    most = heights[0]
    for i in range(1, count):
        most = max(most, heights[i])
    return float(most)


@kernel(allocates=False)
def _height(solids: Solids, w: Cells, k: int, u: Vector) -> float:
    """Support of solid k in the middle along a unit direction [m]; of a half-space its plane."""
    T = w.poses
    rounding = solids.sizes[k, 2]
    if solids.kinds[k] == _HALFSPACE:
        return float(T[k, 0, 3] * u[0] + T[k, 1, 3] * u[1] + T[k, 2, 3] * u[2] + rounding)
    size = solids.sizes[k, 0], solids.sizes[k, 1], 0.0
    first, last = solids.starts[k], solids.starts[k + 1]
    along = height(solids.kinds[k], size, solids.columns, first, last, T, k, u)
    return float(along + rounding)


@kernel(allocates=False, inline="code")
def _add_ball(solids: Solids, w: Cells, k: int, known: tuple[int, int, float], u: Vector) -> None:
    """Add to ``heights`` how far the ball of solid k goes along a direction in the cell."""
    (count, meeting, _), heights, c = known, w.heights, w.centers
    t, s, (ux, uy, uz) = w.twists[solids.body[k] + 1], w.twists[meeting + 1], u
    radius, (a, b, c) = solids.radii[k] - solids.sizes[k, 2], (c[k, 0], c[k, 1], c[k, 2])
    for i in range(count):
        x, y, z = t[0, i] - s[0, i], t[1, i] - s[1, i], t[2, i] - s[2, i]
        # The direction, as points that turn see it, turns the other way.
        x, y, z = uy * z - uz * y, uz * x - ux * z, ux * y - uy * x
        shift = ux * (t[3, i] - s[3, i]) + uy * (t[4, i] - s[4, i]) + uz * (t[5, i] - s[5, i])
        shift += x * a + y * b + z * c
        heights[i] += shift + radius * math.sqrt(x * x + y * y + z * z)


@kernel(allocates=False)
def _add_reach(solids: Solids, w: Cells, k: int, known: tuple[int, int, float], u: Vector) -> None:
    """Add the supports of solid k along a direction in the cell to ``heights``."""
    (count, meeting, _), heights, rounding = known, w.heights, solids.sizes[k, 2]
    size = solids.sizes[k, 0], solids.sizes[k, 1], 0.0
    first, last = solids.starts[k], solids.starts[k + 1]
    t, s, (ux, uy, uz) = w.twists[solids.body[k] + 1], w.twists[meeting + 1], u
    for i in range(count):
        x, y, z = t[0, i] - s[0, i], t[1, i] - s[1, i], t[2, i] - s[2, i]
        v = (ux + uy * z - uz * y, uy + uz * x - ux * z, uz + ux * y - uy * x)
        shift = ux * (t[3, i] - s[3, i]) + uy * (t[4, i] - s[4, i]) + uz * (t[5, i] - s[5, i])
        heights[i] += (
            shift
            + rounding
            + height(solids.kinds[k], size, solids.columns, first, last, w.poses, k, v)
        )
