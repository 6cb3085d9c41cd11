"""Trajectories under dilation, splitting, differentiation; extrema that no sample exceeds."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.polynomial import Polynomial

from kinematics.arrays import Array
from kinematics.trajectory.trajectory import Trajectory, concatenate
from tests.properties import trajectories

ORDERS = st.integers(0, 3)
SHARES = st.floats(0.02, 0.98)


def instants(trajectory: Trajectory) -> Array:
    """Instants inside the pieces, none at a break, where derivatives jump."""
    lengths = np.diff(trajectory.breaks)[:, None]
    return np.asarray((trajectory.breaks[:-1, None] + lengths * np.linspace(0.03, 0.97, 9)).ravel())


def size(trajectory: Trajectory, order: int) -> float:
    """A bound of the derivative of this order over all pieces, from the moduli of its terms."""
    c, h = np.abs(trajectory.coefficients), np.diff(trajectory.breaks)[:, None]
    for _ in range(order):
        c = c[:, :, 1:] * np.arange(1.0, c.shape[2]) if c.shape[2] > 1 else 0.0 * c
    return float((c * h[..., None] ** np.arange(c.shape[2])).sum(axis=2).max()) + 1e-6


@given(trajectories(), ORDERS)
def test_samples_are_those_of_numpys_polynomials(trajectory: Trajectory, order: int) -> None:
    times = instants(trajectory)
    found = trajectory.sample(times, order)
    for row, t in zip(found, times, strict=True):
        i = int(np.searchsorted(trajectory.breaks, t)) - 1
        for j in range(trajectory.n):
            expected = Polynomial(trajectory.coefficients[i, j]).deriv(order)(
                t - trajectory.breaks[i]
            )
            assert row[j] == pytest.approx(expected, rel=1e-9, abs=1e-12 * size(trajectory, order))


@given(trajectories(), ORDERS, ORDERS)
def test_derivatives_of_derivatives_are_derivatives(
    trajectory: Trajectory, first: int, second: int
) -> None:
    times = instants(trajectory)
    found = trajectory.derivative(first).sample(times, second)
    expected = trajectory.sample(times, first + second)
    np.testing.assert_allclose(
        found, expected, rtol=1e-9, atol=1e-12 * size(trajectory, first + second)
    )


@given(trajectories(), st.floats(0.1, 10.0), ORDERS)
def test_dilation_divides_each_derivative_by_its_power(
    trajectory: Trajectory, factor: float, order: int
) -> None:
    times = instants(trajectory)
    slow = trajectory.dilate(factor)
    assert slow.duration == pytest.approx(factor * trajectory.duration, rel=1e-12)
    found = slow.sample(np.minimum(times * factor, slow.duration), order) * factor**order
    expected = trajectory.sample(times, order)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * size(trajectory, order))
    peaks, slower = trajectory.peaks(order).value, slow.peaks(order).value * factor**order
    np.testing.assert_allclose(slower, peaks, rtol=1e-9, atol=1e-11 * size(trajectory, order))


@given(trajectories(), SHARES)
def test_the_parts_of_a_split_play_as_the_whole(trajectory: Trajectory, share: float) -> None:
    time = share * trajectory.duration
    head, tail = trajectory.split(time)
    assert head.duration == pytest.approx(time, rel=1e-15)
    assert head.duration + tail.duration == pytest.approx(trajectory.duration, rel=1e-12)
    whole = concatenate([head, tail])
    times = instants(trajectory)
    times = times[np.abs(times - time) > 1e-9]
    scale = size(trajectory, 0)
    np.testing.assert_allclose(
        whole.sample(times), trajectory.sample(times), rtol=1e-9, atol=1e-12 * scale
    )
    # Where pieces meet these trajectories may jump.
    if np.abs(trajectory.breaks - time).min() > 1e-9 * trajectory.duration:
        assert float(np.abs(tail.start - head.end).max()) < 1e-12 * scale


@given(trajectories(), ORDERS)
def test_no_sample_is_beyond_the_extrema_and_they_are_reached(
    trajectory: Trajectory, order: int
) -> None:
    low, low_time, high, high_time = trajectory.extrema(order)
    rates, hair = trajectory.derivative(order), 1e-12 * size(trajectory, order)
    values = trajectory.sample(instants(trajectory), order)
    assert (values >= low - hair).all()
    assert (values <= high + hair).all()
    for extreme, time in ((low, low_time), (high, high_time)):
        for j in range(trajectory.n):
            # At a break the extreme may belong to the piece that ends there.
            places = np.searchsorted(trajectory.breaks, [time[j] - 1e-9, time[j] + 1e-9]) - 1
            reached = [
                Polynomial(rates.coefficients[i, j])(time[j] - trajectory.breaks[i])
                for i in np.clip(places, 0, trajectory.pieces - 1)
            ]
            assert min(abs(value - extreme[j]) for value in reached) <= 1e-9 * size(
                trajectory, order
            )
    peaks = trajectory.peaks(order).value
    np.testing.assert_allclose(peaks, np.maximum(np.abs(low), np.abs(high)), rtol=1e-12)


@given(trajectories(), ORDERS)
def test_extrema_of_the_whole_are_those_of_its_pieces(trajectory: Trajectory, order: int) -> None:
    low, high = trajectory.piece_extrema(order)
    whole = trajectory.extrema(order)
    hair = 1e-12 * size(trajectory, order)
    np.testing.assert_allclose(low.min(axis=0), whole.minimum, rtol=1e-12, atol=hair)
    np.testing.assert_allclose(high.max(axis=0), whole.maximum, rtol=1e-12, atol=hair)


@given(trajectories(continuous=True))
def test_continuous_motions_have_no_jumps(trajectory: Trajectory) -> None:
    assert trajectory.continuity().position <= 1e-12 * size(trajectory, 0)
