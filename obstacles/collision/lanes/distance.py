"""Distances and bounds of eight points at once, one in each lane, from boxes, pieces and grids."""

import math

from compiled.kernel import kernel
from compiled.simd import (
    LANES,
    Lanes,
    bits,
    choose,
    fill,
    floor,
    lane,
    load,
    on_stack,
    store,
)
from kinematics.arrays import Array
from obstacles.collision.model.model_arrays import ModelArrays
from obstacles.distance.ball_distance import from_core
from obstacles.distance.piece_set import (
    HALF,
    KIND,
    MIDDLE,
    POSE,
    ROUNDING,
    SIZE,
    START,
    STOP,
    CoreKind,
)

_POLYTOPE = int(CoreKind.POLYTOPE)
_CYLINDER = int(CoreKind.CYLINDER)
_HALFSPACE = int(CoreKind.HALFSPACE)
_CONE = int(CoreKind.CONE)
_POINT = int(CoreKind.POINT)
#: Numbers on the stack for four vectors.
_FOUR = 4 * LANES
Point = tuple[Lanes, Lanes, Lanes]


@kernel(allocates=False, inline="code")
def box_gap(nodes: Array, node: int, p: Point) -> Lanes:
    """``bvh.gap`` of points."""
    x, y, z = p
    dx = max(nodes[node, 0] - x, x - nodes[node, 3])
    dy = max(nodes[node, 1] - y, y - nodes[node, 4])
    dz = max(nodes[node, 2] - z, z - nodes[node, 5])
    dx, dy, dz = max(dx, 0.0), max(dy, 0.0), max(dz, 0.0)
    square: Lanes = dx * dx + dy * dy + dz * dz
    return square


@kernel(allocates=False, inline="code")
def _outside(a: Lanes, b: Lanes, c: Lanes) -> Lanes:
    """How far out is what is a, b and c beyond three planes at right angles."""
    deepest = max(a, b)
    deepest = max(deepest, c)
    a, b, c = max(a, 0.0), max(b, 0.0), max(c, 0.0)
    return choose(deepest <= 0.0, deepest, math.sqrt(a * a + b * b + c * c))


@kernel(allocates=False, inline="code")
def lane_bound_from(rows: Array, k: int, corners: Array, p: Point) -> Lanes:
    """``ball_distance.bound_from`` of points."""
    a, b, c = p[0] - rows[k, POSE + 3], p[1] - rows[k, POSE + 7], p[2] - rows[k, POSE + 11]
    kind = rows[k, KIND]
    if kind == _POINT:
        ball: Lanes = math.sqrt(a * a + b * b + c * c) - rows[k, ROUNDING]
        return ball
    u: Lanes = rows[k, POSE] * a + rows[k, POSE + 4] * b + rows[k, POSE + 8] * c
    v: Lanes = rows[k, POSE + 1] * a + rows[k, POSE + 5] * b + rows[k, POSE + 9] * c
    w: Lanes = rows[k, POSE + 2] * a + rows[k, POSE + 6] * b + rows[k, POSE + 10] * c
    if kind == _HALFSPACE:
        return w
    if kind == _CYLINDER:
        across, along = math.sqrt(u * u + v * v) - rows[k, SIZE], abs(w) - rows[k, SIZE + 1]
        deepest = max(across, along)
        across, along = max(across, 0.0), max(along, 0.0)
        out = math.sqrt(across * across + along * along)
        beyond: Lanes = choose(deepest <= 0.0, deepest, out) - rows[k, ROUNDING]
        return beyond
    if kind == _CONE or (kind == _POLYTOPE and rows[k, STOP] - rows[k, START] == 2.0):
        return _from_core_each(rows, k, corners, u, v, w)
    return _outside(
        abs(u - rows[k, MIDDLE]) - rows[k, HALF],
        abs(v - rows[k, MIDDLE + 1]) - rows[k, HALF + 1],
        abs(w - rows[k, MIDDLE + 2]) - rows[k, HALF + 2],
    )


@kernel(allocates=False)
def _from_core_each(rows: Array, k: int, corners: Array, u: Lanes, v: Lanes, w: Lanes) -> Lanes:
    """``ball_distance.from_core`` of points, one by one."""
    room = on_stack(_FOUR)
    store(room, 0, u)
    store(room, LANES, v)
    store(room, 2 * LANES, w)
    for at in range(LANES):
        x, y, z = room[at], room[LANES + at], room[2 * LANES + at]
        room[3 * LANES + at] = from_core(rows, k, corners, x, y, z)
    return load(room, 3 * LANES)


@kernel(allocates=False, inline="code")
def closer(p: Point, q: Point, reach: float) -> int:
    """Lanes where two points are at most so far apart, as bits."""
    x, y, z = p[0] - q[0], p[1] - q[1], p[2] - q[2]
    return bits(math.sqrt(x * x + y * y + z * z) <= reach)


@kernel(allocates=False)
def beyond_grid(model: ModelArrays, lanes: Array, s: int, enough: float, open_lanes: int) -> int:
    """Lanes of those open where the grid of pair s does not prove that it is far enough apart."""
    cell, inside = cell_of(model, lanes, s, open_lanes)
    left, start = open_lanes, model.grid_starts[s]
    for number in range(LANES):
        if inside >> number & 1 and model.grid_values[start + int(lane(cell, number))] > enough:
            left &= ~(1 << number)
    return left


@kernel(allocates=False, inline="always")
def cell_of(model: ModelArrays, lanes: Array, s: int, open_lanes: int) -> tuple[Lanes, int]:
    """Cells of the grid of pair s, and the lanes of those open whose states are in it."""
    still = model.joints[model.self_pairs[s, 0]]
    cell, inside, axes = fill(0.0), open_lanes, model.grid_axes
    for k in range(2):
        count = axes[s, k, 2]
        if count != 1.0:
            at = (load(lanes, LANES * (still + 1 + k)) - axes[s, k, 0]) * axes[s, k, 1]
            inside &= bits(at >= 0.0) & bits(at < count)
            cell = cell * count + floor(at)
    return cell, inside
