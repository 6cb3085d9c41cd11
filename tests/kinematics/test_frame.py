"""Steps along a chain as products of homogeneous transforms in numpy."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from compiled.kernel import kernel
from kinematics.arrays import Array
from kinematics.frame import (
    IDENTITY,
    at_joint_kernel,
    compose_kernel,
    move_kernel,
    step_kernel,
    store_kernel,
)
from kinematics.model.chain import Chain
from kinematics.pose import rotation_z, transform
from tests.kinematics.samples import random_chain
from tests.properties import transforms

ANGLES = st.floats(-7.0, 7.0)


@kernel
def stepped_kernel(model: Array, row: int, q: float, T: Array) -> None:
    """The frame behind a joint from the identity."""
    store_kernel(step_kernel(model, row, q, IDENTITY), T)


@kernel
def moved_kernel(model: Array, row: int, q: float, c: float, s: float, T: Array) -> None:
    """The same where cosine and sine are known."""
    store_kernel(move_kernel(model, row, q, c, s, IDENTITY), T)


@kernel
def composed_kernel(rows: Array, T: Array) -> None:
    """The product of all frames in an array of rows."""
    B = IDENTITY
    for i in range(rows.shape[0]):
        B = compose_kernel(B, rows, i)
    store_kernel(B, T)


@kernel
def is_at_joint_kernel(rows: Array, i: int) -> bool:
    """Whether a row's frame is the identity."""
    return at_joint_kernel(rows, i)


def rows_of(*frames: Array) -> Array:
    """Frames in rows as ``Chain.model`` has them."""
    rows = np.zeros((len(frames), 14))
    for row, T in zip(rows, frames, strict=True):
        row[1:13] = T[:3].ravel()
    return rows


@given(st.lists(transforms, max_size=3))
def test_composition_is_the_product_of_the_transforms(frames: list[Array]) -> None:
    T, expected = np.full((4, 4), np.nan), np.eye(4)
    for frame in frames:
        expected = expected @ frame
    composed_kernel(rows_of(*frames), T)
    np.testing.assert_allclose(T, expected, atol=1e-13)
    np.testing.assert_array_equal(T[3], [0.0, 0.0, 0.0, 1.0])


@given(transforms, ANGLES, st.booleans())
def test_a_joint_moves_about_or_along_the_z_axis_of_its_own_frame(
    A: Array, q: float, slides: bool
) -> None:
    model = rows_of(A)
    model[0, 0] = float(slides)
    motion = transform(None, [0.0, 0.0, q]) if slides else transform(rotation_z(q))
    T, known = np.full((4, 4), np.nan), np.full((4, 4), np.nan)
    stepped_kernel(model, 0, q, T)
    np.testing.assert_allclose(T, A @ motion, atol=1e-13)
    moved_kernel(model, 0, q, float(np.cos(q)), float(np.sin(q)), known)
    np.testing.assert_allclose(known, T, atol=1e-14)


@given(transforms, ANGLES, ANGLES, st.booleans())
def test_two_motions_of_a_joint_are_one_of_their_sum(
    A: Array, first: float, second: float, slides: bool
) -> None:
    model = rows_of(A, np.eye(4))
    model[:, 0] = float(slides)
    T, ahead, behind = np.empty((3, 4, 4))
    stepped_kernel(model, 0, first + second, T)
    stepped_kernel(model, 0, first, ahead)
    stepped_kernel(model, 1, second, behind)
    np.testing.assert_allclose(ahead @ behind, T, atol=1e-13)


def frame_rows(chain: Chain) -> Array:
    """The rows of the links of a chain."""
    return np.asarray(chain.model[1 + chain.n :])


def test_a_joint_of_the_model_is_read_from_its_row() -> None:
    rng = np.random.default_rng(3)
    for _ in range(10):
        chain = random_chain(rng, 4)
        for i in range(chain.n):
            q, T = float(rng.uniform(-3.0, 3.0)), np.empty((4, 4))
            stepped_kernel(chain.model, 1 + i, q, T)
            slides = chain.joint_types[i] == 1
            M = transform(None, [0.0, 0.0, q]) if slides else transform(rotation_z(q))
            np.testing.assert_allclose(T, chain.offsets[i] @ M, atol=1e-14)


def test_only_the_identity_is_at_the_joint() -> None:
    rows = rows_of(np.eye(4))
    assert is_at_joint_kernel(rows, 0)
    for column in range(1, 13):
        for change in (1e-16, -1e-12, 0.5):
            other = rows.copy()
            other[0, column] += change
            if other[0, column] != rows[0, column]:
                assert not is_at_joint_kernel(other, 0), (column, change)
    assert not is_at_joint_kernel(rows_of(np.diag([-1.0, -1.0, 1.0, 1.0])), 0)


@pytest.mark.parametrize("column", [0, 13])
def test_what_stands_beside_the_frame_in_its_row_does_not_count(column: int) -> None:
    rows = rows_of(np.eye(4))
    rows[0, column] = 5.0
    assert is_at_joint_kernel(rows, 0)
