"""Task poses on a grid in a box of the workspace."""

from dataclasses import dataclass

import numpy as np

from kinematics.arrays import Array, frozen, numbers
from kinematics.errors import InvalidOption


@dataclass(frozen=True, slots=True, eq=False)
class PoseGrid:
    """Points of a grid in a box, each with the same orientations.

    Args:
        size: Lengths of the box's edges, shape (3,) [m]; 0 for a plane or a line.
        spacing: Largest distance of neighbouring points along an edge [m].
        T_base_box: Pose of the box's centre, shape (4, 4).
        rotations: R_base_tool of the orientations, shape (o, 3, 3).

    Raises:
        InvalidOption: The spacing is not positive, an edge is negative or there are too many poses.
    """

    size: Array
    spacing: float
    T_base_box: Array
    rotations: Array

    def __post_init__(self) -> None:
        shapes = {"size": (3,), "T_base_box": (4, 4), "rotations": (-1, 3, 3)}
        for name, shape in shapes.items():
            object.__setattr__(self, name, frozen(numbers(getattr(self, name), name, shape)))
        if not 0.0 < self.spacing < np.inf:
            raise InvalidOption(f"spacing is {self.spacing:g} m; it must be positive")
        if min(self.size) < 0.0:
            raise InvalidOption(f"size is {list(self.size)} m; no edge may be negative")
        count = int(np.prod([float(k) for k in self.shape]))
        # The most poses of one grid.
        max_poses = 1_000_000
        if count > max_poses:
            raise InvalidOption(
                f"the grid has {count} poses, at most {max_poses} are looked at",
                hint="Take a wider spacing or fewer orientations.",
            )

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """Numbers of points along x, y and z and of orientations."""
        x, y, z = (int(min(np.ceil(edge / self.spacing - 1e-9), 1e9)) + 1 for edge in self.size)
        return x, y, z, len(self.rotations)

    def axes(self) -> tuple[Array, Array, Array]:
        """Coordinates of the points along the box's axes, from its centre [m]."""
        x, y, z = (
            np.linspace(-0.5 * edge, 0.5 * edge, count) if count > 1 else np.zeros(1)
            for edge, count in zip(self.size, self.shape[:3], strict=True)
        )
        return x, y, z

    def points(self) -> Array:
        """The points in the base frame, shape (x y z, 3), z changes fastest [m]."""
        p_box = np.stack(np.meshgrid(*self.axes(), indexing="ij"), axis=-1).reshape(-1, 3)
        return np.asarray(p_box @ self.T_base_box[:3, :3].T + self.T_base_box[:3, 3])

    def poses(self) -> Array:
        """T_base_tool, orientations change fastest, shape (x y z o, 4, 4)."""
        points, o = self.points(), len(self.rotations)
        T = np.tile(np.eye(4), (len(points) * o, 1, 1))
        T[:, :3, 3] = np.repeat(points, o, axis=0)
        T[:, :3, :3] = np.tile(self.rotations, (len(points), 1, 1))
        return T
