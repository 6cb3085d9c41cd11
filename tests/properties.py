"""Values that property tests are drawn from: rotations, rigid motions, trajectories."""

from typing import Any

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from kinematics.arrays import Array
from kinematics.pose import from_axis_angle, transform
from kinematics.trajectory.trajectory import Trajectory

#: Angles with those that conversions find hard [rad].
angles = st.one_of(
    st.sampled_from([0.0, 1e-12, 1e-8, 1e-4, 0.5 * np.pi, np.pi - 1e-8, np.pi, -np.pi]),
    st.floats(-np.pi, np.pi),
)


def _no_tiny(x: float) -> float:
    return 0.0 if abs(x) < 1e-9 else x


def numbers(shape: int | tuple[int, ...], size: float = 1.0) -> st.SearchStrategy[Array]:
    """Arrays of numbers from -size to size, tiny ones left out."""
    return arrays(np.float64, shape, elements=st.floats(-size, size).map(_no_tiny))


def _unit(v: Array) -> Array:
    length = float(np.linalg.norm(v))
    return v / length if length > 1e-3 else np.array([0.0, 0.0, 1.0])


#: Unit vectors, shape (3,).
directions = numbers(3).map(_unit)
#: Rotation matrices, shape (3, 3).
rotations = st.builds(from_axis_angle, directions, angles)
#: Rigid motions, shape (4, 4).
transforms = st.builds(transform, rotations, numbers(3, 2.0))


@st.composite
def trajectories(draw: Any, continuous: bool = False) -> Trajectory:
    """Of one to three joints, one to four pieces and a degree of at most six."""
    n, pieces = draw(st.integers(1, 3)), draw(st.integers(1, 4))
    size = draw(st.integers(2, 7))
    lengths = draw(arrays(np.float64, pieces, elements=st.floats(0.05, 2.0)))
    coefficients = draw(numbers((pieces, n, size), 3.0))
    if continuous:
        for i in range(1, pieces):
            powers = lengths[i - 1] ** np.arange(size)
            coefficients[i, :, 0] = coefficients[i - 1] @ powers
    names = tuple("abc"[:n])
    return Trajectory(names, np.concatenate([[0.0], np.cumsum(lengths)]), coefficients)
