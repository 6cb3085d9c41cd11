"""Frames and Jacobians of eight configurations abreast, for batches.

What one configuration has as a number is here eight numbers in a row of memory, a *lane* for each
configuration, so that the innermost loops, over lanes, compile to vector instructions. A frame has
twelve rows of lanes, a Jacobian six for each joint, joint values one for each joint; all are flat
arrays. The arithmetic is that of ``forward`` and ``jacobian``, operation by operation.
"""

from kinematics.chain import Array
from kinematics.kernel import kernel
from kinematics.turns import turns_kernel

#: Configurations abreast: two vectors of four, which hides the time an operation takes.
LANES = 8
#: Rows of lanes of a frame and of a column of a Jacobian.
FRAME, COLUMN = 12, 6


@kernel
def gather_kernel(q: Array, lanes: Array) -> None:
    """Lay q (LANES, n) out by joints, into lanes (n * LANES,)."""
    for lane in range(8):
        for j in range(q.shape[1]):
            lanes[j * 8 + lane] = q[lane, j]


@kernel
def identity_lanes_kernel(B: Array) -> None:
    """Set the frames B (FRAME * LANES,) to the identity."""
    for i in range(96):
        B[i] = 0.0
    for lane in range(8):
        B[lane], B[40 + lane], B[80 + lane] = 1.0, 1.0, 1.0


@kernel
def compose_lanes_kernel(B: Array, A: Array, i: int, C: Array) -> None:
    """``forward.compose_kernel`` of frames B (FRAME * LANES,) into C, which may be B."""
    a00, a01, a02, a03 = A[i, 1], A[i, 2], A[i, 3], A[i, 4]
    a10, a11, a12, a13 = A[i, 5], A[i, 6], A[i, 7], A[i, 8]
    a20, a21, a22, a23 = A[i, 9], A[i, 10], A[i, 11], A[i, 12]
    for row in range(3):
        at = 32 * row
        for lane in range(8):
            x, y, z, p = B[at + lane], B[at + 8 + lane], B[at + 16 + lane], B[at + 24 + lane]
            C[at + lane] = x * a00 + y * a10 + z * a20
            C[at + 8 + lane] = x * a01 + y * a11 + z * a21
            C[at + 16 + lane] = x * a02 + y * a12 + z * a22
            C[at + 24 + lane] = x * a03 + y * a13 + z * a23 + p


@kernel
def move_lanes_kernel(
    model: Array, row: int, q: Array, cosines: Array, sines: Array, at: int, B: Array
) -> None:
    """``forward.move_kernel`` in place, for the lanes from ``at`` on of values and turns."""
    A, i = model, row
    a00, a01, a02, a03 = A[i, 1], A[i, 2], A[i, 3], A[i, 4]
    a10, a11, a12, a13 = A[i, 5], A[i, 6], A[i, 7], A[i, 8]
    a20, a21, a22, a23 = A[i, 9], A[i, 10], A[i, 11], A[i, 12]
    if A[i, 0] == 0.0:
        for k in range(3):
            b = 32 * k
            for lane in range(8):
                x, y, z, p = B[b + lane], B[b + 8 + lane], B[b + 16 + lane], B[b + 24 + lane]
                c, s = cosines[at + lane], sines[at + lane]
                u, v = x * a00 + y * a10 + z * a20, x * a01 + y * a11 + z * a21
                B[b + lane], B[b + 8 + lane] = u * c + v * s, v * c - u * s
                B[b + 16 + lane] = x * a02 + y * a12 + z * a22
                B[b + 24 + lane] = x * a03 + y * a13 + z * a23 + p
        return
    compose_lanes_kernel(B, model, row, B)
    for k in range(3):
        for lane in range(8):
            B[32 * k + 24 + lane] += q[at + lane] * B[32 * k + 16 + lane]


@kernel
def store_lanes_kernel(frames: Array, poses: Array) -> None:
    """Write frames (links * FRAME * LANES,) into poses (LANES, links, 4, 4), flat."""
    count = frames.shape[0] // 96
    for lane in range(8):
        for link in range(count):
            to, at = 16 * (lane * count + link), 96 * link + lane
            for i in range(12):
                poses[to + i] = frames[at + 8 * i]
            poses[to + 12], poses[to + 13], poses[to + 14], poses[to + 15] = 0.0, 0.0, 0.0, 1.0


@kernel
def jacobian_lanes_kernel(
    model: Array, q: Array, cosines: Array, sines: Array, link: int, B: Array, J: Array
) -> None:
    """Write frames of a link into B and Jacobians into J (n * COLUMN * LANES,), column by column.

    ``jacobian.frame_and_jacobian_kernel`` from joint values and their turns (n * LANES,).
    """
    n = q.shape[0] // 8
    row = 1 + n + (link if link >= 0 else int(model[0, 1]))
    last = int(model[row, 0])
    identity_lanes_kernel(B)
    for j in range(last + 1):
        move_lanes_kernel(model, 1 + j, q, cosines, sines, 8 * j, B)
        at = 48 * j
        for k in range(3):
            for lane in range(8):
                J[at + 8 * k + lane] = B[32 * k + 24 + lane]
                J[at + 24 + 8 * k + lane] = B[32 * k + 16 + lane]
    compose_lanes_kernel(B, model, row, B)
    for j in range(n):
        at = 48 * j
        if j > last:
            for i in range(48):
                J[at + i] = 0.0
        elif model[1 + j, 0] == 0.0:
            for lane in range(8):
                x = B[24 + lane] - J[at + lane]
                y = B[56 + lane] - J[at + 8 + lane]
                z = B[88 + lane] - J[at + 16 + lane]
                a, b, c = J[at + 24 + lane], J[at + 32 + lane], J[at + 40 + lane]
                J[at + lane], J[at + 8 + lane], J[at + 16 + lane] = (
                    b * z - c * y, c * x - a * z, a * y - b * x,
                )  # fmt: skip
        else:
            for i in range(24):
                J[at + i], J[at + 24 + i] = J[at + 24 + i], 0.0


@kernel
def at_joint_kernel(A: Array, i: int) -> bool:
    """Whether the frame in row i is the identity, as most links' frames in their joint's are."""
    return bool(
        A[i, 4] == 0.0 and A[i, 8] == 0.0 and A[i, 12] == 0.0 and A[i, 2] == 0.0
        and A[i, 3] == 0.0 and A[i, 5] == 0.0 and A[i, 7] == 0.0 and A[i, 9] == 0.0
        and A[i, 10] == 0.0 and A[i, 1] == 1.0 and A[i, 6] == 1.0 and A[i, 11] == 1.0
    )  # fmt: skip


@kernel
def poses_lanes_kernel(model: Array, q: Array, poses: Array, room: Array) -> None:
    """Poses (LANES, links, 4, 4) of all links at q (LANES, n).

    The frames wait in ``room``, (3 n + FRAME (links + 1)) * LANES, until the poses are written from
    the first to the last byte: memory likes that better than eight places in turn.
    """
    n, count = q.shape[1], poses.shape[1]
    size = 8 * n
    values, cosines, sines = room[:size], room[size : 2 * size], room[2 * size : 3 * size]
    B, frames = room[3 * size : 3 * size + 96], room[3 * size + 96 :]
    gather_kernel(q, values)
    turns_kernel(values, cosines, sines)
    identity_lanes_kernel(B)
    joint = -1
    for k in range(count):
        link = int(model[1 + n + k, 13])
        row = 1 + n + link
        while joint < int(model[row, 0]):
            joint += 1
            move_lanes_kernel(model, 1 + joint, values, cosines, sines, 8 * joint, B)
        C = frames[96 * link : 96 * link + 96]
        if at_joint_kernel(model, row):
            for i in range(96):
                C[i] = B[i]
        else:
            compose_lanes_kernel(B, model, row, C)
    store_lanes_kernel(frames[: 96 * count], poses.reshape(poses.size))


@kernel
def pose_lanes_kernel(model: Array, q: Array, link: int, poses: Array, room: Array) -> None:
    """Poses (LANES, 4, 4) of a link, -1 for the tip; room (3 n + FRAME) * LANES."""
    n = q.shape[1]
    size = 8 * n
    row = 1 + n + (link if link >= 0 else int(model[0, 1]))
    values, cosines, sines = room[:size], room[size : 2 * size], room[2 * size : 3 * size]
    B = room[3 * size : 3 * size + 96]
    gather_kernel(q, values)
    turns_kernel(values, cosines, sines)
    identity_lanes_kernel(B)
    for j in range(int(model[row, 0]) + 1):
        move_lanes_kernel(model, 1 + j, values, cosines, sines, 8 * j, B)
    compose_lanes_kernel(B, model, row, B)
    store_lanes_kernel(B, poses.reshape(poses.size))
