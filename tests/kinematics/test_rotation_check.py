"""Checks of rotations refuse what is none, on the numbers that numpy computes as well."""

import math

import numpy as np
import pytest

from kinematics.errors import InvalidPose
from kinematics.rotation_check import (
    check_axis_length,
    check_orthonormal,
    check_quaternion_norm,
)


@pytest.mark.parametrize("norm", [1.0, 1.0 + 0.999e-3, 1.0 - 0.999e-3])
def test_a_norm_near_one_passes(norm: float) -> None:
    check_quaternion_norm(norm)


@pytest.mark.parametrize("norm", [0.0, 1.0 + 1.001e-3, 1.0 - 1.001e-3, 2.0, math.inf])
def test_another_norm_is_refused(norm: float) -> None:
    with pytest.raises(InvalidPose, match="has norm") as error:
        check_quaternion_norm(norm)
    assert error.value.details["norm"] == norm


def test_a_matrix_is_refused_that_is_not_orthonormal_or_is_a_reflection() -> None:
    check_orthonormal(0.99e-6, 1.0)
    for error, determinant in ((1.01e-6, 1.0), (0.0, -1.0)):
        with pytest.raises(InvalidPose, match="no rotation"):
            check_orthonormal(error, determinant)


def test_an_axis_without_length_is_refused() -> None:
    check_axis_length(1.01e-12)
    with pytest.raises(InvalidPose, match="length 0"):
        check_axis_length(float(np.finfo(float).tiny))
