"""Rotations and rigid motions as groups, and conversions that lose nothing."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from kinematics.arrays import Array
from kinematics.pose import (
    align_z,
    from_axis_angle,
    from_matrix,
    from_quaternion,
    from_rpy,
    from_zyz,
    inverse,
    rotation_error,
    to_axis_angle,
    to_quaternion,
    to_quaternions,
    to_rpy,
    to_zyz,
)
from tests.properties import angles, directions, rotations, transforms


def close(actual: Array, expected: Array, tolerance: float = 1e-12) -> None:
    np.testing.assert_allclose(actual, expected, rtol=0.0, atol=tolerance)


@given(transforms, transforms, transforms)
def test_rigid_motions_are_a_group(a: Array, b: Array, c: Array) -> None:
    close((a @ b) @ c, a @ (b @ c))
    close(a @ inverse(a), np.eye(4))
    close(inverse(a @ b), inverse(b) @ inverse(a))
    close(inverse(inverse(a)), a)


@given(rotations)
def test_rotations_keep_lengths_and_hands(R: Array) -> None:
    close(R.T @ R, np.eye(3))
    assert abs(np.linalg.det(R) - 1.0) < 1e-12


@given(rotations)
def test_conversions_come_back(R: Array) -> None:
    close(from_quaternion(to_quaternion(R)), R)
    close(from_axis_angle(*to_axis_angle(R)), R)
    # A sine below 1e-12 counts as 0, which turns the axis by twice as much at most.
    for flip in (False, True):
        close(from_zyz(to_zyz(R, flip=flip)), R, 3e-12)
        close(from_rpy(to_rpy(R, flip=flip)), R, 3e-12)


@given(st.lists(rotations, min_size=1, max_size=4))
def test_many_quaternions_are_those_of_each(Rs: list[Array]) -> None:
    each = np.array([to_quaternion(R) for R in Rs])
    close(to_quaternions(np.array(Rs)), each)


@given(rotations, rotations)
def test_the_error_leads_to_the_target_the_shorter_way(R: Array, target: Array) -> None:
    error = rotation_error(R, target)
    angle = float(np.linalg.norm(error))
    assert angle <= np.pi + 1e-12
    led = from_axis_angle(error, angle) @ R if angle > 1e-11 else R
    close(led, target, 1e-11)


@given(directions, angles, angles)
def test_turns_about_one_axis_add_up(axis: Array, first: float, second: float) -> None:
    both = from_axis_angle(axis, first) @ from_axis_angle(axis, second)
    close(both, from_axis_angle(axis, first + second))
    close(both @ axis, axis)


@given(directions)
def test_z_is_aligned_by_a_rotation(axis: Array) -> None:
    R = align_z(axis)
    close(R[:, 2], axis)
    close(R.T @ R, np.eye(3))
    assert np.linalg.det(R) > 0.0


def test_a_matrix_that_was_put_right_stays_as_it_is() -> None:
    rng = np.random.default_rng(0)
    exact = Rotation.random(2000, random_state=1).as_matrix()
    for R in exact + 1e-7 * rng.uniform(-1.0, 1.0, exact.shape):
        once = from_matrix(R)
        assert np.array_equal(from_matrix(once), once)
