"""Numbers that describe a rotation, at the exact bounds, and what is no number."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dynamics.model.payload import inertia
from kinematics.errors import InvalidOption, InvalidPose, InvalidRobotDescription
from kinematics.model.dh import DhRow, DhTable, chain_from_dh
from kinematics.pose import from_axis_angle, from_matrix, from_quaternion
from kinematics.rounding import (
    NORM_TOLERANCE,
    ORTHONORMAL_TOLERANCE,
    rounding,
)

SEEDS = pytest.mark.parametrize("seed", range(12))


def test_the_rounding_of_numbers_is_half_of_the_last_decimal_that_any_has() -> None:
    assert rounding([0.903, -0.5, 1.0]) == pytest.approx(5e-4)
    assert rounding([0.9027, 0.4, 0.0]) == pytest.approx(5e-5)
    assert rounding([1e-05, 1.0]) == pytest.approx(5e-6)
    assert rounding([1.0, 0.0, -1.0]) == pytest.approx(5e-4)  # never coarser than three decimals
    assert rounding([0.7071, 6.123233995736766e-17]) == pytest.approx(5e-5)  # a computed zero


@SEEDS
@pytest.mark.parametrize("decimals", [3, 4, 5, 6])
def test_a_rotation_written_with_few_decimals_is_the_nearest_one(seed: int, decimals: int) -> None:
    exact = Rotation.random(random_state=seed).as_matrix()
    written = np.round(exact, decimals)
    taken = from_matrix(written)
    # scipy's own projection: the nearest rotation in the Frobenius norm.
    np.testing.assert_allclose(taken, Rotation.from_matrix(written).as_matrix(), atol=1e-14)
    angle = Rotation.from_matrix(taken.T @ exact).magnitude()
    assert angle <= 3.0 * 0.5 * 10.0**-decimals * np.sqrt(2.0)


@SEEDS
@pytest.mark.parametrize("form", ["%.3g", "%.4g", "%.5g", "%.6g", "%.3e"])
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
