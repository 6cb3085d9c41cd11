"""Mesh of the reach in a box: the surface of what is reached, coloured by manipulability."""

import numpy as np

from kinematics.arrays import Array
from obstacles.convex.triangles import Triangles
from obstacles.meshes.writer import glb
from planning.reach.evaluation import Reach, Status
from planning.reach.grid import PoseGrid
from service.endpoints.reach.picture import HIGH, LOW

#: Corners of a cube's face at the upper end of an axis, in units of its half edges: along the next
#: axis and the one after, counter-clockwise from outside.
_CORNERS = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])


def draw(grid: PoseGrid, found: Reach) -> bytes:
    """A GLB of a grid: a cube at each point that is reached, without the faces between two of them.

    Cubes go from blue at the least manipulability to yellow at the largest, and are as large as the
    spacing; along an edge of the box without length they are as thick.

    Args:
        grid: Points with one orientation, one of them at least reached.
        found: Their reach.
    """
    shape = grid.shape[:3]
    reached = found.status.reshape(shape) == Status.REACHED.value
    figure = found.manipulability.reshape(shape)
    share = np.where(reached, figure, 0.0) / max(float(figure[reached].max()), 1e-12)
    padded = np.pad(reached, 1)
    edges = [edge / (count - 1) if count > 1 else grid.spacing
             for edge, count in zip(grid.size, shape, strict=True)]  # fmt: skip
    centres = np.stack(np.meshgrid(*grid.axes(), indexing="ij"), axis=-1)
    corners, shares = [], []
    for axis in range(3):
        for side in (1, -1):
            beside = np.roll(padded, -side, axis)[1:-1, 1:-1, 1:-1]
            bare = reached & ~beside
            corners.append(centres[bare][:, None] + 0.5 * _face(axis, side) * edges)
            shares.append(share[bare])
    points = np.concatenate(corners).reshape(-1, 3)
    points = points @ grid.T_base_box[:3, :3].T + grid.T_base_box[:3, 3]
    first = 4 * np.arange(len(points) // 4)[:, None]
    faces = np.concatenate(
        [first + np.array(corner) for corner in ((0, 1, 2), (0, 2, 3))], axis=1
    ).reshape(-1, 3)
    colours = LOW + np.repeat(np.concatenate(shares), 4)[:, None] * (HIGH - LOW)
    opaque = np.column_stack([colours, np.full(len(colours), 255.0)])
    return glb(Triangles(points, faces), "reach", opaque.astype(np.uint8))


def _face(axis: int, side: int) -> Array:
    """Corners of a cube's face, counter-clockwise from outside, shape (4, 3)."""
    corners = np.empty((4, 3))
    corners[:, axis] = side
    corners[:, (axis + 1) % 3], corners[:, (axis + 2) % 3] = _CORNERS[::side].T
    return corners
