"""Middles of a robot's balls at eight states: of bodies, parts of bodies, and pieces' spheres."""

from compiled.kernel import kernel
from compiled.simd import LANES, fill, load, store
from kinematics.arrays import Array
from kinematics.simd_frames import FRAME_SIZE, load_frame_kernel
from obstacles.collision.lanes.distance import Point
from obstacles.collision.model.kernel_work import BALL_SIZE, Workspace
from obstacles.collision.model.model_arrays import ModelArrays
from obstacles.collision.model.pair_groups import BALL, OTHER_BALL, PARTED, SIZE
from obstacles.distance.piece_set import CENTER


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
    store(work.lanes, at, p[0])
    store(work.lanes, at + LANES, p[1])
    store(work.lanes, at + 2 * LANES, p[2])


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


@kernel(allocates=False)
def enter_group(model: ModelArrays, work: Workspace, group: int, near: int) -> int:
    """How many groups to go on by at one that is parted, its parts placed where lanes are near."""
    groups, size = model.groups, model.groups[group, SIZE]
    if near == 0:
        return int(size)
    part = group + 1
    while part < group + size:
        for row in (groups[part, BALL], groups[part, OTHER_BALL]):
            if model.joints[row] >= 0:
                place_balls(model, work, row)
        part += groups[part, SIZE] if groups[part, PARTED] < 0 else 1
    return 1
