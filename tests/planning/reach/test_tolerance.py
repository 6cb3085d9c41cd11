"""Deviations of task poses against rotations of scipy."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from kinematics.errors import InvalidOption
from planning.reach.tolerance import Axis, Tolerance


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
