"""Distances and bounds of eight points at once, one in each lane, from boxes, pieces and grids.

The points are centres of a robot's balls at eight states: of bodies, parts of bodies, and spheres.
"""

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
from compiled.simd_transpose import store_rows_kernel
from kinematics.arrays import Array
from kinematics.simd_frames import FRAME_SIZE, load_frame_kernel
from obstacles.collision.model.kernel_work import BALL_SIZE, Workspace
from obstacles.collision.model.model_arrays import ModelArrays
from obstacles.collision.model.pair_groups import BALL, GROUP_SIZE, OTHER_BALL, PARTED
from obstacles.distance.ball_distance import from_core
from obstacles.distance.piece_set import (
    CENTER,
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
    buffer = on_stack(_FOUR)
    store(buffer, 0, u)
    store(buffer, LANES, v)
    store(buffer, 2 * LANES, w)
    for at in range(LANES):
        x, y, z = buffer[at], buffer[LANES + at], buffer[2 * LANES + at]
        buffer[3 * LANES + at] = from_core(rows, k, corners, x, y, z)
    return load(buffer, 3 * LANES)


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


@kernel(allocates=False, inline="code")
def frame_at(work: Workspace, joint: int) -> int:
    """Place in ``work.lanes`` at which the frames of a body begin."""
    return int(3 * LANES * work.joints.shape[1] + FRAME_SIZE * joint)


@kernel(allocates=False, inline="code")
def _first_of(model: ModelArrays, work: Workspace, row: int) -> int:
    """Place in ``work.lanes`` at which the middles of a body's ball begin."""
    first = frame_at(work, work.frames.shape[0])
    return int(first + BALL_SIZE * (row - model.skipped.shape[0]))


@kernel(allocates=False, inline="code")
def moved(lanes: Array, at: int, x: float, y: float, z: float) -> Point:
    """A point in the base frame, by the frames that begin at an index."""
    F = load_frame_kernel(lanes, at)
    return (
        F[0] * x + F[1] * y + F[2] * z + F[3],
        F[4] * x + F[5] * y + F[6] * z + F[7],
        F[8] * x + F[9] * y + F[10] * z + F[11],
    )


@kernel(allocates=False, inline="code")
def place_balls(model: ModelArrays, work: Workspace, row: int) -> None:
    """Bring the middles of a moving body's ball at eight states into the base frame."""
    rows, at = model.robot, _first_of(model, work, row)
    x, y, z = rows[row, CENTER], rows[row, CENTER + 1], rows[row, CENTER + 2]
    p = moved(work.lanes, frame_at(work, model.joints[row]), x, y, z)
    store_rows_kernel(work.lanes, at, LANES, p)


@kernel(allocates=False, inline="code")
def ball_at(model: ModelArrays, work: Workspace, row: int) -> Point:
    """The middle of a body's ball in the base frame."""
    if model.joints[row] < 0:
        rows = model.robot
        return fill(rows[row, CENTER]), fill(rows[row, CENTER + 1]), fill(rows[row, CENTER + 2])
    at = _first_of(model, work, row)
    return load(work.lanes, at), load(work.lanes, at + LANES), load(work.lanes, at + 2 * LANES)


@kernel(allocates=False, inline="code")
def sphere_at(model: ModelArrays, work: Workspace, sphere: int, joint: int) -> Point:
    """The middle of a sphere of the robot in the base frame."""
    spheres = model.spheres
    x, y, z = spheres[sphere, 0], spheres[sphere, 1], spheres[sphere, 2]
    if joint < 0:
        return fill(x), fill(y), fill(z)
    return moved(work.lanes, frame_at(work, joint), x, y, z)


@kernel(allocates=False, inline="always")
def enter_group(model: ModelArrays, work: Workspace, group: int, near: int) -> int:
    """How many groups to go on by at one that is parted, its parts placed where lanes are near."""
    groups, size = model.groups, model.groups[group, GROUP_SIZE]
    if near == 0:
        return int(size)
    part = group + 1
    while part < group + size:
        for row in (groups[part, BALL], groups[part, OTHER_BALL]):
            if model.joints[row] >= 0:
                place_balls(model, work, row)
        part += groups[part, GROUP_SIZE] if groups[part, PARTED] < 0 else 1
    return 1
