"""Grids of task poses."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from kinematics.errors import InvalidOption
from kinematics.pose import rotation_z, transform
from planning.reach.grid import PoseGrid
from planning.reach.tolerance import Axis, Tolerance

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


def test_no_tolerance_is_the_pose_itself() -> None:
    assert Tolerance().deviations() == pytest.approx(np.eye(4)[None])


def test_deviations_are_translations_and_rotations_in_the_poses_frame() -> None:
    tolerance = Tolerance({"x": (-0.1, 0.1), "rx": (0.2, 0.2), "rz": (-0.3, 0.3)}, samples=3)
    T = tolerance.deviations()
    assert len(T) == 9
    expected = {
        (x, z): (Rotation.from_rotvec([0.2, 0, 0]) * Rotation.from_rotvec([0, 0, z])).as_matrix()
        for x in (-0.1, 0.0, 0.1)
        for z in (-0.3, 0.0, 0.3)
    }
    for (x, _), R in expected.items():
        assert any(np.allclose(D[:3, :3], R) and np.allclose(D[:3, 3], [x, 0, 0]) for D in T)
    # The least deviation is tried first.
    assert T[0, :3, 3] == pytest.approx([0.0, 0.0, 0.0])


def test_a_free_axis_has_each_angle_once() -> None:
    T = Tolerance.free("rz", samples=8).deviations()
    angles = Rotation.from_matrix(T[:, :3, :3]).as_rotvec()[:, 2]
    assert np.sort(np.remainder(angles, 2 * np.pi)) == pytest.approx(np.arange(8) * np.pi / 4)


@pytest.mark.parametrize(
    ("ranges", "samples", "message"),
    [
        ({"x": (0.1, -0.1)}, 4, "above"),
        ({"rz": (-4.0, 4.0)}, 4, "more than a turn"),
        ({"x": (0, 1), "y": (0, 1), "rz": (0, 1)}, 12, "1728 deviations"),
    ],
)
def test_contradictions_are_refused(
    ranges: dict[Axis, tuple[float, float]], samples: int, message: str
) -> None:
    with pytest.raises(InvalidOption, match=message):
        Tolerance(ranges, samples)
