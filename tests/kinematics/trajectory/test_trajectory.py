"""Trajectories as values: samples, exact extrema, continuity, cutting and joining."""

import pickle
from collections.abc import Callable

import numpy as np
import pytest
from numpy.polynomial import polynomial as power_basis
from numpy.typing import ArrayLike, NDArray

from kinematics.errors import InvalidOption, InvalidTrajectory
from kinematics.trajectory.trajectory import (
    MAX_DEGREE,
    MAX_SAMPLES,
    REST,
    Trajectory,
    concatenate,
    stay,
)

Array = NDArray[np.float64]


def names(n: int) -> tuple[str, ...]:
    return tuple(f"joint{i}" for i in range(n))


def random_trajectory(rng: np.random.Generator, m: int, n: int, k: int) -> Trajectory:
    breaks = np.concatenate([[0.0], np.cumsum(rng.uniform(0.02, 0.5, m))])
    return Trajectory(names(n), breaks, rng.normal(size=(m, n, k)))


def reference_range(c: Array, h: float, order: int) -> tuple[float, float]:
    """Range of a derivative on [0, h] by numpy's companion matrix, complex roots included.

    The real parts of all roots are candidates: what a nearly double root loses in its real part
    costs nothing in the value, and a candidate too many does no harm.
    """
    p = power_basis.polyder(c, order) if order < len(c) else np.zeros(1)
    inner = np.trim_zeros(power_basis.polyder(p), "b") if len(p) > 1 else np.zeros(0)
    roots = power_basis.polyroots(inner).real if len(inner) > 1 else np.zeros(0)
    candidates = np.concatenate([[0.0, h], roots[(roots > 0.0) & (roots < h)]])
    values = power_basis.polyval(candidates, p)
    return float(values.min()), float(values.max())


def made(joint_names: tuple[str, ...], breaks: ArrayLike, coefficients: ArrayLike) -> Trajectory:
    return Trajectory(joint_names, np.asarray(breaks), np.asarray(coefficients))


def piece(c: ArrayLike, h: float) -> Trajectory:
    return made(("joint",), [0.0, h], np.asarray(c, dtype=float)[None, None])


@pytest.mark.parametrize("degree", [0, 1, 2, 3, 4, 5, 7, 10])
def test_extrema_agree_with_numpys_roots(degree: int) -> None:
    rng = np.random.default_rng(degree)
    trajectory = random_trajectory(rng, 60, 5, degree + 1)
    for order in range(4):
        lower, upper = trajectory.piece_extrema(order)
        scale = np.abs(upper - lower).max() + np.abs(upper).max() + 1.0
        for i in range(trajectory.pieces):
            h = float(np.diff(trajectory.breaks)[i])
            for j in range(trajectory.n):
                low, high = reference_range(trajectory.coefficients[i, j], h, order)
                assert lower[i, j] == pytest.approx(low, abs=1e-12 * scale)
                assert upper[i, j] == pytest.approx(high, abs=1e-12 * scale)
        found = trajectory.extrema(order)
        np.testing.assert_allclose(found.minimum, lower.min(axis=0), atol=1e-13 * scale)
        np.testing.assert_allclose(found.maximum, upper.max(axis=0), atol=1e-13 * scale)


@pytest.mark.parametrize(
    ("c", "h"),
    [
        ([2.0], 1.0),
        ([0.0], 1.0),
        ([1.0, 2.0, 0.0, 0.0, 0.0], 3.0),
        ([0.0, 0.0, 0.0, 0.0, 1.0], 2.0),
        ([1e-300, 0.0, 1e-300], 1.0),
        ([1e150, -3e150, 1e150, 2e150], 2.0),
        ([1.0, -1.0, 1e-18, 1e-30], 5.0),
        ([0.0, 1.0, -1e6], 1e-6),
        ([0.0, 1e-9, -1e-12], 1e4),
        (list(power_basis.polyfromroots([0.5] * 5)), 1.0),
        (list(power_basis.polyfromroots([0.25, 0.25, 0.75, 0.75])), 1.0),
        (list(power_basis.polyfromroots([0.5, 0.5 + 1e-9, 0.5 - 1e-9])), 1.0),
        (list(power_basis.polyfromroots([0.0, 0.0, 1.0, 1.0])), 1.0),
        ([0.0, 0.0, 1.0, -2.0, 1.0], 2.0),
    ],
)
def test_extrema_of_degenerate_pieces(c: list[float], h: float) -> None:
    trajectory = piece(np.array(c), h)
    for order in range(4):
        low, high = reference_range(np.array(c), h, order)
        found = trajectory.extrema(order)
        size = max(abs(low), abs(high))
        assert found.minimum[0] == pytest.approx(low, rel=1e-12, abs=1e-12 * size)
        assert found.maximum[0] == pytest.approx(high, rel=1e-12, abs=1e-12 * size)
        dense = trajectory.sample(np.linspace(0.0, h, 10_001), order)
        assert dense.max() <= found.maximum[0] + 1e-13 * size
        assert dense.min() >= found.minimum[0] - 1e-13 * size


def test_extrema_of_thousands_of_pieces_with_chosen_stationary_points() -> None:
    rng = np.random.default_rng(3)
    for _ in range(3000):
        degree = int(rng.integers(1, 6))
        # Roots of the derivative within, at the ends of, beyond and upon each other.
        stationary = rng.choice([0.0, 1.0, 0.5, *rng.uniform(-0.5, 1.5, 4)], size=degree)
        derivative = power_basis.polyfromroots(stationary) * rng.choice([-1.0, 1.0])
        h = float(10.0 ** rng.uniform(-4, 3))
        scale = 10.0 ** rng.uniform(-8, 8)
        unit = power_basis.polyint(derivative) * scale
        inside = [0.0, 1.0, *stationary[(stationary > 0.0) & (stationary < 1.0)]]
        values = power_basis.polyval(np.array(inside), unit)
        found = piece(unit / h ** np.arange(len(unit)), h).extrema()
        size = float(np.abs(unit).max())
        assert found.minimum[0] == pytest.approx(values.min(), abs=2e-15 * 8 * size)
        assert found.maximum[0] == pytest.approx(values.max(), abs=2e-15 * 8 * size)


def test_ends_are_sampled_and_times_beyond_them_refused() -> None:
    trajectory = made(
        ("a", "b"), [0.0, 0.1, 0.3], [[[0.0, 1.0], [1.0, 0.0]], [[0.1, 2.0], [1.0, 0.0]]]
    )
    np.testing.assert_array_equal(trajectory.start, [0.0, 1.0])
    np.testing.assert_allclose(trajectory.end, [0.5, 1.0], atol=1e-16)
    assert trajectory.sample([0.1], 1)[0, 0] == 2.0
    for times in ([-1e-6], [0.300001], [np.nan], [[0.0]]):
        with pytest.raises(InvalidOption, match="outside"):
            trajectory.sample(times)
    with pytest.raises(InvalidOption, match="order -1"):
        trajectory.sample([0.0], -1)


def test_jumps_are_found() -> None:
    pieces = [[[0.0, 1.0, 2.0]], [[1.0 + 1e-3, 3.25, 1.0]]]
    trajectory = made(("a",), [0.0, 0.5, 1.5], pieces)
    position, velocity, acceleration = trajectory.continuity()
    assert position == pytest.approx(1e-3, rel=1e-9)
    assert velocity == pytest.approx(0.25)
    assert acceleration == pytest.approx(2.0)
    assert piece(np.array([1.0, 2.0]), 1.0).continuity() == (0.0, 0.0, 0.0)


def test_reversing_runs_the_same_motion_backwards() -> None:
    trajectory = random_trajectory(np.random.default_rng(11), 6, 3, 5)
    back = trajectory.reverse()
    assert back.duration == trajectory.duration
    times = np.linspace(0.0, trajectory.duration, 301)
    times = times[np.abs(times[:, None] - trajectory.breaks).min(axis=1) > 1e-9]
    for order in range(4):
        expected = (-1.0) ** order * trajectory.sample(times, order)
        actual = back.sample(trajectory.duration - times, order)
        np.testing.assert_allclose(actual, expected, rtol=1e-9, atol=1e-9)


def test_concatenation_pads_degrees_and_refuses_other_joints() -> None:
    first = piece(np.array([0.0, 1.0]), 1.0)
    second = piece(np.array([1.0, 1.0, 3.0]), 2.0)
    joined = concatenate([first, second])
    assert joined.degree == 2
    assert joined.continuity().position == 0.0
    with pytest.raises(InvalidTrajectory, match="different joints"):
        concatenate([first, made(("other",), [0.0, 1.0], [[[0.0]]])])
    with pytest.raises(InvalidTrajectory):
        concatenate([])


@pytest.mark.parametrize("period", [0.01, 0.1, 0.3, 1.0 / 3.0, 0.7, 5.0])
@pytest.mark.parametrize("duration", [0.3, 1.0, 0.1 * 3, 2.1, 1e-6])
def test_uniform_samples_ascend_and_end_exactly(period: float, duration: float) -> None:
    times = piece(np.zeros(1), duration).uniform_samples(period)
    steps = np.diff(times)
    assert times[0] == 0.0
    assert times[-1] == duration
    assert (steps > 0.0).all()
    assert (steps <= period * (1.0 + 1e-5)).all()
    assert np.allclose(steps[:-1], period)


def test_sample_periods_are_checked() -> None:
    trajectory = piece(np.zeros(1), 1.0)
    for bad in (0.0, -1.0, np.nan, np.inf, 0.5 / MAX_SAMPLES):
        with pytest.raises(InvalidOption):
            trajectory.uniform_samples(bad)


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: made((), [0, 1], np.zeros((1, 0, 1))), "names"),
        (lambda: made(("a", "a"), [0, 1], np.zeros((1, 2, 1))), "distinct"),
        (lambda: made(("a",), [0], np.zeros((0, 1, 1))), "at least one piece"),
        (lambda: made(("a",), [1, 2], np.zeros((1, 1, 1))), "start at 1"),
        (lambda: made(("a",), [0, 1, 1], np.zeros((2, 1, 1))), "after break 1"),
        (lambda: made(("a",), [0, np.nan], np.zeros((1, 1, 1))), "finite"),
        (lambda: made(("a",), [0, 1], [[[np.inf]]]), "finite"),
        (lambda: made(("a",), [0, 1], np.zeros((2, 1, 1))), "do not fit"),
        (lambda: made(("a",), [0, 1], np.zeros((1, 2, 1))), "do not fit"),
        (lambda: made(("a",), [0, 1], np.zeros((1, 1, 0))), "do not fit"),
        (lambda: made(("a",), [0, 1], np.zeros((1, 1))), "do not fit"),
        (lambda: made(("a",), [0, 1], np.zeros((1, 1, 40))), "degree 39"),
        (lambda: made(("a",), [0, 1], [[["x"]]]), "not an array of numbers"),
    ],
)
def test_malformed_trajectories_are_refused(make: Callable[[], Trajectory], match: str) -> None:
    with pytest.raises(InvalidTrajectory, match=match):
        make()


def test_a_trajectory_is_a_value() -> None:
    trajectory = random_trajectory(np.random.default_rng(2), 3, 2, 4)
    again = pickle.loads(pickle.dumps(trajectory))
    assert again == trajectory
    assert hash(again) == hash(trajectory)
    assert trajectory != trajectory.dilate(1.5)
    assert Trajectory(("x", "y"), trajectory.breaks, trajectory.coefficients) != trajectory
    with pytest.raises(ValueError, match="read-only"):
        trajectory.breaks[0] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        trajectory.coefficients[0, 0, 0] = 1.0


def test_keeping_still_is_a_trajectory() -> None:
    still = stay(names(3), [0.1, -0.2, 0.3])
    assert still.duration == REST
    np.testing.assert_array_equal(still.start, [0.1, -0.2, 0.3])
    np.testing.assert_array_equal(still.end, still.start)
    assert not still.peaks(1).value.any()
    for position, duration in (([0.1], 1.0), ([0.1, 0.2, np.nan], 1.0), ([0.0] * 3, 0.0)):
        with pytest.raises(InvalidTrajectory):
            stay(names(3), position, duration)


def test_the_highest_degree_is_taken_and_the_next_refused() -> None:
    c = np.zeros(MAX_DEGREE + 1)
    c[-1] = 1.0
    assert piece(c, 1.0).end[0] == 1.0
    with pytest.raises(InvalidTrajectory, match=f"degree {MAX_DEGREE + 1}"):
        piece(np.append(c, 1.0), 1.0)
