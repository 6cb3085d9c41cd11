"""How far boxes of two trees are apart, each box in the frame of its piece.

The pose of one piece in the frame of the other is worked out once for all pairs of their nodes.
Seen from one frame the other's box is held by an upright box, and two upright boxes with gaps g_k
along the axes are |g| apart, across a plane with normal g; that is tried in both frames, beside a
plane that parted the last pair. Source: "OBBTree: a hierarchical structure for rapid interference
detection", SIGGRAPH, 1996, for the six face normals.
"""

import math
from typing import NamedTuple

import numpy as np

from compiled.kernel import kernel
from compiled.vec3 import Vector, cross, dot, subtract
from kinematics.arrays import Array
from obstacles.distance.bvh import EXTENT
from obstacles.distance.gjk import Drift, support
from obstacles.distance.piece_set import CENTER, HALF, KIND, MIDDLE, POSE, ROUNDING, CoreKind, Lists

_HALFSPACE = int(CoreKind.HALFSPACE)

#: What stands in which columns of a view: the second piece's turn and place in the frame of the
#: first; a plane's normal in the base frame, in that of the first piece and in that of the second,
#: its height above the origins of both, and what whole pieces reach along it, the first least, the
#: second most; by how much the second's origin is displaced, in its frame, and how far it turns,
#: in both.
TURN, PLACE = 0, 9
NORMAL, NORMAL_A, NORMAL_B = 12, 15, 18
HEIGHT_A, HEIGHT_B, LOW, HIGH = 21, 22, 23, 24
GOES, TURNS_B, TURNS_A = 25, 28, 31
#: Square of the least normal that is divided by [m^4]: below, its last digits are lost.
_LEAST_SQUARE = 1e-200


class Node(NamedTuple):
    """A box in the frame of its piece.

    Args:
        x: Middle of the box [m].
        y: [m].
        z: [m].
        a: Half sizes of the box [m].
        b: [m].
        c: [m].
        radius: Half of its diagonal [m].
        whole: Whether the box holds the whole piece.
    """

    x: float
    y: float
    z: float
    a: float
    b: float
    c: float
    radius: float
    whole: bool


@kernel(allocates=False)
def box_of(desk: Array, k: int, nodes: Array, node: int) -> Node:
    """The box of a node, or that of row k of the desk (node below 0)."""
    if node < 0:
        a, b, c = desk[k, HALF], desk[k, HALF + 1], desk[k, HALF + 2]
        return Node(
            desk[k, MIDDLE], desk[k, MIDDLE + 1], desk[k, MIDDLE + 2], a, b, c,
            math.sqrt(a * a + b * b + c * c), True,
        )  # fmt: skip
    row = nodes[node]
    return Node(
        0.5 * (row[0] + row[3]), 0.5 * (row[1] + row[4]), 0.5 * (row[2] + row[5]),
        0.5 * (row[3] - row[0]), 0.5 * (row[4] - row[1]), 0.5 * (row[5] - row[2]),
        row[EXTENT], False,
    )  # fmt: skip


@kernel(allocates=False)
def in_frame(row: Array, x: float, y: float, z: float) -> Vector:
    """A direction in the frame of a placed row."""
    p = POSE
    return (
        row[p] * x + row[p + 4] * y + row[p + 8] * z,
        row[p + 1] * x + row[p + 5] * y + row[p + 9] * z,
        row[p + 2] * x + row[p + 6] * y + row[p + 10] * z,
    )


@kernel(allocates=False, inline="always")
def write_view(desk: Array, view: Array) -> None:
    """Write the pose of the second row of the desk in the frame of the first."""
    a, b = desk[0], desk[1]
    for axis in range(3):
        u = in_frame(a, b[POSE + axis], b[POSE + 4 + axis], b[POSE + 8 + axis])
        view[TURN + axis], view[TURN + 3 + axis], view[TURN + 6 + axis] = u
    p = POSE + 3
    view[PLACE], view[PLACE + 1], view[PLACE + 2] = in_frame(
        a, b[p] - a[p], b[p + 4] - a[p + 4], b[p + 8] - a[p + 8]
    )


@kernel(allocates=False, inline="always")
def write_drift(desk: Array, drift: Drift, view: Array) -> None:
    """Write the motion of the second piece, given at the middle of its ball."""
    b, p = desk[1], POSE + 3
    v = in_frame(b, drift[0], drift[1], drift[2])
    w = in_frame(b, drift[3], drift[4], drift[5])
    c = in_frame(b, b[CENTER] - b[p], b[CENTER + 1] - b[p + 4], b[CENTER + 2] - b[p + 8])
    view[GOES] = v[0] - (w[1] * c[2] - w[2] * c[1])
    view[GOES + 1] = v[1] - (w[2] * c[0] - w[0] * c[2])
    view[GOES + 2] = v[2] - (w[0] * c[1] - w[1] * c[0])
    view[TURNS_B], view[TURNS_B + 1], view[TURNS_B + 2] = w
    view[TURNS_A], view[TURNS_A + 1], view[TURNS_A + 2] = in_frame(
        desk[0], drift[3], drift[4], drift[5]
    )


@kernel(allocates=False)
def write_plane(
    desk: Array, na: int, nb: int, corners: Array, tables: Lists, n: Vector, view: Array
) -> None:
    """Write the plane across n, with what a whole piece (na or nb below 0) reaches along it.

    A half-space, which is the first piece, has one plane that parts it from anything.
    """
    a, b, p = desk[0], desk[1], POSE
    length = math.sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2])
    n = (n[0] / length, n[1] / length, n[2] / length) if length > 0.0 else (1.0, 0.0, 0.0)
    wall = na < 0 and a[KIND] == _HALFSPACE
    if wall:
        n = (-a[p + 2], -a[p + 6], -a[p + 10])
    view[NORMAL], view[NORMAL + 1], view[NORMAL + 2] = n
    view[NORMAL_A], view[NORMAL_A + 1], view[NORMAL_A + 2] = in_frame(a, n[0], n[1], n[2])
    view[NORMAL_B], view[NORMAL_B + 1], view[NORMAL_B + 2] = in_frame(b, n[0], n[1], n[2])
    view[HEIGHT_A] = n[0] * a[p + 3] + n[1] * a[p + 7] + n[2] * a[p + 11]
    view[HEIGHT_B] = n[0] * b[p + 3] + n[1] * b[p + 7] + n[2] * b[p + 11]
    view[LOW], view[HIGH] = -np.inf, np.inf
    if wall:
        view[LOW] = view[HEIGHT_A]
    elif na < 0:
        q = support(desk, 0, corners, tables, (-n[0], -n[1], -n[2]))
        view[LOW] = n[0] * q[0] + n[1] * q[1] + n[2] * q[2] - a[ROUNDING]
    if nb < 0:
        q = support(desk, 1, corners, tables, n)
        view[HIGH] = n[0] * q[0] + n[1] * q[1] + n[2] * q[2] + b[ROUNDING]


@kernel(allocates=False, inline="always")
def _along(view: Array, at: int, box: Node) -> tuple[float, float]:
    """Middle of a box along the normal at a column, and how far the box reaches."""
    x, y, z = view[at], view[at + 1], view[at + 2]
    return (
        x * box.x + y * box.y + z * box.z,
        abs(x) * box.a + abs(y) * box.b + abs(z) * box.c,
    )


@kernel(allocates=False, inline="always")
def gap_along(view: Array, a: Node, b: Node) -> float:
    """How far two boxes are apart across the plane of a view [m], below 0 where they are not."""
    low, high = view[LOW], view[HIGH]
    if not a.whole:
        middle, half = _along(view, NORMAL_A, a)
        low = view[HEIGHT_A] + middle - half
    if not b.whole:
        middle, half = _along(view, NORMAL_B, b)
        high = view[HEIGHT_B] + middle + half
    return float(low - high)


@kernel(allocates=False, inline="always")
def gap_in_first(view: Array, a: Node, b: Node) -> tuple[float, Vector]:
    """How far two boxes are apart seen from the first piece [m], and the direction, in its frame.

    Where no axis parts them that is minus the least overlap, and there is no direction.
    """
    r = view
    x = r[0] * b.x + r[1] * b.y + r[2] * b.z + r[9] - a.x
    y = r[3] * b.x + r[4] * b.y + r[5] * b.z + r[10] - a.y
    z = r[6] * b.x + r[7] * b.y + r[8] * b.z + r[11] - a.z
    u = abs(x) - a.a - abs(r[0]) * b.a - abs(r[1]) * b.b - abs(r[2]) * b.c
    v = abs(y) - a.b - abs(r[3]) * b.a - abs(r[4]) * b.b - abs(r[5]) * b.c
    w = abs(z) - a.c - abs(r[6]) * b.a - abs(r[7]) * b.b - abs(r[8]) * b.c
    return _across(u, v, w, x, y, z)


@kernel(allocates=False)
def gap_in_second(view: Array, a: Node, b: Node) -> tuple[float, Vector]:
    """``gap_in_first`` seen from the second piece, the direction in its frame."""
    r = view
    p, q, s = a.x - r[9], a.y - r[10], a.z - r[11]
    x = r[0] * p + r[3] * q + r[6] * s - b.x
    y = r[1] * p + r[4] * q + r[7] * s - b.y
    z = r[2] * p + r[5] * q + r[8] * s - b.z
    u = abs(x) - b.a - abs(r[0]) * a.a - abs(r[3]) * a.b - abs(r[6]) * a.c
    v = abs(y) - b.b - abs(r[1]) * a.a - abs(r[4]) * a.b - abs(r[7]) * a.c
    w = abs(z) - b.c - abs(r[2]) * a.a - abs(r[5]) * a.b - abs(r[8]) * a.c
    return _across(u, v, w, x, y, z)


@kernel(allocates=False)
def _across(u: float, v: float, w: float, x: float, y: float, z: float) -> tuple[float, Vector]:
    """Length and direction of gaps along three axes, with the signs of x, y and z."""
    most = max(u, v, w)
    if most <= 0.0:
        return most, (0.0, 0.0, 0.0)
    u, v, w = max(u, 0.0), max(v, 0.0), max(w, 0.0)
    length = math.sqrt(u * u + v * v + w * w)
    scale = 1.0 / length
    return length, (
        scale * (u if x > 0.0 else -u),
        scale * (v if y > 0.0 else -v),
        scale * (w if z > 0.0 else -w),
    )


@kernel(allocates=False, inline="always")
def is_halfspace(desk: Array) -> bool:
    """Whether the first row of the desk is a half-space, which no box holds."""
    return bool(desk[0, KIND] == _HALFSPACE)


@kernel(allocates=False)
def triangle_gap(view: Array, corners: Array, a: int, b: int) -> tuple[float, Vector]:
    """How far two triangles are apart across the plane of one of them [m], below 0 for none.

    Their corners begin at a and b. The direction points from the second to the first, in the frame
    of the first. What both reach along it is worked out, so thin triangles prove nothing wrong.
    """
    x, y, z = corners[a, 0], corners[a, 1], corners[a, 2]
    p = (corners[a + 1, 0] - x, corners[a + 1, 1] - y, corners[a + 1, 2] - z)
    q = (corners[a + 2, 0] - x, corners[a + 2, 1] - y, corners[a + 2, 2] - z)
    u = _moved_corner(view, corners, b, x, y, z)
    v = _moved_corner(view, corners, b + 1, x, y, z)
    w = _moved_corner(view, corners, b + 2, x, y, z)
    gap, n = _gap_across(cross(p, q), p, q, u, v, w)
    other, m = _gap_across(cross(subtract(v, u), subtract(w, u)), p, q, u, v, w)
    return (gap, n) if gap >= other else (other, m)


@kernel(allocates=False, inline="always")
def _moved_corner(view: Array, corners: Array, k: int, x: float, y: float, z: float) -> Vector:
    """A corner of the second piece in the frame of the first, seen from a point there."""
    r, a, b, c = view, corners[k, 0], corners[k, 1], corners[k, 2]
    return (
        r[0] * a + r[1] * b + r[2] * c + (r[9] - x),
        r[3] * a + r[4] * b + r[5] * c + (r[10] - y),
        r[6] * a + r[7] * b + r[8] * c + (r[11] - z),
    )


@kernel(allocates=False)
def _gap_across(
    n: Vector, p: Vector, q: Vector, u: Vector, v: Vector, w: Vector
) -> tuple[float, Vector]:
    """Gap of the triangles 0, p, q and u, v, w along n, and the unit direction to the first."""
    square = dot(n, n)
    if not square > _LEAST_SQUARE:
        return -np.inf, (1.0, 0.0, 0.0)
    scale = 1.0 / math.sqrt(square)
    d, e = dot(n, p), dot(n, q)
    f, g, h = dot(n, u), dot(n, v), dot(n, w)
    above = min(f, g, h) - max(d, e, 0.0)
    below = min(d, e, 0.0) - max(f, g, h)
    if above > below:
        return scale * above, (-scale * n[0], -scale * n[1], -scale * n[2])
    return scale * below, (scale * n[0], scale * n[1], scale * n[2])


@kernel(allocates=False, inline="always")
def from_first(desk: Array, n: Vector, axis: Array) -> None:
    """Write a direction in the frame of the first row of the desk as one in the base frame."""
    for k in range(3):
        at = POSE + 4 * k
        axis[k] = desk[0, at] * n[0] + desk[0, at + 1] * n[1] + desk[0, at + 2] * n[2]
