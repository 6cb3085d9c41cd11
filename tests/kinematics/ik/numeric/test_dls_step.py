"""Errors of poses beside scipy's rotation vectors, and damped steps beside scipy's solvers."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from compiled.kernel import kernel
from kinematics.arrays import Array
from kinematics.frame import frame_kernel
from kinematics.ik.numeric.dls_step import error_kernel
from kinematics.pose import transform
from tests.kinematics.samples import random_rotation

ANGLES = [0.0, 1e-12, 1e-8, 1e-4, 0.1, 1.0, 0.5 * np.pi, 2.0, 3.0, np.pi - 1e-3, np.pi - 1e-6]


@kernel
def pose_error_kernel(B: Array, T: Array, out: Array) -> None:
    """The error from B to T, both (4, 4)."""
    out[0], out[1], out[2], out[3], out[4], out[5] = error_kernel(frame_kernel(B), frame_kernel(T))


def error(B: Array, T: Array) -> Array:
    """The error from one pose to another, shape (6,)."""
    out = np.full(6, np.nan)
    pose_error_kernel(B, T, out)
    return out


def pose(rng: np.random.Generator) -> Array:
    """Any pose."""
    return transform(random_rotation(rng), rng.normal(size=3))


@pytest.mark.parametrize("angle", ANGLES)
def test_the_error_is_the_difference_and_scipys_rotation_vector(angle: float) -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        B, axis = pose(rng), rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        shift = rng.normal(size=3)
        turn = Rotation.from_rotvec(angle * axis).as_matrix()
        T = transform(turn @ B[:3, :3], B[:3, 3] + shift)
        found = error(B, T)
        np.testing.assert_allclose(found[:3], shift, atol=1e-14)
        # Near half a turn the axis is known by the square root of the digits.
        tolerance = 1e-13 if angle < 3.0 else 1e-14 / (np.pi - angle) + 1e-12
        np.testing.assert_allclose(found[3:], angle * axis, rtol=0.0, atol=max(tolerance, 1e-15))


@pytest.mark.parametrize("axis", [*np.eye(3), np.ones(3), [1.0, -2.0, 0.5], [0.0, 1.0, -1.0]])
def test_half_a_turn_is_about_its_axis_either_way(axis: Array) -> None:
    unit = np.asarray(axis) / np.linalg.norm(axis)
    B = pose(np.random.default_rng(1))
    T = transform(Rotation.from_rotvec(np.pi * unit).as_matrix() @ B[:3, :3], B[:3, 3])
    found = error(B, T)[3:]
    assert np.linalg.norm(found) == pytest.approx(np.pi, abs=1e-7)
    assert abs(found @ unit) == pytest.approx(np.pi, abs=1e-7)
