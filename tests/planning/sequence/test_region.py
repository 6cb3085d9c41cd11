"""Regions of grasps and places against scipy's rotations."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import armwright as aw
from kinematics.errors import InvalidOption
from planning.sequence.target import grasp_region, place_region


def test_grasps_turn_about_the_axis_and_move_along_it() -> None:
    base = aw.pose([0.03, 0.01, 0.02])
    axis = (1.0, 2.0, 2.0)
    grips = grasp_region(base, axis, (-0.5, 1.0), (0.0, 0.06), (4, 3))
    assert grips.shape == (12, 4, 4)
    unit = np.array(axis) / 3.0
    for k, T in enumerate(grips):
        angle = -0.5 + 0.5 * (k % 4)
        R = Rotation.from_rotvec(angle * unit).as_matrix()
        np.testing.assert_allclose(T[:3, :3], R, atol=1e-12)
        at = R @ base[:3, 3] + 0.03 * (k // 4) * unit
        np.testing.assert_allclose(T[:3, 3], at, atol=1e-12)


def test_a_whole_turn_has_no_angle_twice() -> None:
    grips = grasp_region(np.eye(4), (0, 0, 1), (0.0, 2.0 * np.pi), samples=(8, 1))
    angles = Rotation.from_matrix(grips[:, :3, :3]).as_euler("zyx")[:, 0] % (2.0 * np.pi)
    np.testing.assert_allclose(np.sort(angles), np.arange(8) * np.pi / 4.0, atol=1e-12)


def test_places_lie_on_the_rectangle_the_middle_first() -> None:
    base = aw.pose([0.5, 0.2, 0.3])
    poses = place_region(base, (0.2, 0.4), (0.0, 0.0), (3, 3, 1))
    offsets = poses[:, :3, 3] - base[:3, 3]
    assert np.array_equal(offsets[0], np.zeros(3))
    assert {tuple(np.round(row, 12)) for row in offsets} == {
        (x, y, 0.0) for x in (-0.1, 0.0, 0.1) for y in (-0.2, 0.0, 0.2)
    }


@pytest.mark.parametrize(
    ("axis", "angles", "samples"),
    [((0, 0, 0), (0, 1), (2, 1)), ((0, 0, 1), (1, 0), (2, 1)), ((0, 0, 1), (0, 1), (0, 1))],
)
def test_empty_regions_are_refused(
    axis: tuple[int, ...], angles: tuple[int, int], samples: tuple[int, int]
) -> None:
    with pytest.raises(InvalidOption):
        grasp_region(np.eye(4), axis, angles, samples=samples)
