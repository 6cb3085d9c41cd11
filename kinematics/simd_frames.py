"""Frames and Jacobians of eight configurations at a time, one in each SIMD lane, for batches.

What one configuration has as a number is here a vector of eight (see ``simd``), and the
arithmetic is that of ``frame`` itself. In memory a vector is a row of eight numbers: a frame has
twelve rows, a Jacobian six for each joint, joint values one for each joint; all are flat arrays.
"""

from compiled.kernel import kernel
from compiled.simd import LANES, Lanes, fill, load, store
from compiled.simd_transpose import (
    gather_kernel,
    load_rows_kernel,
    scatter_kernel,
    store_rows_kernel,
    transpose,
)
from compiled.sincos import turns_kernel
from kinematics.arrays import Array
from kinematics.frame import Frame, at_joint_kernel, compose_kernel, move_kernel

#: Rows of a frame.
FRAME = 12
#: Numbers of a pose (4, 4).
POSE = 16
#: Rows of a column of a Jacobian.
COLUMN = 6
#: Numbers in eight frames.
FRAME_SIZE = FRAME * LANES
#: Numbers in eight columns.
COLUMN_SIZE = COLUMN * LANES
Column = tuple[Lanes, Lanes, Lanes, Lanes, Lanes, Lanes]


@kernel(inline="code")
def identity_lanes_kernel() -> Frame:
    """Eight identities."""
    zero, one = fill(0.0), fill(1.0)
    return one, zero, zero, zero, zero, one, zero, zero, zero, zero, one, zero


@kernel(allocates=False)
def stream_lanes_kernel(frames: Array, poses: Array, count: int) -> None:
    """Write frames of links, eight each, into poses (LANES, links, 4, 4) from first to last byte.

    Poses take the place of the frames before that: from the last link on, none is overwritten that
    is still to be read.
    """
    zero, one = fill(0.0), fill(1.0)
    for link in range(count - 1, -1, -1):
        at, to = FRAME_SIZE * link, LANES * POSE * link
        upper = transpose(load_rows_kernel(frames, at, LANES))
        lower = transpose((
            load(frames, at + 8 * LANES), load(frames, at + 9 * LANES),
            load(frames, at + 10 * LANES), load(frames, at + 11 * LANES), zero, zero, zero, one,
        ))  # fmt: skip
        store_rows_kernel(frames, to, POSE, upper)
        store_rows_kernel(frames, to + LANES, POSE, lower)
    to = 0
    for lane in range(LANES):
        for link in range(count):
            at = POSE * (LANES * link + lane)
            store(poses, to, load(frames, at))
            store(poses, to + LANES, load(frames, at + LANES))
            to += POSE


@kernel(allocates=False)
def axes_lanes_kernel(
    model: Array, q: Array, cosines: Array, sines: Array, link: int, axes: Array
) -> Frame:
    """The frames of a link from joint values and their turns (n * LANES,).

    The origins and z axes of the joints on the way are written into axes (n * COLUMN * LANES,).
    """
    row = 1 + q.shape[0] // LANES + (link if link >= 0 else int(model[0, 1]))
    B = identity_lanes_kernel()
    for j in range(int(model[row, 0]) + 1):
        at = LANES * j
        B = move_kernel(model, 1 + j, load(q, at), load(cosines, at), load(sines, at), B)
        store_rows_kernel(axes, COLUMN_SIZE * j, LANES, (B[3], B[7], B[11], B[2], B[6], B[10]))
    return compose_kernel(B, model, row)


@kernel(inline="code")
def column_lanes_kernel(model: Array, axes: Array, j: int, last: int, B: Frame) -> Column:
    """Column j of the Jacobians of frames B that joint ``last`` carries, by what is in ``axes``."""
    zero = fill(0.0)
    if j > last:
        return zero, zero, zero, zero, zero, zero
    px, py, pz, zx, zy, zz = load_column_kernel(axes, COLUMN_SIZE * j)
    if model[1 + j, 0] != 0.0:
        return zx, zy, zz, zero, zero, zero
    x, y, z = B[3] - px, B[7] - py, B[11] - pz
    return zy * z - zz * y, zz * x - zx * z, zx * y - zy * x, zx, zy, zz


@kernel(allocates=False)
def jacobians_lanes_kernel(model: Array, q: Array, link: int, J: Array, room: Array) -> None:
    """Jacobians (LANES, 6, n), flat, of a link at q (LANES, n).

    ``jacobian.frame_and_jacobian_kernel`` in lanes; room ((3 + 2 * COLUMN) * n * LANES,).
    """
    n = q.shape[1]
    size, columns = n * LANES, n * COLUMN * LANES
    values, cosines, sines = room[:size], room[size : 2 * size], room[2 * size : 3 * size]
    axes, rows = room[3 * size : 3 * size + columns], room[3 * size + columns :]
    last = int(model[1 + n + (link if link >= 0 else int(model[0, 1])), 0])
    gather_kernel(q, values)
    turns_kernel(values, cosines, sines)
    B = axes_lanes_kernel(model, values, cosines, sines, link, axes)
    for j in range(n):
        column = column_lanes_kernel(model, axes, j, last, B)
        store_rows_kernel(rows, LANES * j, size, column)
    # By way of the axes, which are read no more: a batch that is too large for the cache is written
    # from the first to the last byte, which memory likes better than eight places in turn.
    scatter_kernel(rows, axes)
    for at in range(0, columns, LANES):
        store(J, at, load(axes, at))


@kernel(inline="code")
def load_column_kernel(J: Array, at: int) -> Column:
    """The six vectors of a column that begins at an index."""
    return (
        load(J, at), load(J, at + LANES), load(J, at + 2 * LANES),
        load(J, at + 3 * LANES), load(J, at + 4 * LANES), load(J, at + 5 * LANES),
    )  # fmt: skip


@kernel(inline="code")
def load_frame_kernel(frames: Array, at: int) -> Frame:
    """The twelve vectors of eight frames that begin at an index."""
    return load_column_kernel(frames, at) + load_column_kernel(frames, at + COLUMN_SIZE)


@kernel(allocates=False, inline="code")
def poses_lanes_kernel(model: Array, q: Array, poses: Array, room: Array) -> None:
    """Poses (LANES, links, 4, 4) of all links but those on mimic joints at q (LANES, n).

    The poses wait in ``room``, (3 n + POSE links) * LANES, until they are written from the first to
    the last byte: memory likes that better than eight places in turn.
    """
    n, count = q.shape[1], poses.shape[1]
    size = LANES * n
    values, cosines, sines = room[:size], room[size : 2 * size], room[2 * size : 3 * size]
    frames = room[3 * size :]
    gather_kernel(q, values)
    turns_kernel(values, cosines, sines)
    B = identity_lanes_kernel()
    joint = -1
    for k in range(count):
        link = int(model[1 + n + k, 13])
        row = 1 + n + link
        if int(model[row, 0]) >= n:
            break
        while joint < int(model[row, 0]):
            joint += 1
            at = LANES * joint
            B = move_kernel(
                model, 1 + joint, load(values, at), load(cosines, at), load(sines, at), B
            )
        if at_joint_kernel(model, row):
            store_rows_kernel(frames, FRAME_SIZE * link, LANES, B)
        else:
            store_rows_kernel(frames, FRAME_SIZE * link, LANES, compose_kernel(B, model, row))
    stream_lanes_kernel(frames, poses.reshape(poses.size), count)


@kernel(allocates=False, inline="code")
def pose_lanes_kernel(model: Array, q: Array, link: int, poses: Array, room: Array) -> None:
    """Poses (LANES, 4, 4) of a link, -1 for the tip; room 3 n * LANES."""
    n = q.shape[1]
    size = LANES * n
    row = 1 + n + (link if link >= 0 else int(model[0, 1]))
    values, cosines, sines = room[:size], room[size : 2 * size], room[2 * size : 3 * size]
    gather_kernel(q, values)
    turns_kernel(values, cosines, sines)
    B = identity_lanes_kernel()
    for j in range(int(model[row, 0]) + 1):
        at = LANES * j
        B = move_kernel(model, 1 + j, load(values, at), load(cosines, at), load(sines, at), B)
    B = compose_kernel(B, model, row)
    zero, one = fill(0.0), fill(1.0)
    upper = transpose((B[0], B[1], B[2], B[3], B[4], B[5], B[6], B[7]))
    lower = transpose((B[8], B[9], B[10], B[11], zero, zero, zero, one))
    store_rows_kernel(poses.reshape(poses.size), 0, POSE, upper)
    store_rows_kernel(poses.reshape(poses.size), LANES, POSE, lower)
