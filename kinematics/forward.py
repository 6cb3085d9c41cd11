"""Forward kinematics: joint values to frames."""

import math
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from compiled.kernel import direct, kernel
from compiled.simd import LANES, on_stack
from compiled.simd_transpose import aligned_kernel
from compiled.sincos import TURNS, few_turns_kernel, turn_at_kernel
from kinematics.arrays import Array
from kinematics.frame import (
    IDENTITY,
    at_joint_kernel,
    compose_kernel,
    frame_kernel,
    move_kernel,
    step_kernel,
    store_kernel,
    store_rows_kernel,
)
from kinematics.model.branch import branch_to, is_on_branch, require_on_chain
from kinematics.model.chain import Chain
from kinematics.simd_frames import POSE, pose_lanes_kernel, poses_lanes_kernel

_FLOAT = np.dtype(np.float64)
# Names of this module: looking them up in another one costs as much as a joint does.
_empty, _POSE = np.empty, (4, 4)


@kernel(allocates=False)
def finite_kernel(q: Array) -> bool:
    """Whether all of (n,) is finite."""
    total = 0.0
    for i in range(q.shape[0]):
        total += q[i] - q[i]
    return total == 0.0


@kernel(allocates=False)
def fits_kernel(model: Array, q: Array) -> bool:
    """Whether q is one finite number a joint, one beside the other."""
    n = int(model[0, 0])
    return q.shape[0] == n and (n == 1 or q.strides[0] == 8) and finite_kernel(q)


@kernel(allocates=False, unlocks=False, inline="code")
def pose_kernel(model: Array, q: Array, link: int, T: Array) -> bool:
    """Write the pose (4, 4) of link number ``link``, -1 for the tip; False where q does not fit."""
    if not fits_kernel(model, q):
        return False
    row = 1 + q.shape[0] + (link if link >= 0 else int(model[0, 1]))
    turns = on_stack(TURNS)
    few = few_turns_kernel(q, turns)
    B = IDENTITY
    for i in range(int(model[row, 0]) + 1):
        c, s = turn_at_kernel(q, i, few, turns)
        B = move_kernel(model, 1 + i, q[i], c, s, B)
    store_kernel(compose_kernel(B, model, row), T)
    return True


@kernel(allocates=False, unlocks=False)
def poses_kernel(model: Array, q: Array, poses: Array) -> bool:
    """Write the poses (len(links), 4, 4) of all links; False where q does not fit.

    Those of links on mimic joints, the last in order, stay as they are.
    """
    if not fits_kernel(model, q):
        return False
    n = q.shape[0]
    turns = on_stack(TURNS)
    few = few_turns_kernel(q, turns)
    B, joint = IDENTITY, -1
    for k in range(poses.shape[0]):
        link = int(model[1 + n + k, 13])
        row = 1 + n + link
        if int(model[row, 0]) >= n:
            break
        while joint < int(model[row, 0]):
            joint += 1
            c, s = turn_at_kernel(q, joint, few, turns)
            B = move_kernel(model, 1 + joint, q[joint], c, s, B)
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
        room = aligned_kernel(3 * q.shape[1] * LANES)
        for k in range(0, m, LANES):
            pose_lanes_kernel(model, q[k : k + LANES], link, poses[k : k + LANES], room)
    for k in range(m, q.shape[0]):
        pose_kernel(model, q[k], link, poses[k])


@kernel
def poses_batch_kernel(model: Array, q: Array, poses: Array) -> None:
    """Write the poses (m, len(links), 4, 4) of all links for a batch q (m, n)."""
    m = q.shape[0] - q.shape[0] % LANES
    if m > 0:
        room = aligned_kernel((3 * q.shape[1] + POSE * poses.shape[1]) * LANES)
        for k in range(0, m, LANES):
            poses_lanes_kernel(model, q[k : k + LANES], poses[k : k + LANES], room)
    for k in range(m, q.shape[0]):
        poses_kernel(model, q[k], poses[k])


@kernel(allocates=False)
def frames_kernel(model: Array, q: Array, frames: Array) -> None:
    """Write T_base_i of every body into ``frames`` (bodies, 4, 4), of which the last rows stay.

    ``model`` is ``Chain.model``. Cosines and sines are the library's, to the last bit. Bodies that
    there is no row for, as mimic joints come last, are left out.
    """
    B = IDENTITY
    for i in range(q.shape[0]):
        c, s = 1.0, 0.0
        if model[1 + i, 0] == 0.0:
            c, s = math.cos(q[i]), math.sin(q[i])
        B = move_kernel(model, 1 + i, q[i], c, s, B)
        store_rows_kernel(B, frames[i])
    if model[0, 2] > 0.0:
        n, first = q.shape[0], int(model[0, 3])
        for k in range(min(int(model[0, 2]), frames.shape[0] - n)):
            row = first + 2 * k
            parent, leader = int(model[row, 13]), int(model[row + 1, 0])
            B = frame_kernel(frames[parent]) if parent >= 0 else IDENTITY
            B = step_kernel(model, row, model[row + 1, 1] * q[leader] + model[row + 1, 2], B)
            store_rows_kernel(B, frames[n + k])


@kernel
def frames_batch_kernel(model: Array, q: Array, frames: Array) -> None:
    """``frames_kernel`` for a batch: q (m, n), frames (m, bodies, 4, 4), last rows too."""
    for k in range(q.shape[0]):
        frames_kernel(model, q[k], frames[k])
        for i in range(frames.shape[1]):
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
    """Index in ``chain.links`` of a link that a joint of the chain carries, or none.

    Raises:
        InvalidLinkName: There is no such link.
        InvalidOption: The link hangs on a joint that mimics one of the chain.
    """
    number = chain.index.get(name)
    if number is None:
        number = chain.index[chain.link(name).name]
    if chain.mimic_joints:
        require_on_chain(chain, name)
    return number


def joint_frames(chain: Chain, q: ArrayLike) -> Array:
    """Frames of all bodies in the base frame: of the joints after their motion, then mimic joints.

    Args:
        chain: The robot.
        q: One configuration (n,) or a batch (..., n) [rad or m].

    Returns:
        T_base_i, shape (..., bodies, 4, 4).

    Raises:
        InvalidRobotState: Wrong length or not finite.
    """
    q = chain.configuration(q)
    flat = q.reshape(-1, chain.n)
    frames = np.empty((flat.shape[0], chain.body_count, 4, 4))
    frames_batch_kernel(chain.model, flat, frames)
    return frames.reshape(*q.shape[:-1], chain.body_count, 4, 4)


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
    if chain.mimic_joints and is_on_branch(chain, link):
        branch = branch_to(chain, link or chain.tip_link)
        return forward(branch.chain, branch.positions(chain.configuration(q)), link)
    number = -1 if link is None else link_number(chain, link)
    # The usual case, one configuration that is as it should be, is told by the kernel itself.
    one: Any = q
    try:
        if one.dtype == _FLOAT and one.ndim == 1:
            T = _empty(_POSE)
            if one_pose()(chain.model, one, number, T):
                return T
    except (AttributeError, TypeError):
        pass  # It is no array.
    q = chain.configuration(q)
    flat = q.reshape(-1, chain.n)
    poses = np.empty((flat.shape[0], 4, 4))
    pose_batch_kernel(chain.model, flat, number, poses)
    return poses.reshape(*q.shape[:-1], 4, 4)


def link_poses(chain: Chain, q: ArrayLike, links: Sequence[str] | None = None) -> Array:
    """Poses of several links (all of them where none are named), shape (..., len(links), 4, 4).

    Args:
        chain: The robot.
        q: One configuration (n,) or a batch (..., n) [rad or m].
        links: Names of the links.

    Raises:
        InvalidRobotState: Wrong length or not finite.
        InvalidLinkName: No such link.
    """
    if links is not None:
        numbers = [chain.index[chain.link(name).name] for name in links]
        return link_poses(chain, q)[..., numbers, :, :]
    shape = (len(chain.links), 4, 4)
    one: Any = q
    try:
        if one.dtype == _FLOAT and one.ndim == 1:
            poses = _empty(shape)
            if all_poses()(chain.model, one, poses):
                if chain.mimic_joints:
                    write_branches(chain, one, poses)
                return poses
    except (AttributeError, TypeError):
        pass
    q = chain.configuration(q)
    flat = q.reshape(-1, chain.n)
    poses = np.empty((flat.shape[0], *shape))
    poses_batch_kernel(chain.model, flat, poses)
    if chain.mimic_joints:
        write_branches(chain, flat, poses)
    return poses.reshape(*q.shape[:-1], *shape)


def write_branches(chain: Chain, q: Array, poses: Array) -> None:
    """Write the poses (..., links, 4, 4) of the links that hang on mimic joints, at q (..., n)."""
    frames = joint_frames(chain, q)
    for k, link in enumerate(chain.links):
        if link.joint >= chain.n:
            poses[..., k, :, :] = frames[..., link.joint, :, :] @ link.T_joint_link
