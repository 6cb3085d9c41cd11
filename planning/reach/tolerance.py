"""Tolerance of task poses: axes of their own frame along and about which the tool may deviate."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import product
from typing import Literal, get_args

import numpy as np

from kinematics.arrays import Array
from kinematics.errors import InvalidOption

Axis = Literal["x", "y", "z", "rx", "ry", "rz"]
AXES: tuple[Axis, ...] = get_args(Axis)


@dataclass(frozen=True, slots=True)
class Tolerance:
    """Ranges of deviation in a pose's own frame, sampled on a grid.

    The tool's pose is T_pose Trans(x, y, z) Rx(rx) Ry(ry) Rz(rz).

    Args:
        ranges: Least and largest deviation by axis [m, rad]; axes left out are exact. A range of a
            rotation that spans a full turn means a free axis.
        samples: Values tried on each of these axes.

    Raises:
        InvalidOption: A range is empty, a rotation spans more than a turn, or there are too many
            deviations.
    """

    ranges: Mapping[Axis, tuple[float, float]] = field(default_factory=dict)
    samples: int = 12

    def __post_init__(self) -> None:
        for axis, (low, high) in self.ranges.items():
            if not low <= high:
                raise InvalidOption(f"tolerance of {axis}: {low:g} is above {high:g}")
            if axis.startswith("r") and high - low > 2.0 * math.pi + 1e-9:
                raise InvalidOption(
                    f"tolerance of {axis} spans {high - low:g} rad, more than a turn",
                    hint="Name the axis in free where any angle will do.",
                )
        count = math.prod(len(self._values(axis)) for axis in AXES)
        # The most deviations that one pose is tried at.
        max_samples = 1_000
        if count > max_samples:
            raise InvalidOption(
                f"the tolerance has {count} deviations of each pose, at most {max_samples} "
                "are tried",
                hint="Ask for fewer samples, or for fewer axes.",
            )

    @classmethod
    def free(cls, *axes: Axis, samples: int = 12) -> "Tolerance":
        """Rotations about axes by any angle."""
        return cls(dict.fromkeys(axes, (-math.pi, math.pi)), samples)

    def deviations(self) -> Array:
        """T_pose_tool of each deviation, the least first, shape (s, 4, 4)."""
        grid = np.array(list(product(*(self._values(axis) for axis in AXES))))
        grid = grid[np.argsort(np.abs(grid).sum(axis=1), kind="stable")]
        T = np.tile(np.eye(4), (len(grid), 1, 1))
        T[:, :3, 3] = grid[:, :3]
        for column in range(3):
            T[:, :3, :3] = T[:, :3, :3] @ _rotations(column, grid[:, 3 + column])
        return T

    def _values(self, axis: Axis) -> Array:
        low, high = self.ranges.get(axis, (0.0, 0.0))
        if low == high:
            return np.array([low])
        if axis.startswith("r") and high - low > 2.0 * math.pi - 1e-9:
            # Both ends are the same angle; the pose's own is among them.
            return np.asarray(np.arange(self.samples) * 2.0 * np.pi / self.samples)
        return np.linspace(low, high, max(self.samples, 2))


def _rotations(axis: int, angles: Array) -> Array:
    """Rotations about a coordinate axis (0, 1, 2) by angles, shape (s, 3, 3)."""
    c, s = np.cos(angles), np.sin(angles)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    R = np.zeros((len(angles), 3, 3))
    R[:, axis, axis] = 1.0
    R[:, i, i], R[:, j, j], R[:, j, i], R[:, i, j] = c, c, s, -s
    return R
