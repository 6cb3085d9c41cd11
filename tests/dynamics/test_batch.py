"""Joint vectors side by side: what fits what, by numpy's own rules of broadcasting."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import mutually_broadcastable_shapes

from kinematics.errors import InvalidRobotState
from kinematics.model.chain import stack_vectors
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


def test_batches_that_do_not_fit_are_named_with_their_shapes() -> None:
    with pytest.raises(InvalidRobotState, match="batches do not fit") as caught:
        stack_vectors(CHAIN, joints=np.zeros((4, 3)), velocities=np.zeros((2, 3)))
    assert "joints (4, 3), velocities (2, 3)" in caught.value.message
    with pytest.raises(InvalidRobotState, match="do not fit"):
        stack_vectors(CHAIN, a=np.zeros((2, 4, 3)), b=np.zeros((4, 2, 3)))
