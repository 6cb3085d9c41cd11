"""Distances of pieces of meshes that are not convex, by their triangles.

Covers prove that pieces are apart. Where a cover touches, what it covers decides: its triangles,
met from the top of a tree over them, and whether the one body lies inside the other without any
triangle touching, as a bolt in its hole does not, but a ball in a block does.
"""

import math

import numpy as np

from compiled.kernel import kernel
from compiled.vec3 import Vector
from kinematics.arrays import Array
from obstacles.distance.box_pairs import (
    NORMAL,
    Node,
    box_of,
    from_first,
    gap_along,
    gap_in_first,
    gap_in_second,
    in_frame,
    is_halfspace,
    triangle_gap,
    write_plane,
    write_view,
)
from obstacles.distance.bvh import FIRST, SKIP
from obstacles.distance.gjk import BETWEEN, CLOSER, FARTHER, STILL, separation, support
from obstacles.distance.piece_set import (
    ANCHOR,
    ANCHOR_STOP,
    CENTER,
    GROUP,
    GROUP_STOP,
    HALF,
    KIND,
    MIDDLE,
    NODE,
    NODE_STOP,
    POSE,
    RADIUS,
    ROUNDING,
    START,
    STOP,
    WIDTH,
    CoreKind,
    Lists,
    Pair,
    PieceSet,
    Shapes,
)

_POLYTOPE = int(CoreKind.POLYTOPE)
_HALFSPACE = int(CoreKind.HALFSPACE)
#: Pairs of nodes that can wait: two trees, halved each time, and one sibling at each step.
_WAITING = 256
#: The first of the two rows of ``stack`` that hold the parts compared, behind those that wait, and
#: the row of numbers by which boxes of one are seen from the other.
DESK, VIEW = _WAITING, _WAITING + 2
STACK = (_WAITING + 3, WIDTH)
#: Column of the first row of ``stack`` with the number of pairs of nodes that were compared.
CHECKS = 3


@kernel(allocates=False)
def open_node(desk: Array, k: int, nodes: Array, node: int) -> None:
    """Let row k of ``desk`` be a node's box, and its triangle where it is a leaf."""
    square = 0.0
    for axis in range(3):
        low, high = nodes[node, axis], nodes[node, 3 + axis]
        half = 0.5 * (high - low)
        desk[k, MIDDLE + axis], desk[k, HALF + axis] = 0.5 * (low + high), half
        square += half * half
    desk[k, RADIUS] = math.sqrt(square)
    x, y, z = desk[k, MIDDLE], desk[k, MIDDLE + 1], desk[k, MIDDLE + 2]
    for axis in range(3):
        at = POSE + 4 * axis
        turned = desk[k, at] * x + desk[k, at + 1] * y + desk[k, at + 2] * z
        desk[k, CENTER + axis] = turned + desk[k, at + 3]
    if nodes[node, FIRST] >= 0.0:
        desk[k, START], desk[k, STOP] = nodes[node, FIRST], nodes[node, FIRST] + 3.0


@kernel(allocates=False)
def begin_row(desk: Array, k: int, rows: Array, i: int) -> int:
    """Copy a row to the desk; the root of its tree, or -1 where it is the solid itself."""
    for column in range(WIDTH):
        desk[k, column] = rows[i, column]
    if not rows[i, NODE_STOP] > 0.0:
        return -1
    desk[k, KIND], desk[k, ROUNDING] = _POLYTOPE, 0.0
    return int(rows[i, NODE])


@kernel(allocates=False)
def open_leaf(desk: Array, k: int, nodes: Array, node: int) -> None:
    """Let row k of ``desk`` be the triangle of a leaf; the solid itself below 0."""
    if node >= 0:
        desk[k, START], desk[k, STOP] = nodes[node, FIRST], nodes[node, FIRST] + 3.0


@kernel(allocates=False)
def _gap_of_boxes(desk: Array, view: Array, a: Node, b: Node, enough: float) -> float:
    """How far two boxes are apart at least, and what they hold with them [m].

    Args:
        desk: The rows of their pieces.
        view: View of these boxes.
        a: A box of the first piece.
        b: One of the second.
        enough: A bound beyond this will do: no sharper one is sought [m].
    """
    gap = gap_along(view, a, b)
    if gap > enough or is_halfspace(desk):
        return gap
    other, _ = gap_in_second(view, a, b)
    gap = max(gap, other)
    if gap > enough:
        return gap
    other, _ = gap_in_first(view, a, b)
    return max(gap, other)


@kernel(allocates=False)
def surface_distance(  # noqa: C901, PLR0912, PLR0915
    pair: Pair, shapes: Shapes, near: float, most: float, hint: Array, buffer: Array, stack: Array
) -> tuple[int, float]:
    """Compare the distance of the triangles under two covers with two thresholds.

    Args:
        pair: The covers; the second is no half-space.
        shapes: Corners, tables and trees of both.
        near: Distance up to which the surfaces are too close [m]; -inf asks for the distance
            itself.
        most: Farther apart than this is far enough [m].
        hint: A direction from j to i across which they may be apart, shape (3,).
        buffer: Workspace, shape (9, 3).
        stack: Workspace, shape STACK. The rows from DESK are left as the parts that are nearest to
            each other, where the answer is BETWEEN, and at CHECKS the pairs of nodes compared.

    Returns:
        FARTHER, CLOSER (at most ``near`` apart, touching, or one inside the other) or BETWEEN, and
        a lower bound of the distance [m].
    """
    a, i, b, j = pair
    corners, tables, nodes = shapes
    desk, view, axis = stack[DESK : DESK + 2], stack[VIEW], buffer[8]
    na, nb = begin_row(desk, 0, a, i), begin_row(desk, 1, b, j)
    write_view(desk, view)
    write_plane(desk, na, nb, corners, tables, (hint[0], hint[1], hint[2]), view)
    limit, top = most, 1
    stack[0, 0], stack[0, 1], stack[0, 2], stack[0, CHECKS] = na, nb, -np.inf, 0.0
    best_a, best_b = -1, -1
    while top > 0:
        top -= 1
        if stack[top, 2] > limit:
            continue
        na, nb = int(stack[top, 0]), int(stack[top, 1])
        stack[0, CHECKS] += 1.0
        whole_a, whole_b = na < 0 or nodes[na, FIRST] >= 0.0, nb < 0 or nodes[nb, FIRST] >= 0.0
        if whole_a and whole_b:
            open_leaf(desk, 0, nodes, na)
            open_leaf(desk, 1, nodes, nb)
            axis[0], axis[1], axis[2] = view[NORMAL], view[NORMAL + 1], view[NORMAL + 2]
            if na >= 0 and nb >= 0:
                gap, n = triangle_gap(view, corners, int(nodes[na, FIRST]), int(nodes[nb, FIRST]))
                if gap > limit:
                    continue
                if gap > 0.0:
                    from_first(desk, n, axis)
            verdict, lower, upper = separation(
                Pair(desk, 0, desk, 1), corners, tables, near, limit, STILL, axis, buffer
            )
            if upper <= max(near, 0.0):
                return CLOSER, min(lower, 0.0) if near < 0.0 else lower
            if verdict != FARTHER and lower <= limit:
                limit, best_a, best_b = lower, na, nb
                n = (axis[0], axis[1], axis[2])
                write_plane(desk, min(na, 0), min(nb, 0), corners, tables, n, view)
            continue
        side, one, other = 0, box_of(desk, 0, nodes, na), box_of(desk, 1, nodes, nb)
        if whole_a or (not whole_b and other.radius > one.radius):
            side = 1
        left = (na if side == 0 else nb) + 1
        right = int(nodes[left, SKIP])
        if side == 0:
            first = _gap_of_boxes(desk, view, box_of(desk, 0, nodes, left), other, limit)
            second = _gap_of_boxes(desk, view, box_of(desk, 0, nodes, right), other, limit)
        else:
            first = _gap_of_boxes(desk, view, one, box_of(desk, 1, nodes, left), limit)
            second = _gap_of_boxes(desk, view, one, box_of(desk, 1, nodes, right), limit)
        # The nearer one comes first.
        if first <= second:
            left, right, first, second = right, left, second, first
        for child, bound in ((left, first), (right, second)):
            if bound <= limit:
                stack[top, 0], stack[top, 1], stack[top, 2] = na, nb, bound
                stack[top, side] = child
                top += 1
    if is_contained(pair, shapes):
        return CLOSER, -np.inf
    if limit >= most:
        return FARTHER, most
    if best_a >= 0:
        open_node(desk, 0, nodes, best_a)
    if best_b >= 0:
        open_node(desk, 1, nodes, best_b)
    return BETWEEN, limit


@kernel(allocates=False, inline="always")
def is_contained(pair: Pair, shapes: Shapes) -> bool:
    """Whether a body of one piece lies inside the solid of the other, when no triangle touches."""
    a, i, b, j = pair
    if b[j, GROUP_STOP] > 0.0 and _has_inside(Pair(b, j, a, i), shapes):
        return True
    return bool(a[i, GROUP_STOP] > 0.0 and _has_inside(pair, shapes))


@kernel(allocates=False)
def _has_inside(pair: Pair, shapes: Shapes) -> bool:
    """Whether the solid that the first piece belongs to has a body of the second inside."""
    rows, j, others, i = pair
    corners, tables, nodes = shapes
    if others[i, KIND] == _HALFSPACE:
        return False
    if not others[i, NODE_STOP] > 0.0:
        return _inside(
            rows, j, corners, nodes, support(others, i, corners, tables, (1.0, 0.0, 0.0))
        )
    for k in range(int(others[i, ANCHOR]), int(others[i, ANCHOR_STOP])):
        x, y, z = corners[k, 0], corners[k, 1], corners[k, 2]
        p, q = POSE, others[i]
        point = (
            q[p] * x + q[p + 1] * y + q[p + 2] * z + q[p + 3],
            q[p + 4] * x + q[p + 5] * y + q[p + 6] * z + q[p + 7],
            q[p + 8] * x + q[p + 9] * y + q[p + 10] * z + q[p + 11],
        )
        if _inside(rows, j, corners, nodes, point):
            return True
    return False


@kernel(allocates=False)
def _inside(rows: Array, j: int, corners: Array, nodes: Array, point: Vector) -> bool:
    """Whether a point is inside the solid that row j belongs to.

    Rays along the three axes are counted through the surface, out less in; where a crack lets one
    through, the other two outvote it.
    """
    p, row = POSE, rows[j]
    local = in_frame(row, point[0] - row[p + 3], point[1] - row[p + 7], point[2] - row[p + 11])
    votes = 0
    for w in range(3):
        u, v = (w + 1) % 3, (w + 2) % 3
        turns = 0
        for k in range(int(row[GROUP]), int(row[GROUP_STOP])):
            node, stop = int(rows[k, NODE]), int(rows[k, NODE_STOP])
            while node < stop:
                if (
                    local[u] < nodes[node, u] or local[u] > nodes[node, 3 + u]
                    or local[v] < nodes[node, v] or local[v] > nodes[node, 3 + v]
                    or local[w] > nodes[node, 3 + w]
                ):  # fmt: skip
                    node = int(nodes[node, SKIP])
                    continue
                if nodes[node, FIRST] >= 0.0:
                    turns += _crossed(corners, int(nodes[node, FIRST]), local, u, v, w)
                node += 1
        votes += turns != 0
    return votes >= 2


@kernel(allocates=False, inline="always")
def _crossed(corners: Array, first: int, p: Vector, u: int, v: int, w: int) -> int:
    """Whether the ray from p along axis w goes through a triangle: out 1, in -1, past it 0.

    Edges belong to one of two neighbours, and are computed alike for both.
    """
    turns = 0
    for k in range(3):
        s, t = first + k, first + (k + 1) % 3
        up = 1
        if corners[s, v] > corners[t, v]:
            s, t, up = t, s, -1
        if corners[s, v] <= p[v] < corners[t, v]:
            ahead = (corners[t, u] - corners[s, u]) * (p[v] - corners[s, v])
            ahead -= (p[u] - corners[s, u]) * (corners[t, v] - corners[s, v])
            if ahead > 0.0:
                turns += up
    if turns == 0:
        return 0
    a, b, c = first, first + 1, first + 2
    bu, bv, bw = (
        corners[b, u] - corners[a, u],
        corners[b, v] - corners[a, v],
        corners[b, w] - corners[a, w],
    )
    cu, cv, cw = (
        corners[c, u] - corners[a, u],
        corners[c, v] - corners[a, v],
        corners[c, w] - corners[a, w],
    )
    nu, nv, nw = bv * cw - bw * cv, bw * cu - bu * cw, bu * cv - bv * cu
    above = (corners[a, u] - p[u]) * nu + (corners[a, v] - p[v]) * nv + (corners[a, w] - p[w]) * nw
    if nw == 0.0 or not above / nw > 0.0:
        return 0
    return 1 if nw > 0.0 else -1


@kernel
def touching(placed: PieceSet, i: int, j: int) -> bool:
    """Whether two pieces, placed in a common frame, touch."""
    rows, corners, tables = placed.rows, placed.corners, placed.tables
    buffer = np.zeros((9, 3))
    for row in range(3):
        at = POSE + 4 * row + 3
        buffer[8, row] = rows[i, at] - rows[j, at]
    pair = Pair(rows, i, rows, j)
    _, _, upper = separation(pair, corners, tables, 0.0, np.inf, STILL, buffer[8], buffer)
    if upper > 0.0 or not max(rows[i, NODE_STOP], rows[j, NODE_STOP]) > 0.0:
        return bool(upper <= 0.0)
    shapes = Shapes(corners, tables, placed.surfaces)
    verdict, _ = surface_distance(pair, shapes, 0.0, 0.0, buffer[8], buffer, np.empty(STACK))
    return bool(verdict == CLOSER)


@kernel
def mesh_distance(
    a: Array, i: int, b: Array, j: int, corners: Array, tables: Lists, nodes: Array, axis: Array
) -> float:
    """Distance of two pieces of meshes, placed in a common frame, 0 where they touch [m].

    Args:
        a: Rows of the solid that the first one is a part of.
        i: Number of the first piece.
        b: Rows of the second set.
        j: Number of the second piece; no half-space.
        corners: Corners of both.
        tables: Tables of both.
        nodes: Nodes of both.
        axis: Direction to search first, from j to i, shape (3,).
    """
    buffer, stack = np.zeros((9, 3)), np.empty(STACK)
    verdict, lower = surface_distance(
        Pair(a, i, b, j), Shapes(corners, tables, nodes), -np.inf, np.inf, axis, buffer, stack
    )
    return 0.0 if verdict == CLOSER else lower
