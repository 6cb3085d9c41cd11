"""Sampling against SciPy's piecewise polynomials."""

import numpy as np
import pytest
from scipy.interpolate import PPoly

from armwright_client import InvalidArgument, Samples, Segment, Trajectory


def random_trajectory(seed: int) -> tuple[Trajectory, PPoly]:
    random = np.random.default_rng(seed)
    pieces, joints, powers = random.integers(1, 8), random.integers(1, 8), random.integers(1, 7)
    breaks = np.cumsum(random.uniform(1e-3, 2.0, pieces + 1)) - random.uniform(0.0, 2.0)
    coefficients = random.normal(size=(pieces, joints, powers))
    segments = [
        Segment.of(t0=float(t0), t1=float(t1), coefficients=rows)
        for t0, t1, rows in zip(breaks[:-1], breaks[1:], coefficients, strict=True)
    ]
    # SciPy wants the highest power first, shape (powers, pieces, joints).
    expected = PPoly(np.moveaxis(coefficients[:, :, ::-1], 2, 0), breaks)
    return Trajectory(segments=segments), expected


@pytest.mark.parametrize("seed", range(40))
def test_samples_are_those_of_the_polynomials(seed: int) -> None:
    trajectory, expected = random_trajectory(seed)
    random = np.random.default_rng(seed)
    inner = random.uniform(expected.x[0], expected.x[-1], 50)
    times = np.concatenate([inner, expected.x])
    for derivative in range(5):
        sampled = trajectory.sample(times, derivative)
        np.testing.assert_allclose(sampled, expected(times, derivative), rtol=1e-11, atol=1e-11)


def test_samples_are_plain_numbers() -> None:
    trajectory, _ = random_trajectory(3)
    assert trajectory.segments is not None
    row = trajectory.sample((trajectory.segments[0].t0,))[0]
    assert all(type(value) is float for value in row)


def test_times_may_miss_the_ends_by_rounding() -> None:
    trajectory = Trajectory(segments=[Segment(t0=0, t1=0.3, coefficients=[[0, 1]])])
    assert trajectory.sample([0.1 + 0.2]) == [[0.3]]
    for outside in (-1e-6, 0.3001, float("nan")):
        with pytest.raises(InvalidArgument, match="outside the motion"):
            trajectory.sample([outside])


def test_what_can_not_be_sampled_is_refused() -> None:
    points = Trajectory(samples=Samples(time=[0, 1], position=[[0], [1]]), interpolation="linear")
    with pytest.raises(InvalidArgument, match="samples only"):
        points.sample([0.5])
    with pytest.raises(InvalidArgument, match="order -1"):
        Trajectory(segments=[Segment(t0=0, t1=1, coefficients=[[0]])]).sample([0.5], -1)
