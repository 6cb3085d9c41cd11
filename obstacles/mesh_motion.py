"""Motion of meshes past each other: how long the triangles under two covers stay apart.

What counts is motion along the normal of a plane that parts two triangles, or two boxes that hold
triangles. Where a plane proves them d apart and they can move by at most m along its normal in the
whole interval, they stay apart on a share d / m of it. The least share of all pairs is sought from
the top of both trees; what a larger one is proved of is not looked into.
"""

from kinematics.arrays import Array
from kinematics.compiled.kernel import kernel
from obstacles.bounds import quick_bound
from obstacles.bvh import FIRST, SKIP
from obstacles.gjk import FARTHER, Drift, allowance, separation
from obstacles.mesh_distance import (
    DESK,
    LOOKS,
    Plane,
    begin_row,
    extent_along,
    is_contained,
    open_node,
    plane_across,
)
from obstacles.piece_set import RADIUS, Pair, Shapes

#: Motion of a whole interval up to which it is worth to part triangles all over it [m]. Where they
#: move farther the share that is asked for gets smaller with the square of the motion: to search
#: for the nearest ones within a metre looks at most of both meshes.
_WHOLE = 0.01
#: Least motion that is divided by [m].
_LEAST_MOTION = 1e-15


@kernel(allocates=False)
def surface_share(
    pair: Pair, shapes: Shapes, near: float, enough: float, drift: Drift, hint: Array, room: Array,
    stack: Array,
) -> tuple[bool, float]:  # fmt: skip
    """Share of an interval of motion on which the triangles under two covers are proved apart.

    Args:
        pair: The covers, placed in the middle of the interval; the second is no half-space.
        shapes: Corners, tables and trees of both.
        near: At most this far apart is too close [m].
        enough: Farther apart than this is far enough [m].
        drift: Motion of the second piece seen from the first.
        hint: A direction from j to i across which they may be apart, shape (3,).
        room: Workspace, shape (9, 3).
        stack: Workspace of ``surface_distance``; at LOOKS the pairs of nodes looked at are left.

    Returns:
        Whether they are not too close in the middle (touching, or one inside the other), and the
        share about the middle that is proved: 1 for the whole interval, and no more than is asked
        for where they move far.
    """
    a, i, b, j = pair
    corners, tables, nodes = shapes
    desk, axis = stack[DESK : DESK + 2], room[8]
    na, nb = begin_row(desk, 0, a, i), begin_row(desk, 1, b, j)
    plane = plane_across(desk, na, nb, corners, tables, hint[0], hint[1], hint[2])
    most, top = drift[8], 1
    share = 1.0 if most <= _WHOLE else (_WHOLE / most) ** 2
    stack[0, 0], stack[0, 1], stack[0, 2], stack[0, LOOKS] = na, nb, -1.0, 0.0
    while top > 0:
        top -= 1
        if stack[top, 2] >= share:
            continue
        na, nb = int(stack[top, 0]), int(stack[top, 1])
        stack[0, LOOKS] += 1.0
        if na >= 0:
            open_node(desk, 0, nodes, na)
        if nb >= 0:
            open_node(desk, 1, nodes, nb)
        whole_a, whole_b = na < 0 or nodes[na, FIRST] >= 0.0, nb < 0 or nodes[nb, FIRST] >= 0.0
        if whole_a and whole_b:
            axis[0], axis[1], axis[2] = plane[0], plane[1], plane[2]
            verdict, lower, upper = separation(
                Pair(desk, 0, desk, 1), corners, tables, near, enough, _part(drift, share), axis,
                room,
            )  # fmt: skip
            if upper <= max(near, 0.0):
                return False, 0.0
            if verdict != FARTHER:
                moved = max(allowance((axis[0], axis[1], axis[2]), drift), _LEAST_MOTION)
                share = min(share, max(lower - enough, 0.0) / moved)
                plane = plane_across(
                    desk, min(na, 0), min(nb, 0), corners, tables, axis[0], axis[1], axis[2]
                )
            continue
        side = 0
        if whole_a or (not whole_b and desk[1, RADIUS] > desk[0, RADIUS]):
            side = 1
        left = (na if side == 0 else nb) + 1
        right = int(nodes[left, SKIP])
        open_node(desk, side, nodes, left)
        first = _node_share(desk, na, nb, plane, enough, share, drift)
        open_node(desk, side, nodes, right)
        second = _node_share(desk, na, nb, plane, enough, share, drift)
        # The one that stays apart for less is looked at first.
        if first <= second:
            left, right, first, second = right, left, second, first
        for child, bound in ((left, first), (right, second)):
            if bound < share:
                stack[top, 0], stack[top, 1], stack[top, 2] = na, nb, bound
                stack[top, side] = child
                top += 1
    if is_contained(pair, shapes):
        return False, 0.0
    return True, share


@kernel(allocates=False)
def _part(drift: Drift, share: float) -> Drift:
    """The drift of a share of the interval about its middle, to first order in its length."""
    vx, vy, vz, wx, wy, wz, radius, rest, most = drift
    return (
        share * vx, share * vy, share * vz, share * wx, share * wy, share * wz, radius,
        share * rest, share * most,
    )  # fmt: skip


@kernel(allocates=False)
def _node_share(
    desk: Array, na: int, nb: int, plane: Plane, enough: float, share: float, drift: Drift
) -> float:
    """Share of the interval on which the boxes of two rows are proved apart, below 0 for none."""
    low, high = plane[3], plane[4]
    if na >= 0:
        low, _ = extent_along(desk, 0, plane)
    if nb >= 0:
        _, high = extent_along(desk, 1, plane)
    moved = max(allowance((plane[0], plane[1], plane[2]), drift), _LEAST_MOTION)
    proved = (low - high - enough) / moved
    if proved >= share:
        return proved
    bound, n = quick_bound(desk, 0, desk, 1, enough + share * drift[8])
    return float(max(proved, (bound - enough) / max(allowance(n, drift), _LEAST_MOTION)))
