"""Numbers that describe a rotation, at the exact bounds, and what is no number."""

import math

import numpy as np
import pytest

from kinematics.errors import InvalidPose
from kinematics.pose import from_axis_angle, from_matrix, from_quaternion
from kinematics.rotation_check import (
    NORM_TOLERANCE,
    ORTHONORMAL_TOLERANCE,
    check_axis_length,
    check_orthonormal,
    check_quaternion_norm,
)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_quaternion_may_miss_its_norm_by_the_tolerance(sign: float) -> None:
    check_quaternion_norm(1.0 + sign * 0.999 * NORM_TOLERANCE)
    with pytest.raises(InvalidPose, match="norm") as caught:
        check_quaternion_norm(1.0 + sign * 1.001 * NORM_TOLERANCE)
    assert caught.value.details["norm"] == 1.0 + sign * 1.001 * NORM_TOLERANCE


@pytest.mark.parametrize("norm", [0.0, -1.0, 2.0, math.inf, math.nan])
def test_other_norms_are_refused(norm: float) -> None:
    with pytest.raises(InvalidPose):
        check_quaternion_norm(norm)


def test_a_matrix_may_miss_orthonormality_by_the_tolerance() -> None:
    check_orthonormal(0.0, 1.0)
    check_orthonormal(ORTHONORMAL_TOLERANCE, 1.0)
    for error in (1.001 * ORTHONORMAL_TOLERANCE, 1.0, math.inf, math.nan):
        with pytest.raises(InvalidPose, match="not a rotation"):
            check_orthonormal(error, 1.0)


@pytest.mark.parametrize("determinant", [-1.0, 0.0, math.nan])
def test_a_matrix_that_mirrors_or_flattens_is_refused(determinant: float) -> None:
    with pytest.raises(InvalidPose, match="det R"):
        check_orthonormal(0.0, determinant)


def test_an_axis_has_a_length() -> None:
    check_axis_length(1e-12)
    check_axis_length(1e9)
    for length in (0.0, 0.999e-12, math.nan):
        with pytest.raises(InvalidPose, match="direction"):
            check_axis_length(length)


def test_rotations_are_checked_by_the_same_rules() -> None:
    q = np.array([0.1, -0.2, 0.3, 0.4])
    q /= np.linalg.norm(q)
    from_quaternion((1.0 + 0.9 * NORM_TOLERANCE) * q)
    with pytest.raises(InvalidPose):
        from_quaternion((1.0 + 1.1 * NORM_TOLERANCE) * q)
    R = from_axis_angle([1.0, 2.0, 3.0], 0.5)
    from_matrix(R * (1.0 + 0.4 * ORTHONORMAL_TOLERANCE))
    for wrong in (R * (1.0 + 0.6 * ORTHONORMAL_TOLERANCE), -R, R * np.nan):
        with pytest.raises(InvalidPose):
            from_matrix(wrong)
    with pytest.raises(InvalidPose):
        from_axis_angle([0.0, 1e-13, 0.0], 0.5)
