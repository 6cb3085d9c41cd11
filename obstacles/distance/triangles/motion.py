"""Motion of meshes past each other: how long the triangles under two covers stay apart.

What counts is motion along the normal of a plane that parts two triangles, or two boxes that hold
triangles. Where a plane proves them d apart and they can move by at most m along its normal in the
whole interval, they stay apart on a share d / m of it. The least share of all pairs is sought from
the top of both trees; what a larger one is proved of is not searched.
"""

import math

from compiled.kernel import kernel
from compiled.vec3 import Vector
from kinematics.arrays import Array
from obstacles.distance.box_pairs import (
    GOES,
    NORMAL,
    NORMAL_B,
    TURN,
    TURNS_A,
    TURNS_B,
    Node,
    box_of,
    from_first,
    gap_along,
    gap_in_first,
    gap_in_second,
    is_halfspace,
    triangle_gap,
    write_drift,
    write_plane,
    write_view,
)
from obstacles.distance.bvh import FIRST, SKIP
from obstacles.distance.gjk import FARTHER, Drift, allowance, separation
from obstacles.distance.piece_set import POSE, Pair, Shapes
from obstacles.distance.triangles.distance import (
    CHECKS,
    DESK,
    VIEW,
    begin_row,
    is_contained,
    open_leaf,
)

#: Motion of a whole interval up to which it is worth to part triangles all over it [m]. Where they
#: move farther the share that is asked for gets smaller with the square of the motion: to search
#: for the nearest ones within a metre visits most of both meshes.
_WHOLE = 0.01
#: Least motion that is divided by [m].
_LEAST_MOTION = 1e-15
#: What stays apart on this share of the least share found is not searched: to find the very
#: least one takes half as many checks again, and makes intervals hardly longer.
_ENOUGH = 0.8


@kernel(allocates=False)
def surface_share(  # noqa: PLR0912, PLR0915
    pair: Pair, shapes: Shapes, near: float, enough: float, drift: Drift, hint: Array,
    buffer: Array, stack: Array,
) -> tuple[bool, float]:  # fmt: skip
    """Share of an interval of motion on which the triangles under two covers are proved apart.

    Args:
        pair: The covers, placed in the middle of the interval; the second is no half-space.
        shapes: Corners, tables and trees of both.
        near: Distance up to which the surfaces are too close [m].
        enough: Farther apart than this is far enough [m].
        drift: Motion of the second piece seen from the first.
        hint: A direction from j to i across which they may be apart, shape (3,).
        buffer: Workspace, shape (9, 3).
        stack: Workspace of ``surface_distance``; at CHECKS the pairs of nodes compared are left.

    Returns:
        Whether they are not too close in the middle (touching, or one inside the other), and the
        share about the middle that is proved: 1 for the whole interval, and no more than is asked
        for where they move far.
    """
    a, i, b, j = pair
    corners, tables, nodes = shapes
    desk, view, axis = stack[DESK : DESK + 2], stack[VIEW], buffer[8]
    na, nb = begin_row(desk, 0, a, i), begin_row(desk, 1, b, j)
    write_view(desk, view)
    write_drift(desk, drift, view)
    write_plane(desk, na, nb, corners, tables, (hint[0], hint[1], hint[2]), view)
    most, top = drift[8], 1
    share = 1.0 if most <= _WHOLE else (_WHOLE / most) ** 2
    # What is proved for as long as this is not searched; the least such share is the answer.
    wanted, least = share, share
    stack[0, 0], stack[0, 1], stack[0, 2], stack[0, CHECKS] = na, nb, -1.0, 0.0
    while top > 0:
        top -= 1
        if stack[top, 2] >= wanted:
            least = min(least, stack[top, 2])
            continue
        na, nb = int(stack[top, 0]), int(stack[top, 1])
        stack[0, CHECKS] += 1.0
        whole_a, whole_b = na < 0 or nodes[na, FIRST] >= 0.0, nb < 0 or nodes[nb, FIRST] >= 0.0
        if whole_a and whole_b:
            open_leaf(desk, 0, nodes, na)
            open_leaf(desk, 1, nodes, nb)
            axis[0], axis[1], axis[2] = view[NORMAL], view[NORMAL + 1], view[NORMAL + 2]
            moving = _drift_at(desk, view, drift, box_of(desk, 1, nodes, nb))
            if na >= 0 and nb >= 0:
                gap, n = triangle_gap(view, corners, int(nodes[na, FIRST]), int(nodes[nb, FIRST]))
                if gap > enough:
                    from_first(desk, n, axis)
                    n = (axis[0], axis[1], axis[2])
                    bound = (gap - enough) / max(allowance(n, moving), _LEAST_MOTION)
                    if bound >= wanted:
                        least = min(least, bound)
                        continue
            verdict, lower, upper = separation(
                Pair(desk, 0, desk, 1), corners, tables, near, enough, _part(moving, share), axis,
                buffer,
            )  # fmt: skip
            if upper <= max(near, 0.0):
                return False, 0.0
            if verdict != FARTHER:
                n = (axis[0], axis[1], axis[2])
                moved = max(allowance(n, moving), _LEAST_MOTION)
                share = min(share, max(lower - enough, 0.0) / moved)
                wanted, least = _ENOUGH * share, min(least, share)
                write_plane(desk, min(na, 0), min(nb, 0), corners, tables, n, view)
            continue
        side, one, other = 0, box_of(desk, 0, nodes, na), box_of(desk, 1, nodes, nb)
        if whole_a or (not whole_b and other.radius > one.radius):
            side = 1
        left = (na if side == 0 else nb) + 1
        right = int(nodes[left, SKIP])
        if side == 0:
            first = _share(desk, view, box_of(desk, 0, nodes, left), other, enough, wanted, drift)
            second = _share(desk, view, box_of(desk, 0, nodes, right), other, enough, wanted, drift)
        else:
            first = _share(desk, view, one, box_of(desk, 1, nodes, left), enough, wanted, drift)
            second = _share(desk, view, one, box_of(desk, 1, nodes, right), enough, wanted, drift)
        # The one that stays apart for less comes first.
        if first <= second:
            left, right, first, second = right, left, second, first
        for child, bound in ((left, first), (right, second)):
            if bound < wanted:
                stack[top, 0], stack[top, 1], stack[top, 2] = na, nb, bound
                stack[top, side] = child
                top += 1
            else:
                least = min(least, bound)
    if is_contained(pair, shapes):
        return False, 0.0
    return True, least


@kernel(allocates=False, inline="always")
def _part(drift: Drift, share: float) -> Drift:
    """The drift of a share of the interval about its middle, to first order in its length."""
    vx, vy, vz, wx, wy, wz, radius, rest, most = drift
    return (
        share * vx, share * vy, share * vz, share * wx, share * wy, share * wz, radius,
        share * rest, share * most,
    )  # fmt: skip


@kernel(allocates=False, inline="always")
def _going(view: Array, b: Node) -> Vector:
    """Motion of the middle of a box of the second piece, in its frame."""
    g, w = GOES, TURNS_B
    return (
        view[g] + view[w + 1] * b.z - view[w + 2] * b.y,
        view[g + 1] + view[w + 2] * b.x - view[w] * b.z,
        view[g + 2] + view[w] * b.y - view[w + 1] * b.x,
    )


@kernel(allocates=False, inline="always")
def _drift_at(desk: Array, view: Array, drift: Drift, b: Node) -> Drift:
    """The drift of what a box of the second piece holds, in the base frame."""
    u, p = _going(view, b), POSE
    return (
        desk[1, p] * u[0] + desk[1, p + 1] * u[1] + desk[1, p + 2] * u[2],
        desk[1, p + 4] * u[0] + desk[1, p + 5] * u[1] + desk[1, p + 6] * u[2],
        desk[1, p + 8] * u[0] + desk[1, p + 9] * u[1] + desk[1, p + 10] * u[2],
        drift[3], drift[4], drift[5], b.radius, drift[7], drift[8],
    )  # fmt: skip


@kernel(allocates=False, inline="always")
def _moved(n: Vector, u: Vector, w: Vector, radius: float, rest: float, most: float) -> float:
    """``allowance`` with all in one frame, and something to divide by."""
    x, y, z = n[1] * w[2] - n[2] * w[1], n[2] * w[0] - n[0] * w[2], n[0] * w[1] - n[1] * w[0]
    along = abs(n[0] * u[0] + n[1] * u[1] + n[2] * u[2])
    turned = radius * math.sqrt(x * x + y * y + z * z)
    return max(min(along + turned + rest, most), _LEAST_MOTION)


@kernel(allocates=False)
def _share(
    desk: Array, view: Array, a: Node, b: Node, enough: float, wanted: float, drift: Drift
) -> float:
    """Share of the interval on which two boxes are proved apart, below 0 for none."""
    rest, most, u, t = drift[7], drift[8], _going(view, b), TURNS_B
    w = (view[t], view[t + 1], view[t + 2])
    gap = gap_along(view, a, b) - enough
    n = (view[NORMAL_B], view[NORMAL_B + 1], view[NORMAL_B + 2])
    proved = gap / (_moved(n, u, w, b.radius, rest, most) if gap > 0.0 else most)
    if proved >= wanted or is_halfspace(desk):
        return proved
    gap, n = gap_in_second(view, a, b)
    if gap > enough:
        proved = max(proved, (gap - enough) / _moved(n, u, w, b.radius, rest, most))
        if proved >= wanted:
            return proved
    else:
        proved = max(proved, (gap - enough) / most)
    gap, n = gap_in_first(view, a, b)
    if gap > enough:
        t, r = TURNS_A, TURN
        w = (view[t], view[t + 1], view[t + 2])
        u = (
            view[r] * u[0] + view[r + 1] * u[1] + view[r + 2] * u[2],
            view[r + 3] * u[0] + view[r + 4] * u[1] + view[r + 5] * u[2],
            view[r + 6] * u[0] + view[r + 7] * u[1] + view[r + 8] * u[2],
        )
        proved = max(proved, (gap - enough) / _moved(n, u, w, b.radius, rest, most))
    return proved
