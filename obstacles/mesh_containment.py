"""Which points a mesh encloses, by winding numbers: not by the kernel that planning uses."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from kinematics.arrays import Array
from obstacles.piece import Piece
from obstacles.winding import winding_numbers

#: Winding number beyond which a point is inside.
_INSIDE = 0.5
#: A coordinate outside of every box [m].
_FAR = 1e9


def inside_box(piece: Piece, T: Array, points: Array) -> NDArray[np.bool_]:
    """Which of ``points`` (m, 3) are in the box that holds a piece placed by T (4, 4), (m,)."""
    box = piece.local_box()
    finite = np.where(np.isfinite(points), points, _FAR)
    local = (finite - T[:3, 3]) @ T[:3, :3]
    return np.asarray((np.abs(local - box[:3]) <= box[3:]).all(axis=1))


def encloses(group: Sequence[Piece], T: Array, points: Array) -> NDArray[np.bool_]:
    """Which of ``points`` are inside the solid that the triangles of a group bound, shape (m,).

    Args:
        group: Pieces with surfaces that belong together, in one frame.
        T: That frame in the world, shape (4, 4).
        points: In the world, shape (m, 3).
    """
    triangles = np.concatenate([piece.surface.triangles for piece in group if piece.surface])
    corners = np.ascontiguousarray(triangles.reshape(-1, 3))
    local = np.ascontiguousarray((points - T[:3, 3]) @ T[:3, :3])
    numbers = np.zeros(len(local))
    winding_numbers(local, corners, np.arange(len(corners)).reshape(-1, 3), numbers)
    return np.asarray(np.abs(numbers) > _INSIDE)
