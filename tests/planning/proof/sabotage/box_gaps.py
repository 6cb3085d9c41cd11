"""Boxes that a plane parts: what need not be asked of FCL."""

import numpy as np

from kinematics.arrays import Array


def box_gaps(first: tuple[Array, Array], second: tuple[Array, Array], between: Array) -> Array:
    """How far boxes are apart at least, along the normals of their faces, shape (k,) [m].

    Args:
        first: Rotations (k, 3, 3) and half sizes (k, 3) of boxes.
        second: Those of the other ones.
        between: Middles of the first ones less those of the others, shape (k, 3) [m].
    """
    (A, a), (B, b) = first, second
    turned = np.abs(A.swapaxes(1, 2) @ B)
    gaps = [
        np.abs(T.swapaxes(1, 2) @ between[:, :, None])[..., 0] - reach
        for T, reach in (
            (A, a + (turned @ b[:, :, None])[..., 0]),
            (B, b + (a[:, None, :] @ turned)[:, 0]),
        )
    ]
    return np.asarray(np.concatenate(gaps, axis=1).max(axis=1))
