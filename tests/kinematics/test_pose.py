"""Forms of rotations and poses: conversions, branches of angles and singular cases."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from kinematics import pose
from kinematics.arrays import Array
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
from tests.kinematics.samples import random_rotation

RNG = np.random.default_rng(20)
#: Angles at and around where conversions change branch.
CRITICAL = [
    sign * (base + sign_of_tiny * tiny)
    for base in (0.0, math.pi / 2, math.pi)
    for tiny in (0.0, 1e-16, 1e-12, 1e-9, 1e-7, 1e-4)
    for sign in (1.0, -1.0)
    for sign_of_tiny in (1.0, -1.0)
]


def rotations() -> list[Array]:
    generic = [random_rotation(RNG) for _ in range(300)]
    axes = [*np.eye(3), *RNG.normal(size=(5, 3))]
    critical = [pose.from_axis_angle(axis, angle) for axis in axes for angle in CRITICAL]
    zyz = [pose.from_zyz([RNG.uniform(-3, 3), t, RNG.uniform(-3, 3)]) for t in CRITICAL]
    return generic + critical + zyz


ROTATIONS = rotations()


@pytest.mark.parametrize(
    ("function", "axis"),
    [(pose.rotation_x, "x"), (pose.rotation_y, "y"), (pose.rotation_z, "z")],
)
def test_elementary_rotations(function: "object", axis: str) -> None:
    assert callable(function)
    for angle in [*CRITICAL, *RNG.uniform(-10, 10, 20)]:
        expected = Rotation.from_euler(axis, angle).as_matrix()
        np.testing.assert_allclose(function(angle), expected, atol=1e-15)


def test_skew_is_the_cross_product() -> None:
    for w, v in RNG.normal(size=(50, 2, 3)):
        np.testing.assert_allclose(pose.skew(w) @ v, np.cross(w, v), atol=1e-14)


def test_quaternion_is_scipys() -> None:
    for R in ROTATIONS:
        q = pose.to_quaternion(R)
        expected = Rotation.from_matrix(R).as_quat()
        assert q[3] >= 0.0
        assert np.linalg.norm(q) == pytest.approx(1.0, abs=1e-15)
        assert min(np.abs(q - expected).max(), np.abs(q + expected).max()) < 1e-14


@pytest.mark.parametrize("q", [[0, 0, 0, 0], [0, 0, 0, 1.01], [0, 0, 0, 0.998], [1, 0, 0]])
def test_quaternion_refused(q: list[float]) -> None:
    with pytest.raises(InvalidPose, match="quaternion_xyzw"):
        pose.from_quaternion(q)


def test_not_finite_refused() -> None:
    for bad in (math.nan, math.inf):
        with pytest.raises(InvalidPose):
            pose.from_quaternion([0, 0, bad, 1])
        with pytest.raises(InvalidPose):
            pose.from_matrix(np.diag([1.0, 1.0, bad]))
        for function in (pose.from_rpy, pose.from_zyz, pose.skew, pose.align_z):
            with pytest.raises(InvalidPose):
                function([0, bad, 0])


def test_matrix_is_checked_and_put_right() -> None:
    for R in ROTATIONS[:50]:
        rounded = np.round(R, 7)
        mended = pose.from_matrix(rounded)
        np.testing.assert_allclose(mended.T @ mended, np.eye(3), atol=1e-15)
        np.testing.assert_allclose(mended, R, atol=1e-7)
        with pytest.raises(InvalidPose, match="not a rotation"):
            pose.from_matrix(-R)
        with pytest.raises(InvalidPose, match="not a rotation"):
            pose.from_matrix(1.001 * R)
    with pytest.raises(InvalidPose):
        pose.from_matrix(np.eye(4))


def test_zyz_is_scipys() -> None:
    for angles in RNG.uniform(-4, 4, size=(100, 3)):
        expected = Rotation.from_euler("ZYZ", angles).as_matrix()
        np.testing.assert_allclose(pose.from_zyz(angles), expected, atol=1e-15)


@pytest.mark.parametrize("flip", [False, True])
def test_zyz_round_trip(flip: bool) -> None:
    for R in ROTATIONS:
        angles = pose.to_zyz(R, flip=flip)
        np.testing.assert_allclose(pose.from_zyz(angles), R, atol=2e-12)
        singular = math.hypot(R[0, 2], R[1, 2]) < 1e-12
        low, high = (-math.pi, 0.0) if flip and not singular else (0.0, math.pi)
        assert low <= angles[1] <= high


def test_zyz_keeps_small_theta() -> None:
    for theta in (1e-11, 1e-9, 1e-5, math.pi - 1e-9):
        R = pose.from_zyz([0.4, theta, -1.1])
        assert pose.to_zyz(R)[1] == pytest.approx(theta, rel=1e-5 if theta < 1e-8 else 1e-9)


def test_rpy_is_scipys() -> None:
    for rpy in RNG.uniform(-4, 4, size=(100, 3)):
        expected = Rotation.from_euler("xyz", rpy).as_matrix()
        np.testing.assert_allclose(pose.from_rpy(rpy), expected, atol=1e-15)


def test_axis_angle_is_scipys() -> None:
    for axis in RNG.normal(size=(20, 3)):
        unit = axis / np.linalg.norm(axis)
        for angle in CRITICAL:
            expected = Rotation.from_rotvec(unit * angle).as_matrix()
            np.testing.assert_allclose(pose.from_axis_angle(axis, angle), expected, atol=1e-15)
    with pytest.raises(InvalidPose, match="length 0"):
        pose.from_axis_angle([0, 0, 0], 1.0)


def test_rotation_error_of_tiny_turns() -> None:
    for exponent in range(-15, 0):
        axis, R = random_rotation(RNG)[0], random_rotation(RNG)
        error = pose.rotation_error(R, pose.from_axis_angle(axis, 10.0**exponent) @ R)
        np.testing.assert_allclose(error, axis * 10.0**exponent, atol=1e-15)


@pytest.mark.parametrize("flip", [False, True])
def test_rpy_both_branches(flip: bool) -> None:
    for R in [*ROTATIONS, *(pose.from_rpy([0.3, sign * math.pi / 2, -0.8]) for sign in (-1, 1))]:
        angles = pose.to_rpy(R, flip=flip)
        np.testing.assert_allclose(pose.from_rpy(angles), R, atol=4e-15)
        assert np.isfinite(angles).all()
        if not flip:
            assert abs(angles[1]) <= math.pi / 2 + 1e-15
        x, y, z = angles
        expected = Rotation.from_euler("xyz", [x, y, z]).as_matrix()
        np.testing.assert_allclose(expected, R, atol=4e-15)


def test_axis_and_angle_undo_each_other() -> None:
    for R in ROTATIONS:
        axis, angle = pose.to_axis_angle(R)
        assert np.linalg.norm(axis) == pytest.approx(1.0, abs=1e-15)
        assert 0.0 <= angle <= math.pi
        np.testing.assert_allclose(pose.from_axis_angle(axis, angle), R, atol=2e-15)
    assert pose.to_axis_angle(np.eye(3))[1] == 0.0


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
