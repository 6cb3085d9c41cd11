"""Branches, singular cases and composition of poses, against scipy."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from kinematics.errors import InvalidPose
from kinematics.pose import (
    compose,
    from_axis_angle,
    from_rpy,
    from_zyz,
    rotation_x,
    rotation_z,
    rpy_branches,
    singular_forms,
    transform,
    zyz_branches,
)


def test_both_branches_are_the_same_rotation() -> None:
    for matrix in Rotation.random(50, random_state=0).as_matrix():
        zyz, rpy = zyz_branches(matrix), rpy_branches(matrix)
        assert (len(zyz), len(rpy)) == (2, 2)
        assert zyz[0, 1] > 0.0 > zyz[1, 1]
        assert np.cos(rpy[0, 1]) > 0.0 > np.cos(rpy[1, 1])
        for angles in zyz:
            built = Rotation.from_euler("ZYZ", angles).as_matrix()
            np.testing.assert_allclose(built, matrix, atol=1e-14)
        for angles in rpy:
            built = Rotation.from_euler("xyz", angles).as_matrix()
            np.testing.assert_allclose(built, matrix, atol=1e-14)
        assert singular_forms(matrix) == ()


@pytest.mark.parametrize(
    ("matrix", "form", "determined", "choice"),
    [
        (rotation_z(0.4), "euler_zyz", "theta = 0: only phi + psi is determined", "psi = 0"),
        (rotation_x(np.pi), "euler_zyz", "theta = pi: only phi - psi is determined", "psi = 0"),
        (from_rpy([0.3, np.pi / 2, 0.5]), "rpy", "pitch = pi/2: only yaw - roll", "roll = 0"),
        (from_rpy([0.3, -np.pi / 2, 0.5]), "rpy", "pitch = -pi/2: only yaw + roll", "roll = 0"),
        (np.eye(3), "axis_angle", "angle = 0: the axis is free", "the axis z"),
        (from_axis_angle([1, 2, 3], np.pi), "axis_angle", "angle = pi: the axis is", "quaternion"),
    ],
)
def test_a_singular_form_is_told_with_the_choice(
    matrix: np.ndarray, form: str, determined: str, choice: str
) -> None:
    case = next(case for case in singular_forms(matrix) if case.form == form)
    assert determined in case.determined
    assert choice in case.choice
    for angles in zyz_branches(matrix) if form == "euler_zyz" else ():
        assert angles[2] == 0.0
        np.testing.assert_allclose(from_zyz(angles), matrix, atol=1e-14)
    for angles in rpy_branches(matrix) if form == "rpy" else ():
        assert angles[0] == 0.0
        np.testing.assert_allclose(from_rpy(angles), matrix, atol=1e-14)


def test_motions_are_composed_about_current_and_fixed_axes() -> None:
    # Of the notes: phi about z, theta about the current y, psi about the current z is zyz; the same
    # about fixed axes in the other order.
    a, b, c = (transform(from_axis_angle(axis, angle)) for axis, angle in
               (([0, 0, 1], 0.3), ([0, 1, 0], 0.7), ([0, 0, 1], -1.1)))  # fmt: skip
    zyz = transform(from_zyz([0.3, 0.7, -1.1]))
    current = compose([(a, "current"), (b, "current"), (c, "current")])
    np.testing.assert_allclose(current[-1], zyz, atol=1e-15)
    np.testing.assert_allclose(current[1], a @ b, atol=1e-15)
    fixed = compose([(c, "fixed"), (b, "fixed"), (a, "fixed")])
    np.testing.assert_allclose(fixed[-1], zyz, atol=1e-15)
    mixed = compose([(b, "current"), (c, "current"), (a, "fixed")])
    np.testing.assert_allclose(mixed[-1], zyz, atol=1e-15)
    with pytest.raises(InvalidPose, match="no motion"):
        compose([])
