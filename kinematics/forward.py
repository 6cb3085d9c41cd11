"""Forward kinematics: joint values to frames."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from kinematics.chain import Array, Chain, Indices
from kinematics.kernel import kernel


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
    return link_poses(chain, q, [link or chain.tip_link])[..., 0, :, :]


def link_poses(chain: Chain, q: ArrayLike, links: Sequence[str] | None = None) -> Array:
    """Poses of several links (all of them where none are named), shape (..., len(links), 4, 4).

    Raises:
        InvalidRobotState: Wrong length or not finite.
        InvalidLinkName: No such link.
    """
    wanted = chain.links if links is None else tuple(chain.link(name) for name in links)
    frames = joint_frames(chain, q)
    poses = np.empty((*frames.shape[:-3], len(wanted), 4, 4))
    for i, link in enumerate(wanted):
        if link.joint < 0:
            poses[..., i, :, :] = link.T_joint_link
        else:
            poses[..., i, :, :] = frames[..., link.joint, :, :] @ link.T_joint_link
    return poses
