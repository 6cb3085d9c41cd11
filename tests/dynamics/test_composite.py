"""Frames that the dynamics kernels read, beside forward kinematics."""

import numpy as np
import pytest

from dynamics.kernels.composite import COMPOSITE_WORK, frames_kernel
from dynamics.model.body import bodies
from kinematics.forward import joint_frames
from tests.dynamics.samples import random_chain


@pytest.mark.parametrize("n", [1, 2, 7, 8, 9])
def test_frames_are_those_of_kinematics_from_the_last_origin(n: int) -> None:
    chain = random_chain(n, n)
    rows, work = bodies(chain).rows, np.zeros((n, COMPOSITE_WORK))
    for q in np.random.default_rng(n).uniform(-3.0, 3.0, (20, n)):
        frames_kernel(rows, q, work)
        expected = joint_frames(chain, q)[:, :3]
        expected[:, :, 3] -= expected[-1, :, 3].copy()
        np.testing.assert_allclose(work[:, :12].reshape(n, 3, 4), expected, atol=1e-13)


def test_joint_values_need_not_lie_side_by_side() -> None:
    chain = random_chain(3, 6)
    rows = bodies(chain).rows
    values = np.random.default_rng(0).uniform(-3.0, 3.0, (6, 5))
    work, expected = np.zeros((2, 6, COMPOSITE_WORK))
    frames_kernel(rows, values[:, 2], work)
    frames_kernel(rows, values[:, 2].copy(), expected)
    np.testing.assert_allclose(work, expected, atol=1e-14)


def test_angles_of_many_turns_keep_their_digits() -> None:
    chain = random_chain(4, 5)
    rows, work = bodies(chain).rows, np.zeros((5, COMPOSITE_WORK))
    q = np.array([1e7, -3e6, 0.1, 2e8, 1.0]) * (chain.joint_types == 0)
    frames_kernel(rows, q, work)
    expected = joint_frames(chain, q)[:, :3, :3]
    np.testing.assert_allclose(work[:, :12].reshape(5, 3, 4)[:, :, :3], expected, atol=1e-13)
