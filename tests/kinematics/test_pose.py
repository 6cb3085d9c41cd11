"""Forms of rotations and poses: conversions, groups, singular cases and rounded numbers."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from dynamics.model.payload import inertia
from kinematics import pose
from kinematics.arrays import Array
from kinematics.errors import InvalidOption, InvalidPose, InvalidRobotDescription
from kinematics.model.dh import DhRow, DhTable, chain_from_dh
from kinematics.pose import (
    align_z,
    compose,
    from_axis_angle,
    from_matrix,
    from_quaternion,
    from_rpy,
    from_zyz,
    inverse,
    rotation_error,
    rotation_x,
    rotation_z,
    rpy_branches,
    singular_forms,
    to_quaternion,
    to_quaternions,
    transform,
    zyz_branches,
)
from kinematics.rounding import (
    NORM_TOLERANCE,
    ORTHONORMAL_TOLERANCE,
    rounding,
)
from tests.kinematics.samples import random_rotation
from tests.properties import angles as any_angles
from tests.properties import directions, rotations, transforms

RNG = np.random.default_rng(20)
#: Angles at and around where conversions change branch.
CRITICAL = [
    sign * (base + sign_of_tiny * tiny)
    for base in (0.0, math.pi / 2, math.pi)
    for tiny in (0.0, 1e-16, 1e-12, 1e-9, 1e-7, 1e-4)
    for sign in (1.0, -1.0)
    for sign_of_tiny in (1.0, -1.0)
]


def rotation_samples() -> list[Array]:
    generic = [random_rotation(RNG) for _ in range(300)]
    axes = [*np.eye(3), *RNG.normal(size=(5, 3))]
    critical = [pose.from_axis_angle(axis, angle) for axis in axes for angle in CRITICAL]
    zyz = [pose.from_zyz([RNG.uniform(-3, 3), t, RNG.uniform(-3, 3)]) for t in CRITICAL]
    return generic + critical + zyz


ROTATIONS = rotation_samples()


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


@pytest.mark.parametrize("flip", [False, True])
def test_zyz_round_trip(flip: bool) -> None:
    for R in ROTATIONS:
        angles = pose.to_zyz(R, flip=flip)
        np.testing.assert_allclose(pose.from_zyz(angles), R, atol=2e-12)
        singular = math.hypot(R[0, 2], R[1, 2]) < 1e-12
        low, high = (-math.pi, 0.0) if flip and not singular else (0.0, math.pi)
        assert low <= angles[1] <= high


@pytest.mark.parametrize(("function", "axes"), [(pose.from_zyz, "ZYZ"), (pose.from_rpy, "xyz")])
def test_angles_are_scipys(function: Callable[[Array], Array], axes: str) -> None:
    for angles in RNG.uniform(-4, 4, size=(100, 3)):
        expected = Rotation.from_euler(axes, angles).as_matrix()
        np.testing.assert_allclose(function(angles), expected, atol=1e-15)


def test_zyz_keeps_small_theta() -> None:
    for theta in (1e-11, 1e-9, 1e-5, math.pi - 1e-9):
        R = pose.from_zyz([0.4, theta, -1.1])
        assert pose.to_zyz(R)[1] == pytest.approx(theta, rel=1e-5 if theta < 1e-8 else 1e-9)


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


def close(actual: Array, expected: Array, tolerance: float = 1e-12) -> None:
    np.testing.assert_allclose(actual, expected, rtol=0.0, atol=tolerance)


@given(transforms, transforms, transforms)
def test_rigid_motions_are_a_group(a: Array, b: Array, c: Array) -> None:
    close((a @ b) @ c, a @ (b @ c))
    close(a @ inverse(a), np.eye(4))
    close(inverse(a @ b), inverse(b) @ inverse(a))
    close(inverse(inverse(a)), a)


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


@given(directions, any_angles, any_angles)
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


SEEDS = pytest.mark.parametrize("seed", range(12))


def test_the_rounding_of_numbers_is_half_of_the_last_decimal_that_any_has() -> None:
    assert rounding([0.903, -0.5, 1.0]) == pytest.approx(5e-4)
    assert rounding([0.9027, 0.4, 0.0]) == pytest.approx(5e-5)
    assert rounding([1e-05, 1.0]) == pytest.approx(5e-6)
    assert rounding([1.0, 0.0, -1.0]) == pytest.approx(5e-4)  # never coarser than three decimals
    assert rounding([0.7071, 6.123233995736766e-17]) == pytest.approx(5e-5)  # a computed zero


@SEEDS
@pytest.mark.parametrize("form", ["%.3g", "%.4g", "%.5g", "%.6g", "%.3e", "%.5f", "%.6f"])
@pytest.mark.parametrize("size", [2.0, 0.1, 1e-3])
def test_a_rotation_written_with_few_digits_is_the_nearest_one(
    seed: int, form: str, size: float
) -> None:
    exact = Rotation.from_rotvec(size * np.random.default_rng(seed).normal(size=3)).as_matrix()
    written = np.array([[float(form % x) for x in row] for row in exact])
    taken = from_matrix(written)
    np.testing.assert_allclose(taken, Rotation.from_matrix(written).as_matrix(), atol=1e-14)
    np.testing.assert_allclose(taken, exact, atol=3.0 * 10.0 ** -int(form[2]))


@SEEDS
@pytest.mark.parametrize("form", ["%.3g", "%.4g", "%.5g", "%.3e", "%.4f"])
def test_an_inertia_of_a_plate_or_a_rod_may_be_written_with_few_digits(
    seed: int, form: str
) -> None:
    random = np.random.default_rng(seed)
    a, b = random.uniform(0.01, 1.0, 2)
    R = Rotation.from_rotvec(0.1 * random.normal(size=3)).as_matrix()
    for moments in ([a, b, a + b], [a, a, 0.0]):  # at the ends of what a body can have
        tensor = R @ np.diag(moments) @ R.T
        written = np.array([[float(form % x) for x in row] for row in tensor])
        np.testing.assert_allclose(inertia(1.0, [0, 0, 0], written).tensor, written)
    for moments in ([a, b, 1.03 * (a + b)], [a, a, -0.02 * a]):
        wrong = R @ np.diag(moments) @ R.T
        with pytest.raises(InvalidOption):
            inertia(1.0, [0, 0, 0], [[float(form % x) for x in row] for row in wrong])


@SEEDS
@pytest.mark.parametrize("decimals", [3, 4, 5, 6, 16])
def test_what_is_no_rotation_is_refused_at_any_precision(seed: int, decimals: int) -> None:
    random = np.random.default_rng(seed)
    exact = Rotation.random(random_state=seed).as_matrix()
    unit = 10.0**-decimals
    shear = np.eye(3)
    shear[0, 1 + seed % 2] = max(6.0 * unit, 1e-5)
    for wrong in (
        (1.0 + max(4.0 * unit, 1e-5)) * exact,  # scaled
        exact @ shear,
        exact @ np.diag([1.0, 1.0, -1.0]),  # a reflection
        exact[[1, 0, 2]],  # two rows changed
        random.uniform(-1.0, 1.0, (3, 3)),
    ):
        with pytest.raises(InvalidPose, match="not a rotation"):
            from_matrix(np.round(wrong, decimals))


@SEEDS
def test_single_precision_is_taken(seed: int) -> None:
    exact = Rotation.random(random_state=seed).as_matrix()
    taken = from_matrix(exact.astype(np.float32))
    np.testing.assert_allclose(taken, exact, atol=2e-7)


def test_rotations_are_checked_by_the_same_rules() -> None:
    q = np.array([0.1, -0.2, 0.3, 0.4])
    q /= np.linalg.norm(q)
    for sign in (-1.0, 1.0):
        from_quaternion((1.0 + sign * 0.999 * NORM_TOLERANCE) * q)
        with pytest.raises(InvalidPose, match="norm") as caught:
            from_quaternion((1.0 + sign * 1.001 * NORM_TOLERANCE) * q)
        assert caught.value.details["norm"] == pytest.approx(1.0 + sign * 1.001 * NORM_TOLERANCE)
    R = from_axis_angle([1.0, 2.0, 3.0], 0.5)
    from_matrix(R * np.sqrt(1.0 + 0.999 * ORTHONORMAL_TOLERANCE))
    beyond = R * np.sqrt(1.0 + 1.001 * ORTHONORMAL_TOLERANCE)
    for wrong in (beyond, -R, R * np.nan, R * np.inf, 0.0 * R):
        with pytest.raises(InvalidPose):
            from_matrix(wrong)
    from_axis_angle([0.0, 1e-12, 0.0], 0.5)
    from_axis_angle([0.0, 1e9, 0.0], 0.5)
    for length in (0.0, 0.999e-12, math.nan):
        with pytest.raises(InvalidPose):
            from_axis_angle([0.0, length, 0.0], 0.5)


@SEEDS
@pytest.mark.parametrize("digits", [3, 4, 5])
def test_an_inertia_written_with_few_digits_is_that_of_the_body(seed: int, digits: int) -> None:
    random = np.random.default_rng([seed, digits])
    plate = np.diag([*(moments := random.uniform(0.005, 0.05, 2)), moments.sum()])  # flat: an edge
    turn = Rotation.random(random_state=seed).as_matrix()
    exact = turn @ plate @ turn.T
    decimals = digits - int(np.floor(np.log10(np.abs(exact).max()))) - 1
    written = exact.round(decimals)
    written[0, 1] += 10.0**-decimals if seed % 2 else 0.0  # another program's rounding
    taken = inertia(1.0, np.zeros(3), written.round(decimals))
    assert np.abs(taken.tensor - exact).max() <= 1.01 * 10.0**-decimals
    row = DhRow("revolute", d=0.1, mass=1.0, inertia=written.round(decimals).tolist())
    link = chain_from_dh("arm", DhTable("standard", (row,))).links[1]
    assert link.inertia is not None
    np.testing.assert_array_equal(link.inertia.tensor, taken.tensor)


def test_an_inertia_that_is_askew_by_more_is_refused() -> None:
    for rows in (
        [[5.0, 1.0, 0.0], [2.0, 5.0, 0.0], [0.0, 0.0, 5.0]],
        [[0.02, 0.0012, 0.0], [0.0015, 0.02, 0.0], [0.0, 0.0, 0.02]],
    ):
        with pytest.raises(InvalidOption, match="not symmetric"):
            inertia(1.0, np.zeros(3), rows)
        row = DhRow("revolute", mass=1.0, inertia=rows)
        with pytest.raises(InvalidRobotDescription, match="not symmetric"):
            chain_from_dh("arm", DhTable("standard", (row,)))
