"""Directions that a Jacobian loses, beside numpy's singular value decomposition."""

import numpy as np
import pytest

from kinematics.arrays import Array, Indices
from kinematics.ik.closed_form.continuation import joint_direction_kernel, weakest_kernel

ALL: Indices = np.arange(6)


def matrix(rng: np.random.Generator, values: list[float]) -> tuple[Array, Array, Array]:
    """A matrix of singular values with its left and right vectors."""
    U, _ = np.linalg.qr(rng.normal(size=(6, 6)))
    V, _ = np.linalg.qr(rng.normal(size=(6, 6)))
    return np.asarray(U * values @ V.T), U, V


def weakest(
    J: Array, joints: Indices = ALL, across: Array | None = None
) -> tuple[float, Array, Array]:
    """The least singular value and its vectors by the kernel."""
    u, v = np.empty((2, 6))
    value = weakest_kernel(J, joints, u, v, np.zeros(6) if across is None else across)
    return value, u, v


@pytest.mark.parametrize("least", [0.3, 1e-2, 1e-4, 1e-6, 1e-8, 1e-12])
def test_the_least_singular_value_and_its_vectors_are_numpys(least: float) -> None:
    rng = np.random.default_rng(0)
    for _ in range(10):
        J, U, V = matrix(rng, [2.0, 1.5, 1.2, 1.0, 0.8, least])
        value, u, v = weakest(J)
        assert value == pytest.approx(least, rel=2e-2, abs=1e-15)
        assert np.linalg.norm(u) == pytest.approx(1.0)
        assert np.linalg.norm(v) == pytest.approx(1.0)
        near = 1e-6 + (least / 0.8) ** 10
        assert abs(u @ U[:, 5]) == pytest.approx(1.0, abs=near)
        assert abs(v @ V[:, 5]) == pytest.approx(1.0, abs=near)


def test_the_second_weakest_is_found_across_the_weakest() -> None:
    rng = np.random.default_rng(1)
    for second in (0.1, 1e-3, 1e-5):
        J, U, V = matrix(rng, [2.0, 1.5, 1.2, 1.0, second, 1e-3 * second])
        _, u, _ = weakest(J)
        value, w, v = weakest(J, across=u)
        assert value == pytest.approx(second, rel=1e-2)
        assert abs(w @ u) < 1e-12
        assert abs(w @ U[:, 4]) == pytest.approx(1.0, abs=1e-4)
        if second > 1e-6:
            assert abs(v @ V[:, 4]) == pytest.approx(1.0, abs=1e-4)


def test_only_the_columns_of_the_joints_that_move_count() -> None:
    rng = np.random.default_rng(2)
    J, _, _ = matrix(rng, [2.0, 1.5, 1.2, 1.0, 0.8, 1e-3])
    wide = rng.normal(size=(6, 8))
    joints = np.array([7, 0, 3, 1, 6, 4])
    wide[:, joints] = J
    value, u, v = weakest(wide, joints)
    expected = weakest(J)
    assert value == pytest.approx(expected[0], rel=1e-9)
    np.testing.assert_allclose(u, expected[1], atol=1e-9)
    np.testing.assert_allclose(v, expected[2], atol=1e-9)


@pytest.mark.parametrize("least", [1.0, 1e-3])
def test_a_direction_of_the_pose_is_reached_by_its_direction_of_the_joints(least: float) -> None:
    rng = np.random.default_rng(3)
    for _ in range(10):
        J, _, _ = matrix(rng, [2.0, 1.5, 1.2, 1.0, 0.8, least])
        w = rng.normal(size=6)
        expected = np.linalg.solve(J, w)
        found = joint_direction_kernel(J, ALL, w / np.linalg.norm(w))
        np.testing.assert_allclose(found, expected / np.linalg.norm(expected), atol=1e-6)
        np.testing.assert_allclose(found, joint_direction_kernel(J, ALL, 5.0 * w), atol=1e-9)


@pytest.mark.parametrize("least", [1e-5, 1e-8])
def test_along_a_lost_direction_the_joints_move_where_nothing_else_moves(least: float) -> None:
    rng = np.random.default_rng(4)
    J, U, V = matrix(rng, [2.0, 1.5, 1.2, 1.0, 0.8, least])
    for w in (U[:, 5], 0.8 * U[:, 5] + 0.6 * U[:, 4]):
        found = joint_direction_kernel(J, ALL, w.copy())
        assert abs(found @ V[:, 5]) == pytest.approx(1.0, abs=1e-3)


def test_a_jacobian_that_lost_a_row_is_singular_along_it() -> None:
    J, _, _ = matrix(np.random.default_rng(5), [2.0, 1.5, 1.2, 1.0, 0.8, 0.5])
    for row in range(6):
        lost = J.copy()
        lost[row] = 0.0
        value, u, v = weakest(lost)
        assert value < 1e-12
        assert abs(u[row]) == pytest.approx(1.0, abs=1e-9)
        assert np.linalg.norm(lost @ v) < 1e-9
