"""What kernels read of a body's row, beside the chain it was packed from."""

import numpy as np
import pytest

from dynamics.model.body import (
    FRAME,
    FRICTION,
    MASS,
    MOTOR,
    ROW,
    TYPE,
    axis,
    bodies,
    origin,
    times_inertia,
    to_child,
    to_parent,
)
from tests.dynamics.samples import random_chain


@pytest.mark.parametrize("seed", range(6))
def test_rows_hold_joints_as_the_chain_has_them(seed: int) -> None:
    chain = random_chain(seed, 1 + seed, motors=True)
    packed = bodies(chain)
    assert packed.rows.shape == (chain.n + 1, ROW)
    np.testing.assert_array_equal(packed.rows[:-1, TYPE:MASS], chain.model[1 : 1 + chain.n, :MASS])
    np.testing.assert_array_equal(packed.rows[:-1, MOTOR], chain.motor_inertia)
    np.testing.assert_array_equal(packed.rows[:-1, FRICTION], chain.viscous_friction)
    np.testing.assert_array_equal(packed.rows[-1, :3], chain.gravity)
    assert FRAME == TYPE + 1


@pytest.mark.parametrize("seed", range(6))
def test_vectors_change_frames_as_matrices_say(seed: int) -> None:
    chain = random_chain(seed, 3)
    packed = bodies(chain)
    rng = np.random.default_rng(seed)
    for i in range(3):
        row, A = packed.rows[i], chain.offsets[i]
        a, q = rng.normal(size=3), rng.uniform(-3.0, 3.0)
        c, s = np.cos(q), np.sin(q)
        R = A[:3, :3] @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        np.testing.assert_allclose(to_parent(row, c, s, tuple(a)), R @ a, atol=1e-14)
        np.testing.assert_allclose(to_child(row, c, s, tuple(a)), R.T @ a, atol=1e-14)
        assert origin(row) == tuple(A[:3, 3])
        assert axis(row) == tuple(A[:3, 2])
        # About the joint's origin, by the parallel axis theorem.
        m, r = packed.masses[i], packed.centers[i]
        inertia = packed.tensors[i] + m * (r @ r * np.eye(3) - np.outer(r, r))
        np.testing.assert_allclose(times_inertia(row, tuple(a)), inertia @ a, atol=1e-12)
