"""Joint vectors side by side: what fits what, by numpy's own rules of broadcasting."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import mutually_broadcastable_shapes

from dynamics.batch import stack_vectors
from kinematics.errors import InvalidRobotState
from tests.dynamics.samples import random_chain

CHAIN = random_chain(3, 3)
NAMES = ("joints", "velocities", "accelerations")


@given(
    mutually_broadcastable_shapes(num_shapes=3, max_dims=3, min_side=0, max_side=3),
    st.integers(0, 2**31),
)
def test_vectors_stack_as_numpy_broadcasts_them(shapes: tuple[object, ...], seed: int) -> None:
    rng = np.random.default_rng(seed)
    inputs = shapes.input_shapes  # type: ignore[attr-defined]
    vectors = {name: rng.normal(size=(*lead, 3)) for name, lead in zip(NAMES, inputs, strict=True)}
    stack, lead = stack_vectors(CHAIN, **vectors)
    assert lead == shapes.result_shape  # type: ignore[attr-defined]
    expected = np.stack(np.broadcast_arrays(*vectors.values()), axis=-2)
    np.testing.assert_array_equal(stack, expected.reshape(-1, 3, 3))
    assert stack.flags.c_contiguous


@pytest.mark.parametrize("count", [1, 2, 4])
def test_single_vectors_are_a_batch_of_one(count: int) -> None:
    vectors = {f"v{i}": np.full(3, float(i)) for i in range(count)}
    stack, lead = stack_vectors(CHAIN, **vectors)
    assert lead == ()
    np.testing.assert_array_equal(stack[0, :, 0], np.arange(count))


def test_one_vector_serves_a_whole_batch() -> None:
    q = np.arange(12.0).reshape(4, 3)
    stack, lead = stack_vectors(CHAIN, joints=q, velocities=[7.0, 8.0, 9.0])
    assert lead == (4,)
    np.testing.assert_array_equal(stack[:, 0], q)
    np.testing.assert_array_equal(stack[:, 1], [[7.0, 8.0, 9.0]] * 4)


def test_the_stack_is_a_copy() -> None:
    q = np.zeros((2, 3))
    stack, _ = stack_vectors(CHAIN, joints=q)
    stack[:] = 5.0
    assert not q.any()


def test_batches_that_do_not_fit_are_named_with_their_shapes() -> None:
    with pytest.raises(InvalidRobotState, match="batches do not fit") as caught:
        stack_vectors(CHAIN, joints=np.zeros((4, 3)), velocities=np.zeros((2, 3)))
    assert "joints (4, 3), velocities (2, 3)" in caught.value.message
    with pytest.raises(InvalidRobotState, match="do not fit"):
        stack_vectors(CHAIN, a=np.zeros((2, 4, 3)), b=np.zeros((4, 2, 3)))


@pytest.mark.parametrize("name", NAMES)
def test_the_vector_that_is_wrong_is_named(name: str) -> None:
    good = {other: np.zeros((2, 3)) for other in NAMES}
    with pytest.raises(InvalidRobotState, match=f"^{name} has 2 value"):
        stack_vectors(CHAIN, **(good | {name: np.zeros(2)}))
    with pytest.raises(InvalidRobotState, match=f"^{name} is not finite at joint 'joint1'"):
        stack_vectors(CHAIN, **(good | {name: [0.0, np.nan, 0.0]}))
