"""Gains are positive, or they are refused with the reason."""

import numpy as np
import pytest
from numpy.typing import ArrayLike

from kinematics.errors import InvalidOption
from tests.dynamics.samples import random_chain
from tracking.controllers.gain import gain_matrix, gain_vector

CHAIN = random_chain(0, 3)


def test_one_number_serves_all_joints() -> None:
    np.testing.assert_array_equal(gain_vector(CHAIN, "Kp", 4.0), [4.0, 4.0, 4.0])
    np.testing.assert_array_equal(gain_matrix(CHAIN, "Kp", 4.0), 4.0 * np.eye(3))
    np.testing.assert_array_equal(gain_matrix(CHAIN, "Kp", [1, 2, 3]), np.diag([1.0, 2.0, 3.0]))


def test_a_positive_definite_matrix_is_kept() -> None:
    K = np.array([[2.0, 1.0, 0.0], [1.0, 2.0, 0.0], [0.0, 0.0, 1.0]])
    kept = gain_matrix(CHAIN, "K", K)
    np.testing.assert_array_equal(kept, K)
    assert not kept.flags.writeable


@pytest.mark.parametrize(
    ("value", "reason"),
    [
        ([1.0, 2.0], r"shape \(2,\).*3 joints"),
        ([1.0, 0.0, 2.0], "0 at joint 'joint1'"),
        (-1.0, "-1 at joint 'joint0'"),
        (np.nan, "not finite"),
        (["a", "b", "c"], "not an array of numbers"),
        ([[1.0, 2.0], [3.0]], "not an array of numbers"),
    ],
)
def test_wrong_gains_are_refused(value: ArrayLike, reason: str) -> None:
    for check in (gain_vector, gain_matrix):
        with pytest.raises(InvalidOption, match=reason):
            check(CHAIN, "Kd", value)


def test_wrong_matrices_are_refused() -> None:
    with pytest.raises(InvalidOption, match="not symmetric"):
        gain_matrix(CHAIN, "K", np.eye(3) + np.eye(3, k=1))
    with pytest.raises(InvalidOption, match=r"not positive definite.*-1"):
        gain_matrix(CHAIN, "K", np.diag([1.0, -1.0, 2.0]))
    with pytest.raises(InvalidOption, match=r"shape \(3, 3\)"):
        gain_vector(CHAIN, "Kp", np.eye(3))
