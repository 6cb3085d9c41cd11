"""Few balls that cover a convex polytope and reach little beyond it.

With s(c) the signed distance of a centre c from the polytope, negative inside, a ball of radius r
about it reaches beyond it by its excess r + s(c), exactly.

That the balls cover it is made so: it is cut into convex cells, and each ball holds all corners of
its cell. The worst cells are cut in two. Then all balls are blown up to the excess of the worst,
and the polytope is cut anew along the planes where two of them have equal power: what one ball
loses others hold, so every cell still lies in its ball, and to fit each ball anew can only lower
the greatest excess. The best centre is where r(c) + s(c) is least, the distance of the farthest
corner plus the highest of the planes: a convex function, walked down along its subgradients.
Sources: "Variational sphere set approximation for solid objects", The Visual Computer, 2006, for
the two steps by turns; "Convex optimization algorithms", chapter 3, for the descent.
"""

import math

import numpy as np

from compiled.kernel import kernel
from compiled.vec3 import cross, dot
from kinematics.arrays import Array, Indices

#: Times that cells and balls are fitted to each other, each time there are twice as many, and last.
_BETWEEN, _ROUNDS = 1, 4
#: Steps towards the best centre, each this much shorter than the one before.
_STEPS, _SHORTER = 24, 0.78
#: Steps from one look at which corners and planes no later step can make the decisive ones to the
#: next.
_BETWEEN_LOOKS = 3
#: What the better half of a cell counts for beside the worse one.
_SMALLER = 0.25
#: A cut that leaves more of the excess than this gains little.
_GAINED = 0.95
#: Of balls that hold others, depths count so much beside radii: they are for telling pairs apart.
_PARTING = 0.1
#: Lengths below this [m] are rounding errors.
_ROUNDING = 1e-9


@kernel(inline="always")
def _farthest(points: Array, x: float, y: float, z: float) -> tuple[int, float]:
    """Number of the farthest of ``points`` (v, 3) from a point, and its distance."""
    square, corner = -1.0, 0
    for k in range(points.shape[0]):
        a, b, c = x - points[k, 0], y - points[k, 1], z - points[k, 2]
        if a * a + b * b + c * c > square:
            square, corner = a * a + b * b + c * c, k
    return corner, math.sqrt(square)


@kernel
def _best_ball(points: Array, planes: Array, share: float, ball: Array) -> None:
    """Write the ball about ``points`` (v, 3) that is best: centre, radius, depth of the centre.

    Args:
        points: Corners of a part of the piece.
        planes: Planes of the piece, each with its offset, shape (f, 4); none of a flat one.
        share: Weight of the depth beside the radius.
        ball: Filled, shape (5,).
    """
    x, y, z = 0.0, 0.0, 0.0
    count, faces = points.shape[0], planes.shape[0]
    for k in range(count):
        x += points[k, 0] / count
        y += points[k, 1] / count
        z += points[k, 2] / count
    corners, sides = np.arange(count), np.arange(faces)
    away, heights = np.empty(count), np.empty(faces)
    best, step = np.inf, -1.0
    for turn in range(_STEPS):
        corner, square = 0, -1.0
        for k in range(count):
            v = corners[k]
            a, b, c = x - points[v, 0], y - points[v, 1], z - points[v, 2]
            away[k] = a * a + b * b + c * c
            if away[k] > square:
                square, corner = away[k], v
        radius = math.sqrt(square)
        highest, face = -np.inf, 0
        for k in range(faces):
            f = sides[k]
            heights[k] = planes[f, 0] * x + planes[f, 1] * y + planes[f, 2] * z - planes[f, 3]
            if heights[k] > highest:
                highest, face = heights[k], f
        if faces == 0:
            highest = 0.0
        # The first one, a mean of corners, is in the piece whatever rounding says.
        if step < 0.0 or (highest <= 0.0 and radius + share * highest < best):
            best = radius + share * highest
            ball[0], ball[1], ball[2], ball[3], ball[4] = x, y, z, radius, -highest
        step = 0.5 * radius if step < 0.0 else step
        if not radius > 0.0:
            break
        gx, gy = (points[corner, 0] - x) / radius, (points[corner, 1] - y) / radius
        gz = (points[corner, 2] - z) / radius
        if faces > 0:
            gx -= share * planes[face, 0]
            gy -= share * planes[face, 1]
            gz -= share * planes[face, 2]
        length = math.sqrt(gx * gx + gy * gy + gz * gz)
        if length < _ROUNDING:
            break
        if turn % _BETWEEN_LOOKS == 0:
            # Distances and heights change by no more than all steps to come together.
            spread = 2.0 * step / (1.0 - _SHORTER) + _ROUNDING
            count = _keep(corners, away, count, max(radius - spread, 0.0) ** 2)
            faces = _keep(sides, heights, faces, highest - spread)
        x += step * gx / length
        y += step * gy / length
        z += step * gz / length
        step *= _SHORTER


@kernel(inline="always")
def _keep(numbers: Indices, values: Array, count: int, least: float) -> int:
    """Keep those of the first ``count`` numbers whose values are so large; how many they are."""
    kept = 0
    for k in range(count):
        if values[k] >= least:
            numbers[kept] = numbers[k]
            kept += 1
    return kept


@kernel(inline="always")
def _worst(balls: Array, count: int) -> int:
    """Number of the ball with the greatest excess, of the first ``count``."""
    worst = 0
    for k in range(1, count):
        if balls[k, 3] - balls[k, 4] > balls[worst, 3] - balls[worst, 4]:
            worst = k
    return worst


@kernel
def _heights(points: Array, n: Array) -> tuple[float, float]:
    """How far points (v, 3) reach along ``n`` (3,) at least and at most."""
    lowest, highest = np.inf, -np.inf
    for v in range(points.shape[0]):
        height = n[0] * points[v, 0] + n[1] * points[v, 1] + n[2] * points[v, 2]
        lowest, highest = min(lowest, height), max(highest, height)
    return lowest, highest


@kernel(inline="always")
def _split(
    points: Array, edges: Indices, planes: Array, ball: Array, pair: Array
) -> tuple[Array, Indices, Array, Indices]:
    """The halves of a cell whose balls, written into ``pair`` (2, 5), have the least excess.

    It is halved along the axes and towards the corner that is farthest from its ball's centre.
    Where none of that gains much, as on a slice of a bar, it is halved along its longest side: the
    next cuts gain then. No half is answered of a cell that has no length.
    """
    n, longest, length = np.zeros(3), np.zeros(3), 0.0
    least, trial = np.inf, np.empty((2, 5))
    chosen = (points, edges, points[:0], edges[:0])
    for side in range(4):
        if side < 3:
            for axis in range(3):
                n[axis] = 1.0 if axis == side else 0.0
            lowest, highest = _heights(points, n)
            if highest - lowest > length:
                length = highest - lowest
                longest[0], longest[1], longest[2] = n[0], n[1], n[2]
        else:
            _towards_farthest(points, ball, n)
        halves = _halve(points, edges, planes, n, trial)
        first, second = trial[0, 3] - trial[0, 4], trial[1, 3] - trial[1, 4]
        excess = max(first, second) + _SMALLER * min(first, second)
        if max(first, second) < _GAINED * (ball[3] - ball[4]) and excess < least:
            least, chosen = excess, halves
            pair[:] = trial
    if least < np.inf:
        return chosen
    return _halve(points, edges, planes, longest, pair)


@kernel
def _halve(
    points: Array, edges: Indices, planes: Array, n: Array, pair: Array
) -> tuple[Array, Indices, Array, Indices]:
    """Halves of a cell along ``n`` (3,), and their balls in ``pair``; none if it has no length."""
    lowest, highest = _heights(points, n)
    if not highest - lowest > _ROUNDING:
        for column in range(5):
            pair[0, column], pair[1, column] = np.inf, 0.0
        return points, edges, points[:0], edges[:0]
    back = np.empty(3)
    for axis in range(3):
        back[axis] = -n[axis]
    one, one_edges = cut_cell(points, edges, n, 0.5 * (lowest + highest))
    other, other_edges = cut_cell(points, edges, back, -0.5 * (lowest + highest))
    _best_ball(one, planes, 1.0, pair[0])
    _best_ball(other, planes, 1.0, pair[1])
    return one, one_edges, other, other_edges


@kernel(inline="always")
def _towards_farthest(points: Array, ball: Array, n: Array) -> None:
    """Write the unit direction from a ball's centre to the farthest of ``points`` into ``n``."""
    corner, distance = _farthest(points, ball[0], ball[1], ball[2])
    for axis in range(3):
        n[axis] = (points[corner, axis] - ball[axis]) / max(distance, _ROUNDING)


@kernel
def cover(corners: Array, edges: Indices, planes: Array, most: int, enough: float) -> Array:
    """Balls that cover a convex polytope, from one about it all down to the finest.

    Args:
        corners: Corners of the polytope, shape (v, 3).
        edges: Pairs of its corners, among them all its edges, shape (e, 2).
        planes: Planes of the polytope's faces, unit normals and offsets, shape (f, 4); none of a
            flat one.
        most: Balls on the finest level, if it takes that many.
        enough: Excess at which fewer will do [m].

    Returns:
        Rows of centre, radius, depth of the centre, and the number of the ball after all below it,
        shape (s, 6).
    """
    cells, lines = [corners], [edges]
    balls, pair = np.empty((most, 5)), np.empty((2, 5))
    _best_ball(corners, planes, 1.0, balls[0])
    count, stuck = 1, False
    while count < most and not stuck:
        for _ in range(min(count, most - count)):
            worst = _worst(balls, count)
            stuck = not balls[worst, 3] - balls[worst, 4] > enough
            if stuck:
                break
            one, one_edges, other, other_edges = _split(
                cells[worst], lines[worst], planes, balls[worst], pair
            )
            stuck = other.shape[0] == 0
            if stuck:
                break
            for column in range(5):
                balls[worst, column], balls[count, column] = pair[0, column], pair[1, column]
            cells[worst], lines[worst] = one, one_edges
            cells.append(other)
            lines.append(other_edges)
            count += 1
        for _ in range(_ROUNDS if count == most else _BETWEEN):
            cells, lines = _fit(corners, edges, planes, balls[:count], cells, lines)
    return _hierarchy(planes, balls[:count], cells)


@kernel
def _fit(
    corners: Array, edges: Indices, planes: Array, balls: Array, cells: list[Array],
    lines: list[Indices],
) -> tuple[list[Array], list[Indices]]:  # fmt: skip
    """Cut a polytope anew where balls of the worst one's excess have equal power; fit them anew.

    ``cells`` and ``lines``, their corners and edges, are filled with the new ones.
    """
    grown, worst = balls.copy(), _worst(balls, balls.shape[0])
    for one in range(balls.shape[0]):
        grown[one, 3] = balls[one, 4] + balls[worst, 3] - balls[worst, 4]
    trial = np.empty(5)
    for one in range(balls.shape[0]):
        points, ends = _power_cell(corners, edges, grown, one)
        if points.shape[0] == 0:
            # Others hold all that it held; it stays as small as it can be.
            points = np.empty((1, 3))
            for axis in range(3):
                points[0, axis] = balls[one, axis]
        _best_ball(points, planes, 1.0, trial)
        _, reach = _farthest(points, balls[one, 0], balls[one, 1], balls[one, 2])
        balls[one, 3] = reach
        if trial[3] - trial[4] < reach - balls[one, 4]:
            for column in range(5):
                balls[one, column] = trial[column]
        cells[one], lines[one] = points, ends
    return cells, lines


@kernel(inline="always")
def _power_cell(corners: Array, edges: Indices, balls: Array, one: int) -> tuple[Array, Indices]:
    """Corners and edges of the part of a polytope where ball ``one`` has the least power."""
    points, ends, k = corners, edges, balls.shape[0]
    n, squares = np.empty(3), np.zeros(k)
    for other in range(k):
        for axis in range(3):
            away = balls[other, axis] - balls[one, axis]
            squares[other] += away * away
    # The nearest first: few of the others still cut anything.
    for other in ascending_order(squares):
        length = math.sqrt(squares[other])
        if other == one or length < _ROUNDING:
            continue
        # |x - c|^2 - r^2 is the same for both on the plane n . x = offset.
        difference = (balls[one, 3] - balls[other, 3]) * (balls[one, 3] + balls[other, 3])
        offset = 0.5 * (squares[other] + difference) / length
        for axis in range(3):
            n[axis] = (balls[other, axis] - balls[one, axis]) / length
            offset += n[axis] * balls[one, axis]
        _, highest = _heights(points, n)
        if highest > offset:
            points, ends = cut_cell(points, ends, n, offset)
        if points.shape[0] == 0:
            break
    return points, ends


@kernel(inline="always")
def _sort(balls: Array, order: Indices) -> None:
    """Put the balls with the numbers in ``order`` in order along their longest side."""
    count = order.shape[0]
    along, own = np.empty((count, 3)), order.copy()
    for entry in range(count):
        for axis in range(3):
            along[entry, axis] = balls[own[entry], axis]
    longest, side, n = -1.0, 0, np.empty(3)
    for axis in range(3):
        n[0], n[1], n[2] = 0.0, 0.0, 0.0
        n[axis] = 1.0
        lowest, highest = _heights(along, n)
        if highest - lowest > longest:
            longest, side = highest - lowest, axis
    for entry in range(count):
        along[entry, 0] = along[entry, side]
    for entry, chosen in enumerate(ascending_order(along[:, 0].copy())):
        order[entry] = own[chosen]


@kernel
def _hierarchy(planes: Array, balls: Array, cells: list[Array]) -> Array:
    """Rows of ``_grow``: halved by halves at the middle one along the longest side."""
    k = balls.shape[0]
    rows, order = np.empty((2 * k - 1, 6)), np.arange(k)
    stack = np.empty((2 * k, 2), dtype=np.int64)
    stack[0, 0], stack[0, 1] = 0, k
    top, made = 1, 0
    spans = np.empty((2 * k - 1, 2), dtype=np.int64)
    while top > 0:
        top -= 1
        first, last = stack[top, 0], stack[top, 1]
        spans[made, 0], spans[made, 1] = first, last
        if last - first == 1:
            for column in range(5):
                rows[made, column] = balls[order[first], column]
            made += 1
            continue
        count = 0
        for entry in range(first, last):
            count += cells[order[entry]].shape[0]
        held, at = np.empty((count, 3)), 0
        for entry in range(first, last):
            cell = cells[order[entry]]
            for v in range(cell.shape[0]):
                for column in range(3):
                    held[at, column] = cell[v, column]
                at += 1
        _best_ball(held, planes, _PARTING, rows[made])
        made += 1
        _sort(balls, order[first:last])
        half = (first + last) // 2
        stack[top, 0], stack[top, 1] = half, last
        stack[top + 1, 0], stack[top + 1, 1] = first, half
        top += 2
    # The rows that follow one and lie in its span are those below it: twice its span less one.
    for row in range(made):
        rows[row, 5] = row + 2 * (spans[row, 1] - spans[row, 0]) - 1
    return rows


@kernel
def cut_cell(points: Array, edges: Indices, n: Array, offset: float) -> tuple[Array, Indices]:
    """Corners and edges of the part of a convex cell where n . x <= offset.

    Where the plane cuts edges, new corners come, and edges between neighbours around the cut.
    """
    v, e = points.shape[0], edges.shape[0]
    height, number = np.empty(v), np.full(v, -1)
    corners, lines = np.empty((v + e, 3)), np.empty((2 * e, 2), dtype=np.int64)
    c, m = 0, 0  # corners and edges so far
    for k in range(v):
        height[k] = n[0] * points[k, 0] + n[1] * points[k, 1] + n[2] * points[k, 2] - offset
        if height[k] <= 0.0:
            for axis in range(3):
                corners[c, axis] = points[k, axis]
            number[k] = c
            c += 1
    first = c
    for k in range(e):
        i, j = edges[k, 0], edges[k, 1]
        if number[i] < 0:
            i, j = j, i
        if number[i] < 0:
            continue
        lines[m, 0], lines[m, 1] = number[i], number[j]
        if number[j] < 0:
            share = height[i] / (height[i] - height[j])
            for axis in range(3):
                corners[c, axis] = points[i, axis] + share * (points[j, axis] - points[i, axis])
            lines[m, 1] = c
            c += 1
        m += 1
    count = c - first
    if count > 1:
        order = _around_cut(corners[first:c], n)
        for k in range(count):
            lines[m, 0], lines[m, 1] = (
                first + order[k],
                first + order[(k + 1) % count],
            )
            m += 1
    return corners[:c], lines[:m]


@kernel(inline="always")
def ascending_order(values: Array) -> Indices:
    """The order of a few values; compiled in a tenth of the time that numba's own takes."""
    order = np.arange(values.shape[0])
    for k in range(1, values.shape[0]):
        entry, at = order[k], k
        while at > 0 and values[order[at - 1]] > values[entry]:
            order[at] = order[at - 1]
            at -= 1
        order[at] = entry
    return order


@kernel(inline="always")
def _around_cut(points: Array, n: Array) -> Indices:
    """The order of coplanar points around their middle, seen along their normal ``n`` (3,)."""
    u = (0.0, n[2], -n[1]) if abs(n[0]) < 0.6 else (-n[2], 0.0, n[0])
    w = cross((n[0], n[1], n[2]), u)
    count, x, y, z = points.shape[0], 0.0, 0.0, 0.0
    for k in range(count):
        x += points[k, 0] / count
        y += points[k, 1] / count
        z += points[k, 2] / count
    turns = np.empty(count)
    for k in range(count):
        p = (points[k, 0] - x, points[k, 1] - y, points[k, 2] - z)
        turns[k] = math.atan2(dot(p, w), dot(p, u))
    return ascending_order(turns)
