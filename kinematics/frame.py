"""Frames as their upper three rows, twelve numbers that stay in registers, along a chain.

The same arithmetic serves one configuration and, with vectors for numbers, eight SIMD lanes.
"""

import math

from compiled.kernel import kernel
from compiled.simd import Lanes
from kinematics.arrays import Array

Frame = tuple[Lanes, Lanes, Lanes, Lanes, Lanes, Lanes, Lanes, Lanes, Lanes, Lanes, Lanes, Lanes]
IDENTITY: Frame = (1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0)


@kernel(allocates=False)
def step_kernel(model: Array, row: int, q: float, B: Frame) -> Frame:
    """The frame behind a joint at ``q``, by its row of ``Chain.model``, from the one before it.

    Rows are named by their number, since a view of one costs as much as the product.
    """
    return move_kernel(model, row, q, math.cos(q), math.sin(q), B)


@kernel(inline="code")
def move_kernel(model: Array, row: int, q: Lanes, c: Lanes, s: Lanes, B: Frame) -> Frame:
    """``step_kernel`` where cosine and sine of q are known."""
    if model[row, 0] == 0.0:
        return turn_kernel(model, row, c, s, B)
    b00, b01, b02, b03, b10, b11, b12, b13, b20, b21, b22, b23 = compose_kernel(B, model, row)
    return (
        b00, b01, b02, b03 + q * b02, b10, b11, b12, b13 + q * b12,
        b20, b21, b22, b23 + q * b22,
    )  # fmt: skip


@kernel(inline="code")
def turn_kernel(model: Array, row: int, c: Lanes, s: Lanes, B: Frame) -> Frame:
    """``step_kernel`` of a revolute joint by its cosine and sine."""
    b00, b01, b02, b03, b10, b11, b12, b13, b20, b21, b22, b23 = compose_kernel(B, model, row)
    return (
        b00 * c + b01 * s, b01 * c - b00 * s, b02, b03,
        b10 * c + b11 * s, b11 * c - b10 * s, b12, b13,
        b20 * c + b21 * s, b21 * c - b20 * s, b22, b23,
    )  # fmt: skip


@kernel(inline="code")
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


@kernel(allocates=False)
def frame_kernel(T: Array) -> Frame:
    """The upper three rows of (4, 4) as twelve numbers."""
    return (
        T[0, 0], T[0, 1], T[0, 2], T[0, 3], T[1, 0], T[1, 1], T[1, 2], T[1, 3],
        T[2, 0], T[2, 1], T[2, 2], T[2, 3],
    )  # fmt: skip


@kernel(inline="code")
def store_rows_kernel(B: Frame, T: Array) -> None:
    """Write a frame into the upper three rows of T (4, 4)."""
    T[0, 0], T[0, 1], T[0, 2], T[0, 3] = B[0], B[1], B[2], B[3]
    T[1, 0], T[1, 1], T[1, 2], T[1, 3] = B[4], B[5], B[6], B[7]
    T[2, 0], T[2, 1], T[2, 2], T[2, 3] = B[8], B[9], B[10], B[11]


@kernel(allocates=False)
def store_kernel(B: Frame, T: Array) -> None:
    """Write a frame into T (4, 4)."""
    store_rows_kernel(B, T)
    T[3, 0], T[3, 1], T[3, 2], T[3, 3] = 0.0, 0.0, 0.0, 1.0


@kernel(allocates=False)
def at_joint_kernel(A: Array, i: int) -> bool:
    """Whether the frame in row i is the identity, as most links' frames in their joint's are."""
    return bool(
        A[i, 4] == 0.0 and A[i, 8] == 0.0 and A[i, 12] == 0.0 and A[i, 2] == 0.0
        and A[i, 3] == 0.0 and A[i, 5] == 0.0 and A[i, 7] == 0.0 and A[i, 9] == 0.0
        and A[i, 10] == 0.0 and A[i, 1] == 1.0 and A[i, 6] == 1.0 and A[i, 11] == 1.0
    )  # fmt: skip
