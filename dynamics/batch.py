"""Batches of joint vectors: checked, broadcast against each other and laid side by side."""

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from kinematics.arrays import Array
from kinematics.errors import InvalidRobotState
from kinematics.model.chain import Chain


def stack_vectors(chain: Chain, **vectors: ArrayLike) -> tuple[Array, tuple[int, ...]]:
    """Check joint vectors, each (n,) or (..., n), and stack them.

    Returns:
        Shape (m, k, n) for the k vectors in their order and m the size of the batch, and the
        leading dimensions of the batch.

    Raises:
        InvalidRobotState: A vector has the wrong length, is not finite or fits no other's batch.
    """
    checked = [chain.configuration(value, name) for name, value in vectors.items()]
    lead = checked[0].shape[:-1]
    if any(value.shape[:-1] != lead for value in checked):
        lead = _common_lead(vectors, checked)
    stack = np.empty((*lead, len(checked), chain.n))
    for i, value in enumerate(checked):
        stack[..., i, :] = value
    return stack.reshape(-1, len(checked), chain.n), lead


def _common_lead(names: Iterable[str], arrays: Sequence[Array]) -> tuple[int, ...]:
    try:
        return np.broadcast_shapes(*(array.shape[:-1] for array in arrays))
    except ValueError:
        shapes = ", ".join(
            f"{name} {array.shape}" for name, array in zip(names, arrays, strict=True)
        )
        raise InvalidRobotState(
            f"the batches do not fit each other: {shapes}",
            hint="Give every one the same leading dimensions, or a single vector.",
        ) from None
