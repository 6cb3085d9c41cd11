"""Forward kinematics: joint values to frames."""

import math
from collections.abc import Callable, Sequence
from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from kinematics.chain import Array, Chain, Indices
from kinematics.errors import InvalidOption
from kinematics.kernel import direct, kernel
from kinematics.lanes import (
    FRAME,
    LANES,
    at_joint_kernel,
    pose_lanes_kernel,
    poses_lanes_kernel,
)
from kinematics.turns import turns_kernel

_FLOAT = np.dtype(np.float64)
# Names of this module: looking them up in another one costs as much as a joint does.
_empty, _contiguous = np.empty, np.ascontiguousarray
#: Joints whose cosines and sines fit into a pose.
_ROOM = 8
Frame = tuple[float, float, float, float, float, float, float, float, float, float, float, float]
IDENTITY: Frame = (1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0)


@kernel
def finite_kernel(q: Array) -> bool:
    """Whether all of (n,) is finite."""
    total = 0.0
    for i in range(q.shape[0]):
        total += q[i] - q[i]
    return total == 0.0


@kernel
def step_kernel(model: Array, row: int, q: float, B: Frame) -> Frame:
    """The frame behind a joint at ``q``, by its row of ``Chain.model``, from the one before it.

    Frames are their upper three rows as twelve numbers: so they stay in registers. Rows are named
    by their number, since a view of one costs as much as the product.
    """
    if model[row, 0] == 0.0:
        return turn_kernel(model, row, math.cos(q), math.sin(q), B)
    return slide_kernel(model, row, q, B)


@kernel
def move_kernel(model: Array, row: int, q: float, c: float, s: float, B: Frame) -> Frame:
    """``step_kernel`` where cosine and sine of q are known."""
    if model[row, 0] == 0.0:
        return turn_kernel(model, row, c, s, B)
    return slide_kernel(model, row, q, B)


@kernel
def slide_kernel(model: Array, row: int, q: float, B: Frame) -> Frame:
    """``step_kernel`` of a prismatic joint."""
    b00, b01, b02, b03, b10, b11, b12, b13, b20, b21, b22, b23 = compose_kernel(B, model, row)
    return (
        b00, b01, b02, b03 + q * b02, b10, b11, b12, b13 + q * b12,
        b20, b21, b22, b23 + q * b22,
    )  # fmt: skip


@kernel
def turn_kernel(model: Array, row: int, c: float, s: float, B: Frame) -> Frame:
    """``step_kernel`` of a revolute joint by its cosine and sine."""
    b00, b01, b02, b03, b10, b11, b12, b13, b20, b21, b22, b23 = compose_kernel(B, model, row)
    return (
        b00 * c + b01 * s, b01 * c - b00 * s, b02, b03,
        b10 * c + b11 * s, b11 * c - b10 * s, b12, b13,
        b20 * c + b21 * s, b21 * c - b20 * s, b22, b23,
    )  # fmt: skip


@kernel
def compose_kernel(B: Frame, A: Array, i: int) -> Frame:
    """B times the frame in row i of an array as ``Chain.model``."""
    b00, b01, b02, b03, b10, b11, b12, b13, b20, b21, b22, b23 = B
    a00, a01, a02, a03 = A[i, 1], A[i, 2], A[i, 3], A[i, 4]
    a10, a11, a12, a13 = A[i, 5], A[i, 6], A[i, 7], A[i, 8]
    a20, a21, a22, a23 = A[i, 9], A[i, 10], A[i, 11], A[i, 12]
    return (
        b00 * a00 + b01 * a10 + b02 * a20, b00 * a01 + b01 * a11 + b02 * a21,
        b00 * a02 + b01 * a12 + b02 * a22, b00 * a03 + b01 * a13 + b02 * a23 + b03,
        b10 * a00 + b11 * a10 + b12 * a20, b10 * a01 + b11 * a11 + b12 * a21,
        b10 * a02 + b11 * a12 + b12 * a22, b10 * a03 + b11 * a13 + b12 * a23 + b13,
        b20 * a00 + b21 * a10 + b22 * a20, b20 * a01 + b21 * a11 + b22 * a21,
        b20 * a02 + b21 * a12 + b22 * a22, b20 * a03 + b21 * a13 + b22 * a23 + b23,
    )  # fmt: skip


@kernel
def store_kernel(B: Frame, T: Array) -> None:
    """Write a frame into T (4, 4)."""
    T[0, 0], T[0, 1], T[0, 2], T[0, 3] = B[0], B[1], B[2], B[3]
    T[1, 0], T[1, 1], T[1, 2], T[1, 3] = B[4], B[5], B[6], B[7]
    T[2, 0], T[2, 1], T[2, 2], T[2, 3] = B[8], B[9], B[10], B[11]
    T[3, 0], T[3, 1], T[3, 2], T[3, 3] = 0.0, 0.0, 0.0, 1.0


@kernel
def fits_kernel(model: Array, q: Array) -> bool:
    """Whether q is one finite number a joint."""
    return q.shape[0] == int(model[0, 0]) and finite_kernel(q)


@kernel
def pose_kernel(model: Array, q: Array, link: int, T: Array) -> bool:
    """Write the pose (4, 4) of link number ``link``, -1 for the tip; False where q does not fit."""
    if not fits_kernel(model, q):
        return False
    n = q.shape[0]
    row = 1 + n + (link if link >= 0 else int(model[0, 1]))
    # The pose has room for the turns of most arms until it is written.
    room = T.reshape(16) if n <= _ROOM else np.empty(2 * n)
    half = room.shape[0] // 2
    turns_kernel(q, room[:half], room[half:])
    B = IDENTITY
    for i in range(int(model[row, 0]) + 1):
        B = move_kernel(model, 1 + i, q[i], room[i], room[half + i], B)
    store_kernel(compose_kernel(B, model, row), T)
    return True


@kernel
def poses_kernel(model: Array, q: Array, poses: Array) -> bool:
    """Write the poses (len(links), 4, 4) of all links; False where q does not fit."""
    if not fits_kernel(model, q):
        return False
    n, count = q.shape[0], poses.shape[0]
    # The pose that is written last has room for the turns until then.
    last = poses[int(model[n + count, 13])]
    room = last.reshape(16) if n <= _ROOM else np.empty(2 * n)
    half = room.shape[0] // 2
    turns_kernel(q, room[:half], room[half:])
    B, joint = IDENTITY, -1
    for k in range(count):
        link = int(model[1 + n + k, 13])
        row = 1 + n + link
        while joint < int(model[row, 0]):
            joint += 1
            B = move_kernel(model, 1 + joint, q[joint], room[joint], room[half + joint], B)
        if at_joint_kernel(model, row):
            store_kernel(B, poses[link])
        else:
            store_kernel(compose_kernel(B, model, row), poses[link])
    return True


@kernel
def pose_batch_kernel(model: Array, q: Array, link: int, poses: Array) -> None:
    """Write the poses (m, 4, 4) of link number ``link`` for a batch q (m, n)."""
    m = q.shape[0] - q.shape[0] % LANES
    if m > 0:
        room = np.empty((3 * q.shape[1] + FRAME) * LANES)
        for k in range(0, m, LANES):
            pose_lanes_kernel(model, q[k : k + LANES], link, poses[k : k + LANES], room)
    for k in range(m, q.shape[0]):
        pose_kernel(model, q[k], link, poses[k])


@kernel
def poses_batch_kernel(model: Array, q: Array, poses: Array) -> None:
    """Write the poses (m, len(links), 4, 4) of all links for a batch q (m, n)."""
    m = q.shape[0] - q.shape[0] % LANES
    if m > 0:
        room = np.empty((3 * q.shape[1] + FRAME * (1 + poses.shape[1])) * LANES)
        for k in range(0, m, LANES):
            poses_lanes_kernel(model, q[k : k + LANES], poses[k : k + LANES], room)
    for k in range(m, q.shape[0]):
        poses_kernel(model, q[k], poses[k])


@kernel
def forward_kernel(types: Indices, offsets: Array, q: Array, frames: Array) -> None:
    """Write T_base_i = T_base_(i-1) A_i M_i(q_i) of every joint into ``frames`` (n, 4, 4).

    Only the upper three rows are written.
    """
    for i in range(q.shape[0]):
        A = offsets[i]
        c, s, d = 1.0, 0.0, 0.0
        if types[i] == 0:
            c, s = np.cos(q[i]), np.sin(q[i])
        else:
            d = q[i]
        for row in range(3):
            if i == 0:
                x, y, z, p = A[row, 0], A[row, 1], A[row, 2], A[row, 3]
            else:
                B = frames[i - 1]
                b0, b1, b2 = B[row, 0], B[row, 1], B[row, 2]
                x = b0 * A[0, 0] + b1 * A[1, 0] + b2 * A[2, 0]
                y = b0 * A[0, 1] + b1 * A[1, 1] + b2 * A[2, 1]
                z = b0 * A[0, 2] + b1 * A[1, 2] + b2 * A[2, 2]
                p = b0 * A[0, 3] + b1 * A[1, 3] + b2 * A[2, 3] + B[row, 3]
            frames[i, row, 0] = x * c + y * s
            frames[i, row, 1] = y * c - x * s
            frames[i, row, 2] = z
            frames[i, row, 3] = p + z * d


@kernel
def forward_batch_kernel(types: Indices, offsets: Array, q: Array, frames: Array) -> None:
    """``forward_kernel`` for a batch: q (m, n), frames (m, n, 4, 4), last rows too."""
    for k in range(q.shape[0]):
        forward_kernel(types, offsets, q[k], frames[k])
        for i in range(q.shape[1]):
            for column in range(3):
                frames[k, i, 3, column] = 0.0
            frames[k, i, 3, 3] = 1.0


@cache
def one_pose() -> Callable[[Array, Array, int, Array], bool]:
    """``pose_kernel`` without dispatch, for a read-only model."""
    return direct(pose_kernel, *_examples(), 0, np.empty((4, 4)))


@cache
def all_poses() -> Callable[[Array, Array, Array], bool]:
    """``poses_kernel`` likewise."""
    return direct(poses_kernel, *_examples(), np.empty((1, 4, 4)))


def _examples() -> tuple[Array, Array]:
    model = np.empty((1, 14))
    model.setflags(write=False)
    return model, np.empty(1)


def link_number(chain: Chain, name: str) -> int:
    """Where a link stands in ``chain.links``.

    Raises:
        InvalidLinkName: There is no such link.
    """
    number = chain.index.get(name)
    return number if number is not None else chain.index[chain.link(name).name]


def joint_frames(chain: Chain, q: ArrayLike) -> Array:
    """Frames of all joints in the base frame, after their motion.

    Args:
        chain: The robot.
        q: One configuration (n,) or a batch (..., n) [rad or m].

    Returns:
        T_base_i, shape (..., n, 4, 4).

    Raises:
        InvalidRobotState: Wrong length or not finite.
    """
    q = chain.configuration(q)
    flat = q.reshape(-1, chain.n)
    frames = np.empty((flat.shape[0], chain.n, 4, 4))
    forward_batch_kernel(chain.joint_types, chain.offsets, flat, frames)
    return frames.reshape(*q.shape[:-1], chain.n, 4, 4)


def forward(chain: Chain, q: ArrayLike, link: str | None = None) -> Array:
    """Pose of one link (the tip where none is named) in the base frame.

    T_base_link(q) = T_base_i(q) T_i_link, with i the joint that carries the link.

    Args:
        chain: The robot.
        q: One configuration (n,) or a batch (..., n) [rad or m].
        link: Name of a link.

    Returns:
        T_base_link, shape (..., 4, 4).

    Raises:
        InvalidRobotState: Wrong length or not finite.
        InvalidLinkName: No such link.
    """
    number = -1 if link is None else link_number(chain, link)
    T = _empty((4, 4))
    # The usual case, one configuration that is as it should be, is told by the kernel itself.
    with_one = one_pose()
    try:
        one = _contiguous(q, _FLOAT)
        if one.ndim == 1 and with_one(chain.model, one, number, T):
            return T
    except (TypeError, ValueError):
        pass
    q = chain.configuration(q)
    flat = q.reshape(-1, chain.n)
    poses = np.empty((flat.shape[0], 4, 4))
    pose_batch_kernel(chain.model, flat, number, poses)
    return poses.reshape(*q.shape[:-1], 4, 4)


def link_poses(
    chain: Chain, q: ArrayLike, links: Sequence[str] | None = None, *, out: Array | None = None
) -> Array:
    """Poses of several links (all of them where none are named), shape (..., len(links), 4, 4).

    Args:
        chain: The robot.
        q: One configuration (n,) or a batch (..., n) [rad or m].
        links: Their names.
        out: Where to write the poses of all links and what to answer then: a contiguous float64
            array of the answer's shape. Fresh memory is a good part of what large batches cost.

    Raises:
        InvalidRobotState: Wrong length or not finite.
        InvalidLinkName: No such link.
        InvalidOption: ``out`` is of another shape or kind, or ``links`` are named too.
    """
    if out is not None:
        return _poses_into(chain, chain.configuration(q), links, out)
    if links is not None:
        numbers = [link_number(chain, name) for name in links]
        return link_poses(chain, q)[..., numbers, :, :]
    shape = (len(chain.links), 4, 4)
    poses = _empty(shape)
    with_one = all_poses()
    try:
        one = _contiguous(q, _FLOAT)
        if one.ndim == 1 and with_one(chain.model, one, poses):
            return poses
    except (TypeError, ValueError):
        pass
    q = chain.configuration(q)
    flat = q.reshape(-1, chain.n)
    poses = np.empty((flat.shape[0], *shape))
    poses_batch_kernel(chain.model, flat, poses)
    return poses.reshape(*q.shape[:-1], *shape)


def _poses_into(chain: Chain, q: Array, links: Sequence[str] | None, out: Array) -> Array:
    shape = (*q.shape[:-1], len(chain.links), 4, 4)
    good = isinstance(out, np.ndarray) and out.shape == shape and out.dtype == _FLOAT
    if links is not None or not good or not (out.flags.c_contiguous and out.flags.writeable):
        raise InvalidOption(
            f"out must be a writable contiguous float64 array of shape {shape}, and no links named"
        )
    poses_batch_kernel(chain.model, q.reshape(-1, chain.n), out.reshape(-1, *shape[-3:]))
    return out
