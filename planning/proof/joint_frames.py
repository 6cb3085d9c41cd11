"""Frames of the joints for the proof, by code that planners do not use."""

import numpy as np

from compiled.kernel import kernel
from kinematics.arrays import Array, Indices
from planning.proof.motion_bounds import PARENT, TYPE


@kernel(allocates=False)
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


@kernel(allocates=False)
def mimic_frames(bodies: Indices, offsets: Array, first: int, q: Array, frames: Array) -> None:
    """``forward_kernel`` of the bodies from ``first`` on, which follow others and hang on any.

    Args:
        bodies: Rows TYPE and PARENT, shape (2, b).
        offsets: Offsets of the joints at 0 in the frames of the bodies before, shape (b, 4, 4).
        first: The first of them.
        q: Positions of all joints, shape (b,) [rad or m].
        frames: Frames of all bodies, those from ``first`` on are written, shape (b, 4, 4).
    """
    for i in range(first, q.shape[0]):
        A, parent = offsets[i], bodies[PARENT, i]
        for row in range(3):
            for column in range(4):
                value = A[row, column]
                if parent >= 0:
                    B = frames[parent]
                    value = B[row, 3] if column == 3 else 0.0
                    for k in range(3):
                        value += B[row, k] * A[k, column]
                frames[i, row, column] = value
        if bodies[TYPE, i] == 1:
            for row in range(3):
                frames[i, row, 3] += frames[i, row, 2] * q[i]
            continue
        c, s = np.cos(q[i]), np.sin(q[i])
        for row in range(3):
            x, y = frames[i, row, 0], frames[i, row, 1]
            frames[i, row, 0], frames[i, row, 1] = x * c + y * s, y * c - x * s
