"""Boxes of the tool by numpy, for tests of the kernels that planners and proofs have."""

import numpy as np

from kinematics.arrays import Array
from planning.tool_motions.tool_tolerance import RX, RY, RZ, ToolTolerance, tilts


def deviations(box: ToolTolerance, nominal: Array, poses: Array) -> Array:
    """Deviations x, y, z, rx, ry, rz of poses from those asked for.

    Args:
        nominal: Poses asked for, shape (k, 4, 4).
        poses: Poses of the tool, shape (k, 4, 4).

    Returns:
        Shape (k, 6) [m], [rad].
    """
    R = nominal[:, :3, :3]
    A = nominal[:, :3, :3] if box.axes is None else np.broadcast_to(box.axes, (len(nominal), 3, 3))
    e = np.einsum("kji,kj->ki", A, poses[:, :3, 3] - nominal[:, :3, 3])
    relative = np.einsum("kil,kjl->kij", poses[:, :3, :3], R)
    D = np.einsum("kji,kjl,klm->kim", A, relative, A)
    angles = [
        np.arctan2(-D[:, 1, 2], D[:, 2, 2]),
        np.arcsin(np.clip(D[:, 0, 2], -1.0, 1.0)),
        np.arctan2(-D[:, 0, 1], D[:, 0, 0]),
    ]
    return np.column_stack([e, *angles])


def clip(box: ToolTolerance, deviations: Array) -> Array:
    """The nearest deviations within the box, and within the tilt by turning less, (k, 6)."""
    d = deviations.copy()
    for column in (RX, RY, RZ):
        if np.isfinite(box.lower[column]):
            middle = 0.5 * (box.lower[column] + box.upper[column])
            # Angles count by the turn that is nearest to the middle of their range.
            turns = np.round((d[:, column] - middle) / (2.0 * np.pi))
            d[:, column] -= 2.0 * np.pi * turns
    d = np.clip(d, box.lower, box.upper)
    if np.isfinite(box.tilt):
        # The tilt is not quite proportional to both angles: a few rounds bring it there.
        # Rounds in which angles are scaled down to a tilt.
        for _ in range(6):
            share = np.minimum(1.0, box.tilt / np.maximum(tilts(d), 1e-12))
            d[:, RX:RZ] *= share[:, None]
    return np.asarray(d)


def excess(box: ToolTolerance, deviations: Array) -> Array:
    """Largest excess of deviations (k, 6) in position [m] and angle [rad], shape (k, 2)."""
    over = np.abs(deviations - clip(box, deviations))
    over[:, RX:] %= 2.0 * np.pi
    over[:, RX:] = np.minimum(over[:, RX:], 2.0 * np.pi - over[:, RX:])
    return np.column_stack([over[:, :RX].max(axis=1), over[:, RX:].max(axis=1)])
