"""How far touching meshes must be moved to be apart, by their triangles.

The least such translation of two bodies that are not convex takes a search over all directions.
Here some are tried: those across which their covers and their hulls part, those in which the
triangles that touch part from each other, and again those that touch just before a way out is
found. Along each of them a bisection leads to where nothing touches any more. So the depth is
that of a way out that was tried on the triangles: it is never too small, and no larger than that of
the hulls across the same directions.
"""

import numpy as np

from compiled.kernel import kernel
from compiled.vec3 import Vector
from kinematics.arrays import Array
from obstacles.distance.bounds import quick_bound
from obstacles.distance.bvh import FIRST
from obstacles.distance.epa import contact
from obstacles.distance.gjk import FARTHER, STILL, separation, support
from obstacles.distance.piece_set import (
    CENTER,
    KIND,
    NODE,
    NODE_STOP,
    POSE,
    ROUNDING,
    START,
    STOP,
    CoreKind,
    Lists,
    Pair,
    Shapes,
)
from obstacles.distance.triangles.distance import DESK, STACK, surface_distance

_HALFSPACE = int(CoreKind.HALFSPACE)
#: Directions that are tried at most.
_DIRECTIONS = 64
#: Comparisons of the moved bodies that a search may take.
_CHECKS = 160
#: A way out is known well enough to this share of its length.
_SHARE = 0.01
#: A way out is known well enough to this [m].
_LEAST = 1e-6
#: A direction is worth a bisection where it leads out in this share of the best one's length.
_SHORTER = 0.95


@kernel
def mesh_depth(a: Array, b: Array, corners: Array, tables: Lists, nodes: Array) -> float:
    """How far one body can be moved to part it from another one that it touches [m].

    Args:
        a: Rows of a body, the pieces of one solid, in a common frame; no half-space.
        b: Pieces of the second body.
        corners: Corners of both.
        tables: Tables of both.
        nodes: Nodes of the trees over their triangles.
    """
    if b[0, KIND] == _HALFSPACE:
        return _depth_in_halfspace(a, b, corners, tables, nodes)
    ways, buffer, stack = np.empty((_DIRECTIONS, 3)), np.zeros((9, 3)), np.empty(STACK)
    moved, shapes = a.copy(), Shapes(corners, tables, nodes)
    known = _first_ways(a, b, corners, tables, ways)
    best, checks, way = np.inf, 0, 0
    while way < known and checks < _CHECKS:
        n = (ways[way, 0], ways[way, 1], ways[way, 2])
        way += 1
        high = _hull_depth(a, b, corners, tables, n)
        if high > _SHORTER * best:
            high = _SHORTER * best
            checks += 1
            if not _is_apart(a, moved, b, shapes, n, high, buffer, stack):
                known = _add_directions(corners, tables, stack, ways, known)
                continue
        # Coarse steps down, since what is shallow is so by orders of magnitude, then halves.
        low, step = 0.0, 0.25
        while high - low > max(_SHARE * high, _LEAST) and checks < _CHECKS:
            middle = low + step * (high - low)
            checks += 1
            if _is_apart(a, moved, b, shapes, n, middle, buffer, stack):
                high = middle
            else:
                low, step = middle, 0.5
                known = _add_directions(corners, tables, stack, ways, known)
        best = min(best, high)
    return best


@kernel(inline="always")
def _depth_in_halfspace(a: Array, b: Array, corners: Array, tables: Lists, nodes: Array) -> float:
    n = (b[0, POSE + 2], b[0, POSE + 6], b[0, POSE + 10])
    offset = n[0] * b[0, POSE + 3] + n[1] * b[0, POSE + 7] + n[2] * b[0, POSE + 11]
    deepest = np.inf
    for i in range(a.shape[0]):
        if not a[i, NODE_STOP] > 0.0:
            p = support(a, i, corners, tables, (-n[0], -n[1], -n[2]))
            deepest = min(deepest, n[0] * p[0] + n[1] * p[1] + n[2] * p[2] - a[i, ROUNDING])
        x = n[0] * a[i, POSE] + n[1] * a[i, POSE + 4] + n[2] * a[i, POSE + 8]
        y = n[0] * a[i, POSE + 1] + n[1] * a[i, POSE + 5] + n[2] * a[i, POSE + 9]
        z = n[0] * a[i, POSE + 2] + n[1] * a[i, POSE + 6] + n[2] * a[i, POSE + 10]
        origin = n[0] * a[i, POSE + 3] + n[1] * a[i, POSE + 7] + n[2] * a[i, POSE + 11]
        for node in range(int(a[i, NODE]), int(a[i, NODE_STOP])):
            first = int(nodes[node, FIRST])
            for k in range(first, first + 3 if first >= 0 else first):
                p = (corners[k, 0], corners[k, 1], corners[k, 2])
                deepest = min(deepest, origin + x * p[0] + y * p[1] + z * p[2])
    return float(max(offset - deepest, 0.0))


@kernel(inline="always")
def _first_ways(a: Array, b: Array, corners: Array, tables: Lists, ways: Array) -> int:
    """Directions to try: out of covers, from middle to middle, and along the axes of the frame."""
    known, axis = 0, np.zeros(3)
    for i in range(a.shape[0]):
        for j in range(b.shape[0]):
            bound, _ = quick_bound(a, i, b, j, 0.0)
            if bound > 0.0 or known >= _DIRECTIONS // 4:
                continue
            distance, n, _ = contact(a, i, b, j, corners, tables, axis)
            if distance <= 0.0:
                known = _add(ways, known, n)
    x, y, z = 0.0, 0.0, 0.0
    for i in range(a.shape[0]):
        x, y, z = x + a[i, CENTER], y + a[i, CENTER + 1], z + a[i, CENTER + 2]
    x, y, z = x / a.shape[0], y / a.shape[0], z / a.shape[0]
    for j in range(b.shape[0]):
        x -= b[j, CENTER] / b.shape[0]
        y -= b[j, CENTER + 1] / b.shape[0]
        z -= b[j, CENTER + 2] / b.shape[0]
    known = _add(ways, known, (x, y, z))
    for k in range(3):
        n = (1.0 if k == 0 else 0.0, 1.0 if k == 1 else 0.0, 1.0 if k == 2 else 0.0)
        known = _add(ways, known, n)
        known = _add(ways, known, (-n[0], -n[1], -n[2]))
    return known


@kernel
def _add(ways: Array, known: int, n: Vector) -> int:
    """Note a direction that is not nearly known; how many there are then."""
    length = np.sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2])
    if known == ways.shape[0] or not length > 0.0:
        return known
    x, y, z = n[0] / length, n[1] / length, n[2] / length
    for k in range(known):
        if x * ways[k, 0] + y * ways[k, 1] + z * ways[k, 2] > 0.999:
            return known
    ways[known, 0], ways[known, 1], ways[known, 2] = x, y, z
    return known + 1


@kernel(inline="always")
def _hull_depth(a: Array, b: Array, corners: Array, tables: Lists, n: Vector) -> float:
    """How far ``a`` has to be moved along n until a plane across n parts all of it from ``b``."""
    low, high = np.inf, -np.inf
    for i in range(a.shape[0]):
        p = support(a, i, corners, tables, (-n[0], -n[1], -n[2]))
        low = min(low, n[0] * p[0] + n[1] * p[1] + n[2] * p[2] - a[i, ROUNDING])
    for j in range(b.shape[0]):
        p = support(b, j, corners, tables, n)
        high = max(high, n[0] * p[0] + n[1] * p[1] + n[2] * p[2] + b[j, ROUNDING])
    return float(max(high - low, 0.0))


@kernel
def _is_apart(
    a: Array, moved: Array, b: Array, shapes: Shapes, n: Vector, by: float, buffer: Array,
    stack: Array,
) -> bool:  # fmt: skip
    """Whether ``a`` is apart from ``b`` once it is moved by some way along n.

    Args:
        a: Rows of a body.
        moved: Filled with its rows once it is moved.
        b: Rows of the other body.
        shapes: Corners, tables and trees of both.
        n: The direction.
        by: How far along it [m].
        buffer: Workspace, shape (9, 3).
        stack: Workspace, shape STACK; its rows from DESK are left as the parts that touch, where
            some do.
    """
    axis = buffer[8]
    for i in range(a.shape[0]):
        for k in range(3):
            moved[i, CENTER + k] = a[i, CENTER + k] + by * n[k]
            moved[i, POSE + 4 * k + 3] = a[i, POSE + 4 * k + 3] + by * n[k]
    for i in range(a.shape[0]):
        for j in range(b.shape[0]):
            bound, u = quick_bound(moved, i, b, j, 0.0)
            if bound > 0.0:
                continue
            axis[0], axis[1], axis[2] = u
            pair = Pair(moved, i, b, j)
            verdict, _, _ = separation(
                pair, shapes.corners, shapes.tables, 0.0, 0.0, STILL, axis, buffer
            )
            if verdict == FARTHER:
                continue
            stack[DESK], stack[DESK + 1] = moved[i], b[j]
            if not max(moved[i, NODE_STOP], b[j, NODE_STOP]) > 0.0:
                return False
            verdict, _ = surface_distance(pair, shapes, 0.0, 0.0, axis, buffer, stack)
            if verdict != FARTHER:
                return False
    return True


@kernel
def _add_directions(corners: Array, tables: Lists, stack: Array, ways: Array, known: int) -> int:
    """Note the directions that part what was left as touching; how many there are then."""
    desk = stack[DESK : DESK + 2]
    if desk[0, KIND] == _HALFSPACE or desk[1, KIND] == _HALFSPACE:
        return known
    distance, n, _ = contact(desk, 0, desk, 1, corners, tables, np.zeros(3))
    if distance <= 0.0:
        known = _add(ways, known, n)
        known = _add(ways, known, (-n[0], -n[1], -n[2]))
    for k in range(2):
        if desk[k, STOP] - desk[k, START] == 3.0:
            n = _normal(desk, k, corners)
            known = _add(ways, known, n)
            known = _add(ways, known, (-n[0], -n[1], -n[2]))
    return known


@kernel(inline="always")
def _normal(desk: Array, k: int, corners: Array) -> Vector:
    """Across a triangle on the desk, of any length."""
    first, T = int(desk[k, START]), POSE
    ux, uy = corners[first + 1, 0] - corners[first, 0], corners[first + 1, 1] - corners[first, 1]
    uz = corners[first + 1, 2] - corners[first, 2]
    vx, vy = corners[first + 2, 0] - corners[first, 0], corners[first + 2, 1] - corners[first, 1]
    vz = corners[first + 2, 2] - corners[first, 2]
    x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    row = desk[k]
    return (
        row[T] * x + row[T + 1] * y + row[T + 2] * z,
        row[T + 4] * x + row[T + 5] * y + row[T + 6] * z,
        row[T + 8] * x + row[T + 9] * y + row[T + 10] * z,
    )
