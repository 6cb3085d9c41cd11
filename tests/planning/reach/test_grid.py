"""Grids of task poses."""

import numpy as np
import pytest

from kinematics.errors import InvalidOption
from kinematics.pose import rotation_z, transform
from planning.reach.grid import PoseGrid

ONE = np.eye(3)[None]


def test_the_points_span_the_box_at_most_a_spacing_apart() -> None:
    T = transform(rotation_z(np.pi / 2), [1.0, 2.0, 3.0])
    grid = PoseGrid(np.array([0.4, 0.1, 0.0]), 0.15, T, ONE)
    assert grid.shape == (4, 2, 1, 1)
    points = grid.points()
    assert points.min(axis=0) == pytest.approx([0.95, 1.8, 3.0])
    assert points.max(axis=0) == pytest.approx([1.05, 2.2, 3.0])


def test_each_point_has_every_orientation() -> None:
    rotations = np.array([np.eye(3), rotation_z(0.5)])
    grid = PoseGrid(np.array([0.1, 0.0, 0.0]), 0.1, np.eye(4), rotations)
    T = grid.poses()
    assert T.shape == (4, 4, 4)
    assert T[:, 0, 3] == pytest.approx([-0.05, -0.05, 0.05, 0.05])
    assert T[1, :3, :3] == pytest.approx(rotations[1])
    assert T[2, :3, :3] == pytest.approx(rotations[0])


@pytest.mark.parametrize(
    ("size", "spacing", "message"),
    [
        ([1, 1, 1], 0.0, "positive"),
        ([1, -1, 1], 0.1, "negative"),
        ([1, 1, 1], 0.005, "at most 1000000"),
        ([1e6, 1e6, 1e6], 1e-9, "at most"),
    ],
)
def test_grids_without_sense_are_refused(size: list[float], spacing: float, message: str) -> None:
    with pytest.raises(InvalidOption, match=message):
        PoseGrid(np.array(size, dtype=float), spacing, np.eye(4), ONE)
